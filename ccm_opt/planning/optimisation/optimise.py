"""Optimises a found motion: shorter first, then with more clearance.

A step that the certificate refuses is shortened, then damped, and what an interval lacks becomes dearer; so the motion
stays in its homotopy class, and the last iterate is always fit for use.

A row keeps both ends of a link, over a whole interval, behind one half-space. The farther the link goes in the
interval, the more room that costs beside what there is; between near keyframes there is more to be had.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.motion import CurveMotion, Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.objective import decimated, resampled, subdivided
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.spline_path import DEGREE, clamped_spline, places_along
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import Weights

_ROOM_SAMPLES = 5
"""Places beside each leg between keyframes at which the room of a smooth path is measured. Taste."""

_GATE_INTERVALS = (40, 60, 90, 135)
"""The same in gates with hardly any play. Taste: the play of a hundredth of a radius asks for about sixty."""
_GATE_HALVINGS = 3
"""Times that legs which fail there may be halved. Taste."""
_WORTH_MANY = 0.05
"""Share of the way by which steps at many keyframes have to shorten it for more of them. Taste."""
_COUNTED_ROUNDS = 2
"""As how many of the rounds these count. Measured: with 5, six crooked motions among clutter lasted 2 % longer in the
median."""
_KEPT_SHARE = 0.8
"""Share of its gap that a motion keeps when it is thinned. Taste."""
_ENOUGH_ROOM = 0.95
"""Share of the wanted gap, or of what the ends leave of it, that is enough. Taste."""
_FINER_LACK = 0.15
"""A motion that lacks more than this share of the wanted gap is made again of more keyframes; in pipes and wing boxes
with few links seven in ten of those come out with all the room that there is."""
_FINER_INTERVALS = 32
"""Least number of intervals then."""
_FINER_PRICE = 400.0
"""First price of slack then."""
_MANY = 1.5
"""Keyframes that are many, as a multiple of the intervals wanted. Taste."""
_FINER = 2.2
"""As many times the keyframes where a motion lacks room. Measured: of 18 motions among clutter that lacked it, few
gained much with as many as before, some with half as many more, most with this."""
_ROOM_PASSES = 2
"""Times that steps at these keyframes are begun anew, with fresh prices. Taste."""
_ROOM_ROUNDS = 20
"""Most steps of each. Taste."""
_ROOM_WORTH = 1.1
"""As many times the room have to be gained for one more. Taste."""
_ROOM_GROWTH = 1.02
"""As many times the most room so far count as growth. Taste."""
_ROOM_PATIENCE = 6
"""Steps without growth after which a pass ends. Taste."""

_FINEST = 80
"""Intervals beyond which a motion is not cut finer for its room. Taste: the cost of a step."""
_MOVED_ROUNDS = 24
"""Most steps where keyframes have to be moved onto limits. Taste."""
MOST_INTERVALS = 60
"""Intervals of a motion beyond which none that lets nothing move is cut finer. Taste."""


def optimise(
    motion: CurveMotion[Any], task: SearchTask, margin: float | None = None, rounds: int | None = None
) -> CurveMotion[Any]:
    """Shorten a certified motion in its homotopy class.

    Args:
        motion: piecewise linear in its unknowns, certified; its keyframes meet all equations.
        task: arm, room, goal, limits and deadline.
        margin: gap that rows ask for beyond contact, as a share of the arm's length; the usual one when None.
        rounds: most steps; those of the settings when None.

    Returns:
        The last certified motion: with a shorter joint path (or whatever the task's weights ask for) and few
        keyframes, with the same start; the given one when nothing shorter was found.
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
    # With default weights the objective is close to the length but not the same; with others a longer path may be
    # what was asked for.
    plain = task.weights == Weights() and task.wanted_gap == 0.0 and not task.user_limits
    return optimised if not plain or optimised.travel < motion.travel else motion


def _optimised_on_limits(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], rounds: int | None
) -> CurveMotion[Any]:
    """The motion optimised through keyframes that limits have moved; the given one when none can be certified."""
    settings = task.settings.optimisation
    taken = _MOVED_ROUNDS if rounds is None else _MOVED_ROUNDS * rounds // settings.rounds
    # Between keyframes a motion leaves equations by the square of the step: where few keyframes fail, more may do.
    for intervals in settings.moved_intervals:
        keyframes, u = thinned(motion, task, intervals)
        program = replace(whole, u=u)
        start = program.restored(keyframes)
        # Thinned keyframes are certified; those that a limit has moved have to be judged anew.
        if start is keyframes or _certified(program, start):
            # What is left is the best there is under the limits, even where the found motion was shorter.
            return replace(motion.through(sequential_convex(program, start, taken)), u=u)
    return motion


def _optimised(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], rounds: int | None
) -> CurveMotion[Any]:
    """The motion optimised at few keyframes.

    A crooked motion needs many keyframes to be certified, and fewer once it has been straightened: after some rounds
    it is thinned again, if it can be.
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
        # A motion that keeps room already is not thinned into the walls again.
        keyframes, u = _few_keyframes(motion, task, whole, _KEPT_SHARE * task.least_gap(motion.configurations))
        if len(keyframes) - 1 <= _MANY * settings.intervals:
            continue
        # Among many walls the half-planes of long intervals leave no way on, and those of shorter ones do: what cannot
        # become few stays as it is, or is cut finer where nothing moves.
        slow = motion.travel > (1.0 - _WORTH_MANY) * length
        if slow and len(before) > (MOST_INTERVALS if stuck else 0):
            break
        keyframes, u = finer(motion, whole, _FINER if stuck else 1.0)
    return motion


def finer(motion: CurveMotion[Any], whole: MotionProgram[Any], times: float) -> tuple[FloatArray, FloatArray]:
    """The unknowns of the same motion at as many times the intervals, as even as may be, and their parameters."""
    ways = whole.ways(motion.unknowns)
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    keyframes = subdivided(labelled, ways, int(np.ceil(times * len(ways))))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def _few_keyframes(
    motion: CurveMotion[Any], task: SearchTask, whole: MotionProgram[Any], gap: float
) -> tuple[FloatArray, FloatArray]:
    """Those of the motion when they are few, else fewer with a certified gap [m]; and their path parameters."""
    settings = task.settings.optimisation
    if settings.intervals <= len(motion.unknowns) - 1 <= _MANY * settings.intervals:
        return motion.unknowns, motion.path_parameters
    if whole.yielding:
        return _few_in_gates(motion, whole)
    return thinned(motion, task, gap=gap)


def _few_in_gates(motion: CurveMotion[Any], whole: MotionProgram[Any]) -> tuple[FloatArray, FloatArray]:
    """Few keyframes that lie in the middle of gates, certified, and their path parameters; those of the motion if none.

    Straight legs between poses in a gate leave it by the square of their turn: what is thinned has to be put back.
    """
    u = motion.path_parameters
    restored = replace(whole, u=u).restored
    for intervals in _GATE_INTERVALS:
        few = resampled(motion.unknowns, u, intervals, whole.failures, restored, _GATE_HALVINGS)
        if few is not None and len(few[1]) < len(u):
            return few
    return motion.unknowns, u


def keeps_limits(motion: CurveMotion[Any], task: SearchTask) -> bool:
    """Whether a motion's keyframes keep the limits that users set, and the motion is certified between them."""
    if not task.user_limits:
        return True  # every motion that is made here is certified
    return _certified(replace(task.program(motion), u=motion.path_parameters), motion.unknowns)


def _certified(program: MotionProgram[Any], unknowns: FloatArray) -> bool:
    """Whether keyframes, shape (K + 1, p), keep every limit, and so does the motion between them."""
    sweep = program.sweep(unknowns)
    return program.feasible(sweep, sweep) and len(program.failures(unknowns)) == 0


def thinned(
    motion: CurveMotion[Any], task: SearchTask, intervals: int | None = None, gap: float = -np.inf
) -> tuple[FloatArray, FloatArray]:
    """Unknowns at few keyframes on certified legs, shape (K + 1, p), and their path parameters, shape (K + 1,).

    Args:
        motion: certified.
        task: what it is for.
        intervals: least number of intervals; that of the settings when None.
        gap: beyond contact that legs have to keep, where that is more than they have to anyway [m].
    """
    settings = task.settings.optimisation
    intervals = settings.intervals if intervals is None else intervals
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    # Keyframes are put in where the task wants some.
    along = np.union1d(np.arange(len(labelled)), task.marks(motion))
    labelled = np.column_stack([np.interp(along, np.arange(len(labelled)), column) for column in labelled.T])
    ends = np.unique((0, *np.searchsorted(along, task.marks(motion)), len(along) - 1))

    def failing(some: FloatArray) -> IntArray:
        # A shallow certificate: a leg that needs many bisections leaves the rows, which know none, no room.
        return task.failures(motion.curve, some[:, :-1], settings.leg_depth, gap)

    def fewer(stride: int) -> FloatArray:
        parts = [decimated(labelled[a : b + 1], failing, stride) for a, b in pairwise(ends)]
        return np.vstack((labelled[:1], *(part[1:] for part in parts)))

    few = fewer(settings.first_stride)
    whole = task.program(motion)
    keyframes = subdivided(few, whole.ways(few[:, :-1]), intervals)
    if not motion.curve.affine and len(whole.failures(keyframes[:, :-1])) > 0:
        # The bends of a fed arm are not linear along an edge: what lies in between is beyond a limit, and the motion's
        # own keyframes are not.
        keyframes = fewer(max(1, len(labelled) // intervals))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def optimise_with_room(motion: CurveMotion[Any], task: SearchTask) -> CurveMotion[Any]:
    """A motion that is optimised; where that lacks room, the roomier of it and of one of more and dearer keyframes.

    Args:
        motion: certified.
        task: what it is for.
    """
    first = optimise(motion, task)
    lacking = _lacking(first, task)
    if task.optimiser == "none" or lacking <= _FINER_LACK * task.wanted_gap or task.deadline.passed():
        return first
    settings = task.settings.optimisation
    steps = settings.steps
    dearer = replace(steps, price=_FINER_PRICE, highest_price=steps.highest_price * _FINER_PRICE / steps.price)
    finer = replace(settings, intervals=_FINER_INTERVALS, steps=dearer)
    second = optimise(motion, replace(task, settings=replace(task.settings, optimisation=finer)))
    return second if _lacking(second, task) < lacking else first


def _lacking(motion: CurveMotion[Any], task: SearchTask) -> float:
    """By how much more of the wanted room a motion lacks on its way than at its ends [m]."""
    at = np.linspace(0.0, len(motion.unknowns) - 1.0, 4 * len(motion.unknowns) - 3)
    unknowns = np.column_stack([np.interp(at, np.arange(len(motion.unknowns)), column) for column in motion.unknowns.T])
    lacking = task.room_lacking(motion.curve.configurations(unknowns))
    return float(np.max(lacking) - np.max(lacking[[0, -1]]))


def room_of(motion: Motion, task: MotionTask) -> float:
    """Least gap of the smooth path that will be laid along a motion, as far as the wanted gap sees [m]."""
    return _room(motion.configurations, task)


def lacks_room(motion: Motion, task: MotionTask) -> bool:
    """Whether a motion keeps less than the wanted gap, or than its ends leave of that, where more can be looked for."""
    # Keyframes that limits have moved stand where the path parameter has them.
    looked_for = task.wanted_gap > 0.0 and task.optimiser != "none" and motion.u is None
    # In the middle of a gate with hardly any play there is all the room that there can be.
    looked_for = looked_for and task.gates is None
    return looked_for and len(motion.unknowns) > DEGREE and room_of(motion, task) < _enough_room(motion, task)


def with_more_room(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """The motion with more room, where it lacks some and more keyframes give it more.

    Args:
        motion: certified and optimised.
        task: it was optimised for.
        margin: that rows of the optimisation ask for, see ``optimise``.

    Returns:
        Certified, with the same ends.
    """
    if not lacks_room(motion, task) or task.deadline.passed():
        return motion
    wanted = _enough_room(motion, task)
    most = room_of(motion, task)
    program = _program_to_end(motion, task, margin)
    # As even as may be; not beyond what is affordable.
    keyframes, u = finer(motion, program, min(_FINER, max(1.0, _FINEST / (len(motion.unknowns) - 1))))
    program = replace(program, u=u)
    roomier = motion.through(keyframes)
    for _ in range(_ROOM_PASSES):
        growth = RoomGrowth(task, wanted)
        roomier = motion.through(sequential_convex(program, roomier.unknowns, _ROOM_ROUNDS, growth.ended))
        room = room_of(roomier, task)
        worthwhile = room >= _ROOM_WORTH * most
        if room > most:
            motion = roomier
            most = room
        dear = len(roomier.unknowns) > MOST_INTERVALS
        if most >= wanted or not worthwhile or dear or task.deadline.passed():
            break
    return motion


@dataclass
class RoomGrowth:
    """Watches the room of motions from step to step.

    Attributes:
        task: they are for.
        wanted: room that is enough [m].
        most: the most so far [m].
        idle: steps since it grew.
    """

    task: MotionTask
    wanted: float
    most: float = 0.0
    idle: int = 0

    def ended(self, sweep: PlanarSweep) -> bool:
        """Whether a motion has enough room, or none has had more for long."""
        room = _room(sweep.configurations, self.task)
        grows = room > _ROOM_GROWTH * self.most
        self.idle = 0 if grows else self.idle + 1
        self.most = max(self.most, room)
        return room >= self.wanted or self.idle >= _ROOM_PATIENCE


def shortened(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """A motion that cannot have all the room that is wanted, made shorter with nearly the room that it has.

    What an interval lacks is so dear that steps serve nothing else; with no more asked than there is, they shorten
    the motion again.

    Args:
        motion: certified, in a bottleneck.
        task: it was optimised for.
        margin: that rows of the optimisation ask for, see ``optimise``.

    Returns:
        Certified, with the same ends.
    """
    room = room_of(motion, task)
    if motion.u is not None or room <= 0.0 or task.deadline.passed():
        return motion
    kept = replace(task, wanted_gap=room)
    shorter = motion.through(sequential_convex(_program_to_end(motion, kept, margin), motion.unknowns, _ROOM_ROUNDS))
    return shorter if room_of(shorter, task) >= _ENOUGH_ROOM * room else motion


def _program_to_end(motion: Motion, task: MotionTask, margin: float | None) -> MotionProgram[PlanarSweep]:
    """The program of a motion that keeps its keyframes' number and its last pose."""
    to_end = task.ending_at(motion.unknowns[-1], motion.configurations[-1])
    return replace(to_end.program(motion, margin), u=motion.path_parameters)


def _enough_room(motion: Motion, task: MotionTask) -> float:
    """Nearly the wanted gap, or what the ends leave of it [m]."""
    most = min(task.wanted_gap, task.least_gap(motion.configurations[[0, -1]]))
    return _ENOUGH_ROOM * most


def _room(q: FloatArray, task: MotionTask) -> float:
    """Least gap of the spline near keyframes, shape (K, c) [m]."""
    samples = places_along(len(q), _ROOM_SAMPLES)
    return task.least_gap(clamped_spline(q)(samples))
