"""The goals of a problem with the keys by which its file knows them, in the plane and in space."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ccm_opt.problem import Tolerances

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
