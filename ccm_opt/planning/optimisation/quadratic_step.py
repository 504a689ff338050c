"""One step of the sequential convex programming: a block-banded sparse QP over all keyframes, solved by PIQP.

Unknowns are the changes of the coordinates of keyframes 1..K, and one slack for each interval. Rows are linearised;
their curvature, weighted by the multipliers of the step before, is in the Hessian where it is convex: positions and
sag are diagonal in headings, so that dropping negative entries is the exact projection onto convex ones.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.clearance_rows import IntervalRows
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, MotionCost, Quadratic
from ccm_opt.planning.link_space import NOMINAL_LINKS
from ccm_opt.planning.optimisation.objective import Objective
from ccm_opt.planning.settings import OptimisationSettings
from ccm_opt.planning.step import GoalPose
from ccm_opt.planning.swept_motion import Sweep

_DAMPING_RIDGE = 1e-3
"""Damping of coordinates beside that of the turns. Taste."""
_SLACK_CURVATURE = 1e-6
"""Curvature of slack, so that the Hessian is definite. Taste."""

_QP_TOLERANCE = 1e-5
"""Of the QP's solution. Taste."""
_QP_GAP = 1e-3
"""Duality gap of the QP's solution; a tenth of it relative. Taste."""
_QP_ITERATIONS = 60
"""Of the QP. Taste."""


@dataclass(frozen=True)
class RowCurvature:
    """Second derivatives of the weighted rows, diagonal in headings and in their turns over the intervals.

    Attributes:
        headings: shape (K + 1, n) [1/rad²].
        turns: shape (K, n) [1/rad²].
    """

    headings: FloatArray
    turns: FloatArray

    @classmethod
    def none(cls, sweep: Sweep) -> "RowCurvature":
        """No curvature."""
        return cls(np.zeros_like(sweep.headings), np.zeros_like(sweep.turns))


@dataclass(frozen=True)
class QuadraticStep:
    """The solution of the QP.

    Attributes:
        change: of the coordinates of all keyframes, shape (K + 1, p); 0 for the first.
        slack: of the intervals, in nominal links, shape (K,).
        multipliers: of the rows, at least 0, shape (m,) [1/m].
        pull: multipliers of the tip's position, shape (2,) [1/m]; 0 when the last keyframe is fixed.
        solved: whether the QP was solved.
    """

    change: FloatArray
    slack: FloatArray
    multipliers: FloatArray
    pull: FloatArray
    solved: bool


@dataclass(frozen=True)
class KeyframeProgram:
    """What a step is asked for.

    Attributes:
        sweep: the motion to step from.
        objective: what to make small.
        rows: what to keep.
        prices: of one nominal link of slack in each interval, shape (K,).
        curvature: of the rows.
        damping: weight on the squared turns of the links.
        goal: where the tip has to stay.
        end_fixed: whether the last keyframe is fixed.
        costs: of a motion beside the objective.
        keyframe_rows: on single keyframes, that have to hold.
        keyframe_equations: likewise.
        settings: of the QP.
    """

    sweep: Sweep
    objective: Objective
    rows: IntervalRows
    prices: FloatArray
    curvature: RowCurvature
    damping: float
    goal: GoalPose
    end_fixed: bool
    costs: tuple[MotionCost, ...] = ()
    keyframe_rows: tuple[KeyframeRows, ...] = ()
    keyframe_equations: tuple[KeyframeRows, ...] = ()
    settings: OptimisationSettings = field(default_factory=OptimisationSettings)

    @cached_property
    def _cost_models(self) -> list[Quadratic]:
        return [cost.model(self.sweep) for cost in self.costs]

    @property
    def nominal_length(self) -> float:
        """Length of a nominal link, by which rows are scaled whatever space the motion was planned in [m]."""
        return self.sweep.space.arm.length / NOMINAL_LINKS

    @property
    def width(self) -> int:
        """Unknowns of one stage: coordinates and slack."""
        return self.sweep.space.dimension + 1

    def solve(self) -> QuadraticStep:
        """Solve the QP."""
        intervals = len(self.sweep.turns)
        p = self.width - 1
        unit = self.nominal_length
        matrix, lower, upper = self.inequalities()
        result = _solve(
            self.hessian(),
            self.gradient(),
            self.end_rows(),
            matrix,
            lower,
            upper,
            self.lower_bounds(),
        )

        if result is None:
            nothing = np.zeros((intervals + 1, p))
            return QuadraticStep(nothing, np.zeros(intervals), np.zeros(len(self.rows)), np.zeros(2), solved=False)

        # Rows were divided by a nominal length; their multipliers have to be, too, to belong to rows in metres.
        x = np.asarray(result.x).reshape(intervals, self.width)
        pull = np.zeros(2) if self.end_fixed else np.asarray(result.y)[:2] / unit
        multipliers = np.maximum(np.asarray(result.z_u)[: len(self.rows)], 0.0) / unit
        solved = result.info.status == piqp.PIQP_SOLVED and bool(np.isfinite(x).all())
        return QuadraticStep(np.vstack((np.zeros(p), x[:, :p])), np.maximum(x[:, p], 0.0), multipliers, pull, solved)

    def hessian(self) -> Any:
        """Hessian, block-banded, shape (K width, K width)."""
        intervals = len(self.sweep.turns)
        p = self.width - 1
        k, m = _block_places(intervals)
        blocks = np.zeros((len(k), self.width, self.width))
        blocks[:, :p, :p] = self.objective.blocks(k, m)

        diagonal, beside = self._row_blocks()
        own = k == m
        blocks[own, :p, :p] += diagonal[1:]
        blocks[own, p, p] = _SLACK_CURVATURE
        # ½ c (δ_{k+1} − δ_k)²: +c on both diagonal blocks, −c between them.
        neighbours = np.abs(m - k) == 1
        blocks[neighbours, :p, :p] -= beside[np.minimum(k, m)[neighbours]]
        for model in self._cost_models:
            blocks[m == k + 1, :p, :p] += model.above[1:]
            blocks[m == k - 1, :p, :p] += model.above[1:].transpose(0, 2, 1)

        size = intervals * self.width
        starts = np.concatenate(([0], np.cumsum(np.bincount(k - 1, minlength=intervals))))
        return sp.bsr_matrix((blocks, m - 1, starts), shape=(size, size)).tocsc()

    def _row_blocks(self) -> tuple[FloatArray, FloatArray]:
        """Curvature of the rows and damping: blocks on the diagonal, and of turns between neighbours."""
        # Headings are affine in v, so a curvature that is diagonal in headings becomes Aᵀ diag(c) A.
        matrix = self.sweep.space.matrix
        beside = matrix.T @ (np.maximum(self.curvature.turns, 0.0)[:, :, None] * matrix)
        diagonal = matrix.T @ (np.maximum(self.curvature.headings, 0.0)[:, :, None] * matrix)

        # Levenberg–Marquardt damping, measured in turns of the links: it holds back what moves the arm, not whatever
        # has a large coordinate.
        diagonal += self.damping * (matrix.T @ matrix + _DAMPING_RIDGE * np.eye(matrix.shape[1]))
        diagonal[1:] += beside
        diagonal[:-1] += beside
        for model in self._cost_models:
            diagonal += model.diagonal
        return diagonal, beside

    def gradient(self) -> FloatArray:
        """Gradient, shape (K width,)."""
        gradient = self.objective.gradient(self.sweep.coordinates)
        for model in self._cost_models:
            gradient = gradient + model.gradient
        return np.column_stack((gradient[1:], self.prices)).ravel()

    def lower_bounds(self) -> FloatArray:
        """Slack is at least 0, shape (K width,)."""
        bounds = np.full((len(self.sweep.turns), self.width), -UNBOUNDED)
        bounds[:, -1] = 0.0
        return bounds.ravel()

    def end_rows(self) -> Any:
        """Rows that hold the last keyframe, or its tip position and heading."""
        p = self.width - 1
        links = self.sweep.space.arm.links
        rows = np.zeros(
            (p if self.end_fixed else 2 + (self.goal.heading is not None), len(self.sweep.turns) * self.width)
        )
        last = slice(rows.shape[1] - self.width, rows.shape[1] - 1)

        # Right-hand sides are 0: the last keyframe has been polished onto the goal, and a step only has to keep it
        # there to first order.
        if self.end_fixed:
            rows[:, last] = np.eye(p)
        else:
            rows[:2, last] = self.sweep.jacobians[-1, links] / self.nominal_length
            rows[2:, last] = self.sweep.space.tip_heading_row
        parts = [sp.csc_matrix(rows)]
        for equations in self.keyframe_equations:
            # A fixed end meets them already; the same row twice would make the equations dependent.
            moves = (equations.keyframe < len(self.sweep.turns)) | (not self.end_fixed)
            parts.append(self._at_keyframes(equations.keyframe[moves], equations.slopes[moves]))
        return sp.vstack(parts).tocsc()

    def _at_keyframes(self, keyframe: IntArray, slopes: FloatArray) -> Any:
        """Rows of single keyframes after the first, each slope of shape (p,)."""
        count, p = slopes.shape
        row = np.repeat(np.arange(count), p)
        column = ((keyframe - 1)[:, None] * self.width + np.arange(p)).ravel()
        return sp.csc_matrix((slopes.ravel(), (row, column)), shape=(count, len(self.sweep.turns) * self.width))

    def inequalities(self) -> tuple[Any, FloatArray, FloatArray]:
        """Matrix, lower and upper bounds of the rows (less their interval's slack) and of those on keyframes."""
        data, row, column = self._row_entries()
        m = len(self.rows)
        shape = (m, len(self.sweep.turns) * self.width)
        matrices = [sp.csc_matrix((data, (row, column)), shape=shape)]
        lower = [np.full(m, -UNBOUNDED)]
        upper = [-self.rows.values(self.sweep) / self.nominal_length]
        for rows in self.keyframe_rows:
            matrices.append(self._at_keyframes(rows.keyframe, rows.slopes))
            lower.append(rows.lower)
            upper.append(rows.upper)
        return sp.vstack(matrices).tocsc(), np.concatenate(lower), np.concatenate(upper)

    def _row_entries(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Entries of the linearised rows as (data, row, column); the first keyframe is fixed and has no columns."""
        p = self.width - 1
        k = self.rows.interval
        start, end = self.rows.slopes(self.sweep)
        # Interval k: coordinates of keyframe k, then those of k + 1 and the slack of k, which stand side by side in one
        # stage. One slack an interval keeps the QP small and is what the price is paid for.
        data = np.column_stack((start / self.nominal_length, end / self.nominal_length, np.full(len(k), -1.0)))
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
    """Rows and columns of the blocks, counted from 1: second differences tie a keyframe to the next but one."""
    row, column = np.indices((intervals, intervals)).reshape(2, -1) + 1
    near = np.abs(row - column) <= 2
    return row[near], column[near]


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
    """Put our settings into the solver's."""
    settings.verbose = False
    # Factors the block-banded system stage by stage, in time linear in the number of keyframes.
    settings.kkt_solver = piqp.sparse_multistage
    settings.eps_abs = _QP_TOLERANCE
    settings.eps_rel = _QP_TOLERANCE
    settings.eps_duality_gap_abs = _QP_GAP
    settings.eps_duality_gap_rel = 0.1 * _QP_GAP
    settings.max_iter = _QP_ITERATIONS
