"""Optimises a found motion: shorter first, then with more clearance.

A row keeps both ends of a link, over a whole interval, behind one half-plane. The farther the link goes in the
interval, the more room that costs beside what there is; between near keyframes there is more to be had.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.motion_certificate import IntervalCertificate, failed_intervals
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.objective import decimated, even_parameters, normalised, resampled, subdivided
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.planning.settings import OptimisationSettings
from ccm_opt.planning.spline_path import DEGREE, clamped_spline, places_along
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import Weights

_LEG_DEPTH = 2
"""Bisections that a leg of the thinned motion may need for its certificate. Taste."""
_FIRST_STRIDE = 16
"""Keyframes that a leg of the thinned motion skips at first. Taste."""
_REACH = 2.5
"""Walls and links farther apart than this many links make no rows. Taste."""
_FIRST_ROUNDS = 5
"""Steps at many keyframes, before the motion is thinned again. Taste."""
_ROOM_SAMPLES = 5
"""Places beside each leg between keyframes at which the room of a smooth path is measured. Taste."""

_GATE_INTERVALS = (40, 60, 90, 135)
"""The same in gates with hardly any play. Taste: the play of a hundredth of a radius asks for about sixty."""
_GATE_HALVINGS = 3
"""Times that legs which fail there may be halved. Taste."""
_LARGEST_LINK = 1.0 / 36.0
"""Share of the arm's length that counts as a link at most. Taste."""
_WORTH_MANY = 0.05
"""Share of the way by which steps at many keyframes have to shorten it for more of them. Taste."""
_COUNTED_ROUNDS = 2
"""As how many of the rounds these count. Measured: with 5, six crooked motions among clutter lasted 2 % longer in the
median."""
_KEPT_SHARE = 0.8
"""Share of its gap that a motion keeps when it is thinned. Taste."""
_ENOUGH_ROOM = 0.95
"""Share of the wanted gap, or of what the ends leave of it, that is enough. Taste."""
_GROUPS = 36
"""Arms with more links than this have rows for groups of neighbouring joints. Taste."""
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

PlanarProgram: TypeAlias = MotionProgram[PlanarSweep]
"""The program of a motion in the plane."""
NO_BREAKS = np.zeros(0)
"""No path parameters."""
_MARGIN = 1e-3
"""Gap that rows ask for beyond contact, as a share of the arm's length. Taste."""
_ACTIVE = 1.1
"""Rows nearer to their bound than this many such links enter the QP. Taste."""
_FINEST = 80
"""Intervals beyond which a motion is not cut finer for its room. Taste: the cost of a step."""
_MOVED_ROUNDS = 24
"""Most steps where keyframes have to be moved onto limits. Taste."""
MOST_INTERVALS = 60
"""Intervals of a motion beyond which none that lets nothing move is cut finer. Taste."""


def optimise(motion: Motion, task: MotionTask, margin: float | None = None, rounds: int | None = None) -> Motion:
    """Shorten a certified motion in its homotopy class.

    Args:
        motion: piecewise linear in its link space, certified; its keyframes meet all equations.
        task: arm, room, goal, limits and deadline.
        margin: gap that rows ask for beyond contact, as a share of the arm's length; the usual one when None.
        rounds: most steps; those of the settings when None.

    Returns:
        The last certified motion: with a shorter joint path (or whatever the task's weights ask for) and few
        keyframes, with the same start; the given one when nothing shorter was found.
    """
    if task.optimiser == "none" or len(motion.unknowns) < 2 or task.deadline.passed():
        return motion
    whole = motion_program(motion, task, margin)
    if task.user_limits:
        return _optimised_on_limits(motion, task, whole, rounds)
    optimised = _optimised(motion, task, whole, rounds)
    # With default weights the objective is close to the length but not the same; with others a longer path may be
    # what was asked for.
    plain = task.weights == Weights() and task.wanted_gap == 0.0
    return optimised if not plain or optimised.travel < motion.travel else motion


def _optimised_on_limits(motion: Motion, task: MotionTask, whole: PlanarProgram, rounds: int | None) -> Motion:
    """The motion optimised through keyframes that limits have moved; the given one when none can be certified."""
    settings = task.settings.optimisation
    taken = _MOVED_ROUNDS if rounds is None else _MOVED_ROUNDS * rounds // settings.rounds
    # Between keyframes a motion leaves equations by the square of the step: where few keyframes fail, more may do.
    for intervals in settings.moved_intervals:
        keyframes, u = thinned(motion, task.certificate, intervals, _breaks(task))
        program = replace(whole, u=u)
        start = program.restored(keyframes)
        # Thinned keyframes are certified; those that a limit has moved have to be judged anew.
        if start is keyframes or _certified(program, start):
            # What is left is the best there is under the limits, even where the found motion was shorter.
            return _with_keyframes(motion, sequential_convex(program, start, taken), u)
    return motion


def _optimised(motion: Motion, task: MotionTask, whole: PlanarProgram, rounds: int | None) -> Motion:
    """The motion optimised at few keyframes.

    A crooked motion needs many keyframes to be certified, and fewer once it has been straightened: after some rounds
    it is thinned again, if it can be.
    """
    settings = task.settings.optimisation
    left = settings.rounds if rounds is None else rounds
    keyframes, u = _few_keyframes(motion, task, whole, 0.0)
    while left > 0:
        program = replace(whole, u=u)
        many = len(keyframes) - 1 > _MANY * settings.intervals
        taken = min(left, _FIRST_ROUNDS) if many else left
        before = keyframes
        length = motion.travel
        motion = _with_keyframes(motion, sequential_convex(program, keyframes, taken), motion.u)
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
        keyframes, u = finer(motion, _FINER if stuck else 1.0)
    return motion


def finer(motion: Motion, times: float) -> tuple[FloatArray, FloatArray]:
    """The coordinates of the same motion at as many times the intervals, as even as may be, and their parameters."""
    turns = np.linalg.norm(np.diff(motion.curve.drives(motion.configurations), axis=0), axis=1)
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))
    keyframes = subdivided(labelled, turns, int(np.ceil(times * len(turns))))
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def _few_keyframes(
    motion: Motion, task: MotionTask, whole: PlanarProgram, spare: float
) -> tuple[FloatArray, FloatArray]:
    """Those of the motion when they are few, else fewer with a certified gap [m]; and their path parameters."""
    settings = task.settings.optimisation
    if settings.intervals <= len(motion.unknowns) - 1 <= _MANY * settings.intervals:
        return motion.unknowns, motion.path_parameters
    if task.gates is not None:
        return _few_in_gates(motion, whole)
    return thinned(motion, task.certificate_with(spare), settings.intervals)


def _few_in_gates(motion: Motion, whole: PlanarProgram) -> tuple[FloatArray, FloatArray]:
    """Few keyframes that lie in the middle of gates, certified, and their path parameters; those of the motion if none.

    Straight legs between poses in a gate leave it by the square of their turn: what is thinned has to be put back.
    """
    space = motion.curve
    u = motion.path_parameters

    def restored(coordinates: FloatArray) -> FloatArray:
        return replace(whole, u=u).restored(coordinates)

    def failures(coordinates: FloatArray) -> IntArray:
        return whole.failures(PlanarSweep(space, coordinates))

    for intervals in _GATE_INTERVALS:
        few = resampled(motion.unknowns, u, intervals, failures, restored, _GATE_HALVINGS)
        if few is not None and len(few[1]) < len(u):
            return few
    return motion.unknowns, u


def keeps_limits(motion: Motion, task: MotionTask) -> bool:
    """Whether a motion's keyframes keep the limits that users set, and the motion is certified between them."""
    if not task.user_limits:
        return True  # every motion that is made here is certified
    program = replace(motion_program(motion, task), u=motion.path_parameters)
    return _certified(program, motion.unknowns)


def _breaks(task: MotionTask) -> FloatArray:
    """Path parameters that keyframes have to be at, increasing."""
    return np.array(sorted({u for limit in task.user_limits for u in limit.breaks}))


def _certified(program: PlanarProgram, coordinates: FloatArray) -> bool:
    """Whether keyframes, shape (K + 1, p), keep every limit, and so does the motion between them."""
    sweep = program.sweep(coordinates)
    return program.feasible(sweep, sweep) and len(program.failures(sweep)) == 0


def _with_keyframes(motion: Motion, coordinates: FloatArray, u: FloatArray | None) -> Motion:
    """A motion with other keyframes in the same link space."""
    return replace(motion, unknowns=coordinates, configurations=motion.curve.configurations(coordinates), u=u)


def thinned(
    motion: Motion,
    certificate: IntervalCertificate,
    intervals: int = OptimisationSettings.intervals,
    breaks: FloatArray = NO_BREAKS,
) -> tuple[FloatArray, FloatArray]:
    """Coordinates at few keyframes on certified legs, shape (K + 1, p), and their path parameters, shape (K + 1,).

    Args:
        motion: certified; where it knows its path parameter, the keyframes are at even steps of that.
        certificate: of the legs.
        intervals: least number of intervals.
        breaks: path parameters that keyframes have to be at, where the motion knows its own.
    """
    space = motion.curve
    labelled = np.column_stack((motion.unknowns, motion.path_parameters))

    # Such a motion was tracked under limits that depend on u: its keyframes may not be shifted against u.
    if motion.u is not None:
        u = even_parameters(intervals, breaks)
        return np.column_stack([np.interp(u, motion.u, column) for column in motion.unknowns.T]), u

    # A shallow certificate: a leg that needs many bisections leaves the rows, which know none, no room.
    judged = partial(certificate.failures, depth=_LEG_DEPTH)
    few = decimated(labelled, lambda v: judged(space.configurations(v[:, :-1])), _FIRST_STRIDE)

    turns = np.diff(space.drives(space.configurations(few[:, :-1])), axis=0)
    keyframes = subdivided(few, np.linalg.norm(turns, axis=1), intervals)
    return np.ascontiguousarray(keyframes[:, :-1]), keyframes[:, -1]


def motion_program(motion: Motion, task: MotionTask, margin: float | None = None) -> PlanarProgram:
    """The program of a motion, its keyframes still to be chosen; arguments as for ``optimise``."""
    margin = _MARGIN if margin is None else margin
    length = task.arm.length
    # Few, long links would otherwise reach for every wall of the room.
    link = min(task.arm.link_length, _LARGEST_LINK * length)
    end = motion.curve.pose(motion.unknowns[-1])
    optimisation = task.settings.optimisation
    # Rows ask for the wanted gap and can buy slack where there is less; what is farther away has to be seen for it.
    limits = task.limits(task.finder(margin * length, _REACH * link + task.wanted_gap), task.wanted_gap)
    return MotionProgram(
        curve=motion.curve,
        sweep=partial(PlanarSweep, motion.curve),
        limits=limits,
        failures=lambda sweep: failed_intervals(limits, sweep.configurations),
        # Of a goal that is a set the motion keeps the member to which it was found.
        goal=task.limited_goal.nearest_member(end.tip, end.tip_direction),
        end_fixed=task.goal_pose is not None,
        u=np.zeros(0),
        deadline=task.deadline,
        weights=normalised(task.weights),
        wanted_gap=task.wanted_gap,
        seen=_ACTIVE * link + task.wanted_gap,
        groups=_GROUPS,
        steps=optimisation.steps,
        slowness=task.slowness,
        many=_MANY * optimisation.intervals,
        yielding=task.gates is not None,
    )


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
    roomier = _with_finer_keyframes(motion)
    program = _program_to_end(roomier, task, margin)
    for _ in range(_ROOM_PASSES):
        growth = RoomGrowth(task, wanted)
        coordinates = sequential_convex(program, roomier.unknowns, _ROOM_ROUNDS, growth.ended)
        roomier = replace(roomier, unknowns=coordinates, configurations=motion.curve.configurations(coordinates))
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
    coordinates = sequential_convex(_program_to_end(motion, kept, margin), motion.unknowns, _ROOM_ROUNDS)
    shorter = replace(motion, unknowns=coordinates, configurations=motion.curve.configurations(coordinates))
    return shorter if room_of(shorter, task) >= _ENOUGH_ROOM * room else motion


def _program_to_end(motion: Motion, task: MotionTask, margin: float | None) -> PlanarProgram:
    """The program of a motion that keeps its keyframes' number and its last pose."""
    to_end = task.ending_at(motion.unknowns[-1], motion.configurations[-1])
    return replace(motion_program(motion, to_end, margin), u=motion.path_parameters)


def _with_finer_keyframes(motion: Motion) -> Motion:
    """The same motion with as many times the intervals, as even as may be; not beyond what is affordable."""
    now = len(motion.unknowns) - 1
    coordinates, _ = finer(motion, min(_FINER, max(1.0, _FINEST / now)))
    return replace(motion, unknowns=coordinates, configurations=motion.curve.configurations(coordinates))


def _enough_room(motion: Motion, task: MotionTask) -> float:
    """Nearly the wanted gap, or what the ends leave of it [m]."""
    most = min(task.wanted_gap, task.least_gap(motion.configurations[[0, -1]]))
    return _ENOUGH_ROOM * most


def _room(q: FloatArray, task: MotionTask) -> float:
    """Least gap of the spline near keyframes, shape (K, c) [m]."""
    samples = places_along(len(q), _ROOM_SAMPLES)
    return task.least_gap(clamped_spline(q)(samples))
