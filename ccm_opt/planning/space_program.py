"""One step of the optimisation: a block-banded sparse quadratic program over all keyframes, solved by PIQP."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.space_continuation import SpaceTipPose
from ccm_opt.planning.space_cost import SpaceMotionCost
from ccm_opt.planning.space_keyframes import CostWithTerms
from ccm_opt.planning.space_rows import KeyframeRows, SpaceRows
from ccm_opt.planning.space_settings import SpaceOptimisationSettings
from ccm_opt.planning.space_sweep import SpaceSweep

_DAMPING_RIDGE = 1e-3
"""Damping of unknowns beside that of the turns."""
_SPARE_TURN = 0.004
"""Of the limits that rows leave [rad, m]."""
_SLACK_CURVATURE = 1e-6
"""Curvature of slack, so that the Hessian is definite."""
_ITERATIONS = 60
"""Of the program."""

_NEAR_LIMIT = 0.3
"""Coordinates nearer to their limit than this are limited in the program [rad, m]."""
_KNOT_BEND = 1.1
"""Bound on the bend by the curvature at a knot of a fed arm, as a multiple of the joint limit; a joint takes the mean
about its place, which is less."""

_FAR = 1e30


@dataclass(frozen=True, eq=False)
class SpaceQuadraticStep:
    """The solution of the program.

    Attributes:
        change: of the unknowns of all keyframes, shape (K + 1, p); 0 for the first.
        slack: of the intervals, in nominal links, shape (K,).
        foreseen: by how much the cost falls by the model.
    """

    change: FloatArray
    slack: FloatArray
    foreseen: float


@dataclass(frozen=True, eq=False)
class SpaceKeyframeProgram:
    """What a step is asked.

    Attributes:
        sweep: the motion to step from.
        cost: what to make small.
        rows: what to keep, each less the slack of its interval.
        prices: of one nominal link of slack in each interval, shape (K,).
        damping: weight on the squared turns of the links.
        goal: where the tip has to stay; None where the last keyframe is fixed.
        settings: of the optimisation.
        held: rows on keyframes that hold without slack; None where there are none.
    """

    sweep: SpaceSweep
    cost: SpaceMotionCost | CostWithTerms
    rows: SpaceRows
    prices: FloatArray
    damping: float
    goal: SpaceTipPose | None
    settings: SpaceOptimisationSettings
    held: KeyframeRows | None = None

    def solve(self) -> SpaceQuadraticStep | None:
        """The step, or None where the solver finds none."""
        sweep = self.sweep
        count = sweep.intervals
        p = sweep.unknowns.shape[1]
        gradient, blocks, row, column = self.cost.model(sweep)
        hessian = self._hessian(blocks, row, column)
        linear = np.column_stack((gradient[1:], self.prices)).ravel()
        equal = self._end_rows()
        matrix, lower, upper = self._inequalities()
        if self.held is not None:
            own = self._held_rows(self.held)
            equal = sp.vstack((equal, own[: self.held.equal])).tocsc()
            matrix = sp.vstack((matrix, own[self.held.equal :])).tocsc()
            least_gain = self.held.lower[self.held.equal :]
            lower = np.concatenate((lower, least_gain))
            upper = np.concatenate((upper, np.full(len(least_gain), _FAR)))
        least = np.full((count, p + 1), -_FAR)
        least[:, p] = 0.0
        try:
            solver = piqp.SparseSolver()
            solver.settings.verbose = False
            solver.settings.kkt_solver = piqp.sparse_multistage
            solver.settings.eps_abs = self.settings.tolerance
            solver.settings.eps_rel = self.settings.tolerance
            solver.settings.max_iter = _ITERATIONS
            solver.setup(
                hessian,
                linear,
                equal,
                np.zeros(equal.shape[0]),
                matrix,
                lower,
                upper,
                least.ravel(),
                np.full(count * (p + 1), _FAR),
            )
            solver.solve()
        except RuntimeError:
            return None
        x = np.asarray(solver.result.x)
        if solver.result.info.status != piqp.PIQP_SOLVED or not np.all(np.isfinite(x)):
            return None
        x = x.reshape(count, p + 1)
        change = np.vstack((np.zeros(p), x[:, :p]))
        quadratic = np.einsum("bp,bpq,bq->", change[row], blocks, change[column])
        return SpaceQuadraticStep(change, np.maximum(x[:, p], 0.0), -float(np.vdot(gradient, change) + 0.5 * quadratic))

    def _hessian(self, blocks: FloatArray, row: IntArray, column: IntArray) -> Any:
        """Hessian of the keyframes after the first, each with the slack of the interval before it."""
        sweep = self.sweep
        count = sweep.intervals
        p = sweep.unknowns.shape[1]
        inner = (row > 0) & (column > 0)
        whole = np.zeros((int(np.sum(inner)), p + 1, p + 1))
        whole[:, :p, :p] = blocks[inner]
        own = row[inner] == column[inner]
        turning = sweep.turning[1:].reshape(count, -1, p)
        damping = turning.transpose(0, 2, 1) @ turning + _DAMPING_RIDGE * np.eye(p)
        whole[own, :p, :p] += self.damping * damping
        whole[own, p, p] = _SLACK_CURVATURE
        starts = np.concatenate(([0], np.cumsum(np.bincount(row[inner] - 1, minlength=count))))
        size = count * (p + 1)
        return sp.bsr_matrix((whole, column[inner] - 1, starts), shape=(size, size)).tocsc()

    def _end_rows(self) -> Any:
        """Rows that hold the last keyframe, or the tip at its goal."""
        sweep = self.sweep
        p = sweep.unknowns.shape[1]
        size = sweep.intervals * (p + 1)
        if self.goal is None:
            rows = np.eye(p)
        else:
            rows, _ = self.goal.rows(sweep.poses[-1], sweep.stepper.unit)
        whole = np.zeros((len(rows), size))
        whole[:, size - p - 1 : size - 1] = rows
        return sp.csc_matrix(whole)

    def _held_rows(self, held: KeyframeRows) -> Any:
        """Matrix of the rows on keyframes."""
        count = self.sweep.intervals
        p = self.sweep.unknowns.shape[1]
        m = len(held.keyframe)
        places = ((held.keyframe - 1) * (p + 1))[:, None] + np.arange(p)
        lines = np.repeat(np.arange(m), p)
        return sp.csr_matrix((held.rows.ravel(), (lines, places.ravel())), shape=(m, count * (p + 1)))

    def _inequalities(self) -> tuple[Any, FloatArray, FloatArray]:
        """Matrix and bounds of the rows over intervals, and of the limits of coordinates that are near them."""
        sweep = self.sweep
        unit = sweep.stepper.unit
        count = sweep.intervals
        p = sweep.unknowns.shape[1]
        width = p + 1
        rows = self.rows.take(self.rows.free)
        upper = -rows.values(sweep) / unit
        m = len(rows)
        data = [-np.ones(m)]
        line = [np.arange(m)]
        place = [rows.interval * width + p]
        for side in (0, 1):
            # At the start, which is given, there is nothing to change.
            moved = np.flatnonzero((rows.weight(side) > 0.0) & (rows.interval + side > 0))
            places = ((rows.interval[moved] + side - 1) * width)[:, None] + np.arange(p)
            data.append((rows.take(moved).slopes(sweep, side) / unit).ravel())
            line.append(np.repeat(moved, p))
            place.append(places.ravel())

        arm = sweep.curve.arm
        room_up = arm.upper_limits - sweep.configurations
        room_down = sweep.configurations - arm.lower_limits
        at, coordinate = np.nonzero(np.minimum(room_up, room_down)[1:] < _NEAR_LIMIT)
        at = at + 1
        limit_rows = sweep.slopes[at, coordinate]
        limit_lines = m + np.repeat(np.arange(len(at)), p)
        limit_places = (((at - 1) * width)[:, None] + np.arange(p)).ravel()
        spare = _SPARE_TURN
        high = np.maximum(room_up[at, coordinate] - spare, 0.0)
        low = np.maximum(room_down[at, coordinate] - spare, 0.0)

        knot_rows, knot_low, knot_high = self._knot_rows()
        matrix = sp.csc_matrix(
            (
                np.concatenate((*data, limit_rows.ravel())),
                (np.concatenate((*line, limit_lines)), np.concatenate((*place, limit_places))),
            ),
            shape=(m + len(at), count * width),
        )
        lower = np.concatenate((np.full(m, -_FAR), -low, knot_low))
        return sp.vstack((matrix, knot_rows)).tocsc(), lower, np.concatenate((upper, high, knot_high))

    def _knot_rows(self) -> tuple[Any, FloatArray, FloatArray]:
        """Bounds on the curvature at the knots of a fed arm; no rows for others.

        Between two keyframes the feed carries joints past knots at which no joint is at either of them.
        """
        sweep = self.sweep
        arm = sweep.curve.arm
        count = sweep.intervals
        p = sweep.unknowns.shape[1]
        if not arm.base_axes:
            return sp.csc_matrix((0, count * (p + 1))), np.zeros(0), np.zeros(0)
        rows = arm.link_length * sweep.curve.curvature_rows
        now = sweep.unknowns[1:] @ rows.T
        most = np.maximum(_KNOT_BEND * arm.joint_limit, np.abs(now))
        block = np.hstack((rows, np.zeros((len(rows), 1))))
        return sp.kron(sp.eye(count), block).tocsc(), (-most - now).ravel(), (most - now).ravel()
