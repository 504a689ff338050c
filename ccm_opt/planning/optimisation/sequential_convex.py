"""Sequential convex programming over all keyframes: linearised rows, sweep regions renewed at every step.

Every iterate is certified: a step that the certificate refuses is shortened, then damped. So the motion stays in its
homotopy class, and the last iterate is always fit for use.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.limits.clearance_rows import IntervalRows, joined_rows, representatives
from ccm_opt.planning.limits.limit import Limit, MotionCost
from ccm_opt.planning.limits.motion_certificate import failed_intervals
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion_task import JointSlowness
from ccm_opt.planning.optimisation.objective import Objective, WallNearness
from ccm_opt.planning.optimisation.quadratic_step import KeyframeProgram, QuadraticStep, RowCurvature
from ccm_opt.planning.pose import pose_in
from ccm_opt.planning.settings import MotionSettings, OptimisationSettings
from ccm_opt.planning.step import GoalPose, polish
from ccm_opt.planning.swept_motion import Sweep
from ccm_opt.problem import Weights

_LACK = 0.03
"""Share of the wanted gap that an interval may lack without its slack becoming dearer. Taste."""
_LACK_RISE = 2.0
"""Rise of the price of slack where an interval lacks room, step by step. Taste."""
_WORTH = 3e-3
"""Share of the objective that a round has to gain. Taste."""
_PATIENCE = 2
"""Rounds in a row that may gain less. Taste."""
_PRICE_RISE = 4.0
"""Its rise where the certificate fails. Taste."""
_FIRST_DAMPING = 0.3
"""Weight on the squared turns of the first step. Taste."""
_REFUSED_GROWTH = 6.0
"""Growth of the damping after a refused step. Taste."""
_SHORTENINGS = (1.0, 0.5, 0.25)
"""Shares of a step that are tried until one is certified. Taste."""
_SUFFICIENT = 0.1
"""Share of the foreseen gain at which a step is taken. Taste."""

_WALL_DISTANCE = 0.03
"""Walls farther than this beyond the planning margin cost nothing where clearance is weighed, as a share of the arm's
length. Taste."""
_ACTIVE_AT_MANY = 0.5
"""Share of that at many keyframes. Measured: among 300 and 1000 polygons the same motions in three quarters of the
time."""
_SECTORS = 12
"""Directions that count as different when rows are thinned. Taste."""
_HIGHEST_LACK_PRICE = 500.0
"""To which it rises. Taste."""
_WORTH_AFRESH = 0.1
"""Share of the objective that has to be gained for prices and damping that let nothing move to be put back to where
they began. Taste."""
_HALVED_GROWTH = 2.0
"""Its growth after a step of half its length or more. Taste."""
_YIELDINGS = 6
"""Times that keyframes about intervals which are not certified take less of a step in gates. Taste."""
_YIELDING_REACH = 4.0
"""Keyframes on either side that give way with it, less and less. Taste."""


@dataclass(frozen=True, eq=False)
class MotionProgram:
    """A motion to be optimised: it stacks what the limits contribute, and knows none of them.

    Attributes:
        space: the link space.
        goal: where the tip has to stay.
        end_fixed: whether the last keyframe is fixed.
        limits: all that the motion has to keep.
        u: path parameter of the keyframes, shape (K + 1,).
        active: rows nearer to their bound than this enter the QP [m].
        deadline: when to stop.
        weights: how much each part of the objective counts.
        slowness: of the joints.
        wanted_gap: room that rows ask for where there is so much [m].
        yielding: whether keyframes may take less of a step where the motion would not be certified, the others all.
        settings: of the search for a motion.
    """

    space: LinkSpace
    goal: GoalPose
    end_fixed: bool
    limits: tuple[Limit, ...]
    u: FloatArray
    active: float
    deadline: Deadline
    weights: Weights = field(default_factory=Weights)
    slowness: JointSlowness | None = None
    wanted_gap: float = 0.0
    yielding: bool = False
    settings: MotionSettings = field(default_factory=MotionSettings)

    @property
    def objective(self) -> Objective:
        """The quadratic part of the objective."""
        return Objective(self.space, len(self.u) - 1, self.weights, self.slowness, self.settings.objective)

    def rows(self, sweep: Sweep) -> IntervalRows:
        """All rows over intervals about a motion."""
        return joined_rows([rows for limit in self.limits for rows in limit.interval_rows(sweep)])

    def nearness(self, rows: IntervalRows, sweep: Sweep) -> tuple[WallNearness, ...]:
        """What nearness to walls costs by the tightest wall rows of a motion; nothing when it does not matter."""
        if self.weights.clearance == 0.0:
            return ()
        distance = _WALL_DISTANCE * self.space.arm.length
        walls = rows.take(rows.against_walls)
        return (WallNearness(self.active_rows(walls, sweep, distance), self.weights.clearance, distance),)

    def costs(self, rows: IntervalRows, sweep: Sweep) -> tuple[MotionCost, ...]:
        """All costs beside the quadratic objective."""
        of_limits = [cost for limit in self.limits for cost in limit.costs(self.space, self.u)]
        return (*self.nearness(rows, sweep), *of_limits)

    def active_rows(self, rows: IntervalRows, sweep: Sweep, within: float) -> IntervalRows:
        """The rows that a step may meet, thinned to one for each joint, or group of joints, and direction."""
        settings = self.settings.optimisation
        values = rows.values(sweep)
        near = np.flatnonzero(values > -within)
        near_rows = rows.take(near)
        group = -(-self.space.arm.links // settings.groups)  # rounded up
        return near_rows.take(representatives(near_rows, values[near], group, _SECTORS))

    def seen_by_steps(self, sweep: Sweep) -> float:
        """How near to their bound rows enter the QP [m]; many keyframes are steps as short as the rows are many."""
        settings = self.settings.optimisation
        many = len(sweep.turns) > settings.many * settings.intervals
        return self.active * (_ACTIVE_AT_MANY if many else 1.0)

    def restored(self, coordinates: FloatArray) -> FloatArray:
        """The keyframes brought back onto the limits, shape (K + 1, p); the same array where no limit moves them."""
        for limit in self.limits:
            coordinates = limit.restored_keyframes(self.space, coordinates, self.u)
        return coordinates

    def ended(self, coordinates: FloatArray) -> FloatArray:
        """The coordinates with the keyframes on the limits and the last one polished onto the goal."""
        coordinates = self.restored(coordinates)
        if not self.end_fixed:
            coordinates[-1] = polish(self.space, self.goal, coordinates[-1])
        return coordinates

    def holds(self, sweep: Sweep, before: Sweep) -> bool:
        """Whether a motion's keyframes keep every limit as well as those of another motion did, or better."""
        return all(limit.holds(sweep, before, self.u) for limit in self.limits)

    def feasible(self, sweep: Sweep, before: Sweep) -> bool:
        """Whether a motion keeps the limits and ends on the goal."""
        if not self.holds(sweep, before):
            return False
        return self.end_fixed or self.goal.on_goal(pose_in(self.space, sweep.coordinates[-1]))

    def failures(self, headings: FloatArray) -> IntArray:
        """Intervals of a motion, link headings of shape (K + 1, links) [rad], that are not certified."""
        return failed_intervals(self.limits, headings)


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
    curvature: RowCurvature
    damping: float
    prices: FloatArray
    gained: float = 0.0


def sequential_convex(
    program: MotionProgram,
    coordinates: FloatArray,
    rounds: int | None = None,
    enough: Callable[[Sweep], bool] | None = None,
) -> FloatArray:
    """Optimise a certified motion.

    Args:
        program: what to keep.
        coordinates: at the keyframes, shape (K + 1, p).
        rounds: most steps; those of the settings when None.
        enough: whether a motion is what was asked for, so that no more steps are taken; when None, they end where they
            gain little.

    Returns:
        The last iterate's coordinates, shape (K + 1, p); certified.
    """
    settings = program.settings.optimisation
    moved = any(limit.moves_keyframes for limit in program.limits)
    objective = program.objective

    sweep = Sweep(program.space, coordinates)
    prices = np.full(len(sweep.turns), settings.price)
    iterate = _Iterate(sweep, RowCurvature.none(sweep), _FIRST_DAMPING, prices)
    idle = 0
    if rounds is None:
        rounds = settings.moved_rounds if moved else settings.rounds
    worth_afresh = (1.0 - _WORTH_AFRESH) * objective.value(coordinates)
    for _ in range(rounds):
        before = objective.value(iterate.sweep.coordinates)
        following = _round(program, objective, iterate)
        if following is None:
            # Prices and damping have risen so far that nothing moves; where the motion has moved much since they were
            # low, they are out of date.
            if before > worth_afresh:
                break
            worth_afresh = (1.0 - _WORTH_AFRESH) * before
            iterate = _Iterate(iterate.sweep, RowCurvature.none(iterate.sweep), _FIRST_DAMPING, prices)
            continue
        iterate = following
        # One meagre round often comes before good ones, while damping or prices find their size.
        idle = idle + 1 if iterate.gained < _WORTH * before else 0
        done = idle >= _PATIENCE if enough is None else enough(iterate.sweep)
        if done or program.deadline.passed():
            break
    return iterate.sweep.coordinates


def _round(program: MotionProgram, objective: Objective, iterate: _Iterate) -> _Iterate | None:
    """One accepted step, or None when none is."""
    settings = program.settings.optimisation
    sweep = iterate.sweep
    rows = program.rows(sweep)
    active = program.active_rows(rows, sweep, program.seen_by_steps(sweep))
    costs = program.costs(rows, sweep)
    keyframe_rows = tuple(each for limit in program.limits for each in limit.keyframe_rows(sweep, program.u))
    equations = tuple(each for limit in program.limits for each in limit.keyframe_equations(sweep, program.u))

    # Rows are linearised once; what is tried again is the QP, with more damping and higher prices.
    for _ in range(settings.tries):
        problem = KeyframeProgram(
            sweep,
            objective,
            active,
            iterate.prices,
            iterate.curvature,
            iterate.damping,
            program.goal,
            program.end_fixed,
            costs,
            keyframe_rows,
            equations,
            settings,
        )
        step = problem.solve()
        following, failing = _part_taken(program, rows, problem, step) if step.solved else (None, _NONE)
        if following is not None:
            return following
        if program.deadline.passed():
            return None

        # A price for each interval: one for all would either leave a bottleneck uncertified or freeze the rest of the
        # motion.
        prices = iterate.prices.copy()
        prices[failing] *= _PRICE_RISE
        damping = _REFUSED_GROWTH * max(iterate.damping, settings.raised_damping)
        iterate = replace(iterate, damping=damping, prices=prices)
    return None


_NONE = np.zeros(0, dtype=np.intp)
"""No intervals."""


def _part_taken(
    program: MotionProgram, rows: IntervalRows, problem: KeyframeProgram, step: QuadraticStep
) -> tuple[_Iterate | None, IntArray]:
    """The longest part of a step that lowers the merit as foreseen and is certified, and where longer ones failed."""
    settings = program.settings.optimisation
    start = problem.sweep
    failed = _NONE
    shares: list[float | FloatArray] = list(_SHORTENINGS)
    if program.yielding and step.solved:
        shares.insert(0, _yielding_shares(program, start, step.change))

    # The merit is an exact l∞ penalty, an interval at a time: slack of the QP is what it foresees of the worst row.
    before = merit(problem, rows, start)
    foreseen = before - _foreseen_cost(problem, step) - float(problem.prices @ step.slack)

    # By convexity of the model a share of the step gains at least that share of what the whole step promises; the ratio
    # of true to promised gain decides, as in a trust-region method.
    for part in shares:
        share = float(np.mean(part))
        sweep = Sweep(program.space, program.ended(start.coordinates + part * step.change))
        gain = (before - merit(problem, rows, sweep)) / max(share * foreseen, 1e-12)
        # The certificate costs most and is asked last.
        # Negated, so that a gain that is NaN, for a cost of the user that is not finite there, is refused.
        if not gain > _SUFFICIENT or not program.feasible(sweep, start):
            continue
        failing = program.failures(sweep.headings)
        if len(failing) == 0:
            # The multipliers with the tip's among them make the Hessian that of the Lagrangian; without the tip's,
            # steps reach a small part of what they promise.
            curvature = RowCurvature(*problem.rows.curvature(sweep, step.multipliers, step.pull))
            # Where longer steps failed, slack was too cheap, even though this shorter one passes.
            prices = problem.prices.copy()
            prices[failed] *= _PRICE_RISE
            lacking = _worst_rows(rows, sweep) > _LACK * program.wanted_gap
            if program.wanted_gap > 0.0:
                prices[lacking] = np.minimum(_LACK_RISE * prices[lacking], _HIGHEST_LACK_PRICE)
            gained = _cost(problem, start) - _cost(problem, sweep)
            return _Iterate(sweep, curvature, _damping(problem.damping, share, gain, settings), prices, gained), failed
        failed = failing
    return None, failed


def _yielding_shares(program: MotionProgram, start: Sweep, change: FloatArray) -> FloatArray:
    """Shares of a step for each keyframe, shape (K + 1, 1): less about intervals that would not be certified.

    In a gate with hardly any play few intervals stand against a step that all others could take.
    """
    settings = program.settings.optimisation
    shares = np.ones(len(change))
    keyframes = np.arange(len(change))
    for _ in range(_YIELDINGS):
        taken = program.ended(start.coordinates + shares[:, None] * change)
        failing = program.failures(program.space.headings(taken))
        if len(failing) == 0:
            break
        # Keyframes beside those that give way follow them, or a kink would be left.
        apart = np.min(np.abs(keyframes[:, None] - (failing + 0.5)), axis=1) - 0.5
        shares *= np.minimum(1.0, settings.yielding + (1.0 - settings.yielding) * apart / _YIELDING_REACH)
    return shares[:, None]


def _foreseen_cost(problem: KeyframeProgram, step: QuadraticStep) -> float:
    """The objective after a whole step, as the QP sees it."""
    value = problem.objective.value(problem.sweep.coordinates + step.change)
    return value + sum(cost.foreseen(problem.sweep, step.change) for cost in problem.costs)


def _cost(problem: KeyframeProgram, sweep: Sweep) -> float:
    """The objective of a motion."""
    return problem.objective.value(sweep.coordinates) + sum(cost.value(sweep) for cost in problem.costs)


def merit(problem: KeyframeProgram, rows: IntervalRows, sweep: Sweep) -> float:
    """Objective plus the price of the worst row of every interval."""
    # All rows count here, not only the thinned ones of the QP: a row that was left out may have become the worst.
    return _cost(problem, sweep) + float(problem.prices @ _worst_rows(rows, sweep)) / problem.nominal_length


def _worst_rows(rows: IntervalRows, sweep: Sweep) -> FloatArray:
    """By how much the worst row of every interval is not kept, at least 0, shape (K,) [m]."""
    worst = np.zeros(len(sweep.turns))
    np.maximum.at(worst, rows.interval, rows.values(sweep))
    return worst


def _damping(damping: float, share: float, gain: float, settings: OptimisationSettings) -> float:
    """More damping after a shortened step, less after a good one."""
    if share < 1.0:
        growth = _HALVED_GROWTH if share >= 0.5 else settings.shortened_growth
        return max(damping, settings.raised_damping) * growth
    if gain > settings.good:
        return max(damping / settings.good_shrinkage, settings.least_damping)
    return damping
