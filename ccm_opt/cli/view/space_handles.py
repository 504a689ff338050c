"""A handle on the goal of a plan in space: where it is dragged to is planned again."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.cli.view.meshes import turned_to
from ccm_opt.cli.view.replanner import Replanner
from ccm_opt.cli.view.space_scene import SpaceScene
from ccm_opt.driver.live_plan import LiveAnswer
from ccm_opt.driver.live_plan_in_space import LivePlanInSpace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.problem import SpaceTipGoal


class SpaceHandles:
    """The handle on the goal, which turns too where a direction is asked for.

    Args:
        scene: where it stands.
        live: the plan that follows.
        told: called with the plan and what came of a change, or what was wrong with it.
    """

    def __init__(
        self, scene: SpaceScene, live: LivePlanInSpace, told: Callable[[LivePlanInSpace, LiveAnswer | str], None]
    ) -> None:
        self._scene = scene
        self._live = live
        self._replanner = Replanner(live, lambda answer: told(live, answer), scene.settings)
        self._replanner.start()
        goal = live.problem.goal
        if isinstance(goal, SpaceTipGoal):
            self._put_on(goal)

    def end(self) -> None:
        """Plan nothing more."""
        self._replanner.end()

    def _put_on(self, goal: SpaceTipGoal) -> None:
        along = np.array([1.0, 0.0, 0.0]) if goal.direction is None else goal.direction
        handle = self._scene.server.scene.add_transform_controls(
            "/handle",
            scale=0.2,
            disable_rotations=goal.direction is None,
            depth_test=False,
            position=goal.position / self._scene.unit,
            wxyz=turned_to(along),
        )

        def dragged(_: Any) -> None:
            place = np.asarray(handle.position, dtype=np.float64) * self._scene.unit
            direction = None if goal.direction is None else direction_of(np.asarray(handle.wxyz))
            self._replanner.ask(lambda: self._live.move_goal(place, direction))

        handle.on_update(dragged)


def direction_of(wxyz: FloatArray) -> FloatArray:
    """Where a quaternion (w, x, y, z) turns world x to, shape (3,)."""
    w, x, y, z = wxyz
    return np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
