"""Sequential convex programming over all keyframes: linearised rows, sweep regions renewed at every step.

Every iterate is certified: a step that the certificate refuses is shortened, then damped. So the motion stays in its
homotopy class, and the last iterate is always fit for use.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.motion.continuation import Deadline
from ccm_opt.motion.goal import POLISH_TOLERANCE, GoalPose, polish
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.motion_task import Slowness
from ccm_opt.motion.optimisation.clearance_rows import Rows, representatives
from ccm_opt.motion.optimisation.nearness import DISTANCE, Nearness, SweepCost
from ccm_opt.motion.optimisation.objective import Objective
from ccm_opt.motion.optimisation.own_terms import CostSum, KeyframeTerms
from ccm_opt.motion.optimisation.quadratic_step import Curvature, Step, StepProblem
from ccm_opt.motion.optimisation.swept_motion import Sweep
from ccm_opt.motion.step import LIMIT_SHARE, pose_in
from ccm_opt.problem import Weights

PRICE, RISE = 30.0, 4.0
"""First price of one nominal link (24 to the arm) of slack, and its rise where the certificate fails."""
GROUPS = 36
"""Arms with more links than this have rows for groups of neighbouring joints."""
ROUNDS = 14
TRIES = 5
"""QPs of one round before it is given up."""
WORTH = 3e-3
"""Share of the objective that a round has to gain."""
PATIENCE = 2
"""Rounds in a row that may gain less."""
FIRST_DAMPING = 0.3
LEAST_DAMPING = 1e-4
SHORTENINGS = (1.0, 0.5, 0.25)
_SUFFICIENT, _GOOD = 0.1, 0.6

Failures = Callable[[FloatArray], IntArray]
"""Intervals of a piecewise-linear motion of link headings, shape (K + 1, n), that are not certified."""
MakeRows = Callable[[Sweep], Rows]
"""Rows from the sweep regions of a motion."""


@dataclass(frozen=True)
class Program:
    """A motion to be optimised.

    Attributes:
        space: the link space.
        goal: where the tip has to stay.
        end_fixed: whether the last keyframe is fixed.
        make_rows: builds the rows about a motion.
        failures: the certificate.
        active: rows nearer to their bound than this enter the QP [m].
        deadline: when to stop.
        weights: how much each part of the objective counts.
        slowness: of the joints.
        own: the user's constraints and costs, or None.
    """

    space: LinkSpace
    goal: GoalPose
    end_fixed: bool
    make_rows: MakeRows
    failures: Failures
    active: float
    deadline: Deadline
    weights: Weights = field(default_factory=Weights)
    slowness: Slowness | None = None
    own: KeyframeTerms | None = None

    def objective(self, intervals: int) -> Objective:
        """The quadratic part of the objective."""
        return Objective(self.space, intervals, self.weights, self.slowness)

    def nearness(self, rows: Rows, sweep: Sweep) -> Nearness | None:
        """What nearness to walls costs by the tightest wall rows of a motion; None when it does not matter."""
        if self.weights.clearance == 0.0:
            return None
        distance = DISTANCE * self.space.arm.length
        walls = rows.take(rows.minus == 0)
        return Nearness(active_rows(walls, sweep, distance), self.weights.clearance, distance)

    def beside(self, rows: Rows, sweep: Sweep) -> SweepCost | None:
        """All costs beside the quadratic objective; None when there are none."""
        parts = [part for part in (self.nearness(rows, sweep), self.own) if part is not None]
        return CostSum(tuple(parts)) if parts else None

    def ended(self, coordinates: FloatArray) -> FloatArray:
        """The coordinates with the keyframes on the user's equations and the last one polished onto the goal."""
        if self.own is not None:
            coordinates = self.own.returned(coordinates)
        if not self.end_fixed:
            coordinates[-1] = polish(self.space, self.goal, coordinates[-1])
        return coordinates

    def feasible(self, sweep: Sweep, before: Sweep) -> bool:
        """Whether a motion keeps the joint limits and ends on the goal."""
        arm = self.space.arm
        allowed = np.maximum(0.5 * (1.0 + LIMIT_SHARE) * arm.bend_limits, np.abs(arm.bends(before.headings)))
        if np.any(np.abs(arm.bends(sweep.headings)) > np.minimum(allowed, arm.bend_limits)):
            return False
        if self.own is not None and not self.own.met(sweep):
            return False
        end = pose_in(self.space, sweep.coordinates[-1])
        return self.end_fixed or max(self.goal.errors(end)) <= _GOAL_ERROR


_GOAL_ERROR = 10.0 * POLISH_TOLERANCE


@dataclass(frozen=True)
class _Iterate:
    """Where the iteration is.

    Attributes:
        sweep: the motion, certified.
        curvature: of the rows, by the last multipliers.
        damping: weight on the squared turns of the next step.
        prices: of slack in each interval, shape (K,).
        gained: by which the last step lowered the objective.
    """

    sweep: Sweep
    curvature: Curvature
    damping: float
    prices: FloatArray
    gained: float = 0.0


def sequential_convex(program: Program, coordinates: FloatArray, rounds: int = ROUNDS) -> FloatArray:
    """Optimise a certified motion.

    Args:
        program: what to keep.
        coordinates: at the keyframes, shape (K + 1, p).
        rounds: most steps taken.

    Returns:
        The last iterate's coordinates, shape (K + 1, p); certified.
    """
    objective = program.objective(len(coordinates) - 1)
    sweep = Sweep(program.space, coordinates)
    iterate, idle = _Iterate(sweep, Curvature.none(sweep), FIRST_DAMPING, np.full(len(sweep.turns), PRICE)), 0
    for _ in range(rounds):
        before = objective.value(iterate.sweep.coordinates)
        following = _round(program, objective, iterate)
        if following is None:
            break
        iterate = following
        idle = idle + 1 if iterate.gained < WORTH * before else 0
        if idle >= PATIENCE or program.deadline.passed():
            break
    return iterate.sweep.coordinates


def _round(program: Program, objective: Objective, iterate: _Iterate) -> _Iterate | None:
    """One accepted step, or None when none is."""
    rows = program.make_rows(iterate.sweep)
    active = active_rows(rows, iterate.sweep, program.active)
    nearness = program.beside(rows, iterate.sweep)
    for _ in range(TRIES):
        problem = StepProblem(
            iterate.sweep,
            objective,
            active,
            iterate.prices,
            iterate.curvature,
            iterate.damping,
            program.goal,
            program.end_fixed,
            nearness,
            program.own,
        )
        step = problem.solve()
        following, failing = _part_taken(program, rows, problem, step) if step.solved else (None, _NONE)
        if following is not None:
            return following
        if program.deadline.passed():
            return None
        prices = iterate.prices.copy()
        prices[failing] *= RISE
        iterate = replace(iterate, damping=6.0 * max(iterate.damping, 0.05), prices=prices)
    return None


_NONE = np.zeros(0, dtype=np.intp)


def active_rows(rows: Rows, sweep: Sweep, within: float) -> Rows:
    """The rows that a step may meet, thinned to one for each joint, or group of joints, and direction."""
    values = rows.values(sweep)
    near = np.flatnonzero(values > -within)
    near_rows = rows.take(near)
    return near_rows.take(representatives(near_rows, values[near], -(-sweep.space.arm.links // GROUPS)))


def _part_taken(program: Program, rows: Rows, problem: StepProblem, step: Step) -> tuple[_Iterate | None, IntArray]:
    """The longest part of a step that lowers the merit as foreseen and is certified, and where longer ones failed."""
    start, failed = problem.sweep, _NONE
    before = merit(problem, rows, start)
    foreseen = before - _foreseen_cost(problem, step) - float(problem.prices @ step.slack)
    for share in SHORTENINGS:
        sweep = Sweep(program.space, program.ended(start.coordinates + share * step.change))
        gain = (before - merit(problem, rows, sweep)) / max(share * foreseen, 1e-12)
        if gain <= _SUFFICIENT or not program.feasible(sweep, start):
            continue
        failing = program.failures(sweep.headings)
        if len(failing) == 0:
            curvature = Curvature(*problem.rows.curvature(sweep, step.multipliers, step.pull))
            prices = problem.prices.copy()
            prices[failed] *= RISE
            gained = _cost(problem, start) - _cost(problem, sweep)
            return _Iterate(sweep, curvature, _damping(problem.damping, share, gain), prices, gained), failed
        failed = failing
    return None, failed


def _foreseen_cost(problem: StepProblem, step: Step) -> float:
    """The objective after a whole step, as the QP sees it."""
    cost = problem.objective.value(problem.sweep.coordinates + step.change)
    near = problem.nearness
    return cost if near is None else cost + near.foreseen(problem.sweep, step.change)


def _cost(problem: StepProblem, sweep: Sweep) -> float:
    """The objective of a motion."""
    cost = problem.objective.value(sweep.coordinates)
    return cost if problem.nearness is None else cost + problem.nearness.value(sweep)


def merit(problem: StepProblem, rows: Rows, sweep: Sweep) -> float:
    """Objective plus the price of the worst row of every interval."""
    worst = np.zeros(len(sweep.turns))
    np.maximum.at(worst, rows.interval, rows.values(sweep) / problem.unit)
    return _cost(problem, sweep) + float(problem.prices @ worst)


def _damping(damping: float, share: float, gain: float) -> float:
    """More damping after a shortened step, less after a good one."""
    if share < 1.0:
        return max(damping, 0.05) * (2.0 if share >= 0.5 else 3.0)
    return max(damping / 3.0, LEAST_DAMPING) if gain > _GOOD else damping
