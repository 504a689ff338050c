"""Hard constraints as rows for the planner: equations h(q, u) = 0 and gaps g(q, u) ≥ 0, with their slopes."""

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
    """Values and slopes of the rows that apply at a pose.

    Attributes:
        equations: what must vanish, shape (m,).
        equation_slopes: by the configuration, shape (m, c).
        gaps: what must not be negative, shape (k,).
        gap_slopes: likewise, shape (k, c).
    """

    equations: FloatArray
    equation_slopes: FloatArray
    gaps: FloatArray
    gap_slopes: FloatArray

    @property
    def violation(self) -> float:
        """By how much the worst row is violated, 0 when all hold; infinity when a value is not finite."""
        unequal = float(np.max(np.abs(self.equations), initial=0.0))
        below = float(np.max(-self.gaps, initial=0.0))
        worst = max(unequal, below)
        return worst if np.isfinite(worst) else np.inf


@dataclass(frozen=True)
class _Row:
    """One row of a constraint, before all rows are stacked.

    Attributes:
        name: of the constraint.
        expression: scalar CasADi expression.
        first: path parameter from which it applies.
        last: path parameter up to which it applies.
        equal: whether the row is an equation.
    """

    name: str
    expression: Any
    first: float
    last: float
    equal: bool


@dataclass(frozen=True, eq=False)
class RowSet:
    """Rows of several constraints.

    Attributes:
        names: the constraint of every row.
        equal: whether a row is an equation, shape (rows,).
        first: path parameter from which a row applies, shape (rows,).
        last: path parameter up to which it applies, shape (rows,).
        parametric: whether a row depends on the path parameter, shape (rows,).
        values: CasADi function from configurations and u to the rows.
        slopes: CasADi function from configurations and u to the rows and their derivatives by the configuration.
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
        """The rows of constraints: an equation for equal bounds, else a gap for each finite bound."""
        rows = [row for compiled in constraints for row in _rows_of(compiled)]
        expressions = [row.expression for row in rows]
        column = ca.vertcat(*expressions) if rows else ca.SX(0, 1)

        path_parameter = quantities.path_parameter
        q, column = quantities.in_configurations(column)
        slopes = ca.densify(ca.jacobian(column, q))
        symbols = [q, path_parameter]
        return cls(
            names=tuple(row.name for row in rows),
            equal=np.array([row.equal for row in rows], dtype=bool),
            first=np.array([row.first for row in rows], dtype=np.float64),
            last=np.array([row.last for row in rows], dtype=np.float64),
            parametric=np.array([bool(ca.depends_on(each, path_parameter)) for each in expressions], dtype=bool),
            values=ca.Function("rows", symbols, [column]),
            slopes=ca.Function("slopes", symbols, [column, slopes]),
        )

    def __len__(self) -> int:
        return len(self.names)

    def at(self, q: FloatArray, u: float = 0.0) -> RowValues:
        """Values and slopes of the rows that apply at a pose.

        Args:
            q: configuration, shape (c,) [rad, m].
            u: path parameter.
        """
        # The buffers are overwritten by the next call; picking rows by a mask makes copies.
        values, jacobian = self._evaluated(q, u)
        here = self._apply_at(u)
        equations = here & self.equal
        gaps = here & ~self.equal
        return RowValues(values[equations], jacobian[equations], values[gaps], jacobian[gaps])

    def table(self, q: FloatArray, u: FloatArray | float = 0.0) -> FloatArray:
        """Values of all rows at many poses, shape (N, rows); NaN where a row does not apply.

        Args:
            q: configurations, shape (N, c) [rad, m].
            u: path parameter, shape (N,) or scalar.
        """
        count = len(q)
        places = np.broadcast_to(np.asarray(u, dtype=np.float64), (count,))
        # One pose a column.
        columns = self.values(ca.DM(q.T), ca.DM(places).T)
        values = np.asarray(columns, dtype=np.float64).reshape(len(self), count).T
        table: FloatArray = np.where(self._apply_at(places[:, None]), values, np.nan)
        return table

    def _apply_at(self, u: FloatArray | float) -> BoolArray:
        """Which rows apply at a place of the motion, shape (rows,), or (N, rows) for ``u`` of shape (N, 1)."""
        inside: BoolArray = (self.first <= u + TINY) & (u <= self.last + TINY)
        return inside

    def _evaluated(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """All rows and their slopes, of shapes (rows,) and (rows, c); overwritten by the next call."""
        if not len(self):
            return np.zeros(0), np.zeros((0, len(q)))
        buffers = self._buffers
        buffers.q[:] = q
        buffers.path_parameter[0] = u
        buffers.evaluate()
        return buffers.values, buffers.slopes.T

    @cached_property
    def _buffers(self) -> "_Buffers":
        return _Buffers.around(self.slopes, len(self))


@dataclass(frozen=True, eq=False)
class _Buffers:
    """Arrays that CasADi reads from and writes to in place: a step calls the rows often, and conversions cost more.

    Attributes:
        memory: CasADi's buffer object, which must live as long as ``evaluate`` is called.
        evaluate: fills ``values`` and ``slopes``.
        q: configuration, shape (c,) [rad, m].
        path_parameter: shape (1,).
        values: shape (rows,).
        slopes: shape (c, rows), transposed because CasADi stores matrices by columns.
    """

    memory: Any
    evaluate: Any
    q: FloatArray
    path_parameter: FloatArray
    values: FloatArray
    slopes: FloatArray

    @classmethod
    def around(cls, slopes: Any, rows: int) -> "_Buffers":
        """Buffers for the function that gives ``rows`` rows and their slopes."""
        memory, evaluate = slopes.buffer()
        columns = slopes.size1_in(0)
        buffers = cls(memory, evaluate, np.zeros(columns), np.zeros(1), np.zeros(rows), np.zeros((columns, rows)))

        # CasADi keeps the addresses alone: the arrays must not be replaced, only written to.
        memory.set_arg(0, buffers.q.data)
        memory.set_arg(1, buffers.path_parameter.data)
        memory.set_res(0, buffers.values.data)
        memory.set_res(1, buffers.slopes.data)
        return buffers


def _rows_of(compiled: "CompiledConstraint") -> list[_Row]:
    """The rows of one constraint: an equation for equal bounds, else a gap for each finite bound."""
    where = compiled.constraint.where
    name = compiled.constraint.name
    first = 0.0 if isinstance(where, str) else where.first
    last = 1.0 if isinstance(where, str) else where.last

    rows = []
    for k in range(compiled.expression.numel()):
        entry = compiled.expression[k]
        low = compiled.lower[k]
        high = compiled.upper[k]
        # As two gaps, an equation would leave a planner no room between them.
        if low == high:
            rows.append(_Row(name, entry - low, first, last, equal=True))
            continue
        if np.isfinite(low):
            rows.append(_Row(name, entry - low, first, last, equal=False))
        if np.isfinite(high):
            rows.append(_Row(name, high - entry, first, last, equal=False))
    return rows
