"""Functions of users' terms, over poses and over time."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.quantities import ArmQuantities
from ccm_opt.ik.terms import Constraint, Cost, Interval, Where, applies_at


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
    quantities: ArmQuantities

    @cached_property
    def function(self) -> Any:
        """Bends, feed and u to the expression."""
        return ca.Function("constraint", list(self.quantities.symbols), [self.expression])

    @cached_property
    def slopes(self) -> Any:
        """Configuration and u to the derivative of the expression by the configuration."""
        q, expression = self.quantities.in_configurations(self.expression)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("slopes", symbols, [ca.densify(ca.jacobian(expression, q))])

    def residuals(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """By how much the worst entry violates its bounds, shape (N,); 0 where all hold, NaN where not finite.

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameter, shape (N,).
        """
        return np.maximum(self.beyond_bounds(evaluated(self.function, self.quantities, q, u)), 0.0)

    def excesses(self, states: "MotionStates") -> FloatArray:
        """By how much the worst entry passes its bounds, shape (N,); negative where all hold, NaN where not finite."""
        return self.beyond_bounds(evaluated(self.function, self.quantities, states.q, states.u))

    def beyond_bounds(self, values: FloatArray) -> FloatArray:
        """The same for values of the expression, shape (N, m)."""
        # NaN would win or lose any comparison unnoticed, so it is set aside and put back at the end.
        finite = np.all(np.isfinite(values), axis=1)
        values = np.where(finite[:, None], values, 0.0)
        below = self.lower - values
        above = values - self.upper
        worst: FloatArray = np.where(finite, np.maximum(below, above).max(axis=1), np.nan)
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
    quantities: ArmQuantities

    @cached_property
    def function(self) -> Any:
        """Bends, feed and u to the cost."""
        return ca.Function("cost", list(self.quantities.symbols), [self.expression])

    def values(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """The cost, unweighted, shape (N,); arguments as for ``CompiledConstraint.residuals``."""
        return evaluated(self.function, self.quantities, q, u)[:, 0]

    @cached_property
    def _derivatives(self) -> Any:
        q, expression = self.quantities.in_configurations(self.expression)
        hessian, gradient = ca.hessian(expression, q)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("derivatives", symbols, [ca.densify(gradient), ca.densify(hessian)])

    def second_order(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Gradient, shape (c,), and Hessian, shape (c, c), by one configuration."""
        gradient, hessian = self._derivatives(q, u)
        return np.asarray(gradient)[:, 0], np.asarray(hessian)

    def applies(self, u: FloatArray) -> BoolArray:
        """At which places of the motion, the last of them the goal, the cost counts, shape (N,)."""
        return applies_at(self.cost.where, u)


def evaluated(function: Any, quantities: ArmQuantities, q: FloatArray, u: FloatArray) -> FloatArray:
    """Values of a function of bends, feed and u at many configurations, shape (N, m); arguments as for residuals."""
    # CasADi maps a function over the columns of its arguments: one pose, one column.
    values = function(*quantities.places(q), ca.DM(u).T)
    return np.asarray(values, dtype=np.float64).reshape(-1, len(q)).T


def as_cost(compiled: CompiledConstraint) -> CompiledCost:
    """A soft constraint as a cost: half its squared violation."""
    term = compiled.constraint
    # Costs are averaged over keyframes anyway, so that "keyframes" and "motion" are one place to them.
    where: Where = "motion" if term.where == "keyframes" else term.where
    cost = Cost(term.name, term.expression, term.weight, where)
    return CompiledCost(cost, 0.5 * ca.sumsqr(_violation(compiled)), compiled.quantities)


def _violation(compiled: CompiledConstraint) -> Any:
    """By how much every bound is violated, as an expression."""
    lower = compiled.lower
    upper = compiled.upper
    expression = compiled.expression
    if np.array_equal(lower, upper):
        # The same square as below, but smooth at the bound, so that its Hessian does not jump there.
        return expression - ca.DM(lower)
    # An infinite bound cannot be violated, so it has no entry.
    below = [float(lower[k]) - expression[k] for k in np.flatnonzero(np.isfinite(lower))]
    above = [expression[k] - float(upper[k]) for k in np.flatnonzero(np.isfinite(upper))]
    return ca.fmax(ca.vertcat(*below, *above), 0.0)


@dataclass(frozen=True)
class MotionStates:
    """Places and rates of a motion at which constraints on speeds are checked.

    Attributes:
        q: configurations, shape (N, c) [rad, m].
        u: path parameter, shape (N,).
        rates: of the configurations, shape (N, c) [rad/s, m/s]; NaN where time is unknown.
    """

    q: FloatArray
    u: FloatArray
    rates: FloatArray


@dataclass(frozen=True, eq=False)
class TimedConstraint:
    """A hard constraint whose expression holds speeds.

    Attributes:
        compiled: its expression and bounds.
    """

    compiled: CompiledConstraint

    def __post_init__(self) -> None:
        # Refused rather than ignored in silence: planners know nothing of speeds.
        constraint = self.constraint
        if constraint.soft:
            raise ProblemError(
                f"constraint '{constraint.name}': a soft constraint shapes the path, which has no speed yet; limit "
                "speeds by limits.tip_velocity or limits.points, or make the constraint hard"
            )
        if constraint.where == "keyframes":
            raise ProblemError(
                f"constraint '{constraint.name}': keyframes have no speed; use where='motion', 'goal' or an Interval"
            )

    @property
    def constraint(self) -> Constraint:
        """What the user wrote."""
        return self.compiled.constraint

    @property
    def parametric(self) -> bool:
        """Whether it depends on the path parameter, by its expression or by where it applies."""
        of_path = ca.depends_on(self.compiled.expression, self.compiled.quantities.path_parameter)
        return isinstance(self.constraint.where, Interval) or bool(of_path)

    @cached_property
    def _function(self) -> Any:
        symbols = list(self.compiled.quantities.timed_symbols)
        return ca.Function("timed_constraint", symbols, [self.compiled.expression])

    def excesses(self, states: MotionStates) -> FloatArray:
        """By how much the worst entry passes its bounds, shape (N,); negative where all hold, NaN where not finite."""
        # CasADi maps a function over the columns of its arguments: one state, one column.
        places = self.compiled.quantities.places
        arguments = (*places(states.q), ca.DM(states.u).T, *places(states.rates))
        values = np.asarray(self._function(*arguments), dtype=np.float64).reshape(-1, len(states.u)).T
        return self.compiled.beyond_bounds(values)
