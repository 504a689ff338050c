"""One step of the sequential convex programming: a block-banded sparse QP over all keyframes, solved by PIQP.

Its variables are the changes of the unknowns of keyframes 1..K, and one slack for each interval. Rows are linearised;
their curvature, weighted by the multipliers of the previous step, is in the Hessian where the sweep provides it and it
is convex.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, MotionCost, Quadratic
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep
from ccm_opt.planning.optimisation.objective import Objective

_DAMPING_RIDGE = 1e-3
"""Damping of unknowns in addition to that of the turns. Taste."""
_SLACK_CURVATURE = 1e-6
"""Curvature of slack, so that the Hessian is definite. Taste."""

_QP_TOLERANCE = 1e-5
"""Tolerance of the QP's solution. Taste."""
_QP_GAP = 1e-3
"""Absolute duality gap of the QP's solution; the relative one is a tenth of it. Taste."""
_QP_ITERATIONS = 60
"""Most iterations of the QP. Taste."""
_MANY_ROWS = 2000
"""Number of rows above which the QP is solved with the tightest of them first. Taste: one of so many takes as long as
its matrices."""
_TIGHTEST = 30
"""Rows of each interval, and of each keyframe, that enter the QP at a time where there are many. Measured in pipes: of
10,000 rows 100 to 200 decide; with 30 at a time three QPs with 1000 to 2000 rows take a quarter of the time of one."""
_VIOLATED = 1e-3
"""Violation above which a row that was left out enters the QP [u, rad]. Taste: a hundredth of the usual gap."""


@dataclass(frozen=True)
class QuadraticStep:
    """Solution of the QP of one step.

    Attributes:
        change: change of the unknowns of all keyframes, shape (K + 1, p); 0 for the first.
        slack: slack of the parts of intervals, in nominal links, shape (K m,).
        multipliers: multipliers of the rows, at least 0, shape (m,) [1/m].
        pull: multipliers of the tip's position, shape (d,) [1/m]; 0 when the last keyframe is fixed.
    """

    change: FloatArray
    slack: FloatArray
    multipliers: FloatArray
    pull: FloatArray


@dataclass(frozen=True)
class LinearMotion:
    """A motion linearised for one step.

    Attributes:
        sweep: the motion.
        objective: the quadratic objective.
        costs: further costs of the motion.
        rows: all rows that the motion has to keep.
        active: the rows that a step may reach.
        keyframe_rows: rows on single keyframes, which have to hold.
        equations: equations on single keyframes, which have to hold.
        end_rows: rows that hold the last keyframe, or the tip at its goal with the position first, shape (r, p).
        end_fixed: whether the last keyframe is fixed.
        unit: length of a nominal link, by which rows are scaled [m].
    """

    sweep: Sweep
    objective: Objective
    costs: tuple[MotionCost, ...]
    rows: IntervalRows
    active: IntervalRows
    keyframe_rows: tuple[KeyframeRows, ...]
    equations: tuple[KeyframeRows, ...]
    end_rows: FloatArray
    end_fixed: bool
    unit: float

    def cost(self, sweep: Sweep) -> float:
        """Return the objective and all costs of a motion."""
        return self.objective.value(sweep) + sum(cost.value(sweep) for cost in self.costs)

    def foreseen_cost(self, change: FloatArray) -> float:
        """Return the QP's model of the cost after a change of the unknowns, shape (K + 1, p)."""
        value = self.objective.foreseen(self.sweep, change)
        return value + sum(cost.foreseen(self.sweep, change) for cost in self.costs)

    def worst_rows(self, sweep: Sweep) -> FloatArray:
        """Return the largest row violation ≥ 0 in every part of the motion's intervals, shape (K m,) [m]."""
        # All rows count here, not only the thinned ones of the QP: a row that was left out may have become the worst.
        worst = np.zeros(sweep.intervals * sweep.parts)
        np.maximum.at(worst, self.rows.part(sweep), self.rows.values(sweep))
        return worst

    @cached_property
    def cost_models(self) -> tuple[Quadratic, ...]:
        """Quadratic models of the costs."""
        return tuple(cost.model(self.sweep) for cost in self.costs)


@dataclass(frozen=True)
class KeyframeProgram:
    """The QP of one step.

    Attributes:
        motion: linearised motion to step from.
        prices: price of one nominal link of slack in each part of an interval, shape (K m,).
        curvature: curvature of the rows; None where it is not known.
        damping: weight on the squared turns of the links.
    """

    motion: LinearMotion
    prices: FloatArray
    curvature: RowCurvature | None
    damping: float

    @property
    def _intervals(self) -> int:
        return self.motion.sweep.intervals

    @property
    def width(self) -> int:
        """Number of variables of one stage, which has the unknowns of a keyframe and the slack before the keyframe."""
        return int(self.motion.sweep.unknowns.shape[1]) + self.motion.sweep.parts

    def solve(self) -> QuadraticStep | None:
        """Return the solution of the QP; None where the solver fails."""
        p = self.width - self.motion.sweep.parts
        motion = self.motion
        result, multipliers = self._solved()
        if result is None:
            return None
        # Rows were divided by a nominal length; so are their multipliers, to belong to rows in metres.
        x = np.asarray(result.x).reshape(self._intervals, self.width)
        d = motion.rows.normal.shape[1]
        pull = np.zeros(d) if motion.end_fixed else np.asarray(result.y)[:d] / motion.unit
        multipliers = np.maximum(multipliers[: len(motion.active)], 0.0) / motion.unit
        return QuadraticStep(np.vstack((np.zeros(p), x[:, :p])), np.maximum(x[:, p:], 0.0).ravel(), multipliers, pull)

    def _solved(self) -> tuple[Any, FloatArray]:
        """Return the solver's result, or None where it fails, and the multipliers of all upper bounds.

        Where there are many rows, the tightest enter first, then rows that a solution violates, until none is violated.
        """
        matrix, lower, upper = self.inequalities()
        stage = np.concatenate((self.motion.active.interval, *(r.keyframe for r in self.motion.keyframe_rows)))
        stage[len(self.motion.active) :] += self._intervals
        fixed = (self.hessian(), self.gradient(), self.equations())
        if len(upper) <= _MANY_ROWS:
            entered = np.arange(len(upper))
        else:
            matrix = matrix.tocsr()
            entered = _largest(np.maximum(lower, -upper), stage, _TIGHTEST)
        while True:
            some = matrix if len(entered) == len(upper) else matrix[entered].tocsc()
            result = _solve(*fixed, some, lower[entered], upper[entered], self.lower_bounds())
            if result is None or result.info.status != piqp.PIQP_SOLVED or not np.isfinite(result.x).all():
                return None, upper
            reached = matrix @ np.asarray(result.x)
            excess = np.maximum(lower - reached, reached - upper)
            excess[entered] = 0.0
            violated = np.flatnonzero(excess > _VIOLATED)
            if len(violated) == 0:
                multipliers = np.zeros(len(upper))
                multipliers[entered] = np.asarray(result.z_u)
                return result, multipliers
            entered = np.union1d(entered, violated[_largest(excess[violated], stage[violated], _TIGHTEST)])

    def hessian(self) -> Any:
        """Return the Hessian, block-banded, shape (K width, K width)."""
        intervals = self._intervals
        p = self.width - self.motion.sweep.parts
        k, m = _block_places(intervals)
        blocks = np.zeros((len(k), self.width, self.width))
        blocks[:, :p, :p] = self.motion.objective.blocks(self.motion.sweep, k, m)

        own = k == m
        blocks[own, :p, :p] += self._diagonal()[1:]
        blocks[own, p:, p:] = _SLACK_CURVATURE * np.eye(self.motion.sweep.parts)
        if self.curvature is not None:
            # ½ c (δ_{k+1} − δ_k)²: +c on both diagonal blocks, −c between them.
            neighbours = np.abs(m - k) == 1
            blocks[neighbours, :p, :p] -= self.curvature.beside[np.minimum(k, m)[neighbours]]
        for model in self.motion.cost_models:
            blocks[m == k + 1, :p, :p] += model.above[1:]
            blocks[m == k - 1, :p, :p] += model.above[1:].transpose(0, 2, 1)

        size = intervals * self.width
        starts = np.concatenate(([0], np.cumsum(np.bincount(k - 1, minlength=intervals))))
        return sp.bsr_matrix((blocks, m - 1, starts), shape=(size, size)).tocsc()

    def _diagonal(self) -> FloatArray:
        """Return the diagonal blocks of the damping and of the curvature of rows and costs, shape (K + 1, p, p)."""
        # Levenberg–Marquardt damping, measured in turns of the links: it damps motion of the arm, not large unknowns.
        diagonal = self.damping * (
            self.motion.sweep.turn_metrics + _DAMPING_RIDGE * np.eye(self.width - self.motion.sweep.parts)
        )
        if self.curvature is not None:
            diagonal += self.curvature.diagonal
            diagonal[1:] += self.curvature.beside
            diagonal[:-1] += self.curvature.beside
        for model in self.motion.cost_models:
            diagonal += model.diagonal
        return diagonal

    def gradient(self) -> FloatArray:
        """Return the gradient, shape (K width,)."""
        gradient = self.motion.objective.gradient(self.motion.sweep)
        for model in self.motion.cost_models:
            gradient = gradient + model.gradient
        return np.column_stack((gradient[1:], self.prices.reshape(self._intervals, -1))).ravel()

    def lower_bounds(self) -> FloatArray:
        """Return the lower bounds, shape (K width,): 0 for slack, none for the unknowns."""
        bounds = np.full((self._intervals, self.width), -UNBOUNDED)
        bounds[:, -self.motion.sweep.parts :] = 0.0
        return bounds.ravel()

    def equations(self) -> Any:
        """Return the rows that hold the last keyframe, or its tip at the goal, and the equations of other keyframes."""
        # Right-hand sides are 0: the last keyframe is already on the goal, and a step only has to keep it there to
        # first order.
        end = self.motion.end_rows
        parts = [self._at_keyframes(np.full(len(end), self._intervals), end)]
        for equations in self.motion.equations:
            # A fixed end meets them already; duplicate rows would make the equations dependent.
            moves = (equations.keyframe < self._intervals) | (not self.motion.end_fixed)
            parts.append(self._at_keyframes(equations.keyframe[moves], equations.slopes[moves]))
        return sp.vstack(parts).tocsc()

    def _at_keyframes(self, keyframe: IntArray, slopes: FloatArray) -> Any:
        """Return the rows of single keyframes after the first as a sparse matrix, each slope of shape (p,)."""
        count, p = slopes.shape
        row = np.repeat(np.arange(count), p)
        column = ((keyframe - 1)[:, None] * self.width + np.arange(p)).ravel()
        return sp.csc_matrix((slopes.ravel(), (row, column)), shape=(count, self._intervals * self.width))

    def inequalities(self) -> tuple[Any, FloatArray, FloatArray]:
        """Return the matrix and bounds of the interval rows, less their slack, and of the keyframe rows."""
        active = self.motion.active
        data, row, column = self._row_entries()
        m = len(active)
        matrices = [sp.csc_matrix((data, (row, column)), shape=(m, self._intervals * self.width))]
        lower = [np.full(m, -UNBOUNDED)]
        upper = [-active.values(self.motion.sweep) / self.motion.unit]
        for rows in self.motion.keyframe_rows:
            matrices.append(self._at_keyframes(rows.keyframe, rows.slopes))
            lower.append(rows.lower)
            upper.append(rows.upper)
        return sp.vstack(matrices).tocsc(), np.concatenate(lower), np.concatenate(upper)

    def _row_entries(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the entries of the linearised rows as (data, row, column).

        The first keyframe is fixed and has no columns.
        """
        parts = self.motion.sweep.parts
        p = self.width - parts
        unit = self.motion.unit
        k = self.motion.active.interval
        start, end = self.motion.active.slopes(self.motion.sweep)
        # Interval k: unknowns of keyframe k, then those of k + 1 and the slack of k, which are adjacent in one stage.
        # One slack per part keeps the QP small; the price applies to it.
        slack = self.motion.active.part(self.motion.sweep) - parts * k
        data = np.column_stack((start / unit, end / unit, np.where(slack[:, None] == np.arange(parts), -1.0, 0.0)))
        data[k == 0, :p] = 0.0

        # Columns begin at keyframe 1. Rows of interval 0 have no entries for keyframe 0: np.maximum only keeps their
        # indices legal, the zeros are dropped below.
        columns = np.empty(data.shape, dtype=np.intp)
        columns[:, :p] = (np.maximum(k - 1, 0) * self.width)[:, None] + np.arange(p)
        columns[:, p:] = (k * self.width)[:, None] + np.arange(self.width)

        row, place = np.nonzero(data)
        return data[row, place], row, columns[row, place]


@lru_cache(maxsize=8)
def _block_places(intervals: int) -> tuple[IntArray, IntArray]:
    """Return block rows and columns, from 1, of the Hessian; second differences couple keyframes up to two apart."""
    row, column = np.indices((intervals, intervals)).reshape(2, -1) + 1
    near = np.abs(row - column) <= 2
    return row[near], column[near]


def _largest(values: FloatArray, group: IntArray, most: int) -> IntArray:
    """Return the indices of the largest values, at most ``most`` per group; both arrays have the shape (m,)."""
    order = np.lexsort((-values, group))
    ordered = group[order]
    place = np.arange(len(group)) - np.searchsorted(ordered, ordered)
    return np.sort(order[place < most])


def _solve(
    hessian: Any,
    gradient: FloatArray,
    equal: Any,
    matrix: Any,
    lower: FloatArray,
    upper: FloatArray,
    least: FloatArray,
) -> Any:
    """Solve min ½ xᵀHx + gᵀx, equal x = 0, lower ≤ matrix x ≤ upper, x ≥ least; None where the solver raises."""
    try:
        solver = piqp.SparseSolver()
        _set(solver.settings)
        most = np.full(len(gradient), UNBOUNDED)
        solver.setup(hessian, gradient, equal, np.zeros(equal.shape[0]), matrix, lower, upper, least, most)
        solver.solve()
    except RuntimeError:
        return None
    return solver.result


def _set(settings: Any) -> None:
    """Apply the tolerances and options of this module to the solver's settings."""
    settings.verbose = False
    # Factors the block-banded system stage by stage, in time linear in the number of keyframes.
    settings.kkt_solver = piqp.sparse_multistage
    settings.eps_abs = _QP_TOLERANCE
    settings.eps_rel = _QP_TOLERANCE
    settings.eps_duality_gap_abs = _QP_GAP
    settings.eps_duality_gap_rel = 0.1 * _QP_GAP
    settings.max_iter = _QP_ITERATIONS
