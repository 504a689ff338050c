"""How users' constraints and costs become functions: expressions are built and checked, and refused by name."""

from collections.abc import Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.user_terms.arm_quantities import ArmQuantities
from ccm_opt.user_terms.functions import CompiledConstraint, CompiledCost
from ccm_opt.user_terms.terms import Constraint, Cost, answer_of

TIME_TO_BUILD = 10.0
"""That an expression may take [s]; those of arms of 100 links take milliseconds."""
_COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR)
"""Operations whose result is true or false."""


def _is_comparison(entry: Any) -> bool:
    """Whether an entry of an expression is true or false and nothing else."""
    return any(entry.is_op(operation) for operation in _COMPARISONS)


def _expression(term: Constraint | Cost, kind: str, quantities: ArmQuantities) -> Any:
    """The expression as a column, checked."""
    made = answer_of(lambda: term.expression(quantities), f"{kind} '{term.name}'", TIME_TO_BUILD)
    try:
        column = ca.vec(ca.SX(made))
    except (NotImplementedError, RuntimeError, TypeError) as error:
        got = f"{type(made).__module__}.{type(made).__name__}"
        raise ProblemError(
            f"{kind} '{term.name}': expected a CasADi SX expression of the quantities, got {got}"
        ) from error

    if isinstance(made, bool) or any(_is_comparison(column[k]) for k in range(column.numel())):
        raise ProblemError(
            f"{kind} '{term.name}': expected a number, got a comparison, which is true or false; "
            "return what is compared, and bound it by lower= and upper="
        )
    if column.numel() == 0:
        raise ProblemError(f"{kind} '{term.name}': the expression is empty, expected at least one entry")
    # Without allow_free CasADi would refuse the foreign symbols too, but with an error that does not name the term.
    free = ca.Function("check", list(quantities.timed_symbols), [column], {"allow_free": True}).get_free()
    if free:
        names = ", ".join(str(symbol) for symbol in free[:4])
        raise ProblemError(
            f"{kind} '{term.name}': free symbol(s) {names}; use the quantities that the function is given, not symbols "
            "of its own"
        )
    return ca.densify(column)


def compiled_constraint(constraint: Constraint, quantities: ArmQuantities) -> CompiledConstraint:
    """A constraint with its functions.

    Raises:
        ProblemError: naming the constraint and what is wrong with it.
    """
    expression = _expression(constraint, "constraint", quantities)
    lower = _bound(constraint, "lower", expression.numel())
    upper = _bound(constraint, "upper", expression.numel())
    if np.any(lower > upper):
        raise ProblemError(f"constraint '{constraint.name}': a lower bound exceeds its upper bound")
    # An entry that is free on both sides is most likely a slip.
    if not np.all(np.isfinite(lower) | np.isfinite(upper)):
        raise ProblemError(f"constraint '{constraint.name}': give each entry a lower or an upper bound")
    return CompiledConstraint(constraint, expression, lower, upper, quantities)


def _bound(constraint: Constraint, key: Literal["lower", "upper"], count: int) -> FloatArray:
    """One of the bounds, for every entry of the expression, shape (count,)."""
    value = getattr(constraint, key)
    try:
        bound = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise ProblemError(f"constraint '{constraint.name}': {key} must be numbers, got {value!r}") from error
    if len(bound) not in {1, count}:
        raise ProblemError(
            f"constraint '{constraint.name}': the expression has {count} entries, but {key} has {len(bound)}; "
            "give one number, or one for each entry"
        )
    if np.any(np.isnan(bound)):
        raise ProblemError(f"constraint '{constraint.name}': {key} must not be NaN")
    return np.broadcast_to(bound, (count,)).copy()


def compiled_cost(cost: Cost, quantities: ArmQuantities) -> CompiledCost:
    """A cost with its functions.

    Raises:
        ProblemError: naming the cost and what is wrong with it.
    """
    expression = _expression(cost, "cost", quantities)
    if expression.numel() != 1:
        raise ProblemError(f"cost '{cost.name}': expected a scalar, got {expression.numel()} entries; sum them up")
    if quantities.is_timed(expression):
        raise ProblemError(
            f"cost '{cost.name}': a cost shapes the path, which has no speed yet; weigh planner.weights.duration, or "
            "limit speeds by limits.tip_velocity and limits.points"
        )
    return CompiledCost(cost, expression, quantities)


def refuse_double_names(terms: Sequence[Constraint | Cost]) -> None:
    """Messages and checks call terms by their names, so that no two may have the same.

    Raises:
        ProblemError: two have the same.
    """
    names = [term.name for term in terms]
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise ProblemError(f"names of constraints and costs must differ, got '{double[0]}' twice")
