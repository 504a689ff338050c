"""Limits of a coordinate's speed, acceleration and jerk.

TOPP-RA knows no s⃛, so the fastest motion keeps only the part that the shape of the path causes; ``smoothing`` does the
rest.
"""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.retiming.motion_limits.motion_limit import MotionLimit, SpeedRows
from ccm_opt.retiming.motion_samples import MotionSamples, mean_rates, of_samples, second_differences
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import ProfileSettings

_JERK_SHARE = 0.7
"""Share of the jerk limits that may go to the shape of the path, whose third derivative jumps at knots. Taste."""


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


BESIDE = 1e-10
"""Distance in s at which a jump of the third derivative is looked at from both sides; a guard against rounding."""


class CoordinateJerk(MotionLimit):
    """Every coordinate's jerk.

    Args:
        limit: of every coordinate, shape (n,) [rad/s³, m/s³], inf where it is not limited.
        share: of the limit that may go to the shape of the path.
    """

    def __init__(self, limit: FloatArray, share: float) -> None:
        self._limit = limit
        self._share = share

    @classmethod
    def from_path(cls, path: TimedPath, settings: ProfileSettings) -> Iterator["CoordinateJerk"]:
        """One limit for all coordinates, where any of them has one."""
        del settings
        if path.bounds.smooth:
            yield cls(path.bounds.jerk, _JERK_SHARE)

    def slowness(self, spline: BSpline, s: FloatArray) -> FloatArray:
        """1/ṡ at which q''' ṡ³, due to the path's shape, takes its share of the limit."""
        before, after = sides_of_third(spline, s)
        third = np.maximum(np.abs(before), np.abs(after))
        return np.asarray(np.cbrt(np.max(third / self._limit, axis=1) / self._share))

    def stretches(self, samples: MotionSamples) -> FloatArray:
        """By the differences of accelerations, and of mean accelerations."""
        step = samples.steps
        gained = np.max(np.abs(mean_rates(samples.acceleration, step)) / self._limit, axis=1)
        second = np.max(np.abs(second_differences(samples.velocity, step)) / self._limit, axis=1)
        # At the ends velocity is no mirrored rest, so a second difference says nothing there.
        second[[0, -1]] = 0.0
        return np.asarray(np.cbrt(np.maximum(of_samples(gained), second)))


def sides_of_third(spline: BSpline, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q''' just before and just after points of the path, where it may jump, each of shape (P, n)."""
    before = np.asarray(spline(np.clip(s - BESIDE, 0.0, 1.0), 3))
    after = np.asarray(spline(np.clip(s + BESIDE, 0.0, 1.0), 3))
    return before, after
