"""Times a path and samples it.

Between samples the columns of a path are taken as linear in time. The chord from s₀ to s₁ leaves the path in a column
by at most ⅛ (s₁ − s₀)² max|q''|, so with headings φ (running sums of the bends) every point of the arm leaves its way
by at most ⅛ (s₁ − s₀)² (Σ l |φ''| + |feed''|), the greatest on the interval. The second derivative of a cubic spline is
linear between knots, so the greatest stands at a knot or at an end. What a chord does in time does not matter: it is
another speed along the same way.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import ROUNDING, FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.profile import PathRows, SpeedProfile, path_grid, path_rows, refine, span_lengths
from ccm_opt.dynamics.retiming.speed_optimizer import SmoothProfile, fastest_within, jerk_limited, refine_unresolved
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, Revolutes, TimedPath, likely_coordinates
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, SamplingSettings, TimingSettings
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates

_LEAST_SAMPLES = 100
"""Steps of a short motion, whatever the time between them. Taste."""
_MOST_NUMBERS = 30_000_000
"""Steps times coordinates of the arm; a motion of more is not sampled. Taste: an array of them has a quarter of a
gigabyte, and a fed arm of 24 links moves for 40 minutes."""
_SPARE_SHARE = 0.5
"""Share of the gap that a path is certified to spare that chords between samples may use. Derived: the other half is
the verifier's, whose bounds are not sharp."""
_CUTTINGS = 8
"""Most rounds of cutting steps, for chords and again for accelerations. Measured: the first leaves few steps too long
for chords."""
_STANDING = 1e-9
"""Path length in joint space below which a path counts as standing still [rad]. Taste, above rounding."""

_BESIDE_JUMP = 0.02
"""Share of a step by which such a sample is at least away from its neighbours. Derived: nearer than this to a sample, a
jump adds less than 4 %."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Chords:
    """Allowed deviation of the straight chords between samples from the path.

    Attributes:
        link_length: length of a link [m].
        sag: maximum deviation of any point of the arm from its path [m].
    """

    link_length: float
    sag: float

    @classmethod
    def beside(cls, path: JointPath, link_length: float, settings: SamplingSettings) -> "Chords":
        """Return chords whose allowed deviation is a fraction of the gap certified for a path.

        The deviation allowed is at least ``settings.hair``.
        """
        return cls(link_length, max(_SPARE_SHARE * path.spare, settings.hair))


Profile: TypeAlias = SpeedProfile | SmoothProfile
"""A motion along the path parameter."""


def sample_motion(
    spline: BSpline,
    profile: Profile,
    step: float,
    chords: Chords | None,
    coordinates: Coordinates,
    settings: SamplingSettings = DEFAULT_TIMING.sampling,
    jumps: FloatArray | None = None,
) -> MotionSamples:
    """Return samples of the motion along a path with a speed profile: q̇ = q' ṡ, q̈ = q' s̈ + q'' ṡ².

    Args:
        spline: spline of the arm's coordinates over the path parameter.
        profile: path parameter as a function of time.
        step: largest time between two samples [s].
        chords: allowed deviation of chords between samples from the path; None for no bound.
        coordinates: the columns of the spline.
        settings: settings of sampling.
        jumps: times at which accelerations jump and samples are placed [s]; None where there are none.

    Raises:
        RetimingError: the motion is too slow to be sampled with this step.
    """
    most = _MOST_NUMBERS // spline.c.shape[1]
    if profile.duration / step > most:
        raise _too_slow(profile.duration, step, most)
    # The small number keeps rounding from adding a step where the duration is a whole number of them.
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
    """Return the motion along a path at times, shape (T,) [s], from its start to its end."""
    s, speed, growth = (values[:, None] for values in profile.at(time))
    # Both ends are free of rounding, so that start and goal are met exactly and at rest.
    s[[0, -1], 0] = (0.0, 1.0)
    speed[[0, -1], 0] = 0.0
    poses = [np.asarray(spline(s[:, 0], nu)) for nu in range(3)]
    return MotionSamples(s[:, 0], time, poses[0], poses[1] * speed, poses[1] * growth + poses[2] * speed**2)


def with_jumps(time: FloatArray, jumps: FloatArray, apart: float) -> FloatArray:
    """Return sample times with times of jumps inserted, except jumps very close to a sample.

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
    """Return sample times with steps divided, up to a number of pieces, where chords would leave the path."""
    # Bounds the number of samples: a path with a kink would otherwise be cut for ever.
    shortest = np.min(np.diff(time)) / settings.most_pieces
    for _ in range(_CUTTINGS):
        # The sag falls with the square of the step, so a step is cut into as many pieces as the root says.
        share = np.sqrt(sag(spline, profile.at(time)[0], chords.link_length, coordinates) / chords.sag)
        pieces = np.minimum(np.ceil(share - 1e-9), np.floor(np.diff(time) / shortest + 1e-9)).astype(np.intp)
        if np.all(pieces <= 1):
            break
        time = _cut(time, np.maximum(pieces, 1))
    _report(sag(spline, profile.at(time)[0], chords.link_length, coordinates), chords, len(time))
    return time


def sag(spline: BSpline, s: FloatArray, link_length: float, coordinates: Coordinates) -> FloatArray:
    """Return bounds on the deviation of any point of the arm on chords between points of the path.

    Args:
        spline: spline of the arm's coordinates over the path parameter.
        s: path parameters, not decreasing, shape (T,).
        link_length: length of a link [m].
        coordinates: the columns of the spline.

    Returns:
        Bounds, shape (T − 1,) [m].
    """
    # |q''| is linear between knots, so knots and ends of intervals are all that need looking at.
    places = np.union1d(s, np.clip(spline.t, 0.0, 1.0))
    weight = coordinates.travel(np.asarray(spline(places, 2)), link_length)
    at = np.searchsorted(places, s)
    # ``reduceat`` covers an interval's start and the knots in it, but not its end, which is taken below; its last entry
    # is the end of the path alone.
    inside = np.maximum.reduceat(weight, at)[:-1]
    return np.asarray(0.125 * np.diff(s) ** 2 * np.maximum(inside, weight[at[1:]]))


def _cut(time: FloatArray, pieces: IntArray) -> FloatArray:
    """Return times with every step divided into a given number of equal pieces."""
    places = np.concatenate(([0], np.cumsum(pieces)))
    return np.interp(np.arange(places[-1] + 1), places, time)


def _report(left: FloatArray, chords: Chords, count: int) -> None:
    worst = float(np.max(left, initial=0.0))
    if worst > 1.1 * chords.sag:
        logger.warning(
            "%d samples: steps are not refined further, though the chord deviation may be %.3g m, more than the %.3g m "
            "asked for",
            count,
            worst,
            chords.sag,
        )


def joined(
    trajectories: Sequence[JointTrajectory], pauses: Sequence[float] = (), *, step: float = DEFAULT_TIMING.sampling.step
) -> JointTrajectory:
    """Return one motion composed of several legs, each from rest to rest, with pauses between them.

    Args:
        trajectories: the legs, at least one; each begins where the previous one ends.
        pauses: time at rest after each leg but the last, length ``len(trajectories) − 1`` [s]; none when left out.
        step: largest time between two samples of a pause [s].

    Returns:
        The motion, whose ``stops`` are the samples at which legs end and the stops of the legs. The sample at a
        stop without a pause reports the acceleration at the end of the leg.

    Raises:
        RetimingError: a leg does not begin where the previous one ends.
        ValueError: the pauses do not fit the legs.
    """
    pauses = pauses or [0.0] * (len(trajectories) - 1)
    if len(pauses) != len(trajectories) - 1 or min(pauses, default=0.0) < 0.0:
        raise ValueError(f"got pauses {list(pauses)} for {len(trajectories)} legs; expected one, ≥ 0, between two legs")
    whole = trajectories[0]
    for number, (leg, pause) in enumerate(zip(trajectories[1:], pauses, strict=True), start=1):
        _check_place(whole, leg, number)
        whole = _after(_paused(whole, pause, step), leg, stop=len(whole.time) - 1)
    return whole


def reversed_trajectory(trajectory: JointTrajectory) -> JointTrajectory:
    """Return the reversed motion, for example a retraction: velocities change their sign, accelerations do not."""
    last = len(trajectory.time) - 1
    return replace(
        trajectory,
        time=trajectory.time[-1] - trajectory.time[::-1],
        positions=trajectory.positions[::-1].copy(),
        velocities=0.0 - trajectory.velocities[::-1],  # not -v: what rests keeps +0.0
        accelerations=trajectory.accelerations[::-1].copy(),
        stops=tuple(last - stop for stop in reversed(trajectory.stops)),
    )


def _paused(trajectory: JointTrajectory, pause: float, step: float) -> JointTrajectory:
    """Return the motion with its last pose held for a given time [s]."""
    count = int(np.ceil(pause / step - 1e-9))
    if count == 0:
        return trajectory
    time = np.linspace(0.0, pause, count + 1)[1:]
    held = np.repeat(trajectory.positions[-1:], count, axis=0)
    rest = np.zeros_like(held)
    return chained(trajectory, JointTrajectory(time, held, rest, rest, trajectory.coordinates))


def _after(first: JointTrajectory, leg: JointTrajectory, stop: int) -> JointTrajectory:
    """Return two consecutive motions as one; the first sample of the second is the last one of the first."""
    later = tuple(len(first.time) - 1 + number for number in leg.stops)
    return replace(chained(first, leg.part(slice(1, None))), stops=(*first.stops, stop, *later))


def chained(first: JointTrajectory, second: JointTrajectory) -> JointTrajectory:
    """Return the samples of two consecutive motions; the second begins at the end of the first."""
    return replace(
        first,
        time=np.concatenate((first.time, first.time[-1] + second.time)),
        positions=np.concatenate((first.positions, second.positions)),
        velocities=np.concatenate((first.velocities, second.velocities)),
        accelerations=np.concatenate((first.accelerations, second.accelerations)),
        timed_by=(*first.timed_by, *second.timed_by),
    )


def _check_place(first: JointTrajectory, leg: JointTrajectory, number: int) -> None:
    # Legs in different coordinates do not fit at all, whatever their numbers.
    gap = np.inf
    if first.coordinates == leg.coordinates:
        # Rounding of a place on a long axis grows with the place.
        size = np.maximum(np.abs(first.positions[-1]), 1.0)
        gap = float(np.max(np.abs(leg.positions[0] - first.positions[-1]) / size))
    if gap <= ROUNDING:
        return
    raise RetimingError(
        Diagnosis(
            reason=f"leg {number + 1} begins {gap:.3g} (rad or m) away from where leg {number} ends",
            stage="retiming",
            advice=("plan each leg from the end of the one before",),
            evidence={"leg": number + 1, "gap": gap},
        )
    )


_PERIOD = 1e-3
"""Time between looks at the smoothed motion, which has no grid of its own [s]. Taste."""
_JUMP = 0.1
"""Change of an acceleration or effort, as a share of its limit, at which a sample is put when it happens at once. A
drive's reference that is interpolated between two samples beside a jump passes the accelerations before and after it by
up to a third of the jump. Taste: what smaller ones add is within the share that plans leave."""
_SMALL_STRETCH = 1.01
"""Stretch of time that keeps the samples where they are on the path; steps are shorter by as much before it. Taste."""
_RESAMPLINGS = 60
"""Most samplings, each of a motion slower than the last by at least a small stretch. Derived: they reach 1.8 times the
duration."""
_MOST_STRETCH = 100.0
"""From which on a motion is not slowed down but given up: samples this far beyond a limit are those of a path that
nothing can be driven along, as one with a corner is, and a motion as slow has millions of them. Taste."""


def retime(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    step: float | None = None,
    link_length: float | None = None,
    coordinates: Coordinates | None = None,
    arm: Arm | None = None,
    share: float = 1.0,
    settings: TimingSettings = DEFAULT_TIMING,
) -> JointTrajectory:
    """Return the fastest motion along a path from rest to rest, within the limits.

    A motion, possibly a slow one, exists whenever every drive can hold the arm still all along the path.

    Args:
        path: spline of the bends, and of the feed when there is a feed axis, over u in [0, 1].
        limits: limits of every revolute (ball i bends by revolute 3 i + 1), of the feed axis, and of points of the arm.
        inverse_dynamics: map from angles, velocities and accelerations, each of shape (N, 3 * links), to torques of
            that shape [N m]. With a feed axis, the map also takes feed accelerations, shape (N,), and has the method
            ``feed_forces``.
        revolutes: linear map from bends, shape (N, links), to revolute angles, shape (N, 3 * links); also maps rates.
        step: largest time between two samples [s]; that of the settings when None.
        link_length: length of a link [m]; when given, steps are divided where chords between samples would leave the
            path by more than half of the gap certified for the path.
        coordinates: the columns of the path; when None, one bend per link, and a feed axis if a column is left.
        arm: arm whose points are limited; needed only when the limits name points.
        share: share of the drives' limits that may be used, see ``robot.coordinates``.
        settings: settings of timing.

    Returns:
        Samples, the first and last at rest at the path's ends. Angles, velocities and accelerations are consistent up
        to rounding, and neither they nor their finite differences exceed a limit. ``timed_by`` names the method that
        found the speeds.

    Raises:
        RetimingError: a drive cannot even hold the arm still at a point of the path.
        ProblemError: points are limited, but no arm is given, or a point lies beyond the arm.
    """
    columns = coordinates or likely_coordinates(limits, path.spline.c.shape[1])
    timed = TimedPath(path.spline, limits, inverse_dynamics, revolutes, columns, arm, share)
    timing = _Timing(timed, limits_along(timed, settings.profile), settings)
    largest = settings.sampling.step if step is None else step

    # A path that goes nowhere has no grid; its rows are still asked whether the arm can be held there.
    if np.sum(span_lengths(timed.weighed, np.linspace(0.0, 1.0, 33))) < _STANDING:
        timing.rows(np.linspace(0.0, 1.0, 2))
        return _standing(path.spline, largest).trajectory(columns, "rest")

    fastest = timing.fastest()
    profile = timing.smooth(fastest) if timed.smooth else fastest
    chords = None if link_length is None else Chords.beside(path, link_length, settings.sampling)
    return timing.sampled(profile, largest, chords).trajectory(columns, fastest.timed_by)


def needed_stretch(samples: MotionSamples, limits: Sequence[MotionLimit]) -> float:
    """Return the factor on time that brings all samples and differences within the limits; at most 1 if all are."""
    return max(float(np.max(limit.stretches(samples))) for limit in limits)


@dataclass(frozen=True)
class _Timing:
    """The stages of timing one path.

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
        """Return the rows of the limits at points of the path; fails where a drive cannot hold the arm still."""
        return path_rows(self.limits, self.path.spline, s)

    @cached_property
    def _dense(self) -> PathRows:
        """Rows of the limits at the grid points and between them."""
        return self.rows(refine(self._grid, self.settings.profile.substeps))

    def fastest(self) -> SpeedProfile:
        """Return the fastest speeds along the path."""
        return fastest_within(self._dense, self.settings.profile)

    def smooth(self, fastest: SpeedProfile) -> SmoothProfile:
        """Return the motion with bounded jerk, slowed down until all limits hold wherever they are evaluated."""
        spline = self.path.spline
        coordinates = self.path.coordinates
        profile = jerk_limited(spline, fastest, self.path.bounds, self.settings.smoothing)
        looks = sample_motion(spline, profile, _PERIOD, None, coordinates, self.settings.sampling)
        # As between the points of a grid, samples will fall beside the looks.
        return profile.slowed(max(needed_stretch(looks, self.limits) / self.settings.profile.dense_share, 1.0))

    def sampled(self, profile: Profile, step: float, chords: Chords | None) -> MotionSamples:
        """Return samples of the motion, slowed down slightly if needed, that satisfy the limits."""
        settings = self.settings.sampling
        for _ in range(_RESAMPLINGS):
            # Sampled a little finer than asked, so that a small stretch does not make the steps too long.
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
        """Return the samples with steps divided where accelerations vary between samples."""
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
        # Rows are shares of the limits, so the greatest coefficient of s̈ is what a change of it does to any of them.
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
