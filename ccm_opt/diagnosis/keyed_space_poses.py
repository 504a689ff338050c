"""The ends of a problem in space as the checks see them: whole-arm poses and goals of the tip, each with its key."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.diagnosis.keyed_poses import KeyedGoal, keyed_goals
from ccm_opt.problem.space_problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.robot.space_arm import SpaceArm


@dataclass(frozen=True)
class WholeSpacePose:
    """A pose of the whole arm.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        q: configuration, shape (c,) [rad, m].
        bend_play: by how much each of the two bends of every joint may miss it [rad].
        base_play: by how much the base may miss its position on the axis [m].
    """

    name: str
    key: str
    q: FloatArray
    bend_play: float = 0.0
    base_play: float = 0.0

    def turn_play(self, arm: SpaceArm) -> FloatArray:
        """Angle by which each link may be turned from where it is in the pose at most, shape (links,) [rad]."""
        # A link is turned by all bends before it, two at each joint; the angles of turns add up at most.
        return np.asarray(np.minimum(2.0 * self.bend_play * np.arange(1.0, arm.links + 1.0), np.pi))

    def link_play(self, arm: SpaceArm) -> FloatArray:
        """Farthest that any point of each link may lie from where it is in the pose, shape (links,) [m]."""
        # The end of link j adds up what the turns of all links up to it do; a turn moves a direction by its chord.
        chords = 2.0 * np.sin(0.5 * self.turn_play(arm))
        return np.asarray(self.base_play + arm.link_length * np.cumsum(chords))


SpaceTipPlace: TypeAlias = KeyedGoal[SpaceTipGoal]
"""A goal for the tip."""


def whole_space_poses(problem: SpaceProblem) -> Iterator[WholeSpacePose]:
    """The start, then every goal that says where all links are."""
    arm = problem.arm
    yield WholeSpacePose("the start", "start", problem.start.configuration(arm))
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, SpaceJointPose):
            q = asked.goal.configuration(arm)
            yield WholeSpacePose(asked.name, asked.key, q, asked.tolerances.heading, asked.tolerances.position)


def space_tip_places(problem: SpaceProblem) -> Iterator[SpaceTipPlace]:
    """Every goal for the tip alone."""
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, SpaceTipGoal):
            yield KeyedGoal(asked.name, f"{asked.key}.position", asked.goal, asked.tolerances)
