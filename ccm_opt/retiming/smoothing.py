"""Jerk-limited speeds.

TOPP-RA's s̈ jumps. The mean of s over two equal windows of time, one after the other, is a motion along the same path
whose s̈ is continuous: with windows w its third derivative is

    s⃛(t) = (ṡ(t) − 2 ṡ(t − w) + ṡ(t − 2 w)) / w²,

linear between the times at which ṡ or one of its copies has a corner, for ṡ is linear between grid points. So the
motion is a polynomial of fourth degree in each piece, and lasts 2 w longer. An axis' jerk: q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³;
time longer by λ divides it by λ³, so that any limit can be met. The window that makes the motion shortest is kept.

The velocity that a joint gains in a step lies between what the accelerations at its two ends would give, unless the
acceleration jumps twice in the step or turns round in it. Paths with a corner at every keyframe do that every few
milliseconds. Such steps are halved until what they hide is a small share of the velocity gained and lost.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, PPoly

from ccm_opt.core.arrays import FloatArray
from ccm_opt.retiming.motion_limits.coordinate_limits import sides_of_third
from ccm_opt.retiming.motion_samples import MotionSamples
from ccm_opt.retiming.path_limits import PathLimits
from ccm_opt.retiming.profile import SpeedProfile
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, SamplingSettings, SmoothingSettings


@dataclass(frozen=True)
class SmoothProfile:
    """A motion along the path parameter with continuous s̈.

    Attributes:
        position: s over time, a polynomial of fourth degree in each piece.
        factor: by which time is longer.
    """

    position: PPoly
    factor: float = 1.0

    @cached_property
    def _derivatives(self) -> tuple[PPoly, PPoly, PPoly]:
        return self.position.derivative(1), self.position.derivative(2), self.position.derivative(3)

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        return float(self.position.x[-1]) * self.factor

    @property
    def corners(self) -> FloatArray:
        """Times at which the jerk of s has corners [s]."""
        return np.asarray(self.position.x) * self.factor

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s, ṡ and s̈ at given times, each of the shape of ``time``."""
        # The polynomial runs in the time before slowing: s(t / λ), whose derivatives fall by λ, λ² and λ³.
        unslowed = np.clip(time / self.factor, 0.0, self.position.x[-1])
        speed, growth, _ = self._derivatives
        s = np.clip(self.position(unslowed), 0.0, 1.0)
        v = np.maximum(speed(unslowed), 0.0)
        return np.asarray(s), np.asarray(v / self.factor), np.asarray(growth(unslowed) / self.factor**2)

    def jerk(self, time: FloatArray) -> FloatArray:
        """s⃛ at given times [1/s³]."""
        return np.asarray(self._derivatives[2](np.clip(time / self.factor, 0.0, self.position.x[-1])) / self.factor**3)

    def slowed(self, factor: float) -> "SmoothProfile":
        """The same profile with all times longer by a factor."""
        return replace(self, factor=self.factor * factor)


def smoothed(profile: SpeedProfile, window: float) -> SmoothProfile:
    """The mean of a motion over two windows of time, one after the other, each of given length [s]."""
    times = profile.times
    speeds = np.sqrt(profile.squared)
    shifts = (0.0, window, 2.0 * window)

    # Corners nearer than rounding would make pieces without a length.
    apart = 1e-9 * (profile.duration + 2.0 * window)
    corners = np.sort(np.concatenate([times + shift for shift in shifts]))
    corners = corners[np.append(True, np.diff(corners) > apart)]

    # Before its begin and after its end the motion rests, so the shifted speeds are 0 there.
    copies = [np.interp(corners - shift, times, speeds, left=0.0, right=0.0) for shift in shifts]
    jerk = (copies[0] - 2.0 * copies[1] + copies[2]) / window**2
    # s⃛ is linear between corners; integrated three times from rest at s = 0 it gives the whole motion.
    slope = np.diff(jerk) / np.diff(corners)
    position = PPoly(np.stack((slope, jerk[:-1])), corners).antiderivative(3)
    # The smoothed speed has its area to rounding only, so the path's end is put at 1 exactly.
    return SmoothProfile(PPoly(position.c / position(corners[-1]), corners))


def jerk_limited(
    spline: BSpline, profile: SpeedProfile, axes: PathLimits, settings: SmoothingSettings = DEFAULT_TIMING.smoothing
) -> SmoothProfile:
    """The smoothed motion, over the best of some windows, slowed down until velocity, acceleration and jerk hold.

    Args:
        spline: the path.
        profile: the fastest motion along it.
        axes: limits.
        settings: windows and looks.
    """

    def tried(window: float) -> SmoothProfile:
        motion = smoothed(profile, window)
        return motion.slowed(max(1.0, _needed(spline, motion, axes, settings.looks)))

    # The best window is not known: halving finds its order of magnitude, a few beside the best refine it.
    windows = profile.duration * 0.5 ** np.arange(1.0, settings.halvings + 1.0)
    motions = [tried(window) for window in windows]
    best = windows[int(np.argmin([motion.duration for motion in motions]))]
    motions += [tried(best * share) for share in settings.beside]
    return min(motions, key=lambda motion: motion.duration)


def _needed(spline: BSpline, motion: SmoothProfile, axes: PathLimits, looks: int) -> float:
    """Factor on time that brings velocity, acceleration and jerk within their limits at many times."""
    # Jerk may peak at the corners of s⃛ and, where the path is crooked, anywhere between them.
    time = np.union1d(motion.corners, np.linspace(0.0, motion.duration, looks))
    s, v, growth = (values[:, None] for values in motion.at(time))
    jerk = motion.jerk(time)[:, None]
    places = s[:, 0]
    first = spline(places, 1)
    second = spline(places, 2)

    # Shares of the limits; those of a time longer by λ are smaller by λ, λ² and λ³, hence the roots at the end.
    velocity = np.abs(first * v) / axes.velocity
    acceleration = np.abs(first * growth + second * v**2) / axes.acceleration
    rest = first * jerk + 3.0 * second * v * growth
    # q''' jumps at the knots of a cubic spline, and the limit must hold on both sides of the jump.
    before, after = sides_of_third(spline, places)
    jerks = np.maximum(np.abs(rest + before * v**3), np.abs(rest + after * v**3)) / axes.jerk
    return float(max(np.max(velocity), np.sqrt(np.max(acceleration)), np.cbrt(np.max(jerks))))


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
