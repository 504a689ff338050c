"""From a joint path to a timed motion: static check, TOPP-RA, dense check, samples (section 5.4 of the paper)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import InverseDynamics, Revolutes
from ccm_opt.retiming.grid import path_grid, refine, span_lengths
from ccm_opt.retiming.motion_limits import MotionLimit, limits_along
from ccm_opt.retiming.motion_samples import MotionSamples
from ccm_opt.retiming.path_limits import likely_coordinates
from ccm_opt.retiming.path_rows import PathRows, path_rows
from ccm_opt.retiming.profile import SpeedProfile
from ccm_opt.retiming.sampling import Chords, sample_motion, samples_at
from ccm_opt.retiming.smoothing import SmoothProfile, halved_where_unseen, jerk_limited
from ccm_opt.retiming.speed_optimizer import fastest_within
from ccm_opt.retiming.timed_path import TimedPath
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING, TimingSettings
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.driven_arm import DrivenArm
from ccm_opt.solution import JointPath, JointTrajectory

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
    arm: DrivenArm | None = None,
    share: float = 1.0,
    settings: TimingSettings = DEFAULT_TIMING,
) -> JointTrajectory:
    """The fastest motion along a path from rest to rest, within the limits.

    A motion exists whenever every drive can hold the arm still all along the path; if in doubt it is a slow one.

    Args:
        path: spline of the bends, and of the feed when there is a feed axis, over u in [0, 1].
        limits: of every revolute; ball i's bend is revolute 3 i + 1; of the feed axis; and of points of the arm.
        inverse_dynamics: (angles, velocities, accelerations), each (N, 3 * links), to torques of that shape [N m]. With
            a feed axis it takes its accelerations (N,) as well, and has the method ``feed_forces``.
        revolutes: bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too.
        step: largest time between two samples [s]; that of the settings when None.
        link_length: of the arm [m]; by it, steps are cut where chords between samples would leave the path by more
            than half the gap that the path is certified to spare. None leaves the steps as they are.
        coordinates: what the columns of the path are; when None, a bend a link, and a feed axis if one is left over.
        arm: whose points are limited; needed when the limits name some.
        share: of the limits of the drives that may be used, see ``jointed.drive_limits``.
        settings: numbers of timing.

    Returns:
        Samples, the first and last at rest at the path's ends; angles, velocities and accelerations are those of one
        motion, to rounding, and neither they nor their finite differences pass a limit. ``timed_by`` says what found
        the speeds.

    Raises:
        RetimingError: a drive cannot even hold the arm still at some point of the path.
        ProblemError: points are limited and there is no arm, or it is shorter than where they are.
    """
    columns = coordinates or likely_coordinates(limits, path.spline.c.shape[1])
    timed = TimedPath(path.spline, limits, inverse_dynamics, revolutes, columns, arm, share)
    timing = _Timing(timed, limits_along(timed, settings.profile), settings)
    largest = settings.sampling.step if step is None else step

    # A path that goes nowhere has no grid; its rows are still asked whether the arm can be held there.
    if np.sum(span_lengths(path.spline, np.linspace(0.0, 1.0, 33))) < settings.standing:
        timing.rows(np.linspace(0.0, 1.0, 2))
        return _standing(path.spline, largest).trajectory(columns, "rest")

    fastest = timing.fastest()
    profile = timing.smooth(fastest) if timed.bounds.smooth else fastest
    chords = None if link_length is None else Chords.beside(path, link_length, settings.sampling)
    return timing.sampled(profile, largest, chords).trajectory(columns, fastest.timed_by)


def needed_stretch(samples: MotionSamples, limits: Sequence[MotionLimit]) -> float:
    """Factor on time that brings every sample and every difference within the limits; 1 or less when all are."""
    return max(float(np.max(limit.stretches(samples))) for limit in limits)


@dataclass(frozen=True)
class _Timing:
    """The stages of timing one path.

    Attributes:
        path: what is timed.
        limits: every limit of it.
        settings: numbers of timing.
    """

    path: TimedPath
    limits: tuple[MotionLimit, ...]
    settings: TimingSettings

    @cached_property
    def _grid(self) -> FloatArray:
        return path_grid(self.path.spline, self.settings.grid)

    def rows(self, s: FloatArray) -> PathRows:
        """The limits at points of the path, at which every drive can hold the arm still, or it is an error."""
        return path_rows(self.limits, self.path.spline, s)

    @cached_property
    def _dense(self) -> PathRows:
        """The limits at the grid points and between them."""
        return self.rows(refine(self._grid, self.settings.profile.substeps))

    def fastest(self) -> SpeedProfile:
        """The fastest speeds along the path."""
        return fastest_within(self._dense, self.settings.profile)

    def smooth(self, fastest: SpeedProfile) -> SmoothProfile:
        """The motion with bounded jerk, slowed down until all limits hold at every look."""
        spline = self.path.spline
        coordinates = self.path.coordinates
        profile = jerk_limited(spline, fastest, self.path.bounds, self.settings.smoothing)
        looks = sample_motion(spline, profile, _PERIOD, None, coordinates, self.settings.sampling)
        # As between the points of a grid, samples will fall beside the looks.
        return profile.slowed(max(needed_stretch(looks, self.limits) / self.settings.profile.dense_share, 1.0))

    def sampled(self, profile: SpeedProfile | SmoothProfile, step: float, chords: Chords | None) -> MotionSamples:
        """Samples that keep the limits, of the motion or one a little slower."""
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
            samples = self._with_all_seen(samples, profile)
            stretch = needed_stretch(samples, self.limits)
            if stretch <= _SMALL_STRETCH:
                return samples.slowed(max(stretch, 1.0))
            self.rows(samples.s)  # a drive that is too weak between grid points is the reason, and is named
            if stretch > _MOST_STRETCH:
                break
            profile = profile.slowed(stretch)
        raise _no_speed(profile)

    def _with_all_seen(self, samples: MotionSamples, profile: SpeedProfile | SmoothProfile) -> MotionSamples:
        """The samples, with more between them where accelerations swing unseen."""
        settings = self.settings.sampling
        for _ in range(settings.cuttings):
            time = halved_where_unseen(samples, self.path.bounds.acceleration, settings)
            if time is None:
                break
            samples = samples_at(self.path.spline, profile, time)
        return samples

    def _jumps(self, profile: SpeedProfile | SmoothProfile) -> FloatArray | None:
        """When the motion's accelerations jump; None for a motion whose jerk is limited."""
        if isinstance(profile, SmoothProfile):
            return None
        # Rows are shares of the limits, so the greatest coefficient of s̈ is what a change of it does to any of them.
        gain = np.max(np.abs(self._dense.every(self.settings.profile.substeps).a), axis=1)
        return profile.jumps(gain, _JUMP)


def _no_speed(profile: SpeedProfile | SmoothProfile) -> RetimingError:
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
