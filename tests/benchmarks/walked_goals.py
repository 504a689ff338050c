"""Goals that are known to be reachable: where a certified walk through a field has led the tip.

From the start the tip is led towards places drawn at random, one after the other, as far as the arm comes; what it
went through is certified, so that a way to the last pose exists for sure. The polygons stay as they are. The walk uses
the planner's own steps and its simplest guide, but no search: it says nothing of how long the way back would take.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import path_length
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search_run import PlanarRun, stack_configurations, tip_led
from ccm_opt.planning.tip_paths import TipPath
from ccm_opt.problem import TipGoal
from tests.scenes import Scene, motion_task

NEAREST = 0.35
"""From the base at which places are drawn, at least, as a share of the arm's length."""
FARTHEST = 0.95
"""At most, likewise."""


@dataclass(frozen=True)
class Walk:
    """How far and how often a walk is led.

    Attributes:
        enough: distance of the last pose's tip from the first's at which a walk ends, as a share of the arm's length.
        least: of the farthest pose's, below which the walk led nowhere, likewise; links as long as the gaps between
            polygons are wide hardly let an arm move.
        legs: places that the tip is led towards, at most.
        paths: of the tip that are tried for each.
        margin: planning margin, in nominal links; none that the search tries, which would only repeat the walk.
    """

    enough: float = 0.5
    least: float = 0.2
    legs: int = 8
    paths: int = 2
    margin: float = 0.018


def walked(scene: Scene, rng: np.random.Generator, walk: Walk = Walk()) -> Scene | None:
    """The scene with a goal pose that a certified walk from its start has reached; None where none comes far."""
    begin = scene.arm.joint_positions(scene.start)[-1]
    poses = [scene.start]
    distances = [0.0]
    while len(poses) <= walk.legs and distances[-1] < walk.enough * scene.arm.length:
        poses.append(_after_leg(replace(scene, start=poses[-1]), rng, walk))
        tip = scene.arm.joint_positions(poses[-1])[-1]
        distances.append(float(np.linalg.norm(tip - begin)))
    farthest = int(np.argmax(distances))
    return replace(scene, goal=poses[farthest]) if distances[farthest] >= walk.least * scene.arm.length else None


def _after_leg(scene: Scene, rng: np.random.Generator, walk: Walk) -> FloatArray:
    """The pose that the arm comes to on the way to a place drawn at random; the start where it cannot move."""
    try:
        task = motion_task(scene.problem(_drawn_goal(scene, rng)))
        run = PlanarRun.from_task(task, walk.margin)
    except NoPlanFound:
        return scene.start  # no way of the tip leads there
    ways = [_certified_part(run, path) for path in task.tip_paths[: walk.paths]]
    farthest = max(ways, key=lambda way: path_length(np.array([pose.points[-1] for pose in way])), default=[run.start])
    return task.arm.headings(farthest[-1].q)


def _drawn_goal(scene: Scene, rng: np.random.Generator) -> TipGoal:
    angle = rng.uniform(-np.pi, np.pi)
    distance = scene.arm.length * rng.uniform(NEAREST, FARTHEST)
    return TipGoal(scene.arm.base + distance * np.array([np.cos(angle), np.sin(angle)]), heading=angle)


def _certified_part(run: PlanarRun, path: TipPath) -> list[Pose]:
    """Poses that follow the tip along a path as far as it goes, and as far as the motion is certified."""
    guide = tip_led(run.stepper, path).make_guide()
    try:
        poses = follow(run.stepper, guide, run.start, run.task.deadline)
    except Stalled as stalled:
        poses = stalled.poses
    refused = run.task.certificate.failures(stack_configurations(poses)) if len(poses) > 1 else []
    return poses[: int(refused[0]) + 1] if len(refused) else poses
