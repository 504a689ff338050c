"""The order in which a motion visits goals that may be visited in any order, and the goals that it leaves out."""

from dataclasses import dataclass, replace

from ccm_opt.problem.definition import Problem
from ccm_opt.problem.poses import Stop, Tolerances, name_suffix


@dataclass(frozen=True)
class UnvisitedGoal:
    """A goal that a tour does not visit.

    Attributes:
        goal: number of the goal in the problem, from 1.
        status: "infeasible" if it is proved that the goal cannot be reached, else "not found" or "timed-out".
        reason: reason why no motion to the goal was found.
    """

    goal: int
    status: str
    reason: str


@dataclass(frozen=True)
class Tour:
    """Order in which a motion visits the goals of a problem with ``planner.order = "free"``.

    Attributes:
        posed: the problem, with its goals in the given order.
        order: numbers of the goals in the problem, from 1, in the order of the visits.
        left_out: the other goals, with reasons.
        duration: sum of the durations of the motions from goal to goal, without pauses [s].
        bound: lower bound on this sum for every order of the motions that were found between the goals [s]; 0 if none
            is known, as for goals that were planned for one after the other.
        as_given: this sum for the order of the problem, over the motions found [s].
        views: goals found for what the problem has to see, of which ``order`` has the numbers; empty if the goals are
            the problem's own.
        fewest: lower bound on the number of views among those considered; 0 without views.
        unseen: why parts of the surfaces are seen from none of these, each with its share, in words.
    """

    posed: Problem
    order: tuple[int, ...]
    left_out: tuple[UnvisitedGoal, ...] = ()
    duration: float = 0.0
    bound: float = 0.0
    as_given: float = 0.0
    views: tuple[Stop, ...] = ()
    fewest: int = 0
    unseen: tuple[str, ...] = ()

    @property
    def excess(self) -> float:
        """Largest fraction by which the duration exceeds that of the best order."""
        return max(self.duration / self.bound - 1.0, 0.0) if self.bound > 0.0 else 0.0

    @property
    def in_given_order(self) -> bool:
        """Whether the goals are visited in the order of the problem."""
        return self.order == tuple(sorted(self.order))

    def goal_title(self, number: int) -> str:
        """Return how messages name a goal of the problem, from 1, which has its name and that it is counted so."""
        return f"goal {number} of the file{name_suffix(self.posed.numbered_goals[number - 1].goal)}"

    def lasting(self, duration: float) -> "Tour":
        """Return the tour with another duration of the same motions [s]."""
        as_given = duration if self.in_given_order else max(self.as_given, duration)
        return replace(self, duration=duration, bound=min(self.bound, duration), as_given=as_given)

    @property
    def visited(self) -> Problem:
        """Problem of the goals that are visited, in the order of the visits, and of the way back if there is one."""
        posed = self.posed
        goals = self.views or posed.numbered_goals
        stops = [goals[number - 1] for number in self.order]
        if posed.planner.end == "start":
            stops.append(Stop(posed.start, Tolerances()))
        *before, last = stops
        return replace(
            posed,
            stops=tuple(before),
            goal=last.goal,
            tolerances=last.tolerances,
            pause=last.pause,
            planner=replace(posed.planner, order="given", end="free"),
            source="",
        )
