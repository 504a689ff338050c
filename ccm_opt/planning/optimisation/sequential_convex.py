"""Trajectory optimisation over all keyframes by sequential convex programming.

Constraints are linearised anew for every step; a linearised constraint is called a row. Every iterate is certified: a
step that the certificate refuses is shortened, then damped, and slack in intervals with violations becomes more costly.
So the motion stays in its homotopy class, and every result is a usable motion.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.limit import LimitOf, restored_keyframes
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, RowCurvature, Sweep, joined_rows, representatives
from ccm_opt.planning.optimisation.objective import JointSlowness, Objective, WallNearness
from ccm_opt.planning.optimisation.program import DecidingRows, KeyframeProgram, LinearMotion, QuadraticStep
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.planning.settings import ConvexSettings
from ccm_opt.problem import Weights
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

SweepType = TypeVar("SweepType", bound=Sweep)
"""Type of the motion of an optimisation problem."""

_LACK = 0.03
"""Fraction of the preferred gap that an interval may lack before its slack becomes more costly. Heuristic."""
_LACK_RISE = 2.0
"""Factor by which the price of slack rises per step in intervals that lack clearance. Heuristic."""
_PRICE_RISE = 4.0
"""Factor of the price of slack in intervals for which the certificate fails. Heuristic."""
FIRST_DAMPING = 0.3
"""Weight on the squared rotations of the links in the first step. Heuristic."""
_REFUSED_GROWTH = 6.0
"""Factor by which the damping grows after a refused optimisation step. Heuristic."""
_SHORTENED_GROWTH = 2.0
"""Factor by which the damping grows after a shortened optimisation step. Heuristic."""
_TRIES = 6
"""Maximum number of QPs that are solved for one accepted optimisation step. Heuristic."""
_SHORTENINGS = (1.0, 0.5, 0.25, 0.1)
"""Fractions of an optimisation step that are tried until the result is certified. Heuristic."""
_SUFFICIENT = 0.1
"""Fraction of the predicted gain that a step must achieve to be accepted. Heuristic."""
_WORTH_AFRESH = 0.1
"""Relative decrease of the objective after which prices and damping are reset if they block all motion. Heuristic."""

_SEEN_AT_MANY = 0.5
"""Factor that, for motions with many keyframes, reduces the distance to its bound at which a constraint enters the QP.

Measured: among 300 and 1000 polygons the same motions in three quarters of the time.
"""
_WALL_DISTANCE = 0.03
"""Distance beyond the planning margin above which walls cause no cost, as a fraction of the arm's length. Heuristic.

The cost applies only if the clearance has a weight.
"""
_STEP_REDUCTIONS = 6
"""Maximum number of reductions of the step of keyframes near uncertified intervals in narrow gates. Heuristic."""
_YIELDING_REACH = 4.0
"""Number of keyframes on either side of an uncertified interval that take a smaller fraction of a step. Heuristic.

The reduction decreases with the distance from the interval.
"""
_YIELDING_SHARE = 0.4
"""Factor by which a keyframe next to an uncertified interval reduces its part of a step, each time. Heuristic."""
_STEEPEST = 10.0
"""Largest gradient of the user's costs, relative to that of the objective, for which the prices of slack are tuned.
Measured: with a ratio of 8 the user's costs decrease as intended, with one of 800 no step is accepted."""
_RAISED_DAMPING = 0.05
"""Minimum damping after a rejected or shortened step, before it is increased. Heuristic."""
_GOOD_SHRINKAGE = 3.0
"""Divisor by which the damping is reduced after a good optimisation step. Heuristic."""
_LEAST_DAMPING = 1e-4
"""Lower bound of the damping of optimisation steps. Heuristic."""
_GOOD = 0.6
"""Fraction of the predicted gain from which on a step counts as good. Heuristic."""


@dataclass(frozen=True, eq=False)
class MotionProgram(Generic[SweepType]):
    """Optimisation problem of a motion with K intervals: limits, goal and weights of the objective.

    Attributes:
        curve: map from p unknowns of a curve to configurations.
        sweep: function that builds the motion through keyframes, shape (K + 1, p).
        limits: all limits that the motion has to satisfy.
        failures: function from keyframes, shape (K + 1, p), to the indices of uncertified intervals.
        goal: goal of the tip; None if the last keyframe is fixed.
        end_fixed: whether the last keyframe is fixed.
        u: path parameters of the keyframes, shape (K + 1,).
        deadline: time at which the optimisation stops.
        weights: weights of the parts of the objective.
        wanted_gap: preferred gap, which constraint rows require if possible [m].
        row_reach: distance from their bound below which rows enter the QP [m].
        groups: largest number of groups of neighbouring joints; of an arm with more links, only the tightest constraint
            of each group is used.
        steps: settings of the steps.
        slowness: relative slowness of the coordinates, for the weight of the duration; None if all are equally fast.
        scale: factor of each coordinate in lengths of paths, shape (c,); None if all count alike.
        many: number of intervals above which only rows within half the distance ``row_reach`` enter the QP.
        shortfall: function that returns the clearance that a motion lacks over all its intervals, in nominal links; a
            term of the merit function.
        local_step_reduction: whether keyframes may take a smaller part of a step where the motion would not be
            certified, while the others take the full step.
    """

    curve: CurveUnknowns
    sweep: Callable[[FloatArray], SweepType]
    limits: tuple[LimitOf[Any], ...]
    failures: Callable[[FloatArray], IntArray]
    goal: GoalPose | None
    end_fixed: bool
    u: FloatArray
    deadline: Deadline
    weights: Weights
    wanted_gap: float
    row_reach: float
    groups: int
    steps: ConvexSettings
    slowness: JointSlowness | None = None
    scale: FloatArray | None = None
    many: float = np.inf
    shortfall: Callable[[SweepType], float] = lambda _: 0.0
    local_step_reduction: bool = False

    @property
    def arm(self) -> Arm:
        """Arm that performs the motion."""
        return self.curve.arm

    @property
    def unit(self) -> float:
        """Length of a nominal link, a fixed fraction of the arm's length, by which constraint rows are scaled [m]."""
        return self.arm.length / NOMINAL_LINKS

    def ways(self, unknowns: FloatArray) -> FloatArray:
        """Return the lengths of the K intervals in the space of the drives, shape (K,), for unknowns (K + 1, p)."""
        drives = self.curve.drives(self.curve.configurations(unknowns))
        steps = np.diff(drives if self.scale is None else drives * self.scale, axis=0)
        return np.asarray(np.linalg.norm(steps, axis=1))

    # ------------------------------------------------------------ rows and objective
    def objective(self, intervals: int) -> Objective:
        """Return the quadratic part of the objective for a motion with a given number of intervals."""
        return Objective(self.curve, intervals, self.weights, self.slowness, self.scale)

    def rows(self, sweep: SweepType) -> IntervalRows:
        """Return all linearised constraints (rows) over the intervals of a motion."""
        return joined_rows([rows for limit in self.limits for rows in limit.interval_rows(sweep)])

    def end_rows(self, sweep: SweepType) -> FloatArray:
        """Return the derivatives of the equations that fix the last keyframe, or only its tip at the goal, (r, p).

        They are with respect to the unknowns of the last keyframe. For a goal of the tip, the rows of its position, in
        nominal links, come first.
        """
        if self.end_fixed or self.goal is None:
            return np.eye(sweep.unknowns.shape[1])
        return self.goal.rows(self.curve.pose(sweep.unknowns[-1]), self.unit)

    # ------------------------------------------------------------ moving keyframes onto limits
    def restored(self, unknowns: FloatArray) -> FloatArray:
        """Return keyframes (K + 1, p) moved so that they satisfy the limits.

        The given array itself is returned if no limit has to move a keyframe.
        """
        return restored_keyframes(self.limits, self.curve, unknowns, self.u)

    def ended(self, unknowns: FloatArray) -> FloatArray | None:
        """Return keyframes (K + 1, p) moved so that they satisfy the limits and end at the goal; None if that fails."""
        unknowns = self.restored(unknowns)
        if self.end_fixed or self.goal is None:
            return unknowns
        last = self.curve.pose(unknowns[-1])
        onto = moved_onto(self.curve, self.goal, last)
        if self.goal.on_goal(onto) and self.goal.limits_met(onto):
            return np.vstack((unknowns[:-1], onto.v))
        return unknowns if self.goal.met(last) else None

    def feasible(self, sweep: SweepType, before: SweepType) -> bool:
        """Return whether a motion's keyframes satisfy all limits, or violate none more than those of ``before``."""
        return all(limit.holds(sweep, before, self.u) for limit in self.limits)

    # ------------------------------------------------------------ linearised motion
    def nearness(self, rows: IntervalRows, sweep: SweepType) -> tuple[WallNearness, ...]:
        """Return the cost of closeness to the nearest walls of a motion; () if clearance has no weight."""
        if self.weights.clearance == 0.0:
            return ()
        distance = _WALL_DISTANCE * self.arm.length
        walls = rows.take(rows.against_walls)
        nearest = self.active_rows(walls, sweep, distance)
        return (WallNearness(nearest, self.weights.clearance, distance, NOMINAL_LINKS / self.arm.links),)

    def active_rows(self, rows: IntervalRows, sweep: SweepType, within: float) -> IntervalRows:
        """Return the constraints (rows) that a step may reach, one per interval, time, group of joints and direction.

        Args:
            rows: all constraints over the intervals of the motion.
            sweep: the motion.
            within: distance from its bound up to which a constraint may be reached [m].
        """
        values = rows.values(sweep)
        near = np.flatnonzero(values > -within)
        near_rows = rows.take(near)
        return near_rows.take(representatives(near_rows, values[near], -(-self.arm.links // self.groups)))

    def linearised(self, sweep: SweepType) -> LinearMotion:
        """Return the motion with objective and constraints linearised for one step."""
        rows = self.rows(sweep)
        limits = self.limits
        return LinearMotion(
            sweep=sweep,
            objective=self.objective(sweep.intervals),
            costs=(
                *self.nearness(rows, sweep),
                *(cost for limit in limits for cost in limit.costs(self.curve, self.u)),
            ),
            rows=rows,
            active=self.active_rows(
                rows, sweep, self.row_reach * (_SEEN_AT_MANY if sweep.intervals > self.many else 1.0)
            ),
            keyframe_rows=tuple(each for limit in limits for each in limit.keyframe_rows(sweep, self.u)),
            equations=tuple(each for limit in limits for each in limit.keyframe_equations(sweep, self.u)),
            end_rows=self.end_rows(sweep),
            end_fixed=self.end_fixed,
            unit=self.unit,
        )


@dataclass(frozen=True, eq=False)
class _Certified(Generic[SweepType]):
    """Certified motion of an optimisation problem, with derived quantities that are computed once.

    Attributes:
        program: the optimisation problem.
        sweep: the motion.
    """

    program: MotionProgram[SweepType]
    sweep: SweepType

    @cached_property
    def linear(self) -> LinearMotion:
        """Motion with objective and constraints linearised for one step."""
        return self.program.linearised(self.sweep)

    @cached_property
    def shortfall(self) -> float:
        """Clearance that the motion lacks, a term of the merit function, in nominal links."""
        return self.program.shortfall(self.sweep)


@dataclass(frozen=True, eq=False)
class _Iterate(Generic[SweepType]):
    """State of sequential convex programming after a step.

    Attributes:
        motion: motion from which the next step begins.
        prices: price of slack in each of the m parts of the K intervals, shape (K m,).
        damping: weight on the squared rotations of the links in the next step.
        curvature: second derivatives of the constraints, weighted by the last multipliers; None before the first step.
        gained: decrease of the merit function in the last step.
        deciding: inequalities that decided the last QP.
    """

    motion: _Certified[SweepType]
    prices: FloatArray
    damping: float = FIRST_DAMPING
    curvature: RowCurvature | None = None
    gained: float = 0.0
    deciding: DecidingRows = field(default_factory=DecidingRows)

    def refused(self, damping: float, prices: FloatArray) -> "_Iterate[SweepType]":
        """Return the state after a refused step: unchanged motion, damping raised above ``damping``, given prices."""
        raised = _REFUSED_GROWTH * max(damping, _RAISED_DAMPING)
        return replace(self, damping=raised, prices=prices)


def sequential_convex(program: MotionProgram[SweepType], unknowns: FloatArray, rounds: int) -> FloatArray:
    """Optimise a certified motion by sequential convex programming; return the keyframes of the certified result.

    Args:
        program: limits and objective of the motion.
        unknowns: unknowns at the keyframes of a certified motion, shape (K + 1, p).
        rounds: maximum number of steps.

    Returns:
        Unknowns at the keyframes, shape (K + 1, p).
    """
    sweep = program.sweep(unknowns)
    objective = program.objective(sweep.intervals)
    program = priced(program, sweep)
    settings = program.steps
    prices = np.full(sweep.intervals * sweep.parts, settings.price / sweep.parts)
    iterate = _Iterate(_Certified(program, sweep), prices)
    idle = 0
    worth_afresh = (1.0 - _WORTH_AFRESH) * objective.value(sweep)
    for _ in range(rounds):
        motion = iterate.motion
        before = objective.value(motion.sweep) + settings.price * motion.shortfall
        following = _round(iterate)
        if following is None:
            # Prices and damping have risen so far that nothing moves. They are reset if the motion has improved much
            # since they were low.
            if before > worth_afresh:
                break
            worth_afresh = (1.0 - _WORTH_AFRESH) * before
            iterate = _Iterate(motion, prices, deciding=iterate.deciding)
            continue
        # One poor round often comes before good ones, while damping or prices adapt.
        idle = idle + 1 if following.gained < settings.worth * before else 0
        better = following.gained > 0.0 or not settings.counts_room
        # Where the rows did not predict the outcome of the step, try a shorter one.
        iterate = following if better else iterate.refused(following.damping, following.prices)
        patience = settings.patience if better and iterate.motion.shortfall <= 0.0 else settings.patience_in_want
        if idle >= patience or program.deadline.passed():
            break
    return iterate.motion.sweep.unknowns


def priced(program: MotionProgram[SweepType], sweep: SweepType) -> MotionProgram[SweepType]:
    """Return a program with higher prices of slack if the user's costs are steep, so that contact never pays.

    Args:
        program: the optimisation problem.
        sweep: motion at which the gradients of the user's costs and of the objective are compared.
    """
    costs = [cost for limit in program.limits for cost in limit.costs(program.curve, program.u)]
    steepness = float(np.linalg.norm(np.sum([cost.model(sweep).gradient for cost in costs], axis=0)))
    own = float(np.linalg.norm(program.objective(sweep.intervals).gradient(sweep)))
    growth = max(1.0, steepness / max(_STEEPEST * own, TINY))
    steps = program.steps
    dearer = replace(steps, price=growth * steps.price, highest_price=growth * steps.highest_price)
    return replace(program, steps=dearer)


def _round(iterate: _Iterate[SweepType]) -> _Iterate[SweepType] | None:
    """Return the state after one accepted step, or None if no step is accepted.

    Constraints are linearised once; after a refused step the QP is solved again with more damping and higher prices.
    """
    program = iterate.motion.program
    # Rows are linearised once; only the QP is solved again, with more damping and higher prices.
    for _ in range(_TRIES):
        linear, prices = iterate.motion.linear, iterate.prices
        step = KeyframeProgram(linear, prices, iterate.curvature, iterate.damping, iterate.deciding).solve()
        iterate = iterate if step is None else replace(iterate, deciding=step.deciding)
        following, failing = (None, _NONE) if step is None else _part_taken(iterate, step)
        if following is not None:
            return following
        if program.deadline.passed():
            return None

        # Prices differ between intervals: a common price would either leave a bottleneck uncertified or freeze the rest
        # of the motion.
        iterate = iterate.refused(iterate.damping, _raised(iterate.prices, failing, iterate.motion.sweep))
    return None


_NONE = np.zeros(0, dtype=np.intp)
"""Empty array of interval indices."""


def _part_taken(iterate: _Iterate[SweepType], step: QuadraticStep) -> tuple[_Iterate[SweepType] | None, IntArray]:
    """Return the state after the largest acceptable fraction of a step, and the intervals in which larger ones failed.

    A fraction is acceptable if the merit function falls by enough of the predicted gain, as in a trust-region method,
    and the result is certified. The state is None if no fraction is acceptable.

    Args:
        iterate: state before the step.
        step: solution of the QP.
    """
    program = iterate.motion.program
    settings = program.steps
    motion = iterate.motion.linear
    start = iterate.motion.sweep
    failed = _NONE
    shares: list[float | FloatArray] = list(_SHORTENINGS)
    if program.local_step_reduction:
        shares.insert(0, _local_step_shares(program, start, step.change))

    # The merit is an exact l∞ penalty per interval: the slack of the QP predicts the worst row.
    cost = motion.cost(start)
    before = cost + float(iterate.prices @ motion.worst_rows(start)) / motion.unit
    predicted = before - motion.predicted_cost(step.change) - float(iterate.prices @ step.slack)

    # By convexity of the model a fraction of the step gains at least that fraction of the predicted gain of the whole
    # step; the ratio of true to predicted gain decides, as in a trust-region method.
    for part in shares:
        share = float(np.mean(part))
        unknowns = program.ended(start.unknowns + part * step.change)
        if unknowns is None:
            continue
        sweep = program.sweep(unknowns)
        after = motion.cost(sweep)
        worst = motion.worst_rows(sweep)
        gain = (before - after - float(iterate.prices @ worst) / motion.unit) / max(share * predicted, 1e-12)
        # The certificate is the most costly and comes last.
        # Negated, so that a NaN gain, from a user cost that is not finite there, is refused.
        if not gain > _SUFFICIENT or not program.feasible(sweep, start):
            continue
        failing = program.failures(sweep.unknowns)
        if len(failing) == 0:
            # Together with the multipliers of the tip's goal, the Hessian is that of the Lagrangian; without them,
            # steps gain a small part of what they predict.
            curvature = sweep.curvature(motion.active, step.multipliers, step.pull)
            # Where longer steps failed, slack was too cheap, even though this shorter step passes.
            prices = _raised(iterate.prices, failed, sweep)
            short = worst > _LACK * program.wanted_gap
            if program.wanted_gap > 0.0:
                prices[short] = np.minimum(_LACK_RISE * prices[short], settings.highest_price / sweep.parts)
            found = _Certified(program, sweep)
            gained = cost - after + settings.price * (iterate.motion.shortfall - found.shortfall)
            damping = _damping(iterate.damping, share, gain)
            return _Iterate(found, prices, damping, curvature, gained, step.deciding), failed
        failed = failing
        if share == 1.0 and not program.curve.affine:
            # The links of a fed arm move far; a single interval that fails would else refuse or shorten the whole step.
            shares.insert(1, _local_step_shares(program, start, step.change))
    return None, failed


def _raised(prices: FloatArray, failing: IntArray, sweep: Sweep) -> FloatArray:
    """Return the prices of slack in the m parts of K intervals, raised in given intervals, shape (K m,).

    Args:
        prices: prices before, shape (K m,).
        failing: indices of the intervals.
        sweep: the motion.
    """
    raised = prices.reshape(sweep.intervals, -1).copy()
    raised[failing] *= _PRICE_RISE
    return raised.ravel()


def _local_step_shares(program: MotionProgram[SweepType], start: SweepType, change: FloatArray) -> FloatArray:
    """Return the fraction of a step that each keyframe takes, shape (K + 1, 1), reduced near uncertified intervals.

    In a narrow passage, a few intervals block a step that all other intervals could take in full.

    Args:
        program: the optimisation problem.
        start: motion before the step.
        change: change of the unknowns of the keyframes in the full step, shape (K + 1, p).
    """
    shares = np.ones(len(change))
    keyframes = np.arange(len(change))
    for _ in range(_STEP_REDUCTIONS):
        taken = program.ended(start.unknowns + shares[:, None] * change)
        failing = _NONE if taken is None else program.failures(taken)
        if len(failing) == 0:
            break
        # Neighbouring keyframes reduce their fraction, too, to avoid a kink.
        apart = np.min(np.abs(keyframes[:, None] - (failing + 0.5)), axis=1) - 0.5
        shares *= np.minimum(1.0, _YIELDING_SHARE + (1.0 - _YIELDING_SHARE) * apart / _YIELDING_REACH)
    return shares[:, None]


def _damping(damping: float, share: float, gain: float) -> float:
    """Return the damping of the next step, increased after a shortened step and reduced after a good one.

    Args:
        damping: damping of the last step.
        share: fraction of the last step that was taken.
        gain: true gain of the last step as a fraction of the predicted gain.
    """
    if share < 1.0:
        return max(damping, _RAISED_DAMPING) * _SHORTENED_GROWTH
    if gain > _GOOD:
        return max(damping / _GOOD_SHRINKAGE, _LEAST_DAMPING)
    return damping
