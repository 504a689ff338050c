"""Users' hard constraints as equations h(q, u) = 0 and inequalities g(q, u) ≥ 0 for the planner, with derivatives."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccm_opt.ik.functions import CompiledConstraint
    from ccm_opt.ik.quantities import ArmQuantities


@dataclass(frozen=True)
class RowValues:
    """Values and derivatives, at one configuration, of m equations and k inequalities from users' constraints.

    Attributes:
        equations: values h that must be zero, shape (m,).
        equation_slopes: derivatives of h with respect to the configuration, shape (m, c).
        gaps: values g that must not be negative, shape (k,).
        gap_slopes: derivatives of g with respect to the configuration, shape (k, c).
    """

    equations: FloatArray
    equation_slopes: FloatArray
    gaps: FloatArray
    gap_slopes: FloatArray

    @property
    def violation(self) -> float:
        """Greatest violation of any equation or inequality; 0 if all hold, infinity if a value is not finite."""
        unequal = float(np.max(np.abs(self.equations), initial=0.0))
        below = float(np.max(-self.gaps, initial=0.0))
        worst = max(unequal, below)
        return worst if np.isfinite(worst) else np.inf


@dataclass(frozen=True, eq=False)
class RowSet:
    """Equations and inequalities (rows) of several user constraints, with compiled functions.

    Attributes:
        names: name of the constraint to which each row belongs.
        equal: whether each row is an equation, shape (rows,).
        first: path parameter u from which each row applies, shape (rows,).
        last: path parameter up to which each row applies, shape (rows,).
        parametric: whether each row depends on the path parameter, shape (rows,).
        values: CasADi function from configuration and u to the values of the rows.
        slopes: CasADi function from configuration and u to the values of the rows and their derivatives with respect to
            the configuration.
    """

    names: tuple[str, ...]
    equal: BoolArray
    first: FloatArray
    last: FloatArray
    parametric: BoolArray
    values: Any
    slopes: Any

    @classmethod
    def from_constraints(cls, quantities: "ArmQuantities", constraints: "Sequence[CompiledConstraint]") -> "RowSet":
        """Return the rows of compiled constraints: one equation for equal bounds, else one inequality per finite bound.

        Args:
            quantities: symbols of the arm in the constraints' expressions.
            constraints: the constraints.
        """
        names: list[str] = []
        expressions: list[Any] = []
        equal: list[bool] = []
        places: list[tuple[float, float]] = []
        for compiled in constraints:
            where = compiled.constraint.where
            for k in range(compiled.expression.numel()):
                entry, low, high = compiled.expression[k], compiled.lower[k], compiled.upper[k]
                # Written as two inequalities, an equation would leave the planner no slack between them.
                sides = [(entry - low, low), (high - entry, high)][: 1 if low == high else 2]
                found = [side for side, bound in sides if np.isfinite(bound)]
                names += [compiled.constraint.name] * len(found)
                expressions += found
                equal += [bool(low == high)] * len(found)
                places += [(0.0, 1.0) if isinstance(where, str) else (where.first, where.last)] * len(found)

        path_parameter = quantities.path_parameter
        q, column = quantities.in_configurations(ca.vertcat(ca.SX(0, 1), *expressions))
        slopes = ca.densify(ca.jacobian(column, q))
        symbols = [q, path_parameter]
        first, last = np.array(places, dtype=np.float64).reshape(-1, 2).T
        return cls(
            names=tuple(names),
            equal=np.array(equal, dtype=bool),
            first=first,
            last=last,
            parametric=np.array([bool(ca.depends_on(each, path_parameter)) for each in expressions], dtype=bool),
            values=ca.Function("rows", symbols, [column]),
            slopes=ca.Function("slopes", symbols, [column, slopes]),
        )

    def __len__(self) -> int:
        return len(self.names)

    def at(self, q: FloatArray, u: float = 0.0) -> RowValues:
        """Return the values and derivatives of the rows at a configuration, without rows that do not apply at u.

        Args:
            q: configuration, shape (c,) [rad, m].
            u: path parameter.
        """
        # The next call overwrites the buffers; selecting rows with a mask makes copies.
        values, jacobian = self._evaluated(q, u)
        here = self.applicable_mask(u)
        equations = here & self.equal
        gaps = here & ~self.equal
        return RowValues(values[equations], jacobian[equations], values[gaps], jacobian[gaps])

    def table(self, q: FloatArray, u: FloatArray | float = 0.0) -> FloatArray:
        """Return the values of all rows at N configurations, shape (N, rows); NaN where a row does not apply.

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameter, shape (N,) or scalar.
        """
        count = len(q)
        places = np.broadcast_to(np.asarray(u, dtype=np.float64), (count,))
        # One pose per column.
        columns = self.values(ca.DM(q.T), ca.DM(places).T)
        values = np.asarray(columns, dtype=np.float64).reshape(len(self), count).T
        table: FloatArray = np.where(self.applicable_mask(places[:, None]), values, np.nan)
        return table

    def applicable_mask(self, u: FloatArray | float) -> BoolArray:
        """Return a mask of the rows that apply at a path parameter, shape (rows,), or (N, rows) for ``u`` (N, 1)."""
        inside: BoolArray = (self.first <= u + TINY) & (u <= self.last + TINY)
        return inside

    def _evaluated(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Return the values (rows,) and derivatives (rows, c) of all rows in buffers that the next call overwrites."""
        if not len(self):
            return np.zeros(0), np.zeros((0, len(q)))
        _, evaluate, at, place, values, slopes = self._buffers
        at[:] = q
        place[0] = u
        evaluate()
        return values, slopes.T

    @cached_property
    def _buffers(self) -> tuple[Any, Any, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Arrays that CasADi reads and writes in place, since rows are evaluated often and conversions are slow.

        Returns:
            CasADi's memory, which must stay alive as long as the evaluation is called; the evaluation; q (c,), u (1,),
            the rows (rows,) and their derivatives (c, rows), transposed because CasADi stores matrices by columns.
            CasADi keeps only the addresses: write into the arrays, never replace them.
        """
        memory, evaluate = self.slopes.buffer()
        columns = self.slopes.size1_in(0)
        given = np.zeros(columns), np.zeros(1)
        found = np.zeros(len(self)), np.zeros((columns, len(self)))
        for place in (0, 1):
            memory.set_arg(place, given[place].data)
            memory.set_res(place, found[place].data)
        return memory, evaluate, *given, *found
