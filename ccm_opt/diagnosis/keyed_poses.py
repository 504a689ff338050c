"""Goals and poses with their keys."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, Problem, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm

GoalT = TypeVar("GoalT")


@dataclass(frozen=True)
class KeyedGoal(Generic[GoalT]):
    """A goal, whatever it is for.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        goal: where the arm, or its tip, has to be.
        tolerances: how near counts.
    """

    name: str
    key: str
    goal: GoalT
    tolerances: Tolerances


TipPlace: TypeAlias = KeyedGoal[TipGoal]
"""A goal for the tip alone."""


def keyed_goals(problem: Problem) -> Iterator[KeyedGoal[Goal]]:
    """Yield all goals in order."""
    goals = (*problem.stops, Stop(problem.goal, problem.tolerances))
    for k, stop in enumerate(goals):
        several = len(goals) > 1
        name = f"goal {k + 1} of {len(goals)}" if several else "the goal"
        yield KeyedGoal(name, f"goal[{k}]" if several else "goal", stop.goal, stop.tolerances)


def tip_goal(problem: Problem) -> TipGoal | None:
    """Return the last goal of a problem where it is for the tip; None where it is for the whole arm."""
    return problem.goal.for_tip


def tip_places(problem: Problem) -> Iterator[TipPlace]:
    """Yield every goal for the tip alone."""
    for asked in keyed_goals(problem):
        if asked.goal.for_tip:
            yield KeyedGoal(asked.name, f"{asked.key}.position", asked.goal.for_tip, asked.tolerances)


@dataclass(frozen=True)
class WholePose:
    """A pose of the whole arm.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        q: configuration, shape (c,) [rad, m].
        bend_play: by how much each bend may miss it [rad]; infinite where the pose is a curve, on which other mappings
            may lay the joints elsewhere.
        base_play: by how much the base may miss its position on the axis [m].
    """

    name: str
    key: str
    q: FloatArray
    bend_play: float = 0.0
    base_play: float = 0.0

    def turn_play(self, arm: Arm) -> FloatArray:
        """Angle by which each link may be turned from where it is in the pose at most, shape (links,) [rad]."""
        # A link is turned by all bends before it; the angles of turns add up at most.
        bends = arm.coordinates.bends_a_joint * np.arange(1.0, arm.links + 1.0)
        return np.asarray(np.minimum(self.bend_play * bends, np.pi))

    def link_play(self, arm: Arm) -> FloatArray:
        """Return the farthest that any point of each link may lie from where it is in the pose, shape (links,) [m]."""
        # The end of link j adds up what the turns of all links up to it do; a turn moves a direction by its chord.
        chords = 2.0 * np.sin(0.5 * self.turn_play(arm))
        return np.asarray(self.base_play + arm.link_length * np.cumsum(chords))


def whole_poses(problem: Problem) -> Iterator[WholePose]:
    """Yield the start, then every goal that says where all links are."""
    arm = problem.arm
    yield WholePose("the start", "start", problem.start.configuration(arm))
    for asked in keyed_goals(problem):
        pose = asked.goal.for_joints
        if pose:
            play = asked.tolerances.heading if pose.curve is None else np.inf
            yield WholePose(asked.name, asked.key, pose.configuration(arm), play, asked.tolerances.position)
