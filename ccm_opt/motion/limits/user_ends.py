"""The user's constraints at the ends of the motion: refused at once when the start or a whole-arm goal breaks them."""

from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.user_terms.terms import Interval

if TYPE_CHECKING:
    from ccm_opt.ground.arrays import FloatArray
    from ccm_opt.user_terms.compiled_terms import UserTerms
    from ccm_opt.user_terms.functions import CompiledConstraint


def refuse_broken_start(terms: "UserTerms", start: "FloatArray", allowed: float) -> None:
    """Refuse constraints that the start breaks, and terms that are not finite there.

    Args:
        terms: constraints and costs.
        start: link headings, shape (links,) [rad].
        allowed: by which a hard constraint may be missed, in the unit of its expression.

    Raises:
        ProblemError: naming the constraint that the start breaks, or the term that is not finite there.
    """
    for compiled in terms.all_costs:
        if not np.isfinite(compiled.values(start[None], np.zeros(1))).all():
            raise ProblemError(f"cost '{compiled.cost.name}' is not finite at the start; got NaN or infinity")
    for constraint in terms.constraints:
        _refuse_at_start(constraint, start, allowed)


def refuse_broken_goal(terms: "UserTerms", goal: "FloatArray", allowed: float) -> None:
    """Refuse a whole-arm goal that breaks a hard constraint; arguments as for ``refuse_broken_start``.

    Raises:
        UnreachableGoal: naming the constraint.
    """
    for compiled in terms.hard:
        where = compiled.constraint.where
        applies = where.last == 1.0 if isinstance(where, Interval) else True
        miss = float(compiled.residuals(goal[None], np.ones(1))[0])
        # Not "miss > allowed": NaN has to be refused as well.
        if applies and not miss <= allowed:
            name = compiled.constraint.name
            reason = f"constraint '{name}' is missed by {miss:.6g} at the goal, allowed {allowed:g}"
            advice = ("give the goal for the tip alone", "change the bounds, or make the constraint soft")
            raise UnreachableGoal(Diagnosis(reason, "goal", advice))


def _refuse_at_start(compiled: "CompiledConstraint", start: "FloatArray", allowed: float) -> None:
    where = compiled.constraint.where
    name = compiled.constraint.name
    miss = float(compiled.residuals(start[None], np.zeros(1))[0])
    slopes = np.asarray(compiled.slopes(start, 0.0))
    # A value may be finite where its derivative is not, as with the root of 0; the search would stop there without a
    # word.
    if not np.isfinite(miss) or not np.isfinite(slopes).all():
        what = "value" if not np.isfinite(miss) else "derivative"
        raise ProblemError(f"constraint '{name}' is not finite at the start; its {what} is NaN or infinity")
    applies = where.first == 0.0 if isinstance(where, Interval) else where != "goal"
    if applies and not compiled.constraint.soft and miss > allowed:
        raise ProblemError(
            f"constraint '{name}' contradicts the start: it is missed by {miss:.6g} there, allowed {allowed:g}; "
            "change the start, the bounds, or where the constraint applies, or make it soft"
        )
