"""The ends of a problem as the checks see them: whole-arm poses and goals of the tip, each with its key."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ccm_opt.diagnosis.keyed_goals import KeyedGoal, keyed_goals
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal


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


TipPlace: TypeAlias = KeyedGoal[TipGoal]
"""A goal for the tip."""


def whole_poses(problem: Problem) -> Iterator[WholePose]:
    """The start, then every goal that says where all links are."""
    yield _whole(problem, "the start", "start", problem.start)
    for asked in keyed_goals(problem):
        if not isinstance(asked.goal, TipGoal):
            play = asked.tolerances.heading if isinstance(asked.goal, JointPose) else np.inf
            pose = _whole(problem, asked.name, asked.key, asked.goal)
            yield replace(pose, bend_play=play, base_play=asked.tolerances.position)


def tip_places(problem: Problem) -> Iterator[TipPlace]:
    """Every goal for the tip alone."""
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, TipGoal):
            yield KeyedGoal(asked.name, f"{asked.key}.position", asked.goal, asked.tolerances)


def _whole(problem: Problem, name: str, key: str, pose: JointPose | CurvePose) -> WholePose:
    if isinstance(pose, JointPose):
        headings = problem.arm.headings(pose.bends)
    else:
        headings = map_curve(problem.arm, pose.configuration, problem.planner.mapping)
    return WholePose(name, key, headings, pose.feed)
