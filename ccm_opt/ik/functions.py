"""Compiled functions of the constraints and costs that users wrote, evaluated at many poses of a motion."""

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
    """N states of a motion at which constraints are checked and costs are averaged.

    Attributes:
        q: configurations, shape (N, c) [rad, m].
        u: path parameter, shape (N,).
        rates: rates of the configurations, shape (N, c) [rad/s, m/s]; NaN where time is unknown.
        time: times, shape (N,) [s]; NaN where unknown.
    """

    q: FloatArray
    u: FloatArray
    rates: FloatArray
    time: FloatArray

    def where(self, where: Where) -> "MotionStates":
        """Return the states at which a constraint or cost with the given value of ``where`` applies."""
        chosen = applies_at(where, self.u)
        return MotionStates(self.q[chosen], self.u[chosen], self.rates[chosen], self.time[chosen])


@dataclass(frozen=True, eq=False)
class _Compiled:
    """Compiled expression of a constraint or cost.

    Attributes:
        expression: CasADi column of m entries.
        quantities: quantities of the arm that hold the expression's symbols.
    """

    expression: Any
    quantities: ArmQuantities

    @cached_property
    def timed(self) -> bool:
        """Whether the expression depends on speeds, which only the finished motion has."""
        return self.quantities.is_timed(self.expression)

    @cached_property
    def of_path(self) -> bool:
        """Whether the expression depends on the path parameter."""
        return bool(ca.depends_on(self.expression, self.quantities.path_parameter))

    @cached_property
    def function(self) -> Any:
        """Compiled function that maps bends, feed, u and, if speeds matter, rates to the value of the expression."""
        symbols = self.quantities.timed_symbols if self.timed else self.quantities.symbols
        return ca.Function("term", list(symbols), [self.expression])

    def all_values(self, q: FloatArray, u: FloatArray, rates: FloatArray | None = None) -> FloatArray:
        """Return the values of the m entries of the expression at N configurations, shape (N, m).

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameters, shape (N,).
            rates: rates of the configurations, shape (N, c) [rad/s, m/s]; needed if the expression depends on speeds.
        """
        places = self.quantities.places
        of_time = places(rates) if self.timed and rates is not None else ()
        # CasADi maps a function over the columns of its arguments: one pose, one column.
        values = self.function(*places(q), ca.DM(u).T, *of_time)
        return np.asarray(values, dtype=np.float64).reshape(-1, len(q)).T


@dataclass(frozen=True, eq=False)
class CompiledConstraint(_Compiled):
    """A user's constraint with its compiled expression of m entries and its bounds.

    Attributes:
        constraint: the constraint as the user wrote it.
        lower: lower bounds, shape (m,).
        upper: upper bounds, shape (m,).
    """

    constraint: Constraint
    lower: FloatArray
    upper: FloatArray

    @property
    def parametric(self) -> bool:
        """Whether the constraint depends on the path parameter, by its expression or by its interval."""
        return isinstance(self.constraint.where, Interval) or self.of_path

    @cached_property
    def slopes(self) -> Any:
        """Compiled function from a configuration and u to the expression's Jacobian with respect to the configuration.

        The Jacobian has shape (m, c).
        """
        q, expression = self.quantities.in_configurations(self.expression)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("slopes", symbols, [ca.densify(ca.jacobian(expression, q))])

    def residuals(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the violation of the worst entry of the constraint at N configurations, shape (N,).

        The violation is 0 where all bounds hold, and NaN where a value is not finite.

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameters, shape (N,).
        """
        return np.maximum(self._beyond_bounds(self.all_values(q, u)), 0.0)

    def excesses(self, states: MotionStates) -> FloatArray:
        """Return the signed violation of the worst entry of the constraint at N states, shape (N,).

        The violation is negative where all bounds hold, and NaN where a value is not finite.
        """
        return self._beyond_bounds(self.all_values(states.q, states.u, states.rates))

    def _beyond_bounds(self, values: FloatArray) -> FloatArray:
        """Return the signed violation of the worst entry, shape (N,), for values of m entries, shape (N, m)."""
        # NaN would silently win or lose any comparison, so it is set aside and put back at the end.
        finite = np.all(np.isfinite(values), axis=1)
        values = np.where(finite[:, None], values, 0.0)
        beyond = np.maximum(self.lower - values, values - self.upper).max(axis=1)
        return np.asarray(np.where(finite, beyond, np.nan))

    def as_cost(self) -> "CompiledCost":
        """Return a cost equal to half the squared violation of the constraint, with the constraint's weight."""
        term = self.constraint
        # Costs are averaged over keyframes anyway, so "keyframes" and "motion" mean the same here.
        where: Where = "motion" if term.where == "keyframes" else term.where
        if np.array_equal(self.lower, self.upper):
            # Equals the square below, but is smooth at the bound, so that its Hessian does not jump there.
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
    """A user's cost with its compiled scalar expression.

    Attributes:
        cost: the cost as the user wrote it, or a soft constraint turned into a cost.
    """

    cost: Cost

    def values(self, q: FloatArray, u: FloatArray) -> FloatArray:
        """Return the unweighted cost at N configurations q (N, c) [rad, m] with path parameters u (N,), shape (N,)."""
        return self.all_values(q, u)[:, 0]

    @cached_property
    def _derivatives(self) -> Any:
        q, expression = self.quantities.in_configurations(self.expression)
        hessian, gradient = ca.hessian(expression, q)
        symbols = [q, self.quantities.path_parameter]
        return ca.Function("derivatives", symbols, [ca.densify(gradient), ca.densify(hessian)])

    def second_order(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Return the gradient (c,) and Hessian (c, c) of the unweighted cost with respect to a configuration q (c,).

        ``u`` is the path parameter at which the cost is evaluated.
        """
        gradient, hessian = self._derivatives(q, u)
        return np.asarray(gradient)[:, 0], np.asarray(hessian)

    def applies(self, u: FloatArray) -> BoolArray:
        """Return a mask of the samples of a motion at which the cost applies, shape (N,).

        ``u`` are the path parameters of the samples, increasing, shape (N,); the last sample is the goal.
        """
        return applies_at(self.cost.where, u)
