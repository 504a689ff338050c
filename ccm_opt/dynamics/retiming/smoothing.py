"""Speed profiles of limited jerk, made by smoothing the fastest one over time.

The s̈ of TOPP-RA jumps. The mean of s over two moving windows of time, applied one after the other, is a motion along
the same path whose s̈ is continuous: with windows w its third derivative is

    s⃛(t) = (ṡ(t) − 2 ṡ(t − w) + ṡ(t − 2 w)) / w²,

linear between the times at which ṡ or one of its copies has a corner, since ṡ is linear between grid points. So the
motion is a polynomial of degree four in each piece, and lasts 2 w longer. The jerk of an axis is q' s⃛ + 3 q'' ṡ s̈ +
q''' ṡ³; slowing down by λ divides it by λ³, so that any limit can be met. The window with the shortest motion is kept.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, PPoly

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.motion_limits import third_derivative_sides
from ccm_opt.dynamics.retiming.profile import SpeedProfile
from ccm_opt.dynamics.retiming.timing_settings import (
    DEFAULT_TIMING,
    SmoothingSettings,
)
from ccm_opt.robot.coordinates import DriveLimits


@dataclass(frozen=True)
class SmoothProfile:
    """A motion along the path parameter s with continuous s̈.

    Attributes:
        position: s as a function of time, a piecewise polynomial of degree 4.
        factor: factor by which the motion is slowed down.
    """

    position: PPoly
    factor: float = 1.0

    @cached_property
    def _derivatives(self) -> tuple[PPoly, PPoly, PPoly]:
        return self.position.derivative(1), self.position.derivative(2), self.position.derivative(3)

    @property
    def duration(self) -> float:
        """Duration of the motion from rest to rest [s]."""
        return float(self.position.x[-1]) * self.factor

    @property
    def corners(self) -> FloatArray:
        """Times at which s⃛, the third time derivative of s, has corners [s]."""
        return np.asarray(self.position.x) * self.factor

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the path parameter s, ṡ and s̈ at given times, each of the shape of ``time``."""
        # The polynomial is a function of the time before slowing, s(t / λ), whose derivatives fall by λ, λ² and λ³.
        unslowed = np.clip(time / self.factor, 0.0, self.position.x[-1])
        speed, growth, _ = self._derivatives
        s = np.clip(self.position(unslowed), 0.0, 1.0)
        v = np.maximum(speed(unslowed), 0.0)
        return np.asarray(s), np.asarray(v / self.factor), np.asarray(growth(unslowed) / self.factor**2)

    def jerk(self, time: FloatArray) -> FloatArray:
        """Return the third time derivative of the path parameter at given times [1/s³]."""
        return np.asarray(self._derivatives[2](np.clip(time / self.factor, 0.0, self.position.x[-1])) / self.factor**3)

    def slowed(self, factor: float) -> "SmoothProfile":
        """Return the profile with its duration multiplied by a factor."""
        return replace(self, factor=self.factor * factor)


def smoothed(profile: SpeedProfile, window: float) -> SmoothProfile:
    """Return a speed profile averaged twice over a moving window of given length [s], so that s̈ is continuous."""
    times = profile.times
    speeds = np.sqrt(profile.squared)
    shifts = (0.0, window, 2.0 * window)

    # Corners nearer than rounding would make pieces without a length.
    apart = 1e-9 * (profile.duration + 2.0 * window)
    corners = np.sort(np.concatenate([times + shift for shift in shifts]))
    corners = corners[np.append(True, np.diff(corners) > apart)]

    # The motion is at rest before its start and after its end, so the shifted speeds are 0 there.
    copies = [np.interp(corners - shift, times, speeds, left=0.0, right=0.0) for shift in shifts]
    jerk = (copies[0] - 2.0 * copies[1] + copies[2]) / window**2
    # s⃛ is linear between corners; integrated three times from rest at s = 0 it gives the whole motion.
    slope = np.diff(jerk) / np.diff(corners)
    position = PPoly(np.stack((slope, jerk[:-1])), corners).antiderivative(3)
    # The integral of the smoothed speed is 1 up to rounding only, so the end of the path is set to 1 exactly.
    return SmoothProfile(PPoly(position.c / position(corners[-1]), corners))


def jerk_limited(
    spline: BSpline, profile: SpeedProfile, axes: DriveLimits, settings: SmoothingSettings = DEFAULT_TIMING.smoothing
) -> SmoothProfile:
    """Return the fastest of several smoothed motions, each slowed down to velocity, acceleration and jerk limits.

    Args:
        spline: the path.
        profile: the fastest motion along the path.
        axes: limits of the drives.
        settings: lengths of smoothing windows to try, and number of times at which limits are evaluated.
    """

    def jerk_limited_by(window: float) -> SmoothProfile:
        motion = smoothed(profile, window)
        return motion.slowed(max(1.0, _needed(spline, motion, axes, settings.evaluations)))

    # The best window is not known: halving finds its order of magnitude, a few beside the best refine it.
    windows = profile.duration * 0.5 ** np.arange(1.0, settings.halvings + 1.0)
    motions = [jerk_limited_by(window) for window in windows]
    best = windows[int(np.argmin([motion.duration for motion in motions]))]
    motions += [jerk_limited_by(best * share) for share in settings.neighbour_factors]
    return min(motions, key=lambda motion: motion.duration)


def _needed(spline: BSpline, motion: SmoothProfile, axes: DriveLimits, evaluations: int) -> float:
    """Return the factor on the duration that brings velocity, acceleration and jerk within their limits."""
    # Jerk may peak at the corners of s⃛ and, where the path is curved, anywhere between them.
    time = np.union1d(motion.corners, np.linspace(0.0, motion.duration, evaluations))
    s, v, growth = (values[:, None] for values in motion.at(time))
    jerk = motion.jerk(time)[:, None]
    places = s[:, 0]
    first = spline(places, 1)
    second = spline(places, 2)

    # Fractions of the limits; slowing down by λ divides them by λ, λ² and λ³, hence the roots at the end.
    velocity = np.abs(first * v) / axes.velocity
    acceleration = np.abs(first * growth + second * v**2) / axes.acceleration
    rest = first * jerk + 3.0 * second * v * growth
    # q''' jumps at the knots of a cubic spline, and the limit must hold on both sides of the jump.
    before, after = third_derivative_sides(spline, places)
    jerks = np.maximum(np.abs(rest + before * v**3), np.abs(rest + after * v**3)) / axes.jerk
    return float(max(np.max(velocity), np.sqrt(np.max(acceleration)), np.cbrt(np.max(jerks))))
