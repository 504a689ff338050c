"""Hard constraints as rows: equations h(φ, u) = 0 and gaps g(φ, u) >= 0, with their slopes, for one pose at a time."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ccm_opt.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccm_opt.user_terms.functions import CompiledConstraint
    from ccm_opt.user_terms.quantities import Quantities

_SLACK = 1e-12
"""Rounding of the path parameter at the ends of an interval."""


@dataclass(frozen=True)
class RowValues:
    """Values and slopes of the rows that apply at a pose.

    Attributes:
        equations: what must vanish, shape (m,).
        equation_slopes: by the link headings, shape (m, links).
        gaps: what must not be negative, shape (k,).
        gap_slopes: by the link headings, shape (k, links).
    """

    equations: FloatArray
    equation_slopes: FloatArray
    gaps: FloatArray
    gap_slopes: FloatArray

    @property
    def miss(self) -> float:
        """By how much the worst row is missed; infinity when not finite."""
        worst = max(float(np.max(np.abs(self.equations), initial=0.0)), float(np.max(-self.gaps, initial=0.0)))
        return worst if np.isfinite(worst) else np.inf


@dataclass(frozen=True, eq=False)
class RowSet:
    """Rows of several constraints.

    Attributes:
        names: the constraint of every row.
        equal: whether a row is an equation.
        first: path parameter from which a row applies, shape (rows,).
        last: to which it applies.
        parametric: whether a row depends on the path parameter.
        values: (φ, feed, u) to the rows.
        slopes: (φ, feed, u) to the rows and their derivatives by φ.
    """

    names: tuple[str, ...]
    equal: BoolArray
    first: FloatArray
    last: FloatArray
    parametric: BoolArray
    values: Any
    slopes: Any

    @classmethod
    def of(cls, quantities: "Quantities", constraints: "Sequence[CompiledConstraint]") -> "RowSet":
        """The rows of constraints: an equation for equal bounds, else a gap for each finite bound."""
        rows, names, equal, spans = [], [], [], []
        for compiled in constraints:
            where = compiled.constraint.where
            span = (where.first, where.last) if not isinstance(where, str) else (0.0, 1.0)
            for entry, low, high in zip(_entries(compiled.expression), compiled.lower, compiled.upper, strict=True):
                made = [entry - low] if low == high else [entry - low] * bool(np.isfinite(low))
                made += [high - entry] * bool(low != high and np.isfinite(high))
                rows += made
                names += [compiled.constraint.name] * len(made)
                equal += [bool(low == high)] * len(made)
                spans += [span] * len(made)
        column = ca.vertcat(*rows) if rows else ca.SX(0, 1)
        symbols = list(quantities.symbols)
        slopes = ca.densify(ca.jacobian(column, symbols[0]))
        first, last = np.array(spans, dtype=np.float64).reshape(-1, 2).T
        return cls(
            tuple(names),
            np.array(equal, dtype=bool),
            first,
            last,
            np.array([bool(ca.depends_on(row, symbols[2])) for row in rows], dtype=bool),
            ca.Function("rows", symbols, [column]),
            ca.Function("slopes", symbols, [column, slopes]),
        )

    def __len__(self) -> int:
        return len(self.names)

    def at(self, headings: FloatArray, u: float = 0.0, feed: float = 0.0) -> RowValues:
        """Values and slopes of the rows that apply at a pose.

        Args:
            headings: shape (links,) [rad].
            u: path parameter.
            feed: position of the base on its axis [m].
        """
        values, jacobian = self._evaluated(headings, u, feed)
        here = (self.first <= u + _SLACK) & (u <= self.last + _SLACK)
        equations, gaps = here & self.equal, here & ~self.equal
        return RowValues(values[equations], jacobian[equations], values[gaps], jacobian[gaps])

    def _evaluated(self, headings: FloatArray, u: float, feed: float) -> tuple[FloatArray, FloatArray]:
        """All rows and their slopes, of shapes (rows,) and (rows, links); overwritten by the next call."""
        if not len(self):
            return np.zeros(0), np.zeros((0, len(headings)))
        _, evaluate, arguments, values, slopes = self._buffers
        arguments[0][:], arguments[1][0], arguments[2][0] = headings, feed, u
        evaluate()
        return values, slopes.T

    @cached_property
    def _buffers(self) -> tuple[Any, Any, tuple[FloatArray, ...], FloatArray, FloatArray]:
        """Evaluation through arrays of our own, without CasADi's conversions; CasADi stores by columns."""
        buffer, evaluate = self.slopes.buffer()
        links = self.slopes.size1_in(0)
        arguments = np.zeros(links), np.zeros(1), np.zeros(1)
        values, slopes = np.zeros(len(self)), np.zeros((links, len(self)))
        for k, array in enumerate(arguments):
            buffer.set_arg(k, array.data)
        buffer.set_res(0, values.data)
        buffer.set_res(1, slopes.data)
        return buffer, evaluate, arguments, values, slopes

    def table(self, headings: FloatArray, u: FloatArray | float = 0.0) -> FloatArray:
        """Values of all rows at many poses, shape (N, rows); NaN where a row does not apply.

        Args:
            headings: shape (N, links) [rad].
            u: path parameter, shape (N,) or scalar.
        """
        count = len(headings)
        places = np.broadcast_to(np.asarray(u, dtype=np.float64), (count,))
        column = self.values(ca.DM(headings.T), ca.DM.zeros(1, count), ca.DM(places).T)
        values = np.asarray(column, dtype=np.float64).reshape(len(self), count).T
        here = (self.first <= places[:, None] + _SLACK) & (places[:, None] <= self.last + _SLACK)
        table: FloatArray = np.where(here, values, np.nan)
        return table


def _entries(column: Any) -> list[Any]:
    return [column[k] for k in range(column.numel())]
