"""Optimises a found motion: shortens it first, then increases its clearance.

A step that the certificate refuses is shortened, then damped, and slack in intervals with violations becomes more
costly; so the motion stays in its homotopy class, and every iterate is a usable motion.

A row keeps both ends of a link, over a whole interval, behind one half-space. The farther the link moves in the
interval, the more of the available clearance that costs; keyframes closer together leave more.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.motion import CurveMotion
from ccm_opt.planning.optimisation.objective import decimated, resampled, subdivided
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.spline_path import at_least_four, clamped_spline, places_along
from ccm_opt.problem import Weights

_CLEARANCE_SAMPLES = 5
"""Samples per leg between keyframes at which the clearance of a smooth path is measured. Taste."""

_GATE_INTERVALS = (40, 60, 90, 135)
"""Numbers of intervals tried in gates with hardly any play. Taste: a play of a hundredth of a radius needs about
sixty."""
_GATE_HALVINGS = 3
"""Number of times that legs which fail in gates may be halved. Taste."""
_WORTH_MANY = 0.05
"""Share of its length by which steps with many keyframes have to shorten a motion for more such steps. Taste."""
_COUNTED_ROUNDS = 2
"""Number of rounds that these steps count as. Measured: with 5, six crooked motions among clutter lasted 2 % longer
in the median."""
_KEPT_SHARE = 0.8
"""Share of its gap that a motion keeps when it is thinned. Taste."""
_FINER_LACK = 0.1
"""Share of the wanted gap above which a motion that lacks more is optimised again with more keyframes. Measured in
pipes and wing boxes with few links: seven in ten of those reach all the clearance available."""
_FINER_PRICE = 400.0
"""Initial price of slack in that optimisation."""
_MANY = 1.5
"""Number of intervals that counts as many, as a multiple of the intervals wanted. Taste."""
_FINER = 2.2
"""Factor of the number of intervals where a motion lacks clearance. Measured: of 18 motions among clutter that
lacked it, few gained much with as many as before, some with half as many more, most with this."""

_MOVED_ROUNDS = 24
"""Most steps where keyframes have to be moved onto limits. Taste."""
_MOST_INTERVALS = 60
"""Number of intervals above which a motion that no step moves is not subdivided further. Taste."""


def optimise(
    motion: CurveMotion[Any], task: SearchTask, margin: float | None = None, rounds: int | None = None
) -> CurveMotion[Any]:
    """Shorten a certified motion without leaving its homotopy class.

    Args:
        motion: piecewise linear in its unknowns, certified; its keyframes meet all equations.
        task: arm, workspace, goal, limits and deadline.
        margin: gap that rows demand beyond contact, as a fraction of the arm's length; the default when None.
        rounds: maximum number of steps; that of the settings when None.

    Returns:
        The last certified motion: with a shorter joint path (or better by the task's weights) and few keyframes, with
        the same start; the given motion when nothing shorter was found.
    """
    if task.optimiser == "none" or len(motion.unknowns) < 2 or task.deadline.passed():
        return motion
    whole = task.program(motion, margin)
    optimised = (_optimised_on_limits if task.user_limits else _optimised)(motion, task, whole, rounds)
    if not motion.curve.affine:
        # The bends of a fed arm are not linear between keyframes: others may have come in between.
        if len(whole.failures(optimised.unknowns)) > 0:
            return motion
        in_between = motion.curve.configurations(motion.curve.in_pieces(optimised.unknowns))
        return replace(optimised, configurations=in_between)
    # With default weights the objective is close to the length but not equal to it; other weights may ask for a longer
    # path.
    plain = task.weights == Weights() and task.wanted_gap == 0.0 and not task.user_limits
    return optimised if not plain or optimised.travel < motion.travel else motion


def _optimised_on_limits(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], rounds: int | None
) -> CurveMotion[Any]:
    """Return the motion optimised through keyframes that limits have moved.

    Returns the given motion when no optimised motion can be certified.
    """
    settings = task.settings.optimisation
    taken = _MOVED_ROUNDS if rounds is None else _MOVED_ROUNDS * rounds // settings.rounds
    # Between keyframes a motion leaves equations by the square of the step: where few keyframes fail, more may suffice.
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
    """Return the motion optimised with few keyframes.

    A crooked motion needs many keyframes to be certified, and fewer once it has been straightened: after several rounds
    the motion is thinned again, if possible.
    """
    settings = task.settings.optimisation
    left = settings.rounds if rounds is None else rounds
    keyframes, u = _few_keyframes(motion, task, whole, 0.0)
    while left > 0:
        many = len(keyframes) - 1 > _MANY * settings.intervals
        taken = min(left, settings.first_rounds) if many else left
        before = keyframes
        length = motion.travel
        motion = motion.through(sequential_convex(replace(whole, u=u), keyframes, taken))
        left -= _COUNTED_ROUNDS if many else taken
        if not many:
            continue
        stuck = np.array_equal(motion.unknowns, before)
        # Thinning must not bring a motion that has gained clearance back to the walls.
        keyframes, u = _few_keyframes(motion, task, whole, _KEPT_SHARE * task.least_gap(motion.configurations))
        if len(keyframes) - 1 <= _MANY * settings.intervals:
            continue
        # Among many walls the half-planes of long intervals let nothing move, while those of shorter ones do: a motion
        # that cannot have few keyframes keeps them, or is subdivided where no step moves it.
        slow = motion.travel > (1.0 - _WORTH_MANY) * length
        if slow and len(before) > (_MOST_INTERVALS if stuck else 0):
            break
        keyframes, u = finer(motion, whole, _FINER if stuck else 1.0)
    return motion


def finer(motion: CurveMotion[Any], whole: MotionProgram[Any], times: float) -> tuple[FloatArray, FloatArray]:
    """Return unknowns at keyframes for ``times`` as many, nearly even intervals, and their path parameters."""
    ways = whole.ways(motion.unknowns)
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    keyframes = subdivided(labelled, ways, int(np.ceil(times * len(ways))))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def _few_keyframes(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], gap: float
) -> tuple[FloatArray, FloatArray]:
    """Return keyframes and path parameters: the motion's own if there are few, else fewer with a certified gap [m]."""
    settings = task.settings.optimisation
    if settings.intervals <= len(motion.unknowns) - 1 <= _MANY * settings.intervals:
        return motion.unknowns, motion.path_parameters
    if whole.yielding:
        return _few_in_gates(motion, whole)
    return thinned(motion, task, gap=gap)


def _few_in_gates(motion: CurveMotion[Any], whole: MotionProgram[Any]) -> tuple[FloatArray, FloatArray]:
    """Return few certified keyframes centred in gates, or the motion's own keyframes, with their path parameters.

    Straight legs between poses in a gate leave its middle in proportion to the square of their
    turn, so thinned keyframes are restored.
    """
    u = motion.path_parameters
    restored = replace(whole, u=u).restored
    for intervals in _GATE_INTERVALS:
        few = resampled(motion.unknowns, u, intervals, whole.failures, restored, _GATE_HALVINGS)
        if few is not None and len(few[1]) < len(u):
            return few
    return motion.unknowns, u


def keeps_limits(motion: CurveMotion[Any], task: SearchTask) -> bool:
    """Return whether a motion's keyframes keep the user's limits, and the motion is certified between them."""
    if not task.user_limits:
        return True  # every motion in planning is certified
    return _certified(replace(task.program(motion), u=motion.path_parameters), motion.unknowns)


def _certified(program: MotionProgram[Any], unknowns: FloatArray) -> bool:
    """Return whether keyframes, shape (K + 1, p), and the motion between them keep every limit."""
    sweep = program.sweep(unknowns)
    return program.feasible(sweep, sweep) and len(program.failures(unknowns)) == 0


def thinned(
    motion: CurveMotion[Any], task: SearchTask, intervals: int | None = None, gap: float = -np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return unknowns at few keyframes on certified legs, shape (K + 1, p), and their path parameters, shape (K + 1,).

    Args:
        motion: certified motion.
        task: task of the motion.
        intervals: minimum number of intervals; that of the settings when None.
        gap: gap beyond contact that legs have to keep, where larger than the default [m].
    """
    settings = task.settings.optimisation
    intervals = settings.intervals if intervals is None else intervals
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    # Insert keyframes where the task requires them.
    along = np.union1d(np.arange(len(labelled)), task.marks(motion))
    labelled = np.column_stack([np.interp(along, np.arange(len(labelled)), column) for column in labelled.T])
    ends = np.unique((0, *np.searchsorted(along, task.marks(motion)), len(along) - 1))

    def failing(some: FloatArray) -> IntArray:
        # A shallow certificate: a leg that needs many bisections leaves the rows no clearance.
        return task.failures(motion.curve, some[:, :-1], settings.leg_depth, gap)

    def fewer(stride: int) -> FloatArray:
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(settings.first_stride)
    whole = task.program(motion)
    keyframes = subdivided(few, whole.ways(few[:, :-1]), intervals)
    if not motion.curve.affine and len(whole.failures(keyframes[:, :-1])) > 0:
        # The bends of a fed arm are not linear along an edge: a subdivided leg may exceed a limit, while the motion's
        # own keyframes do not.
        keyframes = fewer(max(1, len(labelled) // intervals))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def with_more_room(
    motion: CurveMotion[Any], begun: CurveMotion[Any], task: SearchTask, margin: float | None = None
) -> CurveMotion[Any]:
    """Return an optimised motion or, where it lacks clearance, the better of this motion and one with more keyframes.

    The motion with more keyframes is optimised with a higher price of missing clearance.

    Args:
        motion: optimised motion, certified.
        begun: certified motion from which the motion with more keyframes is optimised.
        task: task of the motions.
        margin: gap that rows of the optimisation demand, see ``optimise``.
    """
    # In the middle of a gate with hardly any play, no more clearance is possible.
    if task.wanted_gap == 0.0 or task.optimiser == "none" or motion.u is not None or task.program(motion).yielding:
        return motion
    lacking = _lacking(motion, task)
    if lacking <= _FINER_LACK * task.wanted_gap or task.deadline.passed():
        return motion
    settings = task.settings.optimisation
    steps = settings.steps
    dearer = replace(steps, price=_FINER_PRICE, highest_price=steps.highest_price * _FINER_PRICE / steps.price)
    finer = replace(settings, intervals=settings.finer_intervals, steps=dearer)
    other = optimise(begun, replace(task, settings=replace(task.settings, optimisation=finer)), margin)
    return other if _lacking(other, task) < lacking else motion


def _lacking(motion: CurveMotion[Any], task: SearchTask) -> float:
    """Return by how much more the smooth path falls short of the preferred gap on its way than at its ends [m]."""
    control = at_least_four(motion.unknowns)
    unknowns = clamped_spline(control)(places_along(len(control), _CLEARANCE_SAMPLES))
    lacking = task.room_lacking(motion.curve.configurations(unknowns))
    return float(np.max(lacking) - np.max(lacking[[0, -1]]))
