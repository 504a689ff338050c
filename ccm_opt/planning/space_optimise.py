"""Optimises a found motion in space.

A step that the certificate refuses is shortened, then damped, and what an interval lacks becomes dearer; so the motion
stays in its homotopy class, and the last iterate is always fit for use.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.optimisation.objective import decimated, subdivided
from ccm_opt.planning.passed_places import passings
from ccm_opt.planning.space_continuation import onto_goal
from ccm_opt.planning.space_cost import SpaceMotionCost
from ccm_opt.planning.space_keyframes import CostWithTerms, PassingKeyframes, UserKeyframes
from ccm_opt.planning.space_program import SpaceKeyframeProgram, SpaceQuadraticStep
from ccm_opt.planning.space_rows import (
    KeyframeRows,
    SpaceRows,
    motion_rows,
    room_lacking,
    room_lacking_on_the_way,
    tightest,
)
from ccm_opt.planning.space_settings import SpaceOptimisationSettings
from ccm_opt.planning.space_step import SpaceStepper
from ccm_opt.planning.space_sweep import SpaceSweep, failing_edges, in_pieces
from ccm_opt.planning.space_task import SpaceMotion, SpaceTask

_LEG_DEPTH = 4
"""How often an edge of the thinned motion may be halved by its certificate."""
_FIRST_STRIDE = 8
"""Keyframes that an edge skips at first."""
_ROUNDS = 24
"""Most steps."""
_FIRST_ROUNDS = 2
"""Steps at many keyframes, before the motion is thinned again."""
_GROUPS = 24
"""Arms with more links than this have rows for groups of neighbouring joints."""
_PRICE_RISE = 4.0
"""Its rise where the certificate fails."""
_LACK = 0.03
"""Share of the wanted gap that an interval may lack without its slack becoming dearer."""
_LACK_RISE = 2.0
"""Rise of the price where it lacks more."""
_FIRST_DAMPING = 0.3
"""Weight on the squared turns of the first step."""
_REFUSED_GROWTH = 6.0
"""Growth of the damping after a refused step."""
_SHORTENINGS = (1.0, 0.5, 0.25, 0.1)
"""Shares of a step that are tried until one is certified."""
_SUFFICIENT = 0.1
"""Share of the foreseen gain at which a step is taken."""
_WORTH = 0.02
"""Share of the merit that a round has to gain."""
_PATIENCE = 1
"""Rounds in a row that may gain less."""
_PASSING = 0.5
"""How near the tip stays to the places that it passes, as a share of what counts as passing."""

_FINER_LACK = 0.15
"""A motion that lacks more than this share of the wanted gap is made again of more keyframes; in pipes and wing boxes
with few links seven in ten of those come out with all the room that there is."""
_FINER_INTERVALS = 32
"""Least number of intervals then."""
_FINER_PRICE = 400.0
"""First price of slack then."""
_PATIENCE_IN_WANT = 3
"""The same of a motion that lacks room."""


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Where the iteration is.

    Attributes:
        sweep: the motion, certified.
        rows: what it has to keep, drawn about it.
        lack: of room, of all intervals together [u].
        merit: its cost and what it lacks at the first price.
        damping: of the next step.
        prices: of slack in each interval, shape (K,).
    """

    sweep: SpaceSweep
    rows: SpaceRows
    lack: float
    merit: float
    damping: float
    prices: FloatArray


@dataclass(eq=False)
class SequentialConvex:
    """Optimises a certified motion.

    Args:
        task: what the motion is for.
        stepper: of its unknowns.
        end_fixed: whether the last keyframe has to stay.
        terms: the user's, over the keyframes; None where there are none.
        passing: keyframes at which the tip passes places; None where it need not.
    """

    task: SpaceTask
    stepper: SpaceStepper
    end_fixed: bool
    terms: UserKeyframes | None = None
    passing: PassingKeyframes | None = None
    _cost: SpaceMotionCost | CostWithTerms = field(init=False)

    def __post_init__(self) -> None:
        settings = self.task.settings
        plain = SpaceMotionCost(self.task.slowness, settings.objective)
        self._cost = plain if self.terms is None else CostWithTerms(plain, self.terms)

    @property
    def _settings(self) -> SpaceOptimisationSettings:
        return self.task.settings.optimisation

    def optimised(self, unknowns: FloatArray, rounds: int) -> FloatArray:
        """The unknowns of a better motion, shape (K + 1, p), certified; the same where none is found.

        Args:
            unknowns: at the keyframes, shape (K + 1, p); certified.
            rounds: most steps.
        """
        settings = self._settings
        sweep = SpaceSweep(self.stepper, unknowns)
        iterate = self._iterate(sweep, _FIRST_DAMPING, np.full(sweep.intervals, settings.price))
        best = iterate
        idle = 0
        for _ in range(rounds):
            following = self._round(iterate)
            if following is None:
                break
            idle = idle + 1 if following.merit > (1.0 - _WORTH) * best.merit else 0
            if following.merit < best.merit:
                best = following
                iterate = following
            else:
                # The rows did not foresee what came of the step: a shorter one.
                damping = _REFUSED_GROWTH * max(following.damping, settings.raised_damping)
                iterate = replace(best, damping=damping, prices=following.prices)
            patience = _PATIENCE if best.lack <= 0.0 else _PATIENCE_IN_WANT
            if idle >= patience or self.task.deadline.passed():
                break
        return best.sweep.unknowns

    def _iterate(self, sweep: SpaceSweep, damping: float, prices: FloatArray) -> _Iterate:
        """A motion with its rows: what its steps did not foresee counts in its merit."""
        settings = self._settings
        rows = motion_rows(sweep, self.task.wanted_gap, settings.margin * self.task.unit, settings)
        lack = float(np.sum(room_lacking(sweep, self.task.wanted_gap, settings))) / self.task.unit
        merit = self._cost.value(sweep) + settings.price * lack
        return _Iterate(sweep, rows, lack, merit, damping, prices)

    def _round(self, iterate: _Iterate) -> _Iterate | None:
        """One accepted step, or None when none is."""
        settings = self._settings
        task = self.task
        sweep = iterate.sweep
        rows = iterate.rows
        values = rows.values(sweep)
        near = np.flatnonzero(values > -settings.active * task.unit)
        group = max(1, -(-task.arm.links // _GROUPS))
        active = rows.take(near).take(tightest(rows.take(near), values[near], group))
        goal = None if self.end_fixed else task.goal
        held = self._held_rows(sweep)
        for _ in range(settings.tries):
            program = SpaceKeyframeProgram(
                sweep, self._cost, active, iterate.prices, iterate.damping, goal, settings, held
            )
            step = program.solve()
            following = None
            failing = np.zeros(0, dtype=np.intp)
            if step is not None:
                following, failing = self._part_taken(iterate, step)
            if following is not None:
                return following
            if task.deadline.passed():
                return None
            prices = iterate.prices.copy()
            prices[failing] *= _PRICE_RISE
            damping = _REFUSED_GROWTH * max(iterate.damping, settings.raised_damping)
            iterate = replace(iterate, damping=damping, prices=prices)
        return None

    def _part_taken(self, iterate: _Iterate, step: SpaceQuadraticStep) -> tuple[_Iterate | None, IntArray]:
        """The longest part of a step that gains what was foreseen and is certified, and where longer ones failed."""
        settings = self._settings
        start = iterate.sweep
        rows = iterate.rows
        failed = np.zeros(0, dtype=np.intp)
        cost = self._cost.value(start)
        worst = self._worst(rows, start)
        before = cost + float(iterate.prices @ worst)
        foreseen = step.foreseen + float(iterate.prices @ (worst - step.slack))
        for share in _SHORTENINGS:
            unknowns = self._ended(start.unknowns + share * step.change)
            if unknowns is None:
                continue
            if self.terms is not None:
                unknowns = self.terms.restored(self.stepper, unknowns)
            sweep = SpaceSweep(self.stepper, unknowns)
            if not self._holds(sweep):
                continue
            after = self._cost.value(sweep)
            worst_after = self._worst(rows, sweep)
            gain = (before - after - float(iterate.prices @ worst_after)) / max(share * foreseen, 1e-12)
            # Negated, so that a gain that is not a number is refused.
            if not gain > _SUFFICIENT or not all(self.stepper.within_limits(q) for q in sweep.configurations):
                continue
            failing = failing_edges(self.stepper, unknowns)
            if len(failing) == 0:
                prices = iterate.prices.copy()
                prices[failed] *= _PRICE_RISE
                lacking = worst_after * self.task.unit > _LACK * self.task.wanted_gap
                prices[lacking] = np.minimum(_LACK_RISE * prices[lacking], settings.highest_price)
                return self._iterate(sweep, self._damped(iterate.damping, share, gain), prices), failed
            failed = failing
        return None, failed

    def _held_rows(self, sweep: SpaceSweep) -> KeyframeRows | None:
        """What single keyframes have to keep, by the user's terms and by the places that the tip passes."""
        return KeyframeRows.joined([part.rows(sweep) for part in (self.terms, self.passing) if part is not None])

    def _holds(self, sweep: SpaceSweep) -> bool:
        """Whether the keyframes of a motion keep that."""
        return all(part.holds(sweep) for part in (self.terms, self.passing) if part is not None)

    def _worst(self, rows: SpaceRows, sweep: SpaceSweep) -> FloatArray:
        """By how much the worst row of every interval is not kept, at least 0, in nominal links, shape (K,)."""
        worst = np.zeros(sweep.intervals)
        # Rows at the given start can never be mended.
        free = rows.free
        np.maximum.at(worst, rows.interval[free], rows.values(sweep)[free] / self.task.unit)
        return worst

    def _ended(self, unknowns: FloatArray) -> FloatArray | None:
        """The motion with its last keyframe exactly on the goal; None where that fails."""
        if self.end_fixed or self.task.goal is None:
            return unknowns
        last = self.stepper.pose(unknowns[-1])
        onto = onto_goal(self.stepper, self.task.goal, last)
        if onto is None:
            return unknowns if self.task.goal.met(last) else None
        return np.vstack((unknowns[:-1], onto.v))

    def _damped(self, damping: float, share: float, gain: float) -> float:
        """More damping after a shortened step, less after a good one."""
        settings = self._settings
        if share < 1.0:
            return max(damping, settings.raised_damping) * settings.shortened_growth
        if gain > settings.good:
            return max(damping / settings.good_shrinkage, settings.least_damping)
        return damping


def optimise(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """A shorter, smoother and roomier motion in the same homotopy class; the given one where none is found.

    Where that lacks room, another is made of more keyframes, in which room is dearer, and the roomier one is taken.

    Args:
        motion: certified.
        task: what it is for.
    """
    settings = task.settings.optimisation
    first = _optimised(motion, task)
    lacking = _lacking(task, first)
    if lacking <= _FINER_LACK * task.wanted_gap or task.deadline.passed():
        return first
    finer = replace(settings, intervals=_FINER_INTERVALS, price=_FINER_PRICE)
    finer = replace(finer, highest_price=settings.highest_price * _FINER_PRICE / settings.price)
    second = _optimised(motion, replace(task, settings=replace(task.settings, optimisation=finer)))
    return second if _lacking(task, second) < lacking else first


def _lacking(task: SpaceTask, motion: SpaceMotion) -> float:
    """By how much more of the wanted room a motion lacks on its way than at its ends [m]."""
    sweep = SpaceSweep(task.stepper(motion.curve, 0.0), motion.unknowns)
    return room_lacking_on_the_way(sweep, task.wanted_gap, task.settings.optimisation)


def _optimised(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """What comes of one run of the optimisation; the motion itself where nothing does."""
    settings = task.settings.optimisation
    # The straight way between two keyframes is the best there is, unless the user wants something else of it.
    if task.deadline.passed() or (len(motion.unknowns) < 3 and task.user is None and not task.via):
        return motion
    stepper = task.stepper(motion.curve, 0.0)
    end_fixed = _is_end_fixed(task, stepper, motion.unknowns[-1])
    left = _ROUNDS
    unknowns = motion.unknowns
    u = _parameters(motion)
    while left > 0 and not task.deadline.passed():
        passed = _with_passings(task, stepper, unknowns, u)
        few = _few_keyframes(task, stepper, motion, *passed)
        if few is None and left == _ROUNDS:
            return motion
        if few is not None:
            keyframes, u = few
        else:
            # No fewer keep the user's constraints: those of the round before do, and are optimised to the end.
            keyframes = unknowns
        many = few is not None and len(keyframes) - 1 > settings.many * settings.intervals
        taken = min(left, _FIRST_ROUNDS) if many else left
        terms = None if task.user is None else UserKeyframes(task.user, u)
        passing = None if not task.via else _passing(task, stepper, keyframes, passed[0][passed[2]])
        better = SequentialConvex(task, stepper, end_fixed, terms, passing).optimised(keyframes, taken)
        left -= taken
        stuck = np.array_equal(better, keyframes)
        unknowns = better
        if not many or stuck:
            break
    if len(failing_edges(stepper, unknowns)) > 0:
        # Keyframes in between belong to pieces that are not those which were certified.
        return motion
    return SpaceMotion(
        motion.curve,
        unknowns,
        motion.curve.configurations(in_pieces(stepper, unknowns)),
        motion.candidate,
        None if motion.u is None else u,
    )


def _few_keyframes(
    task: SpaceTask, stepper: SpaceStepper, motion: SpaceMotion, unknowns: FloatArray, u: FloatArray, kept: IntArray
) -> tuple[FloatArray, FloatArray] | None:
    """The keyframes of ``thinned``, put onto the user's constraints; None where that cannot be done."""
    keyframes, places = thinned(task, motion, unknowns, u, kept)
    if task.user is None:
        return keyframes, places
    terms = UserKeyframes(task.user, places)
    keyframes = terms.restored(stepper, keyframes)
    if not terms.holds(SpaceSweep(stepper, keyframes)) or len(failing_edges(stepper, keyframes)) > 0:
        return None
    return keyframes, places


def _is_end_fixed(task: SpaceTask, stepper: SpaceStepper, end: FloatArray) -> bool:
    """Whether a motion has to end in a given pose: where no tip counts, or limits keep it a little off its goal."""
    if task.goal is None:
        return True
    exact = onto_goal(stepper, task.goal, stepper.pose(end))
    return exact is None or not stepper.within_limits(exact.q)


def _parameters(motion: SpaceMotion) -> FloatArray:
    """Path parameters of the keyframes of a motion, even ones where it does not know its own, shape (K,)."""
    return np.linspace(0.0, 1.0, len(motion.unknowns)) if motion.u is None else motion.u


def _with_passings(
    task: SpaceTask, stepper: SpaceStepper, unknowns: FloatArray, u: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """A motion with keyframes where the tip comes nearest to the places that it passes, and their numbers.

    Args:
        task: with the places.
        stepper: makes poses.
        unknowns: at the keyframes, shape (k, p).
        u: their path parameters, shape (k,).

    Returns:
        The same with more keyframes, and the numbers of those at which the places are passed, shape (m,).
    """
    if not task.via:
        return unknowns, u, np.zeros(0, dtype=np.intp)
    tips = np.stack([stepper.pose(v).tip for v in unknowns])
    found = passings(tips, np.stack(task.via))
    along = np.unique(np.append(np.arange(len(u), dtype=np.float64), found.along))
    whole = np.column_stack([np.interp(along, np.arange(len(u)), column) for column in (*unknowns.T, u)])
    return whole[:, :-1], whole[:, -1], np.searchsorted(along, found.along)


def _passing(task: SpaceTask, stepper: SpaceStepper, keyframes: FloatArray, passed: FloatArray) -> PassingKeyframes:
    """Which keyframes, shape (K + 1, p), pass the places of a task: those with given unknowns, shape (m, p)."""
    away = np.max(np.abs(keyframes[None] - passed[:, None]), axis=2)
    wanted = _PASSING * task.via_reach
    return PassingKeyframes.of(SpaceSweep(stepper, keyframes), np.argmin(away, axis=1), np.stack(task.via), wanted)


def thinned(
    task: SpaceTask, motion: SpaceMotion, unknowns: FloatArray, u: FloatArray, kept: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Few keyframes of a motion, every edge between them certified, and their path parameters.

    Args:
        task: what the motion is for.
        motion: whose keyframes they are.
        unknowns: of all keyframes, shape (k, p).
        u: path parameters of the same, shape (k,).
        kept: numbers of keyframes that stay, shape (m,).

    Returns:
        Of shapes (K + 1, p) and (K + 1,); where the motion does not know its path parameters they are even.
    """
    settings = task.settings.optimisation
    stepper = task.stepper(motion.curve, 0.0)
    p = unknowns.shape[1]
    labelled = np.column_stack((unknowns, u))

    def failing(some: FloatArray) -> IntArray:
        return failing_edges(stepper, some[:, :p], _LEG_DEPTH)

    def fewer(stride: int) -> FloatArray:
        ends = np.unique((0, *kept, len(labelled) - 1))
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(_FIRST_STRIDE)
    configurations = motion.curve.configurations(few[:, :p])
    sizes = np.linalg.norm(np.diff(configurations * task.slowness, axis=0), axis=1)
    whole = subdivided(few, sizes, settings.intervals)
    if len(failing_edges(stepper, whole[:, :p])) > 0:
        # The bends of a fed arm are not linear along an edge: what lies in between is beyond a limit, and the motion's
        # own keyframes are not.
        whole = fewer(max(1, len(unknowns) // settings.intervals))
    own = np.linspace(0.0, 1.0, len(whole)) if motion.u is None else whole[:, p]
    return np.ascontiguousarray(whole[:, :p]), own
