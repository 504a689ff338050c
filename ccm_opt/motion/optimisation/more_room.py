"""More keyframes where an optimised motion still lacks room.

A row keeps both ends of a link, over a whole interval, behind one half-plane. The farther the link goes in the
interval, the more room that costs beside what there is; between near keyframes there is more to be had.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.clamped_spline import DEGREE, clamped_spline
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.keyframes import subdivided
from ccm_opt.motion.optimisation.optimise import motion_program, path_parameters
from ccm_opt.motion.optimisation.sequential_convex import sequential_convex
from ccm_opt.motion.swept_motion import Sweep


def with_more_room(motion: Motion, task: MotionTask, margin: float | None = None) -> Motion:
    """The motion with more room, where it lacks some and more keyframes give it more.

    Args:
        motion: certified and optimised.
        task: it was optimised for; its last pose stays.
        margin: that rows of the optimisation ask for, see ``optimise``.

    Returns:
        Certified, with the same ends.
    """
    settings = task.settings.optimisation
    # Keyframes that limits have moved stand where the path parameter has them.
    if (
        task.wanted_gap == 0.0
        or task.optimiser != "sequential-convex"
        or motion.u is not None
        or len(motion.coordinates) <= DEGREE
    ):
        return motion
    wanted = settings.enough_room * _most_room(motion, task)
    room = _room(motion.headings, task, settings.room_samples)
    if room >= wanted or task.deadline.passed():
        return motion

    to_end = replace(
        task, goal=replace(task.goal, coordinates=motion.coordinates[-1]), goal_headings=motion.headings[-1]
    )
    finer = _with_finer_keyframes(motion, settings.finer)
    program = replace(motion_program(finer, to_end, margin), u=path_parameters(finer))

    def enough(sweep: Sweep) -> bool:
        # Most steps are judged by few samples: a motion that lacks room there needs no more of them.
        return all(_room(sweep.headings, task, count) >= wanted for count in (1, settings.room_samples))

    for _ in range(settings.room_passes):
        coordinates = sequential_convex(program, finer.coordinates, settings.room_rounds, enough)
        finer = replace(finer, coordinates=coordinates, headings=motion.space.headings(coordinates))
        before = room
        room = _room(finer.headings, task, settings.room_samples)
        if room > before:
            motion = finer
        if room >= wanted or room < settings.room_worth * before or task.deadline.passed():
            break
    return motion


def _with_finer_keyframes(motion: Motion, finer: float) -> Motion:
    """The same motion with as many times the intervals, as even as may be."""
    turns = np.linalg.norm(np.diff(motion.space.bends(motion.headings), axis=0), axis=1)
    coordinates = subdivided(motion.coordinates, turns, int(np.ceil(finer * len(turns))))
    return replace(motion, coordinates=coordinates, headings=motion.space.headings(coordinates))


def _most_room(motion: Motion, task: MotionTask) -> float:
    """The wanted gap, or what the ends leave of it [m]."""
    return min(task.wanted_gap, task.least_gap(motion.headings[[0, -1]]))


def _room(headings: FloatArray, task: MotionTask, samples: int) -> float:
    """Least gap of the spline near keyframes, shape (K, links), at so many samples for each of them [m]."""
    return task.least_gap(clamped_spline(headings)(np.linspace(0.0, 1.0, samples * len(headings))))
