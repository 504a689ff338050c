"""More samples where an acceleration swings between them: what is written shows what the joints do.

The velocity that a joint gains in a step lies between what the accelerations at its two ends would give, unless the
acceleration jumps twice in the step or turns round in it. Paths with a corner at every keyframe do that every few
milliseconds. Such steps are halved until what they hide is a small share of the velocity gained and lost.
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.motion_samples import MotionSamples
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, SamplingSettings


def unseen_gains(samples: MotionSamples) -> FloatArray:
    """Velocity gained in each step beyond what the accelerations at its ends explain, shape (T − 1, n) [rad/s, m/s]."""
    step = samples.steps
    gained = np.diff(samples.velocity, axis=0)
    most = step * np.maximum(samples.acceleration[1:], samples.acceleration[:-1])
    least = step * np.minimum(samples.acceleration[1:], samples.acceleration[:-1])
    return np.asarray(np.maximum(np.maximum(gained - most, least - gained), 0.0))


def halved_where_unseen(
    samples: MotionSamples, acceleration: FloatArray, settings: SamplingSettings = DEFAULT_TIMING.sampling
) -> FloatArray | None:
    """Sample times with those steps halved that hide too much of what a column's acceleration does.

    Args:
        samples: of a motion.
        acceleration: limit of every column, shape (n,) [rad/s², m/s²].
        settings: what may stay unseen.

    Returns:
        Times [s]; None where the samples show enough.
    """
    step = samples.steps
    unseen = unseen_gains(samples)
    gained = np.sum(np.abs(np.diff(samples.velocity, axis=0)), axis=0)
    duration = samples.time[-1]
    allowed = settings.unseen_share * gained + settings.unseen_floor * duration * acceleration
    hiding = np.sum(unseen, axis=0) > allowed
    if not hiding.any():
        return None
    # Steps within their share of what is allowed may stay: together they cannot pass it.
    too_much = np.any(unseen[:, hiding] > allowed[hiding] * step / duration, axis=1)
    middles = 0.5 * (samples.time[1:] + samples.time[:-1])
    return np.union1d(samples.time, middles[too_much])
