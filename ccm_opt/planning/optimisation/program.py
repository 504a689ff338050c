"""Quadratic program of one step of trajectory optimisation, sparse and block-banded over all keyframes, solved by PIQP.

Variables are the changes of the unknowns of keyframes 1..K, and one slack per part of an interval. Constraint rows are
linearised; the convex part of their second derivatives, weighted by the multipliers of the previous step, enters the
Hessian if the motion provides it.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, MotionCost, Quadratic
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep
from ccm_opt.planning.optimisation.objective import Objective
from ccm_opt.problem.solution import ClearanceLimit

_DAMPING_RIDGE = 1e-3
"""Additional damping of the unknowns, relative to that of the link rotations. Heuristic."""
_SLACK_CURVATURE = 1e-6
"""Second derivative of the objective by every slack variable, so that the Hessian is positive definite. Heuristic."""

_QP_TOLERANCE = 1e-5
"""Absolute and relative tolerance of the QP solution. Heuristic."""
_QP_GAP = 1e-3
"""Absolute duality gap of the QP solution; the relative gap is a tenth. Heuristic."""
_QP_ITERATIONS = 60
"""Maximum number of iterations of the QP solver. Heuristic."""
_MANY_ROWS = 2000
"""Number of constraints above which the QP is first solved with the tightest ones alone.

Heuristic: with as many constraints, solving takes as long as building the matrices.
"""
_TIGHTEST = 30
"""Number of constraints per interval, and per keyframe, that enter the QP at a time if there are many.

Measured in pipes: of 10,000 constraints 100 to 200 are active; with 30 at a time three QPs with 1000 to 2000
constraints take a quarter of the time of one QP with all of them.
"""
_VIOLATED = 1e-3
"""Violation above which a constraint that was left out enters the QP [nominal links, rad].

Heuristic: a hundredth of the usual gap.
"""


@dataclass(frozen=True)
class QuadraticStep:
    """Solution of the QP of one optimisation step.

    Attributes:
        change: change of the unknowns of all K + 1 keyframes, shape (K + 1, p); 0 for the first.
        slack: slack of every part of every interval, in nominal links, shape (parts,).
        multipliers: multipliers of the constraints over intervals, at least 0, shape (constraints,) [1/m].
        pull: multipliers of the tip's position at the goal, shape (d,) [1/m]; 0 if the last keyframe is fixed.
        entered: indices of the inequalities that the QP had in the end, shape (e,).
    """

    change: FloatArray
    slack: FloatArray
    multipliers: FloatArray
    pull: FloatArray
    entered: IntArray


@dataclass(frozen=True)
class LinearMotion:
    """Motion with objective and constraints linearised for one optimisation step.

    Attributes:
        sweep: the motion.
        objective: quadratic part of the objective.
        costs: further costs of the motion.
        rows: all linearised constraints over intervals.
        active: those constraints over intervals that the step may reach.
        keyframe_rows: inequalities on single keyframes, without slack.
        equations: equations on single keyframes.
        end_rows: derivatives of the equations that hold the last keyframe, or the tip at its goal with the position
            first, shape (r, p).
        end_fixed: whether the last keyframe is fixed.
        unit: length of a nominal link, by which constraints are scaled [m].
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
        """Return the whole objective of a motion: the quadratic part plus all further costs."""
        return self.objective.value(sweep) + sum(cost.value(sweep) for cost in self.costs)

    def predicted_cost(self, change: FloatArray) -> float:
        """Return the whole objective that the quadratic model predicts after a change of the unknowns, (K + 1, p)."""
        value = self.objective.predicted(self.sweep, change)
        return value + sum(cost.predicted(self.sweep, change) for cost in self.costs)

    def worst_rows(self, sweep: Sweep) -> FloatArray:
        """Return the largest violation of a constraint in every part of the intervals, at least 0, (parts,) [m]."""
        # All rows count here, not only the thinned ones of the QP: a row that was left out may have become the worst.
        worst = np.zeros(sweep.intervals * sweep.parts)
        np.maximum.at(worst, self.rows.part(sweep), self.rows.values(sweep))
        return worst

    @cached_property
    def cost_models(self) -> tuple[Quadratic, ...]:
        """Quadratic models, at the motion, of all costs beyond the quadratic objective."""
        return tuple(cost.model(self.sweep) for cost in self.costs)


@dataclass(frozen=True)
class KeyframeProgram:
    """Quadratic program for one optimisation step of a motion with K intervals.

    Attributes:
        motion: linearised motion from which the step starts.
        prices: price of one nominal link of slack in each part of each interval, shape (parts,).
        curvature: second derivatives of the constraints, weighted by their multipliers; None if not known.
        damping: weight on the squared rotations of the links in the step.
        first: indices of inequalities with which the QP is solved first if there are many, such as those of another
            step from the same motion, shape (e,); None for the tightest.
    """

    motion: LinearMotion
    prices: FloatArray
    curvature: RowCurvature | None
    damping: float
    first: IntArray | None = None

    @property
    def _intervals(self) -> int:
        return self.motion.sweep.intervals

    @property
    def width(self) -> int:
        """Number of QP variables per stage, for the unknowns of a keyframe and the slacks of the interval before."""
        return int(self.motion.sweep.unknowns.shape[1]) + self.motion.sweep.parts

    def solve(self) -> QuadraticStep | None:
        """Return the solution of the QP, or None if the solver fails."""
        p = self.width - self.motion.sweep.parts
        motion = self.motion
        result, multipliers, entered = self._solved()
        if result is None:
            return None
        # Rows were divided by a nominal length, so multipliers are divided, too, to belong to rows in metres.
        x = np.asarray(result.x).reshape(self._intervals, self.width)
        d = motion.rows.normal.shape[1]
        pull = np.zeros(d) if motion.end_fixed else np.asarray(result.y)[:d] / motion.unit
        multipliers = np.maximum(multipliers[: len(motion.active)], 0.0) / motion.unit
        change = np.vstack((np.zeros(p), x[:, :p]))
        return QuadraticStep(change, np.maximum(x[:, p:], 0.0).ravel(), multipliers, pull, entered)

    def clearance_limit(self, improvement: float) -> ClearanceLimit | None:
        """Return the cause that keeps the least clearance of the motion from growing.

        The result is None if the solver fails, no constraint lacks clearance, or nothing holds the arm against more.

        At the solution of the QP the forces λ ∇g of all active constraints g, and the negative gradient of the cost,
        add up to zero. The cause is the kind of forces (walls, links, goal, length, costs or other limits) with the
        largest sum against that of the constraint that lacks most clearance. Damping of the step is not among them.

        Args:
            improvement: fraction of the missing clearance that a step has to gain for the answer ``"steps"``: the
                motion could still be improved, but no step that does so was accepted.
        """
        motion = self.motion
        result, multipliers, _ = self._solved()
        if result is None:
            return None
        x = np.asarray(result.x)
        unknown = np.tile(np.arange(self.width) < self.width - motion.sweep.parts, self._intervals)
        matrix, _, _ = self.inequalities()
        count = len(motion.active)
        # Rows of one part share their slack; the one that lacks most carries the largest multiplier.
        part = int(np.argmax(motion.worst_rows(motion.sweep)))
        of_part = np.flatnonzero(motion.active.part(motion.sweep) == part)
        if len(of_part) == 0:
            return None  # clearance is lacking between the rows only
        worst = of_part[np.argmax(multipliers[of_part])]
        slack = x[~unknown][part]
        if slack < (1.0 - improvement) * float(motion.worst_rows(motion.sweep)[part]) / motion.unit:
            return "steps"
        force = np.where(unknown, multipliers[worst] * matrix[[worst]].toarray()[0], 0.0)
        rows = multipliers * (matrix @ force)
        rows[worst] = 0.0
        against: dict[ClearanceLimit, float] = {
            "walls": _opposing(rows[:count][motion.active.against_walls]),
            "links": _opposing(rows[:count][~motion.active.against_walls]),
            **self._against_by_cost(x, force),
        }
        held = np.asarray(result.y) * (self.equations() @ force)
        ends = len(motion.end_rows)
        against["goal"] = _opposing(held[:ends])
        equal = [(kept.kind, int(np.count_nonzero(self._apart_from_end(kept)))) for kept in motion.equations]
        bounded = [(kept.kind, len(kept.keyframe)) for kept in motion.keyframe_rows]
        for forces, groups in ((held[ends:], equal), (rows[count:], bounded)):
            first = 0
            for kind, number in groups:
                against[kind] = against.get(kind, 0.0) + _opposing(forces[first : first + number])
                first += number
        cause = max(against, key=against.__getitem__)
        return cause if multipliers[worst] > 0.0 and against[cause] > 0.0 else None

    def _against_by_cost(self, x: FloatArray, force: FloatArray) -> dict[ClearanceLimit, float]:
        """Return by how much the length of the motion and its further costs oppose a force, both at a solution.

        Args:
            x: solution of the QP, shape (K width,).
            force: the force, 0 for slack variables, shape (K width,).
        """
        p = self.width - self.motion.sweep.parts
        change, push = (np.vstack((np.zeros(p), v.reshape(self._intervals, -1)[:, :p])) for v in (x, force))
        costs = sum(float(np.vdot(model.gradient_after(change), push)) for model in self.motion.cost_models)
        undamped = replace(self, damping=0.0, curvature=None)
        length = float((undamped.hessian() @ x + self.gradient()) @ force) - costs
        return {"length": max(-length, 0.0), "costs": max(-costs, 0.0)}

    def _solved(self) -> tuple[Any, FloatArray, IntArray]:
        """Return PIQP's result, the multipliers of all m inequalities, (m,), and the indices of those used, (e,).

        The result is None if the solver fails. Multipliers are positive at upper and negative at lower bounds.

        If there are many constraints, the tightest enter the QP first, then those that the solution violates, until
        none is violated.
        """
        matrix, lower, upper = self.inequalities()
        stage = np.concatenate((self.motion.active.interval, *(r.keyframe for r in self.motion.keyframe_rows)))
        stage[len(self.motion.active) :] += self._intervals
        fixed = (self.hessian(), self.gradient(), self.equations())
        if len(upper) <= _MANY_ROWS:
            entered = np.arange(len(upper))
        else:
            matrix = matrix.tocsr()
            entered = _largest(np.maximum(lower, -upper), stage, _TIGHTEST) if self.first is None else self.first
        while True:
            some = matrix if len(entered) == len(upper) else matrix[entered].tocsc()
            result = _solve(*fixed, some, lower[entered], upper[entered], self.lower_bounds())
            if result is None or result.info.status != piqp.PIQP_SOLVED or not np.isfinite(result.x).all():
                return None, upper, entered
            reached = matrix @ np.asarray(result.x)
            excess = np.maximum(lower - reached, reached - upper)
            excess[entered] = 0.0
            violated = np.flatnonzero(excess > _VIOLATED)
            if len(violated) == 0:
                multipliers = np.zeros(len(upper))
                multipliers[entered] = np.asarray(result.z_u) - np.asarray(result.z_l)
                return result, multipliers, entered
            entered = np.union1d(entered, violated[_largest(excess[violated], stage[violated], _TIGHTEST)])

    def hessian(self) -> Any:
        """Return the Hessian of the QP, sparse and block-banded, shape (K width, K width)."""
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
        """Return the diagonal Hessian blocks of damping, constraints and further costs, shape (K + 1, p, p)."""
        # Levenberg–Marquardt damping in terms of link rotations: it damps motion of the arm, not large unknowns.
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
        """Return the gradient of the QP's objective, shape (K width,)."""
        gradient = self.motion.objective.gradient(self.motion.sweep)
        for model in self.motion.cost_models:
            gradient = gradient + model.gradient
        return np.column_stack((gradient[1:], self.prices.reshape(self._intervals, -1))).ravel()

    def lower_bounds(self) -> FloatArray:
        """Return the lower bounds of the QP variables, 0 for slack and none for the unknowns, shape (K width,)."""
        bounds = np.full((self._intervals, self.width), -UNBOUNDED)
        bounds[:, -self.motion.sweep.parts :] = 0.0
        return bounds.ravel()

    def equations(self) -> Any:
        """Return the matrix of the QP equations, for the end of the motion and for single keyframes."""
        # Right-hand sides are 0: the last keyframe is already on the goal, and a step only has to keep it there to
        # first order.
        end = self.motion.end_rows
        parts = [self._at_keyframes(np.full(len(end), self._intervals), end)]
        for equations in self.motion.equations:
            moves = self._apart_from_end(equations)
            parts.append(self._at_keyframes(equations.keyframe[moves], equations.slopes[moves]))
        return sp.vstack(parts).tocsc()

    def _apart_from_end(self, equations: KeyframeRows) -> BoolArray:
        """Return which equations enter the QP, shape (m,): all, or all but those of a fixed last keyframe."""
        # A fixed end satisfies these already; duplicate rows would make the equations dependent.
        return (equations.keyframe < self._intervals) | (not self.motion.end_fixed)

    def _at_keyframes(self, keyframe: IntArray, slopes: FloatArray) -> Any:
        """Return constraints on single keyframes as a sparse matrix over all QP variables, shape (m, K width).

        Args:
            keyframe: index of the keyframe of each constraint, at least 1, shape (m,).
            slopes: derivatives with respect to the unknowns of the keyframe, shape (m, p).
        """
        count, p = slopes.shape
        row = np.repeat(np.arange(count), p)
        column = ((keyframe - 1)[:, None] * self.width + np.arange(p)).ravel()
        return sp.csc_matrix((slopes.ravel(), (row, column)), shape=(count, self._intervals * self.width))

    def inequalities(self) -> tuple[Any, FloatArray, FloatArray]:
        """Return matrix, lower and upper bounds of the inequalities: over intervals, with slack, then on keyframes."""
        active = self.motion.active
        data, row, column = self._row_entries()
        m = len(active)
        matrices = [sp.csc_matrix((data, (row, column)), shape=(m, self._intervals * self.width))]
        lower = [np.full(m, -UNBOUNDED)]
        upper = [-active.values(self.motion.sweep) / self.motion.unit]
        for rows in self.motion.keyframe_rows:
            matrices.append(self._at_keyframes(rows.keyframe, rows.slopes))
            if rows.before is not None:
                moves = rows.keyframe > 1
                matrices[-1] += self._at_keyframes(np.maximum(rows.keyframe - 1, 1), rows.before * moves[:, None])
            lower.append(rows.lower)
            upper.append(rows.upper)
        return sp.vstack(matrices).tocsc(), np.concatenate(lower), np.concatenate(upper)

    def _row_entries(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the nonzero entries of the interval constraints as (data, row, column) of a sparse matrix.

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


def _opposing(products: FloatArray) -> float:
    """Return the sum of the magnitudes of the negative values among scalar products of forces with one force."""
    return -float(np.sum(np.minimum(products, 0.0)))


@lru_cache(maxsize=8)
def _block_places(intervals: int) -> tuple[IntArray, IntArray]:
    """Return the block rows and columns, counted from 1, of the nonzero Hessian blocks, each of shape (b,).

    Second differences couple keyframes up to two apart.
    """
    row, column = np.indices((intervals, intervals)).reshape(2, -1) + 1
    near = np.abs(row - column) <= 2
    return row[near], column[near]


def _largest(values: FloatArray, group: IntArray, most: int) -> IntArray:
    """Return the sorted indices of the largest values, at most ``most`` per group.

    Args:
        values: the values, shape (m,).
        group: index of the group of each value, shape (m,).
        most: maximum number per group.
    """
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
    """Return PIQP's result for min ½ xᵀHx + gᵀx with equal x = 0, lower ≤ matrix x ≤ upper and x ≥ least.

    The result is None if the solver raises an exception.
    """
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
    """Set the tolerances and options of this module in the settings object of a PIQP solver."""
    settings.verbose = False
    # Factors the block-banded system stage by stage, in time linear in the number of keyframes.
    settings.kkt_solver = piqp.sparse_multistage
    settings.eps_abs = _QP_TOLERANCE
    settings.eps_rel = _QP_TOLERANCE
    settings.eps_duality_gap_abs = _QP_GAP
    settings.eps_duality_gap_rel = 0.1 * _QP_GAP
    settings.max_iter = _QP_ITERATIONS
