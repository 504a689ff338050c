"""The limits on the accelerations of the arm's coordinates: |q' s̈ + q'' ṡ²| ≤ a."""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.retiming.motion_limits.motion_limit import MotionLimit, SpeedRows
from ccm_opt.retiming.motion_samples import MotionSamples, mean_rates, of_samples, second_differences
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import ProfileSettings


class CoordinateAcceleration(MotionLimit):
    """Every coordinate's acceleration.

    Args:
        limit: of every coordinate, shape (n,) [rad/s², m/s²].
    """

    kept_by_legs = True

    def __init__(self, limit: FloatArray) -> None:
        self._limit = limit

    @classmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator["CoordinateAcceleration"]:
        """One limit for all coordinates."""
        del settings
        yield cls(path.bounds.acceleration)

    def rows(self, spline: BSpline, s: FloatArray) -> SpeedRows:
        """A row a coordinate."""
        # q̈ = q' s̈ + q'' ṡ².
        a = spline(s, 1) / self._limit
        b = spline(s, 2) / self._limit
        return SpeedRows(a, b, np.zeros_like(a))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """By the accelerations, the differences of velocities and the second differences of places."""
        step = samples.steps
        reported = np.max(np.abs(samples.acceleration) / self._limit, axis=1)
        gained = np.max(np.abs(mean_rates(samples.velocity, step)) / self._limit, axis=1)
        second = np.max(np.abs(second_differences(samples.place, step)) / self._limit, axis=1)
        return np.asarray(np.sqrt(np.maximum.reduce([reported, of_samples(gained), second])))
