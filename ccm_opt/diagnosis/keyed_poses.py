"""Goals and poses with their keys, in the plane and in space."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal, Tolerances
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.arm import Arm

GoalT_co = TypeVar("GoalT_co", covariant=True)


class GoalOnTheWay(Protocol[GoalT_co]):
    """A goal at which the motion rests."""

    @property
    def goal(self) -> GoalT_co:
        """Where the arm stops."""

    @property
    def tolerances(self) -> Tolerances:
        """How near the goal counts."""


class ProblemOfGoals(Protocol[GoalT_co]):
    """The goals of a problem."""

    @property
    def stops(self) -> Sequence[GoalOnTheWay[GoalT_co]]:
        """Goals on the way, in order."""

    @property
    def goal(self) -> GoalT_co:
        """The last."""

    @property
    def tolerances(self) -> Tolerances:
        """How near the last counts."""


@dataclass(frozen=True)
class KeyedGoal(Generic[GoalT_co]):
    """A goal, whatever it is for.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        goal: where the arm, or its tip, has to be.
        tolerances: how near counts.
    """

    name: str
    key: str
    goal: GoalT_co
    tolerances: Tolerances


def keyed_goals(problem: ProblemOfGoals[GoalT_co]) -> Iterator[KeyedGoal[GoalT_co]]:
    """All goals in order."""
    for k, stop in enumerate(problem.stops):
        yield KeyedGoal(f"goal {k + 1} of {len(problem.stops) + 1}", f"goal[{k}]", stop.goal, stop.tolerances)
    number = len(problem.stops)
    name, key = (f"goal {number + 1} of {number + 1}", f"goal[{number}]") if number else ("the goal", "goal")
    yield KeyedGoal(name, key, problem.goal, problem.tolerances)


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
            play = asked.tolerances.heading if asked.goal.curve is None else np.inf
            pose = _whole(problem, asked.name, asked.key, asked.goal)
            yield replace(pose, bend_play=play, base_play=asked.tolerances.position)


def tip_places(problem: Problem) -> Iterator[TipPlace]:
    """Every goal for the tip alone."""
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, TipGoal):
            yield KeyedGoal(asked.name, f"{asked.key}.position", asked.goal, asked.tolerances)


def _whole(problem: Problem, name: str, key: str, pose: JointPose) -> WholePose:
    return WholePose(name, key, pose.headings(problem.arm), pose.feed)


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

    def turn_play(self, arm: Arm) -> FloatArray:
        """Angle by which each link may be turned from where it is in the pose at most, shape (links,) [rad]."""
        # A link is turned by all bends before it, two at each joint; the angles of turns add up at most.
        return np.asarray(np.minimum(2.0 * self.bend_play * np.arange(1.0, arm.links + 1.0), np.pi))

    def link_play(self, arm: Arm) -> FloatArray:
        """Farthest that any point of each link may lie from where it is in the pose, shape (links,) [m]."""
        # The end of link j adds up what the turns of all links up to it do; a turn moves a direction by its chord.
        chords = 2.0 * np.sin(0.5 * self.turn_play(arm))
        return np.asarray(self.base_play + arm.link_length * np.cumsum(chords))


SpaceTipPlace: TypeAlias = KeyedGoal[TipGoal]
"""A goal for the tip."""


def whole_space_poses(problem: SpaceProblem) -> Iterator[WholeSpacePose]:
    """The start, then every goal that says where all links are."""
    arm = problem.arm
    yield WholeSpacePose("the start", "start", problem.start.configuration(arm))
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, JointPose):
            q = asked.goal.configuration(arm)
            yield WholeSpacePose(asked.name, asked.key, q, asked.tolerances.heading, asked.tolerances.position)


def space_tip_places(problem: SpaceProblem) -> Iterator[SpaceTipPlace]:
    """Every goal for the tip alone."""
    for asked in keyed_goals(problem):
        if isinstance(asked.goal, TipGoal):
            yield KeyedGoal(asked.name, f"{asked.key}.position", asked.goal, asked.tolerances)
