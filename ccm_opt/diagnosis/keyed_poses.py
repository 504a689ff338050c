"""The ends of a problem as the checks see them: whole-arm poses and goals of the tip, each with its key."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal, Tolerances


@dataclass(frozen=True)
class WholePose:
    """A pose of the whole arm.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        headings: of the links, shape (links,) [rad].
        feed: position of the base on its feed axis [m].
        bend_play: by how much every joint may miss it [rad]; infinite where the pose is a curve, on which other
            mappings may lay the joints elsewhere.
        base_play: by how much the base may miss its position on the axis [m].
    """

    name: str
    key: str
    headings: FloatArray
    feed: float
    bend_play: float = 0.0
    base_play: float = 0.0

    def link_play(self, arm: Arm) -> FloatArray:
        """Farthest that any point of each link may lie from where it is in the pose, shape (links,) [m]."""
        # The heading of link j is the sum of j bends; its end adds up the ends of all links before it.
        turns = self.bend_play * np.arange(1.0, arm.links + 1.0)
        reach: FloatArray = self.base_play + arm.link_length * np.cumsum(np.minimum(turns, 2.0))
        return reach


@dataclass(frozen=True)
class TipPlace:
    """A goal for the tip.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        goal: where the tip has to be.
        tolerances: how near counts.
    """

    name: str
    key: str
    goal: TipGoal
    tolerances: Tolerances


def whole_poses(problem: Problem) -> Iterator[WholePose]:
    """The start, then every goal that says where all links are."""
    yield _whole(problem, "start", "start", problem.start)
    for name, key, goal, tolerances in _goals(problem):
        if not isinstance(goal, TipGoal):
            play = tolerances.heading if isinstance(goal, JointPose) else np.inf
            yield replace(_whole(problem, name, key, goal), bend_play=play, base_play=tolerances.position)


def tip_places(problem: Problem) -> Iterator[TipPlace]:
    """Every goal for the tip alone."""
    for name, key, goal, tolerances in _goals(problem):
        if isinstance(goal, TipGoal):
            yield TipPlace(name, f"{key}.position", goal, tolerances)


def _goals(problem: Problem) -> Iterator[tuple[str, str, TipGoal | JointPose | CurvePose, Tolerances]]:
    for k, stop in enumerate(problem.stops):
        yield f"stop {k + 1}", f"goal[{k}]", stop.goal, stop.tolerances
    last = f"goal[{len(problem.stops)}]" if problem.stops else "goal"
    yield "goal", last, problem.goal, problem.tolerances


def _whole(problem: Problem, name: str, key: str, pose: JointPose | CurvePose) -> WholePose:
    if isinstance(pose, JointPose):
        headings = problem.arm.headings(pose.bends)
    else:
        headings = map_curve(problem.arm, pose.configuration, problem.planner.mapping)
    return WholePose(name, key, headings, pose.feed)
