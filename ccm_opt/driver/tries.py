"""Several tries with other seeds, side by side."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from ccm_opt.core.deadline import Deadline
from ccm_opt.driver.verified_motion import VerifiedPlan
from ccm_opt.errors import CancelledWithPlan, NoPlanFound, UnreachableGoal, VerificationError
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import TryRecord
from ccm_opt.solution.space_solution import AnySolution


@dataclass(frozen=True)
class TriesSettings:
    """Which of several plans for one problem is the best.

    Attributes:
        room_share: share of the gap that the roomiest try keeps, as far as it is wanted, that a try must keep to be
            taken. Taste, like the share of the wanted gap below which a record calls a motion short of room.
    """

    room_share: float = 0.9


DEFAULT_TRIES = TriesSettings()
"""Used where no other settings are given."""


PlannedProblem = TypeVar("PlannedProblem", Problem, SpaceProblem)
"""A problem in the plane, or one in space."""


def best_of_tries(
    problem: PlannedProblem,
    attempt: Callable[[PlannedProblem], VerifiedPlan],
    as_it_stands: Callable[[VerifiedPlan], AnySolution],
    settings: TriesSettings = DEFAULT_TRIES,
) -> VerifiedPlan:
    """The best plan of as many tries as the problem asks for, each with the next seed and an equal share of the time.

    A seed gives the same plan as long as no try runs out of its share of the time.

    Args:
        problem: what to solve.
        attempt: plans, times and verifies a problem.
        as_it_stands: makes a solution of a plan, for Ctrl-C.
        settings: which try is the best.

    Raises:
        NoPlanFound: no try found a plan; what the first of them said.
        VerificationError: likewise, when the verifier refused its plan.
        CancelledWithPlan: on Ctrl-C once a try has found a plan, with the best.
    """
    asked = problem.planner.tries
    if asked == 1:
        return attempt(problem)
    deadline = Deadline.after(problem.planner.time_limit)
    tries = _Tries(problem, settings.room_share)
    try:
        for number in range(asked):
            if number > 0 and deadline.passed():
                break
            seed = problem.planner.seed + number
            options = replace(problem.planner, seed=seed, time_limit=deadline.left / (asked - number))
            tries.make(attempt, replace(problem, planner=options))
    except KeyboardInterrupt as interrupt:
        if not tries.plans:
            raise
        raise CancelledWithPlan(as_it_stands(tries.best())) from interrupt
    return tries.best()


def least_gap(plan: VerifiedPlan) -> float:
    """The least gap beyond the clearance that the verifier saw between any two bodies [m]."""
    return min(check.worst - check.limit for check in plan.checks if check.name in {"wall clearance", "self-collision"})


@dataclass
class _Tries(Generic[PlannedProblem]):
    """The tries so far.

    Attributes:
        problem: what is solved.
        room_share: share of the roomiest plan's gap that the best must keep.
        plans: found so far, by seed.
        failures: of the other tries, by seed.
    """

    problem: PlannedProblem
    room_share: float
    plans: dict[int, VerifiedPlan] = field(default_factory=dict)
    failures: dict[int, NoPlanFound | VerificationError] = field(default_factory=dict)

    def make(self, attempt: Callable[[PlannedProblem], VerifiedPlan], tried: PlannedProblem) -> None:
        """One more.

        Raises:
            UnreachableGoal: which no other seed would mend.
        """
        try:
            self.plans[tried.planner.seed] = attempt(tried)
        except UnreachableGoal:
            raise
        except (NoPlanFound, VerificationError) as failure:
            self.failures[tried.planner.seed] = failure

    def best(self) -> VerifiedPlan:
        """The shortest of the plans that keep nearly as much of the wanted gap as any, with the record of all tries.

        Raises:
            NoPlanFound: there is none; what the first try said.
            VerificationError: likewise, when the verifier refused its plan.
        """
        if not self.plans:
            raise next(iter(self.failures.values()))
        gaps = {seed: min(least_gap(plan), self.problem.wanted_gap) for seed, plan in self.plans.items()}
        most = max(gaps.values())
        roomy = [seed for seed, gap in gaps.items() if gap >= min(self.room_share * most, most)]
        taken = min(roomy, key=lambda seed: self.plans[seed].trajectory.duration)
        found: list[TryRecord] = [
            TryRecord(seed, plan.trajectory.duration, least_gap(plan), "", taken=seed == taken)
            for seed, plan in self.plans.items()
        ]
        failed: list[TryRecord] = [
            TryRecord(seed, None, None, _reason(failure)) for seed, failure in self.failures.items()
        ]
        return replace(self.plans[taken], tries=tuple(sorted([*found, *failed], key=lambda each: each.seed)))


def _reason(failure: NoPlanFound | VerificationError) -> str:
    if isinstance(failure, NoPlanFound):
        return failure.diagnosis.reason
    return "the verifier refuses the plan: " + "; ".join(failure.failures)
