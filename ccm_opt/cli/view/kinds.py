"""Which frames, scene and handles belong to a plan: those of the plane, or those of space."""

from collections.abc import Callable
from typing import Any, TypeAlias

import viser

from ccm_opt.cli.view.frames import MotionFrames
from ccm_opt.cli.view.handle_frame import PlaneHandles, SpaceHandles
from ccm_opt.cli.view.handles import Handles
from ccm_opt.cli.view.scene import Scene
from ccm_opt.cli.view.space_frames import SpaceFrames
from ccm_opt.cli.view.space_scene import SpaceScene
from ccm_opt.cli.view.view_settings import VIEW, ViewSettings
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.driver.live_plan_in_space import LivePlanInSpace
from ccm_opt.solution import JointStates, JointTrajectory
from ccm_opt.space.problem import AnyProblem, SpaceProblem

AnyFrames: TypeAlias = MotionFrames | SpaceFrames
"""The poses of a motion."""
AnyLivePlan: TypeAlias = LivePlan | LivePlanInSpace
"""A plan that follows drags."""


def frames_of(
    problem: AnyProblem, trajectory: JointTrajectory, joints: JointStates, settings: ViewSettings = VIEW
) -> AnyFrames:
    """The poses of a motion of a problem of either kind."""
    if isinstance(problem, SpaceProblem):
        return SpaceFrames(problem, trajectory, joints, settings)
    return MotionFrames(problem, trajectory, joints, settings)


def scene_of(server: viser.ViserServer, frames: AnyFrames, settings: ViewSettings) -> Scene | SpaceScene:
    """The scene that shows a motion."""
    if isinstance(frames, SpaceFrames):
        return SpaceScene(server, frames, settings)
    return Scene(server, frames, settings)


def handles_of(
    scene: Scene | SpaceScene, live: AnyLivePlan | None, told: Callable[[Any, LiveAnswer | str], None]
) -> Handles | None:
    """Handles on what can be dragged; None where nothing can."""
    if live is None:
        return None
    return Handles(scene, live, SpaceHandles() if isinstance(scene, SpaceScene) else PlaneHandles(), told)
