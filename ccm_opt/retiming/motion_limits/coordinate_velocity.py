"""The limits on the velocities of the arm's coordinates: |q' ṡ| ≤ v."""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.motion_limits.motion_limit import MotionLimit
from ccm_opt.retiming.motion_samples import MotionSamples, mean_rates, of_samples
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import ProfileSettings


class CoordinateVelocity(MotionLimit):
    """Every coordinate's velocity.

    Args:
        limit: of every coordinate, shape (n,) [rad/s, m/s].
    """

    kept_by_legs = True

    def __init__(self, limit: FloatArray) -> None:
        self._limit = limit

    @classmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator["CoordinateVelocity"]:
        """One limit for all coordinates."""
        del settings
        yield cls(path.bounds.velocity)

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """The greatest |q'| / v of all coordinates."""
        return np.asarray(np.max(np.abs(spline(s, 1)) / self._limit, axis=1))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """By the velocities, and the mean velocities of the steps."""
        reported = np.max(np.abs(samples.velocity) / self._limit, axis=1)
        means = np.max(np.abs(mean_rates(samples.place, samples.steps)) / self._limit, axis=1)
        return np.asarray(np.maximum(reported, of_samples(means)))
