"""Timing of a joint path, and sampling of the timed motion.

Between samples, the coordinates are taken as linear in time. In a coordinate, the chord from s₀ to s₁ deviates from the
path by at most ⅛ (s₁ − s₀)² max|q''|, so with headings φ (cumulative sums of the bends) every point of the arm deviates
by at most ⅛ (s₁ − s₀)² (Σ l |φ''| + |feed''|), maximised over the interval. The second derivative of a cubic spline is
linear between knots, so its maximum is at a knot or at an end. Deviations in time along the chord do not matter: they
are another speed along the same path.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.profile import PathRows, SpeedProfile, path_grid, path_rows, refine, span_lengths
from ccm_opt.dynamics.retiming.smoothing import SmoothProfile, jerk_limited
from ccm_opt.dynamics.retiming.speed_optimizer import fastest_within, refine_unresolved
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, Revolutes, TimedPath, likely_coordinates
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, SamplingSettings, TimingSettings
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates

_LEAST_SAMPLES = 100
"""Least number of steps of a motion, however short its duration. Heuristic."""
_MOST_NUMBERS = 30_000_000
"""Largest product of steps and coordinates; a longer motion is not sampled.

Heuristic: an array of this size takes a quarter of a gigabyte, and an arm of 24 links with a feed axis moves for 40
minutes.
"""
_SPARE_SHARE = 0.5
"""Fraction of the certified extra gap of a path that chords between samples may use.

Derived: the other half is left to the verifier, whose bounds are not sharp.
"""
_CUTTINGS = 8
"""Largest number of rounds of dividing steps, for chords and again for accelerations.

Measured: the first round leaves few steps that are too long for chords.
"""
_AT_KEYFRAMES = 5e-7
"""Distance between a chord and a keyframe that is always allowed [rad]. Derived: half of the verifier's tolerance."""
_STANDING = 1e-9
"""Path length in joint space below which a path counts as standing still [rad]. Heuristic: above rounding."""

_BESIDE_JUMP = 0.02
"""Least distance of a sample inserted at a jump from its neighbours, as a fraction of the step.

Derived: a jump nearer than this to a sample adds less than 4 %.
"""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Chords:
    """Allowed deviation of the straight chords between samples from a path.

    Attributes:
        link_lengths: length of each link, shape (links,) [m].
        max_deviation: maximum deviation of any point of the arm from the path [m].
    """

    link_lengths: FloatArray
    max_deviation: float

    @classmethod
    def with_tolerance(cls, path: JointPath, link_lengths: FloatArray, settings: SamplingSettings) -> "Chords":
        """Return chords whose allowed deviation is a fraction of the extra gap certified for a path.

        The allowed deviation is at least ``settings.min_chord_deviation``.
        """
        return cls(link_lengths, max(_SPARE_SHARE * path.spare, settings.min_chord_deviation))


Profile: TypeAlias = SpeedProfile | SmoothProfile
"""Type of a motion along a path: the path parameter s as a function of time."""


def sample_motion(
    spline: BSpline,
    profile: Profile,
    step: float,
    chords: Chords | None,
    coordinates: Coordinates,
    settings: SamplingSettings = DEFAULT_TIMING.sampling,
    jumps: FloatArray | None = None,
) -> MotionSamples:
    """Return samples of the motion along a path with a given speed profile.

    With q(s) the path, q̇ = q' ṡ and q̈ = q' s̈ + q'' ṡ².

    Args:
        spline: spline of the arm's coordinates as a function of the path parameter.
        profile: path parameter as a function of time.
        step: largest time between two samples [s].
        chords: allowed deviation of chords between samples from the path; None for no bound.
        coordinates: layout of the columns of the spline.
        settings: settings of sampling.
        jumps: times at which accelerations jump, where samples are added [s]; None if there are none.

    Raises:
        RetimingError: the motion is too slow to be sampled with this step.
    """
    most = _MOST_NUMBERS // spline.c.shape[1]
    if profile.duration / step > most:
        raise _too_slow(profile.duration, step, most)
    # The small number keeps rounding from adding a step where the duration is a whole number of steps.
    count = max(int(np.ceil(profile.duration / step - 1e-9)), _LEAST_SAMPLES)
    time = np.linspace(0.0, profile.duration, count + 1)
    if chords is not None:
        time = near_the_path(spline, profile, time, chords, coordinates, settings)
    if jumps is not None:
        time = with_jumps(time, jumps, _BESIDE_JUMP)
    return samples_at(spline, profile, time)


def _too_slow(duration: float, step: float, most: int) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"the motion takes {duration:.4g} s within the limits; {most} steps of {step:.2g} s are the "
            "most that is written",
            stage="retiming",
            advice=("raise the limits on speeds and accelerations: one of them hardly lets the arm move",),
            evidence={"duration": duration},
        )
    )


def samples_at(spline: BSpline, profile: Profile, time: FloatArray) -> MotionSamples:
    """Return the samples of the motion along a path at given times, shape (T,) [s], from start to end."""
    s, speed, growth = (values[:, None] for values in profile.at(time))
    # Both ends are free of rounding, so that start and goal are met exactly and at rest.
    s[[0, -1], 0] = (0.0, 1.0)
    speed[[0, -1], 0] = 0.0
    poses = [np.asarray(spline(s[:, 0], nu)) for nu in range(3)]
    return MotionSamples(s[:, 0], time, poses[0], poses[1] * speed, poses[1] * growth + poses[2] * speed**2)


def with_jumps(time: FloatArray, jumps: FloatArray, apart: float) -> FloatArray:
    """Return sample times with the times of acceleration jumps inserted, except jumps very close to a sample.

    Args:
        time: sample times, strictly increasing, shape (T,) [s].
        jumps: times of jumps, increasing, within the motion, shape (J,) [s].
        apart: minimum time between a jump and the ends of its step or the previous jump, as a fraction of the step.
    """
    after = np.clip(np.searchsorted(time, jumps, side="right"), 1, len(time) - 1)
    least = apart * (time[after] - time[after - 1])
    away = np.minimum(jumps - time[after - 1], time[after] - jumps) > least
    since_last = np.diff(jumps, prepend=-np.inf) > least
    return np.union1d(time, jumps[away & since_last])


def near_the_path(
    spline: BSpline,
    profile: Profile,
    time: FloatArray,
    chords: Chords,
    coordinates: Coordinates,
    settings: SamplingSettings,
) -> FloatArray:
    """Return sample times with steps divided where chords between samples would deviate too far from the path.

    Args:
        spline: spline of the arm's coordinates as a function of the path parameter.
        profile: path parameter as a function of time.
        time: sample times, shape (T,) [s].
        chords: allowed deviation of chords from the path.
        coordinates: layout of the columns of the spline.
        settings: largest number of pieces of a step.
    """
    # Bounds the number of samples: steps at a kink of the path would otherwise be divided forever.
    shortest = np.min(np.diff(time)) / settings.most_pieces
    for _ in range(_CUTTINGS):
        # The deviation falls with the square of the step, so the number of pieces is the square root of the excess.
        s = profile.at(time)[0]
        excess = max_deviation(spline, s, chords.link_lengths, coordinates) / chords.max_deviation
        share = np.sqrt(np.maximum(excess, excess_at_keyframes(spline, s, chords.link_lengths, coordinates)))
        pieces = np.minimum(np.ceil(share - 1e-9), np.floor(np.diff(time) / shortest + 1e-9)).astype(np.intp)
        if np.all(pieces <= 1):
            break
        time = _cut(time, np.maximum(pieces, 1))
    _report(max_deviation(spline, profile.at(time)[0], chords.link_lengths, coordinates), chords, len(time))
    return time


def max_deviation(spline: BSpline, s: FloatArray, link_lengths: FloatArray, coordinates: Coordinates) -> FloatArray:
    """Return upper bounds on the distance of any point of the arm from the path while it moves along each chord.

    Args:
        spline: spline of the arm's coordinates as a function of the path parameter.
        s: path parameters, not decreasing, shape (T,).
        link_lengths: length of each link, shape (links,) [m].
        coordinates: layout of the columns of the spline.

    Returns:
        Bounds, shape (T − 1,) [m].
    """
    # |q''| is linear between knots, so it is evaluated at knots and ends of intervals only.
    places = np.union1d(s, np.clip(spline.t, 0.0, 1.0))
    weight = coordinates.travel(np.asarray(spline(places, 2)), link_lengths)
    at = np.searchsorted(places, s)
    # ``reduceat`` covers an interval's start and the knots in it, but not its end, which is taken below; its last entry
    # is the end of the path alone.
    inside = np.maximum.reduceat(weight, at)[:-1]
    return np.asarray(0.125 * np.diff(s) ** 2 * np.maximum(inside, weight[at[1:]]))


def excess_at_keyframes(
    spline: BSpline, s: FloatArray, link_lengths: FloatArray, coordinates: Coordinates
) -> FloatArray:
    """Return how far chords longer than the steps between keyframes pass keyframes by, over what is allowed.

    A path passes each of its keyframes, which are as dense as its knots, at a sixth of their second difference h² q'',
    with the step h between knots. As much is allowed a chord that passes a knot, and for rounding a little more. Chords
    as short as the steps between knots are near enough.

    Args:
        spline: spline of the arm's coordinates as a function of the path parameter.
        s: path parameters of the samples, not decreasing, shape (T,).
        link_lengths: length of each link, shape (links,) [m].
        coordinates: layout of the columns of the spline.

    Returns:
        Ratios, 0 for chords that are near enough, shape (T − 1,).
    """
    knots = np.unique(spline.t)
    steps = np.minimum(np.diff(knots)[1:], np.diff(knots)[:-1])
    chord = np.clip(np.searchsorted(s, knots[1:-1], side="right") - 1, 0, len(s) - 2)
    widths = np.diff(s)
    coarse = widths[chord] > steps
    found = np.zeros(len(widths))
    if not np.any(coarse):
        return found
    # On the base axes, one link length is weighted like one radian.
    weights = np.where(np.arange(len(coordinates)) < coordinates.joints, 1.0, 1.0 / float(np.mean(link_lengths)))
    at, inside = chord[coarse], knots[1:-1][coarse]
    bent = [np.linalg.norm(spline(places, 2) * weights, axis=1) for places in (s[at], inside, s[at + 1])]
    most = np.zeros(len(widths))
    np.maximum.at(most, at, np.max(bent, axis=0))
    ratios = 0.125 * widths[at] ** 2 * most[at] / (steps[coarse] ** 2 * bent[1] / 6.0 + _AT_KEYFRAMES)
    np.maximum.at(found, at, ratios)
    return found


def _cut(time: FloatArray, pieces: IntArray) -> FloatArray:
    """Return sample times with every step divided into a given number of equal pieces."""
    places = np.concatenate(([0], np.cumsum(pieces)))
    return np.interp(np.arange(places[-1] + 1), places, time)


def _report(left: FloatArray, chords: Chords, count: int) -> None:
    worst = float(np.max(left, initial=0.0))
    if worst > 1.1 * chords.max_deviation:
        logger.warning(
            "%d samples: steps are not refined further, though the chord deviation may be %.3g m, more than the %.3g m "
            "asked for",
            count,
            worst,
            chords.max_deviation,
        )


_PERIOD = 1e-3
"""Time step at which a smoothed motion, which has no grid of its own, is checked [s]. Heuristic."""
_JUMP = 0.1
"""Least jump of an acceleration or effort, as a fraction of its limit, at which a sample is placed. Heuristic.

A reference interpolated between two samples around a jump passes the accelerations before and after the jump by up to a
third of the jump. The effect of smaller jumps is within the fraction of limits that plans leave unused.
"""
_SMALL_STRETCH = 1.01
"""Factor of slowing down up to which samples are kept; steps are shorter by this factor beforehand. Heuristic."""
_RESAMPLINGS = 60
"""Largest number of samplings, each of a motion slower than the previous one by at least a small factor.

Derived: they reach 1.8 times the duration.
"""
_MOST_STRETCH = 100.0
"""Factor of slowing down at which a motion is given up. Heuristic.

Samples this far beyond a limit are those of a path that no drive can follow, such as one with a corner, and a motion so
slow has millions of samples.
"""


def retime(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    step: float | None = None,
    link_lengths: FloatArray | None = None,
    coordinates: Coordinates | None = None,
    arm: Arm | None = None,
    share: float = 1.0,
    settings: TimingSettings = DEFAULT_TIMING,
) -> JointTrajectory:
    """Return the fastest motion along a joint path from rest to rest, within the limits.

    A motion, possibly a slow one, exists whenever every drive can hold the arm still all along the path.

    Args:
        path: spline of the bends, and of the feed if there is a feed axis, as a function of u in [0, 1].
        limits: limits of every revolute (ball joint i bends by revolute 3 i + 1), of the feed axis, and of points of
            the arm.
        inverse_dynamics: map from angles, velocities and accelerations, each of shape (N, 3 * links), to torques of
            that shape [N m]. With a feed axis, the map also takes feed accelerations, shape (N,), and has the method
            ``feed_forces``.
        revolutes: linear map from bends, shape (N, links), to revolute angles, shape (N, 3 * links); also maps rates.
        step: largest time between two samples [s]; that of the settings if None.
        link_lengths: length of each link, shape (links,) [m]; if given, steps are divided where chords between samples
            would deviate from the path by more than half of the extra gap certified for the path.
        coordinates: layout of the columns of the path; if None, one bend per link, and a feed axis if there is one more
            column.
        arm: arm whose points are limited; needed only if the limits name points.
        share: fraction of the drives' limits that may be used, see ``robot.coordinates``.
        settings: settings of timing.

    Returns:
        Samples, the first and last at rest at the ends of the path. Angles, velocities and accelerations are consistent
        up to rounding, and neither they nor their finite differences exceed a limit. ``timed_by`` names the method that
        found the speeds.

    Raises:
        RetimingError: a drive cannot even hold the arm still at a point of the path.
        ProblemError: points are limited, but no arm is given, or a point lies beyond the arm.
    """
    columns = coordinates or likely_coordinates(limits, path.spline.c.shape[1])
    timed = TimedPath(path.spline, limits, inverse_dynamics, revolutes, columns, arm, share)
    timing = _Timing(timed, limits_along(timed, settings.profile), settings)
    largest = settings.sampling.step if step is None else step

    # A path without length has no grid; its rows are still evaluated to check whether the arm can be held still.
    if np.sum(span_lengths(timed.weighed, np.linspace(0.0, 1.0, 33))) < _STANDING:
        timing.rows(np.linspace(0.0, 1.0, 2))
        return _standing(path.spline, largest).trajectory(columns, "rest")

    fastest = timing.fastest()
    profile = timing.smooth(fastest) if timed.smooth else fastest
    chords = None if link_lengths is None else Chords.with_tolerance(path, link_lengths, settings.sampling)
    return timing.sampled(profile, largest, chords).trajectory(columns, fastest.timed_by)


def needed_stretch(samples: MotionSamples, limits: Sequence[MotionLimit]) -> float:
    """Return the factor on the duration that brings all samples and differences within limits; at most 1 if all are."""
    return max(float(np.max(limit.stretches(samples))) for limit in limits)


@dataclass(frozen=True)
class _Timing:
    """Timing of one path in stages: fastest profile, smoothing, sampling.

    Attributes:
        path: the path to time.
        limits: all limits on motions along the path.
        settings: settings of timing.
    """

    path: TimedPath
    limits: tuple[MotionLimit, ...]
    settings: TimingSettings

    @cached_property
    def _grid(self) -> FloatArray:
        return path_grid(self.path.weighed, self.settings.grid)

    def rows(self, s: FloatArray) -> PathRows:
        """Return the rows of all limits at points of the path.

        Raises:
            RetimingError: a drive cannot hold the arm still at one of the points.
        """
        return path_rows(self.limits, self.path.spline, s)

    @cached_property
    def _dense(self) -> PathRows:
        """Rows of all limits at the grid points and at equal steps between them."""
        return self.rows(refine(self._grid, self.settings.profile.substeps))

    def fastest(self) -> SpeedProfile:
        """Return the fastest speed profile along the path."""
        return fastest_within(self._dense, self.settings.profile)

    def smooth(self, fastest: SpeedProfile) -> SmoothProfile:
        """Return the profile smoothed to limit jerk, slowed down until all limits hold wherever they are evaluated."""
        spline = self.path.spline
        coordinates = self.path.coordinates
        profile = jerk_limited(spline, fastest, self.path.bounds, self.settings.smoothing)
        sampled = sample_motion(spline, profile, _PERIOD, None, coordinates, self.settings.sampling)
        # The final samples will lie between the samples checked here, as between grid points.
        return profile.slowed(max(needed_stretch(sampled, self.limits) / self.settings.profile.dense_share, 1.0))

    def sampled(self, profile: Profile, step: float, chords: Chords | None) -> MotionSamples:
        """Return samples of the motion that respect all limits, slowed down slightly if necessary."""
        settings = self.settings.sampling
        for _ in range(_RESAMPLINGS):
            # Sampled slightly finer than required, so that slowing down slightly does not make the steps too long.
            samples = sample_motion(
                self.path.spline,
                profile,
                step / _SMALL_STRETCH,
                chords,
                self.path.coordinates,
                settings,
                self._jumps(profile),
            )
            samples = self._densified_samples(samples, profile)
            stretch = needed_stretch(samples, self.limits)
            if stretch <= _SMALL_STRETCH:
                return samples.slowed(max(stretch, 1.0))
            self.rows(samples.s)  # a drive that is too weak between grid points is the reason, and is named
            if stretch > _MOST_STRETCH:
                break
            profile = profile.slowed(stretch)
        raise _no_speed(profile)

    def _densified_samples(self, samples: MotionSamples, profile: Profile) -> MotionSamples:
        """Return the samples with steps divided where accelerations vary too much between samples."""
        settings = self.settings.sampling
        for _ in range(_CUTTINGS):
            time = refine_unresolved(samples, self.path.bounds.acceleration, settings)
            if time is None:
                break
            samples = samples_at(self.path.spline, profile, time)
        return samples

    def _jumps(self, profile: Profile) -> FloatArray | None:
        """Return the times at which accelerations jump [s]; None for a motion whose jerk is limited."""
        if isinstance(profile, SmoothProfile):
            return None
        # Rows are fractions of the limits, so their greatest coefficient of s̈ bounds the effect of a jump of s̈.
        gain = np.max(np.abs(self._dense.every(self.settings.profile.substeps).a), axis=1)
        return profile.jumps(gain, _JUMP)


def _no_speed(profile: Profile) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"no speed was found that keeps the limits; the slowest motion tried takes {profile.duration:.4g} s",
            stage="retiming",
            advice=("raise the torque limits: they may hardly suffice to hold the arm still", "plan a smoother path"),
            evidence={"duration": profile.duration},
        )
    )


def _standing(spline: BSpline, step: float) -> MotionSamples:
    place = np.asarray(spline(np.array([0.0, 1.0])))
    rest = np.zeros((2, spline.c.shape[1]))
    return MotionSamples(np.array([0.0, 1.0]), np.array([0.0, step]), place, rest, rest.copy())
