"""Quadratic program of one step of trajectory optimisation over all keyframes, which are the stages of the program.

Variables are the changes of the unknowns of keyframes 1..K, and one slack per part of an interval. Constraint rows are
linearised; the convex part of their second derivatives, weighted by the multipliers of the previous step, enters the
Hessian if the motion provides it.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.planning.limits.limit import KeyframeRows, MotionCost, Quadratic
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep
from ccm_opt.planning.optimisation.objective import Objective
from ccm_opt.planning.optimisation.staged_program import (
    NO_PART,
    StageRows,
    StageSolution,
    joined_stage_rows,
    solve_stages,
)
from ccm_opt.problem.solution import ClearanceLimit

_DAMPING_RIDGE = 1e-3
"""Additional damping of the unknowns, relative to that of the link rotations. Heuristic."""


@dataclass(frozen=True)
class QuadraticStep:
    """Solution of the QP of one optimisation step.

    Attributes:
        change: change of the unknowns of all K + 1 keyframes, shape (K + 1, p); 0 for the first.
        slack: slack of every part of every interval, in nominal links, shape (parts,).
        multipliers: multipliers of the constraints over intervals, at least 0, shape (constraints,) [1/m].
        pull: multipliers of the tip's position at the goal, shape (d,) [1/m]; 0 if the last keyframe is fixed.
        deciding: the inequalities that decide the solution.
    """

    change: FloatArray
    slack: FloatArray
    multipliers: FloatArray
    pull: FloatArray
    deciding: "DecidingRows"


@dataclass(frozen=True, eq=False)
class DecidingRows:
    """The m inequalities of a QP that decide its solution, with which that of a similar one is found sooner.

    Attributes:
        keys: keys of the inequalities, shape (m,).
        yielding: mask of those whose part has slack, shape (m,).
    """

    keys: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    yielding: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def likely(self, keys: IntArray) -> IntArray:
        """Return for k inequalities of another QP whether they are among these, 2 for those with slack, shape (k,)."""
        return np.isin(keys, self.keys).astype(np.intp) + np.isin(keys, self.keys[self.yielding])


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
        deciding: inequalities that decided a similar program.
    """

    motion: LinearMotion
    prices: FloatArray
    curvature: RowCurvature | None
    damping: float
    deciding: DecidingRows = field(default_factory=DecidingRows)

    @property
    def _intervals(self) -> int:
        return self.motion.sweep.intervals

    def solve(self) -> QuadraticStep | None:
        """Return the solution of the QP, or None if the solver fails."""
        motion = self.motion
        found = self._solved()
        if found is None:
            return None
        # Rows were divided by a nominal length, so multipliers are divided, too, to belong to rows in metres.
        d = motion.rows.normal.shape[1]
        pull = np.zeros(d) if motion.end_fixed else found.pulls[:d] / motion.unit
        multipliers = found.multipliers[: len(motion.active)] / motion.unit
        change = np.vstack((np.zeros_like(found.x[:1]), found.x))
        yielding = np.zeros(len(self._keys), dtype=bool)
        yielding[: len(motion.active)] = found.slack[motion.active.part(motion.sweep)] > 0.0
        active = found.multipliers > 0.0
        return QuadraticStep(change, found.slack, multipliers, pull, DecidingRows(self._keys[active], yielding[active]))

    def _solved(self) -> StageSolution | None:
        likely = self.deciding.likely(self._keys)
        return solve_stages(self.hessian(), self.gradient(), self.equations(), self.inequalities(), self.prices, likely)

    @cached_property
    def _keys(self) -> IntArray:
        """Keys of the inequalities, in their order, shape (m,)."""
        over_intervals = self.motion.active.keys(self.motion.sweep)
        on_keyframes = sum(2 * len(each.keyframe) for each in self.motion.keyframe_rows)
        return np.concatenate((over_intervals, -1 - np.arange(on_keyframes)))

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
        found = self._solved()
        if found is None:
            return None
        every = self.inequalities()
        count = len(motion.active)
        # Rows of one part share their slack; the one that lacks most carries the largest multiplier.
        part = int(np.argmax(motion.worst_rows(motion.sweep)))
        of_part = np.flatnonzero(motion.active.part(motion.sweep) == part)
        if len(of_part) == 0:
            return None  # clearance is lacking between the rows only
        worst = of_part[np.argmax(found.multipliers[of_part])]
        if found.slack[part] < (1.0 - improvement) * float(motion.worst_rows(motion.sweep)[part]) / motion.unit:
            return "steps"
        force = found.multipliers[worst] * every.at(worst, self._intervals)
        rows = found.multipliers * every.times(force)
        rows[worst] = 0.0
        against: dict[ClearanceLimit, float] = {
            "walls": _opposing(rows[:count][motion.active.against_walls]),
            "links": _opposing(rows[:count][~motion.active.against_walls]),
            **self._against_by_cost(found.x, force),
        }
        held = found.pulls * self.equations().times(force)
        ends = len(motion.end_rows)
        against["goal"] = _opposing(held[:ends])
        equal = [(kept.kind, int(np.count_nonzero(self._apart_from_end(kept)))) for kept in motion.equations]
        bounded = [(kept.kind, 2 * len(kept.keyframe)) for kept in motion.keyframe_rows]
        for forces, groups in ((held[ends:], equal), (rows[count:], bounded)):
            first = 0
            for kind, number in groups:
                against[kind] = against.get(kind, 0.0) + _opposing(forces[first : first + number])
                first += number
        cause = max(against, key=against.__getitem__)
        return cause if found.multipliers[worst] > 0.0 and against[cause] > 0.0 else None

    def _against_by_cost(self, x: FloatArray, force: FloatArray) -> dict[ClearanceLimit, float]:
        """Return by how much the length of the motion and its further costs oppose a force, both at a solution.

        Args:
            x: solution of the QP, shape (K, p).
            force: the force, shape (K, p).
        """
        change, push = (np.vstack((np.zeros_like(v[:1]), v)) for v in (x, force))
        costs = sum(float(np.vdot(model.gradient_after(change), push)) for model in self.motion.cost_models)
        undamped = replace(self, damping=0.0, curvature=None)
        length = float(np.vdot(_times(undamped.hessian(), x) + self.gradient(), force)) - costs
        return {"length": max(-length, 0.0), "costs": max(-costs, 0.0)}

    def hessian(self) -> FloatArray:
        """Return the blocks of the Hessian that couple keyframe k with k, k − 1 and k − 2, shape (3, K, p, p)."""
        intervals = self._intervals
        apart, k = np.indices((3, intervals)).reshape(2, -1) + np.array([[0], [1]])
        inside = k - apart >= 1
        p = self.motion.sweep.unknowns.shape[1]
        blocks = np.zeros((3, intervals, p, p))
        blocks.reshape(-1, p, p)[inside] = self.motion.objective.blocks(
            self.motion.sweep, k[inside], k[inside] - apart[inside]
        )
        blocks[0] += self._diagonal()[1:]
        if self.curvature is not None:
            # ½ c (δ_{k+1} − δ_k)²: +c on both diagonal blocks, −c between them.
            blocks[1, 1:] -= self.curvature.beside[1:]
        for model in self.motion.cost_models:
            blocks[1, 1:] += model.above[1:].transpose(0, 2, 1)
        return blocks

    def _diagonal(self) -> FloatArray:
        """Return the diagonal Hessian blocks of damping, constraints and further costs, shape (K + 1, p, p)."""
        # Levenberg–Marquardt damping in terms of link rotations: it damps motion of the arm, not large unknowns.
        metrics = self.motion.sweep.turn_metrics
        diagonal = self.damping * (metrics + _DAMPING_RIDGE * np.eye(metrics.shape[-1]))
        if self.curvature is not None:
            diagonal += self.curvature.diagonal
            diagonal[1:] += self.curvature.beside
            diagonal[:-1] += self.curvature.beside
        for model in self.motion.cost_models:
            diagonal += model.diagonal
        return diagonal

    def gradient(self) -> FloatArray:
        """Return the gradient of the QP's objective, shape (K, p)."""
        gradient = self.motion.objective.gradient(self.motion.sweep)
        for model in self.motion.cost_models:
            gradient = gradient + model.gradient
        return gradient[1:]

    def equations(self) -> StageRows:
        """Return the QP equations, for the end of the motion and for single keyframes."""
        # Right-hand sides are 0: the last keyframe is already on the goal, and a step only has to keep it there to
        # first order.
        end = self.motion.end_rows
        parts = [(np.full(len(end), self._intervals), end)]
        for equations in self.motion.equations:
            moves = self._apart_from_end(equations)
            parts.append((equations.keyframe[moves], equations.slopes[moves]))
        keyframe, slopes = (np.concatenate(each) for each in zip(*parts, strict=True))
        return _at_keyframes(keyframe, slopes, None, np.zeros(len(keyframe)))

    def _apart_from_end(self, equations: KeyframeRows) -> BoolArray:
        """Return which equations enter the QP, shape (m,): all, or all but those of a fixed last keyframe."""
        # A fixed end satisfies these already; duplicate rows would make the equations dependent.
        return (equations.keyframe < self._intervals) | (not self.motion.end_fixed)

    def inequalities(self) -> StageRows:
        """Return the inequalities over intervals, with slack, then on keyframes: upper bounds, then lower ones."""
        active, unit = self.motion.active, self.motion.unit
        start, end = active.slopes(self.motion.sweep)
        part = active.part(self.motion.sweep)
        rows = [StageRows(active.interval, start / unit, end / unit, -active.values(self.motion.sweep) / unit, part)]
        for each in self.motion.keyframe_rows:
            before = each.before
            rows.append(_at_keyframes(each.keyframe, each.slopes, before, each.upper))
            rows.append(_at_keyframes(each.keyframe, -each.slopes, None if before is None else -before, -each.lower))
        return joined_stage_rows(rows)


def _at_keyframes(keyframe: IntArray, slopes: FloatArray, before: FloatArray | None, bound: FloatArray) -> StageRows:
    """Return rows on keyframes from 1 on, and the ones before them, without slack."""
    before = np.zeros_like(slopes) if before is None else before
    return StageRows(keyframe - 1, before, slopes, bound, np.full(len(keyframe), NO_PART))


def _times(blocks: FloatArray, x: FloatArray) -> FloatArray:
    """Return the product of a Hessian, given by its blocks (3, K, p, p), and a vector (K, p), shape (K, p)."""
    product = np.einsum("kpq,kq->kp", blocks[0], x)
    for apart in (1, 2):
        product[apart:] += np.einsum("kpq,kq->kp", blocks[apart, apart:], x[:-apart])
        product[:-apart] += np.einsum("kpq,kp->kq", blocks[apart, apart:], x[apart:])
    return np.asarray(product)


def _opposing(products: FloatArray) -> float:
    """Return the sum of the magnitudes of the negative values among scalar products of forces with one force."""
    return -float(np.sum(np.minimum(products, 0.0)))
