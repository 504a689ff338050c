"""Thins a certified motion to few keyframes, optimises them all at once, and keeps what is certified."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.optimisation.keyframes import decimated, subdivided
from ccm_opt.space.motion.optimisation.space_sequential_convex import SequentialConvex
from ccm_opt.space.motion.pieces import failing_edges, in_pieces
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask


def optimise(motion: SpaceMotion, task: SpaceTask) -> SpaceMotion:
    """A shorter, smoother and roomier motion in the same homotopy class; the given one where none is found.

    Args:
        motion: certified.
        task: what it is for.
    """
    settings = task.settings.optimisation
    if len(motion.unknowns) < 3 or task.deadline.passed():
        return motion
    stepper = task.stepper(motion.curve, 0.0)
    programme = SequentialConvex(task, stepper, task.goal is None)
    left = settings.rounds
    unknowns = motion.unknowns
    while left > 0 and not task.deadline.passed():
        keyframes = thinned(task, motion, unknowns)
        many = len(keyframes) - 1 > settings.many * settings.intervals
        taken = min(left, settings.first_rounds) if many else left
        better = programme.optimised(keyframes, taken)
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
        np.stack([motion.curve.configuration(v) for v in in_pieces(stepper, unknowns)]),
        motion.candidate,
    )


def thinned(task: SpaceTask, motion: SpaceMotion, unknowns: FloatArray) -> FloatArray:
    """Few keyframes of a motion, every edge between them certified, shape (K + 1, p)."""
    settings = task.settings.optimisation
    stepper = task.stepper(motion.curve, 0.0)
    few = decimated(unknowns, lambda v: failing_edges(stepper, v, settings.leg_depth), settings.first_stride)
    configurations = np.stack([motion.curve.configuration(v) for v in few])
    sizes = np.linalg.norm(np.diff(configurations * task.slowness, axis=0), axis=1)
    return subdivided(few, sizes, settings.intervals)
