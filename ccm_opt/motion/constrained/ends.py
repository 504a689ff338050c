"""A user's constraints at the ends of the motion: refused at once when the start or a whole-arm goal breaks them."""

from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.motion.ends import Ends
from ccm_opt.user_terms.terms import Interval

if TYPE_CHECKING:
    from ccm_opt.arrays import FloatArray
    from ccm_opt.user_terms.compiled_terms import UserTerms
    from ccm_opt.user_terms.functions import CompiledConstraint

TOLERANCE = 1e-6
"""By which a hard constraint may be missed, in the unit of its expression."""


def refuse_contradicted(terms: "UserTerms", ends: Ends) -> None:
    """Refuse constraints that the ends of the motion break, and terms that are not finite there.

    Raises:
        ProblemError: naming the constraint that the start breaks, or the term that is not finite there.
        UnreachableGoal: naming the constraint that a whole-arm goal breaks.
    """
    for compiled in terms.all_costs:
        if not np.isfinite(compiled.values(ends.start[None], np.zeros(1))).all():
            raise ProblemError(f"cost '{compiled.cost.name}' is not finite at the start; got NaN or infinity")
    for constraint in terms.constraints:
        _refuse_at_start(constraint, ends.start)
    if ends.goal_headings is not None:
        for constraint in terms.hard:
            _refuse_at_goal(constraint, ends.goal_headings)


def _refuse_at_start(compiled: "CompiledConstraint", start: "FloatArray") -> None:
    where, name = compiled.constraint.where, compiled.constraint.name
    miss = float(compiled.residuals(start[None], np.zeros(1))[0])
    slopes = np.asarray(compiled.slopes(start, 0.0, 0.0))
    if not np.isfinite(miss) or not np.isfinite(slopes).all():
        what = "value" if not np.isfinite(miss) else "derivative"
        raise ProblemError(f"constraint '{name}' is not finite at the start; its {what} is NaN or infinity")
    applies = where.first == 0.0 if isinstance(where, Interval) else where != "goal"
    if applies and not compiled.constraint.soft and miss > TOLERANCE:
        raise ProblemError(
            f"constraint '{name}' contradicts the start: it is missed by {miss:.6g} there, allowed {TOLERANCE:g}; "
            "change the start, the bounds, or where the constraint applies, or make it soft"
        )


def _refuse_at_goal(compiled: "CompiledConstraint", goal: "FloatArray") -> None:
    where = compiled.constraint.where
    applies = where.last == 1.0 if isinstance(where, Interval) else True
    miss = float(compiled.residuals(goal[None], np.ones(1))[0])
    if applies and not miss <= TOLERANCE:
        reason = f"constraint '{compiled.constraint.name}' is missed by {miss:.6g} at the goal, allowed {TOLERANCE:g}"
        advice = ("give the goal for the tip alone", "change the bounds, or make the constraint soft")
        raise UnreachableGoal(Diagnosis(reason, "goal", advice))
