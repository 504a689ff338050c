"""Optimisation of a certified motion: fewer keyframes, a shorter joint path, then more clearance.

A step that the certificate refuses is shortened, then damped, and slack in intervals with violations becomes more
costly; so the motion stays in its homotopy class, and every iterate is a usable motion.

A row keeps both ends of a link in one half-space over a whole interval. The farther the link moves in the interval, the
more of the available clearance is lost; more closely spaced keyframes lose less.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import points_at
from ccm_opt.planning.motion import CurveMotion
from ccm_opt.planning.optimisation.objective import decimated, resampled, subdivided
from ccm_opt.planning.optimisation.program import KeyframeProgram
from ccm_opt.planning.optimisation.sequential_convex import FIRST_DAMPING, MotionProgram, priced, sequential_convex
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.settings import ConvexSettings
from ccm_opt.planning.spline_path import DEGREE, at_least_four, clamped_spline, halved, places_along
from ccm_opt.problem import Weights
from ccm_opt.problem.solution import ClearanceLimit

_CLEARANCE_SAMPLES = 5
"""Number of samples per interval at which the clearance of a smooth path is measured. Heuristic."""

_GATE_INTERVALS = (40, 60, 90, 135)
"""Numbers of intervals that are tried for motions through narrow gates, in order.

Heuristic: for a clearance of a hundredth of a radius, about sixty are needed.
"""
_GATE_HALVINGS = 3
"""Maximum number of times that uncertified intervals in gates are halved. Heuristic."""
_WORTH_MANY = 0.05
"""Relative shortening of a motion, by steps with many keyframes, below which no further such steps are made.
Heuristic."""
_COUNTED_ROUNDS = 2
"""Number of rounds that a series of steps with many keyframes counts as, however many steps it has.

Measured: with 5, six strongly curved motions among clutter lasted 2 % longer in the median.
"""
_KEPT_SHARE = 0.8
"""Fraction of its gap that a motion must still have after keyframes are removed. Heuristic."""
_FINER_LACK = 0.1
"""Lack of clearance, as a fraction of the preferred gap, above which a motion is optimised again with more keyframes.

Measured in pipes and wing boxes with few links: seven in ten of those reach all the clearance available.
"""
_FINER_PRICE = 400.0
"""Initial price of slack in a repeated optimisation with more keyframes."""
_FINER_WORTH = 5e-3
"""Largest gain, relative to the merit, below which a step of a repeated optimisation counts as without gain.

Measured: a keyhole keeps 5.0 instead of 4.0 mm of 5.0, with three more steps, than with four times as much.
"""
_DIVISIONS = 2
"""Maximum number of times that intervals in which a motion lacks clearance are halved. Heuristic."""
_MANY = 1.5
"""Number of intervals above which a motion has many keyframes, as a multiple of the desired number. Heuristic."""
_FINER = 2.2
"""Factor by which the number of intervals is increased if no step moves a motion.

Measured: of 18 motions among clutter that lacked clearance, few gained much with factor 1, several with 1.5, most with
this factor.
"""

_IMPROVABLE = 0.3
"""Fraction of the missing clearance that one more step, or one more division of intervals, has to gain for a motion to
count as improvable. Heuristic."""

_MOVED_ROUNDS = 24
"""Maximum number of steps for motions under user limits, onto which keyframes have to be moved. Heuristic."""
_MOST_INTERVALS = 60
"""Number of intervals above which a motion that no step moves is not subdivided further. Heuristic."""


def optimise(
    motion: CurveMotion[Any], task: SearchTask, margin: float | None = None, rounds: int | None = None
) -> CurveMotion[Any]:
    """Return a motion with a shorter joint path and few keyframes in the homotopy class of a given motion.

    Args:
        motion: certified motion, piecewise linear in its unknowns, whose keyframes satisfy all equations.
        task: arm, workspace, goal, limits, weights and deadline.
        margin: gap beyond contact that constraint rows demand, as a fraction of the arm's length; the default if None.
        rounds: maximum number of steps; that of the settings if None.

    Returns:
        The certified motion of the last step, with the start of the given motion and a shorter joint path (or a lower
        objective by the task's weights); the given motion if no such motion was found.
    """
    if task.optimiser == "none" or len(motion.unknowns) < 2 or task.deadline.passed():
        return motion
    whole = task.program(motion, margin)
    optimised = (_optimised_on_limits if task.user_limits else _optimised)(motion, task, whole, rounds)
    if not motion.curve.affine:
        # The bends of an arm with a feed axis may be nonlinear between keyframes, so configurations are inserted.
        if len(whole.failures(optimised.unknowns)) > 0:
            return motion
        in_between = motion.curve.configurations(motion.curve.in_pieces(optimised.unknowns))
        return replace(optimised, configurations=in_between)
    # With default weights the objective is close to the length but not equal to it; other weights may prefer a longer
    # path.
    plain = task.weights == Weights() and task.wanted_gap == 0.0 and not task.user_limits
    return optimised if not plain or optimised.travel < motion.travel else motion


def _optimised_on_limits(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], rounds: int | None
) -> CurveMotion[Any]:
    """Return a motion optimised under user-defined limits, after its keyframes have been moved onto the limits.

    Args:
        motion: certified motion.
        task: task of the motion.
        whole: optimisation problem of the motion.
        rounds: maximum number of steps without user limits, which is scaled to a number with them; that of the settings
            if None.

    Returns:
        The optimised motion; the given motion if none can be certified.
    """
    settings = task.settings.optimisation
    taken = _MOVED_ROUNDS if rounds is None else _MOVED_ROUNDS * rounds // settings.rounds
    # Between keyframes a motion violates equations by the square of the step: if few keyframes fail, more may suffice.
    for intervals in settings.moved_intervals:
        keyframes, u = thinned(motion, task, intervals)
        program = replace(whole, u=u)
        start = program.restored(keyframes)
        # Thinned keyframes are certified; those that a limit has moved have to be certified again.
        if start is keyframes or _certified(program, start):
            # The result is the best known motion under the limits, even where the found motion was shorter.
            return replace(motion.through(sequential_convex(program, start, taken)), u=u)
    return motion


def _optimised(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], rounds: int | None
) -> CurveMotion[Any]:
    """Return a motion optimised with as few keyframes as can be certified.

    A strongly curved motion needs many keyframes to be certified, and fewer once it has been straightened, so keyframes
    are removed again after several rounds, if possible.

    Args:
        motion: certified motion.
        task: task of the motion.
        whole: optimisation problem of the motion.
        rounds: maximum number of steps; that of the settings if None.
    """
    settings = task.settings.optimisation
    left = settings.rounds if rounds is None else rounds
    keyframes, u = _few_keyframes(motion, task, whole, 0.0)
    while left > 0 and not task.deadline.passed():
        many = len(keyframes) - 1 > _MANY * settings.intervals
        taken = min(left, settings.first_rounds) if many else left
        before = keyframes
        length = motion.travel
        motion = motion.through(sequential_convex(replace(whole, u=u), keyframes, taken))
        left -= _COUNTED_ROUNDS if many else taken
        if not many:
            continue
        stuck = np.array_equal(motion.unknowns, before)
        # Removing keyframes must not bring a motion that has gained clearance back to the walls.
        keyframes, u = _few_keyframes(motion, task, whole, _KEPT_SHARE * task.least_gap(motion.configurations))
        if len(keyframes) - 1 <= _MANY * settings.intervals:
            continue
        # Among many walls the half-planes of long intervals block all motion, while those of shorter ones do not: a
        # motion that needs many keyframes keeps them, and is subdivided if no step moves it.
        slow = motion.travel > (1.0 - _WORTH_MANY) * length
        if slow and len(before) > (_MOST_INTERVALS if stuck else 0):
            break
        keyframes, u = finer(motion, whole, _FINER if stuck else 1.0)
    return motion


def finer(motion: CurveMotion[Any], whole: MotionProgram[Any], times: float) -> tuple[FloatArray, FloatArray]:
    """Return unknowns (K + 1, p) and path parameters (K + 1,) of a motion divided into more, nearly even intervals.

    Args:
        motion: the motion.
        whole: optimisation problem, which defines the lengths of intervals.
        times: factor of the number of intervals.
    """
    ways = whole.ways(motion.unknowns)
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    keyframes = subdivided(labelled, ways, int(np.ceil(times * len(ways))))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def _few_keyframes(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], gap: float
) -> tuple[FloatArray, FloatArray]:
    """Return few keyframes of a motion with certified intervals: unknowns (K + 1, p), path parameters (K + 1,).

    The motion's own keyframes are returned if they are few.

    Args:
        motion: certified motion.
        task: task of the motion.
        whole: optimisation problem of the motion.
        gap: gap beyond contact that intervals between few keyframes have to keep [m].
    """
    settings = task.settings.optimisation
    if settings.intervals <= len(motion.unknowns) - 1 <= _MANY * settings.intervals:
        return motion.unknowns, motion.path_parameters
    if whole.local_step_reduction:
        return _few_in_gates(motion, whole)
    return thinned(motion, task, gap=gap)


def _few_in_gates(motion: CurveMotion[Any], whole: MotionProgram[Any]) -> tuple[FloatArray, FloatArray]:
    """Return few keyframes of a motion through narrow gates: unknowns (K + 1, p) and path parameters (K + 1,).

    The intervals between them are certified; the motion's own keyframes are returned if fewer cannot be certified.
    Intervals between poses in a gate deviate from the middle of the gate by the square of their rotation, so keyframes
    are moved back to the middle.
    """
    u = motion.path_parameters
    restored = replace(whole, u=u).restored
    for intervals in _GATE_INTERVALS:
        few = resampled(motion.unknowns, u, intervals, whole.failures, restored, _GATE_HALVINGS)
        if few is not None and len(few[1]) < len(u):
            return few
    return motion.unknowns, u


def keeps_limits(motion: CurveMotion[Any], task: SearchTask) -> bool:
    """Return whether a motion respects user-defined limits at its keyframes and all its intervals are certified."""
    if not task.user_limits:
        return True  # every motion in planning is certified
    return _certified(replace(task.program(motion), u=motion.path_parameters), motion.unknowns)


def _certified(program: MotionProgram[Any], unknowns: FloatArray) -> bool:
    """Return whether keyframes (K + 1, p) and the motion between them satisfy all limits of an optimisation problem."""
    sweep = program.sweep(unknowns)
    return program.feasible(sweep, sweep) and len(program.failures(unknowns)) == 0


def thinned(
    motion: CurveMotion[Any], task: SearchTask, intervals: int | None = None, gap: float = -np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return few keyframes of a certified motion between which all intervals are certified.

    Args:
        motion: certified motion.
        task: task of the motion, which may require certain keyframes.
        intervals: minimum number of intervals; that of the settings if None.
        gap: gap beyond contact that intervals have to keep, if above the default [m].

    Returns:
        Unknowns at the keyframes, shape (K + 1, p), and their path parameters, shape (K + 1,).
    """
    settings = task.settings.optimisation
    intervals = settings.intervals if intervals is None else intervals
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    # Insert keyframes where the task requires them.
    along = np.union1d(np.arange(len(labelled)), task.marks(motion))
    labelled = points_at(labelled, np.arange(float(len(labelled))), along)
    ends = np.unique((0, *np.searchsorted(along, task.marks(motion)), len(along) - 1))

    def failing(some: FloatArray) -> IntArray:
        # A certificate with few bisections: an interval that needs many leaves the rows no clearance.
        return task.failures(motion.curve, some[:, :-1], settings.leg_depth, gap)

    def fewer(stride: int) -> FloatArray:
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(settings.first_stride)
    whole = task.program(motion)
    keyframes = subdivided(few, whole.ways(few[:, :-1]), intervals)
    if not motion.curve.affine and len(whole.failures(keyframes[:, :-1])) > 0:
        # The bends of an arm with a feed axis may be nonlinear over an interval: a subdivided interval may exceed a
        # limit, while the motion's own keyframes do not.
        keyframes = fewer(max(1, len(labelled) // intervals))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def with_more_clearance(
    motion: CurveMotion[Any],
    task: SearchTask,
    margin: float | None = None,
    begun: CurveMotion[Any] | None = None,
) -> CurveMotion[Any]:
    """Return a motion with more clearance if an optimised motion falls short of the preferred gap.

    It is optimised again with more keyframes and a higher price of missing clearance, then with still more where it
    lacks clearance; the motion that lacks least is returned.

    Args:
        motion: optimised, certified motion.
        task: task of the motion.
        margin: gap beyond contact that constraint rows demand, as a fraction of the arm's length; the default if None.
        begun: certified motion that is optimised instead if the given one gains no clearance, or None.
    """
    # In the middle of a gate hardly wider than the arm, no more clearance is possible.
    if (
        task.wanted_gap == 0.0
        or task.optimiser == "none"
        or motion.u is not None
        or task.program(motion).local_step_reduction
    ):
        return motion
    if _worst_shortfall(motion, task) <= _FINER_LACK * task.wanted_gap or task.deadline.passed():
        return motion
    settings = task.settings.optimisation
    finer = replace(settings, intervals=settings.finer_intervals, steps=_dearer(settings.steps))
    finer_task = replace(task, settings=replace(task.settings, optimisation=finer))
    for start in (motion.through(motion.unknowns), *(() if begun is None else (begun,))):
        other = optimise(start, finer_task, margin)
        if _lacks_less(other, motion, task):
            return _divided_where_lacking(other, finer_task, margin)
    return motion


def _divided_where_lacking(motion: CurveMotion[Any], task: SearchTask, margin: float | None) -> CurveMotion[Any]:
    """Return a motion optimised again with more keyframes where its smooth path lacks clearance.

    Args:
        motion: optimised, certified motion.
        task: task of the motion, with the settings of the optimisation.
        margin: gap beyond contact that constraint rows demand, as a fraction of the arm's length; the default if None.

    Returns:
        The certified motion; the given one if no other lacks less.
    """
    for _ in range(_DIVISIONS):
        shortfalls = _shortfalls(motion, task)
        legs = np.flatnonzero(shortfalls > _FINER_LACK * task.wanted_gap)
        if len(legs) == 0 or task.deadline.passed():
            break
        divided = motion.through(halved(at_least_four(motion.unknowns), legs))
        # Over an interval a fed arm's configurations are not linear, so the halves of a certified one may fail.
        if not motion.curve.affine and len(task.failures(divided.curve, divided.unknowns)) > 0:
            break
        settings = replace(task.settings.optimisation, intervals=len(divided.unknowns) - 1)
        other = optimise(divided, replace(task, settings=replace(task.settings, optimisation=settings)), margin)
        if not _lacks_less(other, motion, task):
            break
        gained = np.max(shortfalls) - _worst_shortfall(other, task)
        motion = other
        if gained < _IMPROVABLE * np.max(shortfalls):
            break
    return motion


def clearance_limit(motion: CurveMotion[Any], task: SearchTask) -> ClearanceLimit | None:
    """Return the cause that keeps an optimised motion's clearance from growing; None if there is enough, or unknown.

    The cause is read off the multipliers of the QP of one more step, with the highest price of missing clearance.
    """
    if task.wanted_gap == 0.0 or _worst_shortfall(motion, task) <= _FINER_LACK * task.wanted_gap:
        return None
    if task.optimiser == "none":
        return "not optimised"
    program = replace(task.program(motion), u=motion.path_parameters)
    sweep = program.sweep(motion.unknowns)
    price = priced(replace(program, steps=_dearer(program.steps)), sweep).steps.highest_price
    prices = np.full(sweep.intervals * sweep.parts, price / sweep.parts)
    found = KeyframeProgram(program.linearised(sweep), prices, None, FIRST_DAMPING).clearance_limit(_IMPROVABLE)
    return "time" if found in ("steps", None) and task.deadline.passed() else found


def _dearer(steps: ConvexSettings) -> ConvexSettings:
    """Return settings of the steps with a higher price of missing clearance, which end later."""
    highest = steps.highest_price * _FINER_PRICE / steps.price
    return replace(steps, price=_FINER_PRICE, highest_price=highest, worth=min(steps.worth, _FINER_WORTH))


def _lacks_less(other: CurveMotion[Any], motion: CurveMotion[Any], task: SearchTask) -> bool:
    """Return whether a motion lacks less of the preferred gap than another one on their smooth paths.

    Where the path with the keyframes of either as control points would touch something, both motions are compared by
    themselves first, since the smooth path has to be refined towards the motion.
    """
    ours, others = _worst_shortfall(motion, task), _worst_shortfall(other, task)
    if max(ours, others) > task.wanted_gap:
        ours_alone, others_alone = _worst_shortfall(motion, task, degree=1), _worst_shortfall(other, task, degree=1)
        if others_alone != ours_alone:
            return others_alone < ours_alone
    return others < ours


def _worst_shortfall(motion: CurveMotion[Any], task: SearchTask, degree: int = DEGREE) -> float:
    """Return the largest shortfall from the preferred gap along a path with a motion's keyframes as control points [m].

    The shortfall at the start or goal, whichever is larger, is subtracted.

    Args:
        motion: the motion.
        task: task with the preferred gap.
        degree: degree of the path, that of the smooth path or 1 for the motion itself.
    """
    return float(np.max(_shortfalls(motion, task, degree)))


def _shortfalls(motion: CurveMotion[Any], task: SearchTask, degree: int = DEGREE) -> FloatArray:
    """Return the shortfall from the preferred gap along each leg of a path, shape (K,) [m].

    The path has a motion's K + 1 keyframes as control points, at least four. From the shortfall, that at the start or
    goal, whichever is larger, is subtracted.

    Args:
        motion: the motion.
        task: task with the preferred gap.
        degree: degree of the path, that of the smooth path or 1 for the motion itself.
    """
    control = at_least_four(motion.unknowns)
    places = places_along(len(control), _CLEARANCE_SAMPLES)
    if degree > 1:
        path = clamped_spline(control)
    else:
        path = make_interp_spline(np.linspace(0.0, 1.0, len(control)), control, 1)
    lacking = task.clearance_shortfall(motion.curve.configurations(path(places)))
    lacking -= np.max(lacking[[0, -1]])
    # Neighbouring legs share the sample between them.
    of_leg = np.lib.stride_tricks.sliding_window_view(lacking, _CLEARANCE_SAMPLES + 1)[::_CLEARANCE_SAMPLES]
    return np.asarray(np.max(of_leg, axis=1))
