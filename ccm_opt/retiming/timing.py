"""From a joint path to a timed motion: static check, TOPP-RA, dense check, samples (section 5.4 of the paper)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.problem import Limits
from ccm_opt.retiming.efforts import Efforts, InverseDynamics, Revolutes
from ccm_opt.retiming.finite_differences import needed_stretch
from ccm_opt.retiming.grid import SUBSTEPS, path_grid, refine, span_lengths
from ccm_opt.retiming.path_limits import PathLimits, likely_coordinates
from ccm_opt.retiming.path_rows import PathRows, path_rows
from ccm_opt.retiming.profile import SpeedProfile
from ccm_opt.retiming.sampling import Chords, Samples, sample_motion
from ccm_opt.retiming.smoothing import SmoothProfile, jerk_limited
from ccm_opt.retiming.speed_rounds import DENSE_SHARE, fastest_within
from ccm_opt.retiming.static_load import check_static_load
from ccm_opt.solution import JointPath, JointTrajectory

LOOK = 1e-3
"""Time between looks at a smoothed motion, which has no grid of its own [s]."""
SMALL_STRETCH = 1.01
"""Stretch of time that keeps the samples where they are on the path; steps are shorter by as much before it."""
RESAMPLINGS = 60
"""Most samplings, each of a motion slower than the last by at least a small stretch."""
NO_MOTION = 1e-9
"""Path length in joint space [rad] below which a path counts as standing still."""


def retime(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    grid: int = 200,
    step: float = 4e-3,
    link_length: float | None = None,
    coordinates: Coordinates | None = None,
) -> JointTrajectory:
    """The fastest motion along a path from rest to rest, within the limits.

    A motion exists whenever every drive can hold the arm still all along the path; if in doubt it is a slow one.

    Args:
        path: spline of the arm's coordinates over u in [0, 1].
        limits: of every revolute; ball i's bend is revolute 3 i + 1; and of the feed axis.
        inverse_dynamics: (angles, velocities, accelerations), each (N, 3 * links), to torques of that shape [N m]. With
            a feed axis it takes its accelerations (N,) as well, and has the method ``feed_forces``.
        revolutes: bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too.
        grid: wanted number of grid intervals along the path.
        step: largest time between two samples [s].
        link_length: of the arm [m]; by it, steps are cut where chords between samples would leave the path by more
            than half the gap that the path is certified to spare. None leaves the steps as they are.
        coordinates: what the columns of the path are; when None, a bend a link, and a feed axis if one is left over.

    Returns:
        Samples, the first and last at rest at the path's ends; angles, velocities and accelerations are those of one
        motion, to rounding, and neither they nor their finite differences pass a limit.

    Raises:
        RetimingError: a drive cannot even hold the arm still at some point of the path.
    """
    columns = coordinates or likely_coordinates(limits, path.spline.c.shape[1])
    task = _Task(path.spline, limits, inverse_dynamics, revolutes, columns)
    if np.sum(span_lengths(path.spline, np.linspace(0.0, 1.0, 33))) < NO_MOTION:
        task.rows(np.linspace(0.0, 1.0, 2))
        return _standing(path.spline, step).trajectory(columns)
    fastest = fastest_within(task.rows(refine(path_grid(path.spline, grid), SUBSTEPS)))
    profile = task.smooth(fastest) if task.axes.smooth else fastest
    chords = None if link_length is None else Chords.beside(path, link_length)
    return task.sampled(profile, step, chords).trajectory(columns)


@dataclass(frozen=True)
class _Task:
    """A path with its limits; attributes as the arguments of ``retime``."""

    spline: BSpline
    limits: Limits
    inverse_dynamics: InverseDynamics
    revolutes: Revolutes
    coordinates: Coordinates

    @cached_property
    def axes(self) -> PathLimits:
        """Limits on the columns of the path."""
        return PathLimits.from_limits(self.limits, self.coordinates, self.spline.c.shape[1])

    @cached_property
    def efforts(self) -> Efforts:
        """Shares of torques and force that motions take."""
        return Efforts(self.limits, self.inverse_dynamics, self.revolutes, self.coordinates)

    def rows(self, s: FloatArray) -> PathRows:
        """The limits at points of the path, at which every drive can hold the arm still, or it is an error."""
        rows = path_rows(self.spline, s, self.limits, self.inverse_dynamics, self.revolutes, self.coordinates)
        check_static_load(rows, self.limits, self.coordinates)
        return rows

    def smooth(self, fastest: SpeedProfile) -> SmoothProfile:
        """The motion with bounded jerk, slowed down until all limits hold at every look."""
        profile = jerk_limited(self.spline, fastest, self.axes)
        looks = sample_motion(self.spline, profile, LOOK, None, self.coordinates)
        return profile.slowed(max(needed_stretch(looks, self.axes, self.efforts) / DENSE_SHARE, 1.0))

    def sampled(self, profile: SpeedProfile | SmoothProfile, step: float, chords: Chords | None) -> Samples:
        """Samples that keep the limits, of the motion or one a little slower."""
        for _ in range(RESAMPLINGS):
            samples = sample_motion(self.spline, profile, step / SMALL_STRETCH, chords, self.coordinates)
            stretch = needed_stretch(samples, self.axes, self.efforts)
            if stretch <= SMALL_STRETCH:
                return samples.slowed(max(stretch, 1.0))
            self.rows(samples.s)
            profile = profile.slowed(stretch)
        raise _no_speed(profile)


def _no_speed(profile: SpeedProfile | SmoothProfile) -> RetimingError:
    return RetimingError(
        Diagnosis(
            reason=f"no speed was found that keeps the limits; the slowest motion tried takes {profile.duration:.4g} s",
            stage="retiming",
            advice=("raise the torque limits: they may hardly suffice to hold the arm still", "plan a smoother path"),
            evidence={"duration": profile.duration},
        )
    )


def _standing(spline: BSpline, step: float) -> Samples:
    place, rest = np.asarray(spline(np.array([0.0, 1.0]))), np.zeros((2, spline.c.shape[1]))
    return Samples(np.array([0.0, 1.0]), np.array([0.0, step]), place, rest, rest.copy())
