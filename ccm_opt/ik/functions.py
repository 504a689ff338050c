"""Functions of users' terms, over poses and over time."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.ik.quantities import ArmQuantities
from ccm_opt.ik.terms import Constraint, Cost, Interval, Where, applies_at


@dataclass(frozen=True)
class MotionStates:
    """Poses of a motion at which constraints are checked and costs are averaged.

    Attributes:
        q: configurations, shape (N, c) [rad, m].
        u: path parameter, shape (N,).
        rates: of the configurations, shape (N, c) [rad/s, m/s]; NaN where time is unknown.
        time: shape (N,) [s]; NaN where unknown.
    """

    q: FloatArray
    u: FloatArray
    rates: FloatArray
    time: FloatArray

    def where(self, where: Where) -> "MotionStates":
        """Return those at which a term applies."""
        chosen = applies_at(where, self.u)
        return MotionStates(self.q[chosen], self.u[chosen], self.rates[chosen], self.time[chosen])


@dataclass(frozen=True, eq=False)
class _Compiled:
    """An expression of a term.

    Attributes:
        expression: column of m entries.
        quantities: holds the symbols.
    """

    expression: Any
    quantities: ArmQuantities

    @cached_property
    def timed(self) -> bool:
        """Whether it holds speeds, which the finished motion alone has."""
        return self.quantities.is_timed(self.expression)

    @cached_property
    def of_path(self) -> bool:
        """Whether it holds the path parameter."""
        return bool(ca.depends_on(self.expression, self.quantities.path_parameter))

    @cached_property
    def function(self) -> Any:
        """Bends, feed and u, and the rates of both where it holds speeds, to the expression."""
        symbols = self.quantities.timed_symbols if self.timed else self.quantities.symbols
        return ca.Function("term", list(symbols), [self.expression])

    def all_values(self, q: FloatArray, u: FloatArray, rates: FloatArray | None = None) -> FloatArray:
        """Return the expression, shape (N, m).

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameter, shape (N,).
            rates: of the configurations, for what holds speeds, shape (N, c).
        """
        places = self.quantities.places
        of_time = places(rates) if self.timed and rates is not None else ()
        # CasADi maps a function over the columns of its arguments: one pose, one column.
        values = self.function(*places(q), ca.DM(u).T, *of_time)
        return np.asarray(values, dtype=np.float64).reshape(-1, len(q)).T


@dataclass(frozen=True, eq=False)
class CompiledConstraint(_Compiled):
    """A constraint with its expression and bounds.

    Attributes:
        constraint: what the user wrote.
        lower: shape (m,).
        upper: shape (m,).
    """

    constraint: Constraint
    lower: FloatArray
    upper: FloatArray

    @property
    def parametric(self) -> bool:
        """Whether it depends on the path parameter, by its expression or by where it applies."""
        return isinstance(self.constraint.where, Interval) or self.of_path

    @cached_property
    def slopes(self) -> Any:
        """Configuration and u to the derivative of the expression by the configuration."""
        q, expression = self.quantities.in_configurations(self.expression)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("slopes", symbols, [ca.densify(ca.jacobian(expression, q))])

    def residuals(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return by how much the worst entry violates its bounds, shape (N,); 0 where all hold, NaN where not finite.

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameter, shape (N,).
        """
        return np.maximum(self._beyond_bounds(self.all_values(q, u)), 0.0)

    def excesses(self, states: MotionStates) -> FloatArray:
        """Return by how much the worst entry passes its bounds, shape (N,).

        Negative where all hold, NaN where not finite.
        """
        return self._beyond_bounds(self.all_values(states.q, states.u, states.rates))

    def _beyond_bounds(self, values: FloatArray) -> FloatArray:
        """Return the same for values of the expression, shape (N, m)."""
        # NaN would win or lose any comparison unnoticed, so it is set aside and put back at the end.
        finite = np.all(np.isfinite(values), axis=1)
        values = np.where(finite[:, None], values, 0.0)
        beyond = np.maximum(self.lower - values, values - self.upper).max(axis=1)
        return np.asarray(np.where(finite, beyond, np.nan))

    def as_cost(self) -> "CompiledCost":
        """Return a soft constraint as a cost: half its squared violation."""
        term = self.constraint
        # Costs are averaged over keyframes anyway, so that "keyframes" and "motion" are one place to them.
        where: Where = "motion" if term.where == "keyframes" else term.where
        if np.array_equal(self.lower, self.upper):
            # The same square as below, but smooth at the bound, so that its Hessian does not jump there.
            violation = self.expression - ca.DM(self.lower)
        else:
            # An infinite bound cannot be violated, so it has no entry.
            below = [float(self.lower[k]) - self.expression[k] for k in np.flatnonzero(np.isfinite(self.lower))]
            above = [self.expression[k] - float(self.upper[k]) for k in np.flatnonzero(np.isfinite(self.upper))]
            violation = ca.fmax(ca.vertcat(*below, *above), 0.0)
        cost = Cost(term.name, term.expression, term.weight, where)
        return CompiledCost(0.5 * ca.sumsqr(violation), self.quantities, cost)


@dataclass(frozen=True, eq=False)
class CompiledCost(_Compiled):
    """A cost with its scalar expression.

    Attributes:
        cost: what the user wrote; soft constraints stand as costs too.
    """

    cost: Cost

    def values(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the cost, unweighted, shape (N,); arguments as for ``CompiledConstraint.residuals``."""
        return self.all_values(q, u)[:, 0]

    @cached_property
    def _derivatives(self) -> Any:
        q, expression = self.quantities.in_configurations(self.expression)
        hessian, gradient = ca.hessian(expression, q)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("derivatives", symbols, [ca.densify(gradient), ca.densify(hessian)])

    def second_order(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Return the gradient, shape (c,), and Hessian, shape (c, c), by one configuration."""
        gradient, hessian = self._derivatives(q, u)
        return np.asarray(gradient)[:, 0], np.asarray(hessian)

    def applies(self, u: FloatArray) -> BoolArray:
        """At which places of the motion, the last of them the goal, the cost counts, shape (N,)."""
        return applies_at(self.cost.where, u)
