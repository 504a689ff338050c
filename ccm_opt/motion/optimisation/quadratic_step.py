"""One step of the sequential convex programming: a block-banded sparse QP over all keyframes, solved by PIQP.

Unknowns are the changes of the coordinates of keyframes 1..K, and one slack for each interval. Rows are linearised;
their curvature, weighted by the multipliers of the step before, is in the Hessian where it is convex: positions and
sag are diagonal in headings, so that dropping negative entries is the exact projection onto convex ones.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.optimisation.clearance_rows import Rows
from ccm_opt.motion.optimisation.nearness import Quadratic, SweepCost
from ccm_opt.motion.optimisation.objective import Objective
from ccm_opt.motion.optimisation.own_terms import KeyframeTerms
from ccm_opt.motion.optimisation.swept_motion import Sweep
from ccm_opt.motion.step import LIMIT_SHARE

_FREE = 1e30
_SMALLEST_SLACK_CURVATURE = 1e-6
_NEAR_LIMIT = 0.25
"""Bends nearer to their limit than this get rows [rad]."""


@dataclass(frozen=True)
class Curvature:
    """Second derivatives of the weighted rows, diagonal in headings and in their turns over the intervals.

    Attributes:
        headings: shape (K + 1, n) [1/rad²].
        turns: shape (K, n) [1/rad²].
    """

    headings: FloatArray
    turns: FloatArray

    @classmethod
    def none(cls, sweep: Sweep) -> "Curvature":
        """No curvature."""
        return cls(np.zeros_like(sweep.headings), np.zeros_like(sweep.turns))


@dataclass(frozen=True)
class Step:
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
class StepProblem:
    """What a step is asked for.

    Attributes:
        sweep: the motion to step from.
        objective: what to make small.
        rows: what to keep.
        prices: of one nominal link (24 to the arm) of slack in each interval, shape (K,).
        curvature: of the rows.
        damping: weight on the squared turns of the links.
        goal: where the tip has to stay.
        end_fixed: whether the last keyframe is fixed.
        nearness: what nearness to walls, and whatever the user asks for, costs.
        own: the user's constraints, or None.
    """

    sweep: Sweep
    objective: Objective
    rows: Rows
    prices: FloatArray
    curvature: Curvature
    damping: float
    goal: GoalPose
    end_fixed: bool
    nearness: SweepCost | None = None
    own: KeyframeTerms | None = None

    @cached_property
    def _near(self) -> Quadratic | None:
        return None if self.nearness is None else self.nearness.model(self.sweep)

    @property
    def unit(self) -> float:
        """The nominal link [m]."""
        return self.sweep.space.arm.length / 24.0

    @property
    def width(self) -> int:
        """Unknowns of one stage: coordinates and slack."""
        return int(self.sweep.space.matrix.shape[1]) + 1

    def solve(self) -> Step:
        """Solve the QP."""
        intervals, p, unit = len(self.sweep.turns), self.width - 1, self.unit
        result = _solve(self.hessian(), self.gradient(), self.end_rows(), *self.inequalities(), self.lower_bounds())
        x = np.asarray(result.x).reshape(intervals, self.width)
        pull = np.zeros(2) if self.end_fixed else np.asarray(result.y)[:2] / unit
        multipliers = np.maximum(np.asarray(result.z_u)[: len(self.rows)], 0.0) / unit
        solved = result.info.status == piqp.PIQP_SOLVED and bool(np.isfinite(x).all())
        return Step(np.vstack((np.zeros(p), x[:, :p])), np.maximum(x[:, p], 0.0), multipliers, pull, solved)

    def hessian(self) -> Any:
        """Hessian, block-banded, shape (K width, K width)."""
        intervals, p = len(self.sweep.turns), self.width - 1
        blocks, columns, starts = [], [], [0]
        diagonal, beside = self._row_blocks()
        for k in range(1, intervals + 1):
            for m in range(max(1, k - 2), min(intervals, k + 2) + 1):
                block = np.zeros((self.width, self.width))
                block[:p, :p] = self.objective.block(k, m)
                if m == k:
                    block[:p, :p] += diagonal[k]
                    block[p, p] = _SMALLEST_SLACK_CURVATURE
                elif abs(m - k) == 1:
                    block[:p, :p] -= beside[min(k, m)]
                    block[:p, :p] += self._between(k, m)
                blocks.append(block)
                columns.append(m - 1)
            starts.append(len(blocks))
        size = intervals * self.width
        return sp.bsr_matrix((np.array(blocks), columns, starts), shape=(size, size)).tocsc()

    def _between(self, k: int, m: int) -> FloatArray:
        """Block that nearness to walls adds between neighbouring keyframes."""
        if self._near is None:
            return np.zeros((self.width - 1, self.width - 1))
        block: FloatArray = self._near.above[k] if m > k else self._near.above[m].T
        return block

    def _row_blocks(self) -> tuple[FloatArray, FloatArray]:
        """Curvature of the rows and damping: blocks on the diagonal, and of turns between neighbours."""
        matrix = self.sweep.space.matrix
        beside = np.einsum("np,kn,nq->kpq", matrix, np.maximum(self.curvature.turns, 0.0), matrix)
        diagonal = np.einsum("np,kn,nq->kpq", matrix, np.maximum(self.curvature.headings, 0.0), matrix)
        diagonal += self.damping * (matrix.T @ matrix + 1e-3 * np.eye(matrix.shape[1]))
        diagonal[1:] += beside
        diagonal[:-1] += beside
        if self._near is not None:
            diagonal += self._near.diagonal
        return diagonal, beside

    def gradient(self) -> FloatArray:
        """Gradient, shape (K width,)."""
        gradient = self.objective.gradient(self.sweep.coordinates)
        if self._near is not None:
            gradient = gradient + self._near.gradient
        return np.column_stack((gradient[1:], self.prices)).ravel()

    def lower_bounds(self) -> FloatArray:
        """Slack is at least 0, shape (K width,)."""
        bounds = np.full((len(self.sweep.turns), self.width), -_FREE)
        bounds[:, -1] = 0.0
        return bounds.ravel()

    def end_rows(self) -> Any:
        """Rows that hold the last keyframe, or its tip position and heading."""
        p, links = self.width - 1, self.sweep.space.arm.links
        rows = np.zeros(
            (p if self.end_fixed else 2 + (self.goal.heading is not None), len(self.sweep.turns) * self.width)
        )
        last = slice(rows.shape[1] - self.width, rows.shape[1] - 1)
        if self.end_fixed:
            rows[:, last] = np.eye(p)
        else:
            rows[:2, last] = self.sweep.jacobians[-1, links] / self.unit
            rows[2:, last] = self.sweep.space.matrix[-1]
        if self.own is None:
            return sp.csc_matrix(rows)
        keyframe, slopes = self.own.equations(self.sweep)
        moves = (keyframe < len(self.sweep.turns)) | (not self.end_fixed)
        return sp.vstack((sp.csc_matrix(rows), self._at_keyframes(keyframe[moves], slopes[moves]))).tocsc()

    def _at_keyframes(self, keyframe: IntArray, slopes: FloatArray) -> Any:
        """Rows of single keyframes after the first, each slope of shape (p,)."""
        count, p = slopes.shape
        row = np.repeat(np.arange(count), p)
        column = ((keyframe - 1)[:, None] * self.width + np.arange(p)).ravel()
        return sp.csc_matrix((slopes.ravel(), (row, column)), shape=(count, len(self.sweep.turns) * self.width))

    def inequalities(self) -> tuple[Any, FloatArray, FloatArray]:
        """Matrix, lower and upper bounds of the rows (less their interval's slack) and of the joint limits."""
        data, row, column = self._row_entries()
        limits, keyframe, joint = self._joint_limits()
        p, m = self.width - 1, len(self.rows)
        data = np.concatenate((data, self.objective.bend_rows[joint].ravel()))
        row = np.concatenate((row, np.repeat(m + np.arange(len(joint)), p)))
        column = np.concatenate((column, ((keyframe - 1)[:, None] * self.width + np.arange(p)).ravel()))
        shape = (m + len(joint), len(self.sweep.turns) * self.width)
        lower = np.concatenate((np.full(m, -_FREE), limits[0]))
        upper = np.concatenate((-self.rows.values(self.sweep) / self.unit, limits[1]))
        matrix = sp.csc_matrix((data, (row, column)), shape=shape)
        if self.own is None:
            return matrix, lower, upper
        keyframe, slopes, least = self.own.gaps(self.sweep)
        matrix = sp.vstack((matrix, self._at_keyframes(keyframe, slopes))).tocsc()
        return matrix, np.concatenate((lower, least)), np.concatenate((upper, np.full(len(least), _FREE)))

    def _row_entries(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Entries of the linearised rows as (data, row, column); the first keyframe is fixed and has no columns."""
        p, k = self.width - 1, self.rows.interval
        start, end = self.rows.slopes(self.sweep)
        data = np.column_stack((start / self.unit, end / self.unit, np.full(len(k), -1.0)))
        data[k == 0, :p] = 0.0
        columns = np.empty(data.shape, dtype=np.intp)
        columns[:, :p] = (np.maximum(k - 1, 0) * self.width)[:, None] + np.arange(p)
        columns[:, p:] = (k * self.width)[:, None] + np.arange(self.width)
        row, place = np.nonzero(data)
        return data[row, place], row, columns[row, place]

    def _joint_limits(self) -> tuple[tuple[FloatArray, FloatArray], IntArray, IntArray]:
        """Bounds on the change of bends near their limits, with keyframe and joint of each."""
        arm = self.sweep.space.arm
        limits = np.broadcast_to(LIMIT_SHARE * arm.bend_limits, self.sweep.headings.shape)
        bends = arm.bends(self.sweep.headings)
        near = np.abs(bends) + _NEAR_LIMIT > limits
        near[0] = False
        keyframe, joint = np.nonzero(near)
        bounds = np.minimum((-limits - bends)[near], 0.0), np.maximum((limits - bends)[near], 0.0)
        return bounds, keyframe, joint


def _solve(
    hessian: Any, gradient: FloatArray, equal: Any, matrix: Any, lower: FloatArray, upper: FloatArray, least: FloatArray
) -> Any:
    """Solve min ½ xᵀHx + gᵀx, equal x = 0, lower ≤ matrix x ≤ upper, x ≥ least."""
    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.verbose = False
    settings.kkt_solver = piqp.sparse_multistage
    settings.eps_abs = settings.eps_rel = 1e-5
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = 1e-3, 1e-4
    settings.max_iter = 60
    most = np.full(len(gradient), _FREE)
    solver.setup(hessian, gradient, equal, np.zeros(equal.shape[0]), matrix, lower, upper, least, most)
    solver.solve()
    return solver.result
