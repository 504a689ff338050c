"""A user's hard constraints in the continuation: rows of the step, and the way back onto equations.

Gaps are treated as clearances are: they keep a margin where there is room for it. Their unit is the user's; divided by
the norm of its slope by the link headings, a gap is the turn of the whole arm that closes it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.arrays import FloatArray, IntcArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.link_space import LinkSpace

if TYPE_CHECKING:
    from ccm_opt.user_terms.row_set import RowSet, RowValues

MARGIN = 2e-3
"""Margin of a gap, as a turn of the whole arm [rad]."""
KEEP_SHARE = 0.4
"""Share of the margin that every accepted pose keeps."""
MET = 1e-10
"""An equation is met when nothing misses by more, in the user's unit."""
PULL = 30.0
"""Weight on mending gaps inside their margin."""
URGENCY = 10.0
"""Scale of the rows of broken gaps, beside those inside their margin."""
WITHIN = 0.995
"""Share of a joint limit to which bends beyond that are brought back; what splines overshoot stays below the limit."""
_NEWTON_STEPS = 12
_RANK = 1e-9
_TINY = 1e-12
_EQUATION = 5
"""The solver's mark of a row that is an equation."""


@dataclass(frozen=True)
class StepRows:
    """Rows of one step: lower ≤ A δ ≤ upper, and what gaps ask for.

    Attributes:
        matrix: A, shape (m, p).
        upper: shape (m,).
        lower: shape (m,).
        sense: the solver's marks, shape (m,).
        wanted_rows: of gaps inside their margin, per radian, shape (k, p).
        wanted: what they should gain, shape (k,) [rad].
    """

    matrix: FloatArray
    upper: FloatArray
    lower: FloatArray
    sense: IntcArray
    wanted_rows: FloatArray
    wanted: FloatArray


@dataclass(frozen=True, eq=False)
class OwnRows:
    """A user's rows in the coordinates of a link space, at one place of the motion.

    Attributes:
        space: the link space.
        rows: of the constraints.
        u: path parameter.
    """

    space: LinkSpace
    rows: "RowSet"
    u: float = 0.0

    def at(self, u: float) -> "OwnRows":
        """The same rows at another place of the motion."""
        return replace(self, u=u)

    @cached_property
    def inverse_metric(self) -> FloatArray:
        """Inverse of AᵀA, a little regularised: least change of the links, shape (p, p)."""
        metric = self.space.matrix.T @ self.space.matrix
        regular = metric + 1e-6 * np.diag(np.diag(metric)) + 1e-9 * np.eye(len(metric))
        return np.asarray(np.linalg.inv(regular), dtype=np.float64)

    def values(self, headings: FloatArray) -> "RowValues":
        """Rows at link headings, shape (links,) [rad]."""
        return self.rows.at(headings, self.u)

    def step_rows(self, values: "RowValues", turn: float) -> StepRows:
        """The rows linearised.

        Args:
            values: of the rows at the pose.
            turn: largest turn of a link in the step [rad]; equations far from met ask for half of it.
        """
        equations, target = self._independent(values, turn)
        scale = slope_norms(values.gap_slopes)
        within = ~(values.gaps > (MARGIN + 2.0 * turn * np.sqrt(self.space.arm.links)) * scale)  # others cannot bind
        scale, gaps = scale[within], values.gaps[within] / scale[within]
        rows = values.gap_slopes[within] @ self.space.matrix / scale[:, None]
        lower = np.minimum(-0.5 * (gaps - MARGIN), 0.0)
        near = gaps < MARGIN
        urgency = np.where(gaps[near] < 0.0, URGENCY, 1.0)
        wanted = np.where(gaps[near] < 0.0, MARGIN - gaps[near], 0.5 * (MARGIN - gaps[near]))
        return StepRows(
            np.vstack((equations, rows)),
            np.concatenate((target, np.full(len(rows), 1e30))),
            np.concatenate((target, lower)),
            np.concatenate((np.full(len(target), _EQUATION), np.zeros(len(rows)))).astype(np.intc),
            urgency[:, None] * rows[near],
            urgency * np.minimum(wanted, turn),
        )

    def _independent(self, values: "RowValues", turn: float) -> tuple[FloatArray, FloatArray]:
        """Orthonormal combinations of the equations' rows, and what they have to change by."""
        slopes = values.equation_slopes @ self.space.matrix
        if not len(slopes):
            return slopes, values.equations
        left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
        kept = sizes > _RANK * max(float(sizes[0]), _TINY)
        target = -(left.T @ values.equations)[kept] / sizes[kept]
        most = float(np.max(np.abs(self.space.matrix @ (right[kept].T @ target)), initial=0.0))
        return right[kept], target * min(1.0, 0.5 * turn / max(most, _TINY))

    def returned(self, v: FloatArray, most: float, *, gaps: bool = False) -> FloatArray | None:
        """Coordinates moved onto the equations by Newton's method of least change of the links, shape (p,).

        Args:
            v: shape (p,).
            most: largest turn of a link on the way [rad].
            gaps: whether to move out of broken gaps, and back within joint limits, too.

        Returns:
            None when that does not converge within ``most``.
        """
        start, held = v, np.zeros(self.space.arm.links)
        for _ in range(_NEWTON_STEPS):
            values = self.values(self.space.headings(v))
            if not np.isfinite(values.violation):
                return None
            slopes, change = values.equation_slopes @ self.space.matrix, -values.equations
            if gaps:
                slopes, change = self.missed(self.space.headings(v))
                turned, back = overbent(self.space.arm, self.space.headings(v), held)
                slopes, change = np.vstack((slopes, turned @ self.space.matrix)), np.append(change, back)
            if np.max(np.abs(change), initial=0.0) <= MET:
                return v
            v = v + self.correction(slopes, change)
            if np.max(np.abs(self.space.matrix @ (v - start))) > most:
                return None
        return None

    def correction(self, slopes: FloatArray, change: FloatArray) -> FloatArray:
        """Least change of the links that changes rows by given amounts, shape (p,)."""
        scale = np.maximum(np.linalg.norm(slopes, axis=1), _TINY)
        scaled = slopes / scale[:, None]
        spread = self.inverse_metric @ scaled.T
        least: FloatArray = spread @ np.linalg.lstsq(scaled @ spread, change / scale, rcond=1e-10)[0]
        return least

    def mending(self, headings: FloatArray, most: float) -> tuple[FloatArray, FloatArray]:
        """Rows of all that is missed, per radian, shape (k, p), and what they should gain, at most ``most`` [rad]."""
        values = self.values(headings)
        short = values.gaps < MARGIN * slope_norms(values.gap_slopes)
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[short]))
        scale = slope_norms(slopes)
        margin = MARGIN * slope_norms(values.gap_slopes[short])
        wanted = np.append(-values.equations, margin - values.gaps[short]) / scale
        return slopes @ self.space.matrix / scale[:, None], np.clip(wanted, -most, most)

    def missed(self, headings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slopes of the equations and of broken gaps, shape (k, p), and by how much they have to change."""
        values = self.values(headings)
        broken = values.gaps < 0.0
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken])) @ self.space.matrix
        aim = KEEP_SHARE * MARGIN * slope_norms(values.gap_slopes[broken])
        return slopes, np.append(-values.equations, aim - values.gaps[broken])

    def worst(self, headings: FloatArray) -> tuple[str, float]:
        """Name of the constraint that is missed most in radians of the arm, and its miss in the user's unit."""
        table = self.rows.table(headings[None], self.u)[0]
        miss = np.where(self.rows.equal, np.abs(table), np.maximum(-table, 0.0))
        if np.all(np.isnan(miss)):
            return "", 0.0
        slopes = slope_norms(np.asarray(self.rows.slopes(headings, 0.0, self.u)[1]))
        k = int(np.nanargmax(miss / slopes))
        return self.rows.names[k], float(miss[k])

    def describe(self, headings: FloatArray) -> str:
        """The constraint that is missed, or else at its bound, in words; empty when none is."""
        name, miss = self.worst(headings)
        if miss > MET:
            return f"constraint '{name}' is missed by {miss:.3g}"
        table = self.rows.table(headings[None], self.u)[0]
        turns = table / slope_norms(np.asarray(self.rows.slopes(headings, 0.0, self.u)[1]))
        near = ~self.rows.equal & (turns < 2.0 * MARGIN)
        return f"constraint '{self.rows.names[int(np.flatnonzero(near)[0])]}' is at its bound" if near.any() else ""

    def keeps(self, before: "RowValues", after: "RowValues") -> bool:
        """Whether a step leaves every gap its share of the margin, or no less than it had."""
        floor = np.minimum(KEEP_SHARE * MARGIN * slope_norms(before.gap_slopes), before.gaps)
        return bool(np.isfinite(after.violation) and np.all(after.gaps >= floor - _TINY))


def overbent(arm: Arm, headings: FloatArray, held: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes of bends too near their limit by the link headings, shape (k, links), and their way back [rad].

    Args:
        arm: whose bends they are.
        headings: shape (links,) [rad].
        held: side to which each bend was too large before, or 0; such bends are kept at the limit, so that Newton's
            method does not go to and fro. What is too large now is added. Shape (links,).
    """
    bends, limits = arm.bends(headings), WITHIN * arm.bend_limits
    beyond = np.abs(bends) > limits + MET
    held[beyond] = np.sign(bends[beyond])
    over = np.flatnonzero(held)
    slopes = np.diff(np.eye(arm.links), axis=0, prepend=0.0)[over]
    return slopes, held[over] * limits[over] - bends[over]


def slope_norms(slopes: FloatArray) -> FloatArray:
    """Norm of every row's slope by the link headings, shape (m,); never 0."""
    norms: FloatArray = np.maximum(np.linalg.norm(slopes, axis=1), _TINY)
    return norms
