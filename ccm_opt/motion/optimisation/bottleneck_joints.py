"""Weights for the joints that decide how long a motion lasts: those that turn fastest.

A motion lasts as long as its busiest joint needs, while the sum of squared turns counts all joints alike. Weighed by a
power of how much each turns at most, in a motion that is nearly optimal, the sum comes near the largest of them
(iteratively reweighted least squares for a higher norm).
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY
from ccm_opt.motion.motion_task import JointSlowness, Motion, MotionTask
from ccm_opt.motion.settings.optimisation_settings import BottleneckSettings


def weighing_bottlenecks(motion: Motion, task: MotionTask) -> MotionTask:
    """The task with most of the weight of the path's length put on the joints that a motion turns most.

    Args:
        motion: nearly optimal, with keyframes at nearly even steps.
        task: with the user's weights and what the joints can do.
    """
    settings = task.settings.bottleneck
    weights = task.weights
    bends = motion.space.drives(motion.headings)
    if weights.path_length == 0.0 or len(bends) < settings.least_keyframes:
        return task
    slowness = task.slowness or JointSlowness.from_limits(np.ones(bends.shape[1]), np.ones(bends.shape[1]))
    busy = JointSlowness(
        slowness.speed * _busyness(slowness.speed * np.diff(bends, axis=0), settings),
        slowness.acceleration * _busyness(slowness.acceleration * np.diff(bends, 2, axis=0), settings),
    )
    moved = settings.share * weights.path_length
    shifted = replace(weights, path_length=weights.path_length - moved, duration=weights.duration + moved)
    return replace(task, weights=shifted, slowness=busy)


def _busyness(differences: FloatArray, settings: BottleneckSettings) -> FloatArray:
    """A factor for each joint by the largest of its differences, shape (m, links) to (links,)."""
    most = np.abs(differences).max(axis=0)
    mean = np.sqrt(np.mean(most**2))
    factors: FloatArray = np.clip(most / max(mean, TINY), settings.least, None) ** settings.power
    return factors
