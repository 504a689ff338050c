"""More keyframes where an optimised motion still lacks room.

A row keeps both ends of a link, over a whole interval, behind one half-plane. The farther the link goes in the
interval, the more room that costs beside what there is; between near keyframes there is more to be had.
"""

from dataclasses import dataclass, replace

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.clamped_spline import DEGREE, clamped_spline, places_along
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.optimise import finer, motion_program, path_parameters
from ccm_opt.motion.optimisation.sequential_convex import MotionProgram, sequential_convex
from ccm_opt.motion.settings.optimisation_settings import OptimisationSettings
from ccm_opt.motion.swept_motion import Sweep


def room_of(motion: Motion, task: MotionTask) -> float:
    """Least gap of the smooth path that will be laid along a motion, as far as the wanted gap sees [m]."""
    return _room(motion.headings, task)


def lacks_room(motion: Motion, task: MotionTask) -> bool:
    """Whether a motion keeps less than the wanted gap, or than its ends leave of that, where more can be looked for."""
    # Keyframes that limits have moved stand where the path parameter has them.
    looked_for = task.wanted_gap > 0.0 and task.optimiser == "sequential-convex" and motion.u is None
    # In the middle of a gate with hardly any play there is all the room that there can be.
    looked_for = looked_for and task.gates is None
    return looked_for and len(motion.coordinates) > DEGREE and room_of(motion, task) < _enough_room(motion, task)


def with_more_room(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """The motion with more room, where it lacks some and more keyframes give it more.

    Args:
        motion: certified and optimised.
        task: it was optimised for.
        margin: that rows of the optimisation ask for, see ``optimise``.

    Returns:
        Certified, with the same ends.
    """
    settings = task.settings.optimisation
    if not lacks_room(motion, task) or task.deadline.passed():
        return motion
    wanted = _enough_room(motion, task)
    most = room_of(motion, task)
    roomier = _with_finer_keyframes(motion, settings)
    program = _program_to_end(roomier, task, margin)
    for _ in range(settings.room_passes):
        growth = RoomGrowth(task, wanted)
        coordinates = sequential_convex(program, roomier.coordinates, settings.room_rounds, growth.ended)
        roomier = replace(roomier, coordinates=coordinates, headings=motion.space.headings(coordinates))
        room = room_of(roomier, task)
        worthwhile = room >= settings.room_worth * most
        if room > most:
            motion = roomier
            most = room
        dear = len(roomier.coordinates) > settings.most_intervals
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

    def ended(self, sweep: Sweep) -> bool:
        """Whether a motion has enough room, or none has had more for long."""
        settings = self.task.settings.optimisation
        room = _room(sweep.headings, self.task)
        grows = room > settings.room_growth * self.most
        self.idle = 0 if grows else self.idle + 1
        self.most = max(self.most, room)
        return room >= self.wanted or self.idle >= settings.room_patience


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
    settings = task.settings.optimisation
    room = room_of(motion, task)
    if motion.u is not None or room <= 0.0 or task.deadline.passed():
        return motion
    kept = replace(task, wanted_gap=room)
    coordinates = sequential_convex(_program_to_end(motion, kept, margin), motion.coordinates, settings.room_rounds)
    shorter = replace(motion, coordinates=coordinates, headings=motion.space.headings(coordinates))
    return shorter if room_of(shorter, task) >= settings.enough_room * room else motion


def _program_to_end(motion: Motion, task: MotionTask, margin: float | None) -> MotionProgram:
    """The program of a motion that keeps its keyframes' number and its last pose."""
    to_end = task.ending_at(motion.coordinates[-1], motion.headings[-1])
    return replace(motion_program(motion, to_end, margin), u=path_parameters(motion))


def _with_finer_keyframes(motion: Motion, settings: OptimisationSettings) -> Motion:
    """The same motion with as many times the intervals, as even as may be; not beyond what is affordable."""
    now = len(motion.coordinates) - 1
    coordinates, _ = finer(motion, min(settings.finer, max(1.0, settings.finest / now)))
    return replace(motion, coordinates=coordinates, headings=motion.space.headings(coordinates))


def _enough_room(motion: Motion, task: MotionTask) -> float:
    """Nearly the wanted gap, or what the ends leave of it [m]."""
    most = min(task.wanted_gap, task.least_gap(motion.headings[[0, -1]]))
    return task.settings.optimisation.enough_room * most


def _room(headings: FloatArray, task: MotionTask) -> float:
    """Least gap of the spline near keyframes, shape (K, links) [m]."""
    samples = places_along(len(headings), task.settings.optimisation.room_samples)
    return task.least_gap(clamped_spline(headings)(samples))
