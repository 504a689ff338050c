"""The user's constraints and costs as the driver is given them: checked and compiled, and in words."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ccm_opt.ground.expected import expect
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.user_terms.terms import Constraint, Cost

if TYPE_CHECKING:
    from ccm_opt.user_terms.compiled_terms import UserTerms


def named_terms(reason: str, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> tuple[tuple[str, str], ...]:
    """Kind and name of every constraint and cost that binds a plan, those first that a reason names."""
    hard = [("constraint", each.name) for each in constraints if not each.soft]
    soft = [("constraint", each.name) for each in constraints if each.soft]
    every = [*hard, *soft, *(("cost", each.name) for each in costs)]
    return tuple(sorted(every, key=lambda term: f"'{term[1]}'" not in reason))


def compiled_terms(arm: DrivenArm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> "UserTerms | None":
    """The user's constraints and costs for an arm; None when there are none.

    Raises:
        ProblemError: they are no lists, or one of them cannot be used.
    """
    # An empty list is fine, and everything else that is as good as false to Python is not.
    expect(constraints, (list, tuple), "a list of constraints", "write constraints=[mine]")
    expect(costs, (list, tuple), "a list of costs", "write costs=[mine]")
    if not (constraints or costs):
        return None
    from ccm_opt.user_terms.compiled_terms import compile_terms  # noqa: PLC0415 - most problems have no terms

    return compile_terms(arm, constraints, costs)
