"""Constraints and costs as CasADi functions of (link headings, feed, path parameter), checked and built once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.arrays import BoolArray, FloatArray
from ccm_opt.errors import CcmError, ProblemError
from ccm_opt.jointed.arm import Arm
from ccm_opt.user_terms.quantities import Quantities
from ccm_opt.user_terms.rows import RowSet
from ccm_opt.user_terms.terms import Constraint, Cost, Interval, Where


@dataclass(frozen=True, eq=False)
class CompiledConstraint:
    """A constraint with its expression and bounds.

    Attributes:
        constraint: what the user wrote.
        expression: column of m entries.
        lower: shape (m,).
        upper: shape (m,).
        quantities: holds the symbols.
    """

    constraint: Constraint
    expression: Any
    lower: FloatArray
    upper: FloatArray
    quantities: Quantities

    @cached_property
    def function(self) -> Any:
        """(φ, feed, u) to the expression."""
        return ca.Function("constraint", list(self.quantities.symbols), [self.expression])

    @cached_property
    def slopes(self) -> Any:
        """(φ, feed, u) to the derivative of the expression by φ."""
        symbols = list(self.quantities.symbols)
        return ca.Function("slopes", symbols, [ca.densify(ca.jacobian(self.expression, symbols[0]))])

    def residuals(self, headings: FloatArray, u: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
        """By how much the worst entry misses its bounds, shape (N,); 0 where all hold, NaN where not finite.

        Args:
            headings: shape (N, links) [rad].
            u: path parameter, shape (N,).
            feed: shape (N,) or scalar [m].
        """
        values = evaluated(self.function, headings, u, feed)
        finite = np.all(np.isfinite(values), axis=1, keepdims=True)
        values = np.where(finite, values, 0.0)
        miss = np.maximum(np.maximum(self.lower - values, values - self.upper), 0.0)
        worst: FloatArray = np.where(finite[:, 0], miss.max(axis=1), np.nan)
        return worst


@dataclass(frozen=True, eq=False)
class CompiledCost:
    """A cost with its expression.

    Attributes:
        cost: what the user wrote; soft constraints stand as costs too.
        expression: scalar.
        quantities: holds the symbols.
    """

    cost: Cost
    expression: Any
    quantities: Quantities

    @cached_property
    def function(self) -> Any:
        """(φ, feed, u) to the cost."""
        return ca.Function("cost", list(self.quantities.symbols), [self.expression])

    def values(self, headings: FloatArray, u: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
        """The cost, unweighted, shape (N,); arguments as for ``CompiledConstraint.residuals``."""
        return evaluated(self.function, headings, u, feed)[:, 0]

    @cached_property
    def _derivatives(self) -> Any:
        symbols = list(self.quantities.symbols)
        hessian, gradient = ca.hessian(self.expression, symbols[0])
        return ca.Function("derivatives", symbols, [ca.densify(gradient), ca.densify(hessian)])

    def second_order(self, headings: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Gradient, shape (links,), and Hessian, shape (links, links), by the link headings at one pose."""
        gradient, hessian = self._derivatives(headings, 0.0, u)
        return np.asarray(gradient)[:, 0], np.asarray(hessian)

    def applies(self, u: FloatArray) -> BoolArray:
        """At which places of the motion, the last of them the goal, the cost counts, shape (N,)."""
        where = self.cost.where
        if isinstance(where, Interval):
            inside: BoolArray = (where.first <= u) & (u <= where.last)
            return inside
        last = np.arange(len(u)) == len(u) - 1
        return last if where == "goal" else np.ones(len(u), dtype=bool)


@dataclass(frozen=True, eq=False)
class UserTerms:
    """All constraints and costs of one problem, compiled.

    Attributes:
        quantities: the symbols of the arm.
        constraints: hard and soft ones.
        costs: those that the user wrote.
    """

    quantities: Quantities
    constraints: tuple[CompiledConstraint, ...]
    costs: tuple[CompiledCost, ...]

    @property
    def hard(self) -> tuple[CompiledConstraint, ...]:
        """Constraints that must hold."""
        return tuple(c for c in self.constraints if not c.constraint.soft)

    @cached_property
    def motion_rows(self) -> RowSet:
        """Rows of the hard constraints that hold at the keyframes on the way."""
        return self._rows([c for c in self.hard if c.constraint.where != "goal"])

    @cached_property
    def path_rows(self) -> RowSet:
        """Rows of the hard constraints that hold between keyframes too."""
        return self._rows([c for c in self.hard if c.constraint.where not in {"goal", "keyframes"}])

    @cached_property
    def goal_rows(self) -> RowSet:
        """Rows of the hard constraints that hold at the goal, those of the whole motion among them."""
        return self._rows([c for c in self.hard if covers(c.constraint.where, 1.0)])

    @cached_property
    def all_costs(self) -> tuple[CompiledCost, ...]:
        """The costs, soft constraints among them as half their squared miss."""
        return (*self.costs, *(_as_cost(c) for c in self.constraints if c.constraint.soft))

    @cached_property
    def parametric(self) -> bool:
        """Whether anything depends on the path parameter, so that keyframes must know theirs."""
        u = self.quantities.path_parameter
        terms = [(c.constraint.where, c.expression) for c in self.constraints]
        terms += [(c.cost.where, c.expression) for c in self.costs]
        return any(isinstance(where, Interval) or ca.depends_on(expression, u) for where, expression in terms)

    @cached_property
    def breaks(self) -> FloatArray:
        """Path parameters inside (0, 1) at which an interval of a term begins or ends, increasing."""
        places = [c.constraint.where for c in self.constraints] + [c.cost.where for c in self.costs]
        ends = {u for where in places if isinstance(where, Interval) for u in (where.first, where.last)}
        return np.array(sorted(ends - {0.0, 1.0}))

    def _rows(self, constraints: Sequence[CompiledConstraint]) -> RowSet:
        return RowSet.of(self.quantities, constraints)


def compile_terms(arm: Arm, constraints: Sequence[Constraint], costs: Sequence[Cost]) -> UserTerms:
    """Build and check every constraint and cost for an arm.

    Raises:
        ProblemError: an expression has a wrong shape or type, or holds foreign symbols; the message names it.
    """
    quantities = Quantities.of(arm)
    for item, kind in [(c, Constraint) for c in constraints] + [(c, Cost) for c in costs]:
        if not isinstance(item, kind):
            wanted = kind.__name__
            raise ProblemError(
                f"expected a {wanted}, got {item!r}; decorate the function with @ccm_opt.{wanted.lower()}"
            )
    _refuse_double_names([*constraints, *costs])
    return UserTerms(
        quantities,
        tuple(_compiled_constraint(c, quantities) for c in constraints),
        tuple(_compiled_cost(c, quantities) for c in costs),
    )


def evaluated(function: Any, headings: FloatArray, u: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
    """Values of a function of (φ, feed, u) at many poses, shape (N, m); headings of shape (N, links)."""
    count = len(headings)
    feeds, places = (np.broadcast_to(np.asarray(x, dtype=np.float64), (count,)) for x in (feed, u))
    values = function(ca.DM(headings.T), ca.DM(feeds).T, ca.DM(places).T)
    return np.asarray(values, dtype=np.float64).reshape(-1, count).T


def covers(where: Where, u: float) -> bool:
    """Whether a constraint applies at a place of the motion; at u = 1 those at the goal do."""
    if isinstance(where, Interval):
        return where.first <= u <= where.last
    return where != "goal" or u == 1.0


def _expression(term: Constraint | Cost, kind: str, quantities: Quantities) -> Any:
    """The expression as a column, checked."""
    try:
        made = term.expression(quantities)
    except CcmError as error:
        raise ProblemError(f"{kind} '{term.name}': {error}") from error
    except Exception as error:
        raise ProblemError(f"{kind} '{term.name}' fails when it is built: {type(error).__name__}: {error}") from error
    try:
        column = ca.vec(ca.SX(made))
    except (NotImplementedError, RuntimeError, TypeError) as error:
        what = f"{type(made).__module__}.{type(made).__name__}"
        raise ProblemError(
            f"{kind} '{term.name}': expected a CasADi SX expression of the quantities, got {what}"
        ) from error
    if column.numel() == 0:
        raise ProblemError(f"{kind} '{term.name}': the expression is empty, expected at least one entry")
    free = ca.Function("check", list(quantities.symbols), [column], {"allow_free": True}).get_free()
    if free:
        names = ", ".join(str(symbol) for symbol in free[:4])
        raise ProblemError(
            f"{kind} '{term.name}': free symbol(s) {names}; use the quantities that the function is given, not symbols "
            "of its own"
        )
    return ca.densify(column)


def _compiled_constraint(constraint: Constraint, quantities: Quantities) -> CompiledConstraint:
    expression = _expression(constraint, "constraint", quantities)
    lower, upper = (_bound(constraint, key, getattr(constraint, key), expression.numel()) for key in ("lower", "upper"))
    if np.any(lower > upper):
        raise ProblemError(f"constraint '{constraint.name}': a lower bound exceeds its upper bound")
    if not np.all(np.isfinite(lower) | np.isfinite(upper)):
        raise ProblemError(f"constraint '{constraint.name}': give each entry a lower or an upper bound")
    return CompiledConstraint(constraint, expression, lower, upper, quantities)


def _bound(constraint: Constraint, key: str, value: Any, count: int) -> FloatArray:
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


def _compiled_cost(cost: Cost, quantities: Quantities) -> CompiledCost:
    expression = _expression(cost, "cost", quantities)
    if expression.numel() != 1:
        raise ProblemError(f"cost '{cost.name}': expected a scalar, got {expression.numel()} entries; sum them up")
    return CompiledCost(cost, expression, quantities)


def _as_cost(compiled: CompiledConstraint) -> CompiledCost:
    """Half the squared miss of a soft constraint."""
    low, high = (np.isfinite(bound) for bound in (compiled.lower, compiled.upper))
    below = [float(compiled.lower[k]) - compiled.expression[k] for k in np.flatnonzero(low)]
    above = [compiled.expression[k] - float(compiled.upper[k]) for k in np.flatnonzero(high)]
    miss = ca.vertcat(*below, *above)
    equal = compiled.lower == compiled.upper
    miss = compiled.expression - ca.DM(compiled.lower) if equal.all() else ca.fmax(miss, 0.0)
    term = compiled.constraint
    where: Where = "motion" if term.where == "keyframes" else term.where
    return CompiledCost(
        Cost(term.name, term.expression, term.weight, where), 0.5 * ca.sumsqr(miss), compiled.quantities
    )


def _refuse_double_names(terms: Sequence[Constraint | Cost]) -> None:
    names = [term.name for term in terms]
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise ProblemError(f"names of constraints and costs must differ, got '{double[0]}' twice")
