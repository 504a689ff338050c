"""A long way round among many walls is cut short before it is optimised.

A motion that needs many keyframes to be certified is dear to optimise, step by step, and mostly long because a guide
went to and fro. Random shortcuts, refuted by samples and certified, take half of it away at a small part of that cost.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.shortcuts import Shortcuts, dense
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.optimise import thinned


def straightened(motion: Motion, task: MotionTask) -> Motion:
    """A certified motion made shorter where it needs many keyframes; the same motion where it does not.

    Args:
        motion: certified, in its link space.
        task: it was found for.
    """
    settings = task.settings.straightening
    # Users' limits do not judge straight motions, and few links do not say which curve they stand for.
    fits = motion.u is None and not task.user_limits and task.arm.links > task.settings.connect.few_links
    if not fits or task.optimiser == "none" or task.deadline.passed():
        return motion
    intervals = len(thinned(motion, task.certificate)[0]) - 1
    if intervals <= settings.many:
        return motion
    check = SampledCheck.of(task.arm, task.workspace, task.settings.connect.sampling)
    shortcuts = Shortcuts(check, task.certificate.failures, settings.shortcuts)
    way = shortcuts.shortened(motion.headings, np.random.default_rng((task.seed, settings.stream)))
    coordinates = _coordinates(motion.space, dense(way, settings.turn), motion)
    headings = motion.space.headings(coordinates)
    # The same way but for rounding.
    if len(task.certificate.failures(headings)):
        return motion
    return replace(motion, coordinates=coordinates, headings=headings)


def _coordinates(space: LinkSpace, way: FloatArray, motion: Motion) -> FloatArray:
    """Coordinates of link headings of the space, shape (K, links) to (K, p); those of the motion's ends stay."""
    inside = np.linalg.lstsq(space.matrix, (way[1:-1] - space.headings(np.zeros(space.dimension))).T, rcond=None)[0].T
    return np.vstack((motion.coordinates[:1], inside, motion.coordinates[-1:]))
