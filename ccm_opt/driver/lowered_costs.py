"""Costs never stand in the way: where no plan is found with the user's costs, it is sought with less of them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from ccm_opt.errors import NoPlanFound, UnreachableGoal, VerificationError
from ccm_opt.ground.deadline import Deadline
from ccm_opt.problem import Problem
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.user_terms.check_settings import COST_SHARES

if TYPE_CHECKING:
    from ccm_opt.user_terms.compiled_terms import UserTerms

Plan = TypeVar("Plan")
PlannedProblem = TypeVar("PlannedProblem", Problem, SpaceProblem)


def planned_with_costs(
    problem: PlannedProblem,
    terms: "UserTerms | None",
    attempt: Callable[[PlannedProblem, "UserTerms | None"], Plan],
    shares: Sequence[float] = COST_SHARES,
) -> tuple[Plan, float]:
    """A plan with as much of the user's costs as one is found with; hard constraints hold in full.

    Args:
        problem: what to solve.
        terms: the user's constraints and costs.
        attempt: plans, times and verifies a problem under terms.
        shares: of the costs' weights that are tried, one after the other.

    Returns:
        The plan, and the share of the costs' weights that it was made with.

    Raises:
        NoPlanFound: there is none without any costs either; or the goal cannot be reached.
        VerificationError: the verifier refuses the last plan, which knows no costs.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    if terms is None or not terms.all_costs:
        return attempt(problem, terms), shares[0]
    hurried = problem
    for share in shares[:-1]:
        try:
            return attempt(hurried, _lowered(terms, share)), share
        except UnreachableGoal:
            raise
        except (NoPlanFound, VerificationError):
            left = deadline.left
            if left <= 0.0:
                raise
            hurried = replace(problem, planner=replace(problem.planner, time_limit=left))
    return attempt(hurried, _lowered(terms, shares[-1])), shares[-1]


def _lowered(terms: "UserTerms", share: float) -> "UserTerms":
    return terms if share == 1.0 else terms.with_costs_lowered(share)
