"""From a joint path to a timed motion: static check, TOPP-RA, dense check, samples (section 5.4 of the paper)."""

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.problem import Limits
from ccm_opt.retiming.diagnosis import check_static_load, explain_failure
from ccm_opt.retiming.grid import SUBSTEPS, path_grid, refine, span_lengths
from ccm_opt.retiming.profile import SpeedProfile, check_profile, slowing
from ccm_opt.retiming.rows import InverseDynamics, PathRows, Revolutes, path_rows
from ccm_opt.retiming.speed_optimizer import NotControllable, fastest_profile
from ccm_opt.solution import JointPath, JointTrajectory

GRID_SHARE = 0.99
"""Share of every limit used at the grid points."""
DENSE_SHARE = 0.996
"""Share of every limit that may be used between them."""
ROUNDS = 4
"""Most runs of TOPP-RA, the limits tightened each time where the last run passed them, and of the final check."""
NEGLIGIBLE = 1.004
"""Stretch of time that is not worth another run."""
LEAST_SAMPLES = 100
"""Samples of a short motion, whatever the step."""
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
) -> JointTrajectory:
    """The fastest motion along a path from rest to rest, within the limits.

    Args:
        path: spline of the bends over u in [0, 1].
        limits: of every revolute; ball i's bend is revolute 3 i + 1.
        inverse_dynamics: (angles, velocities, accelerations), each (N, 3 * links), to torques of that shape [N m].
        revolutes: bends (N, links) to revolute angles (N, 3 * links); linear, so it serves rates too.
        grid: wanted number of grid intervals along the path.
        step: largest time between two samples [s].

    Returns:
        Samples at equal times, the first and last at rest at the path's ends; angles, velocities and accelerations
        are those of one motion, to rounding.

    Raises:
        RetimingError: a joint cannot even hold the arm at some point of the path, or no speed profile exists.
    """
    spline = path.spline
    if np.sum(span_lengths(spline, np.linspace(0.0, 1.0, 33))) < NO_MOTION:
        check_static_load(path_rows(spline, np.linspace(0.0, 1.0, 2), limits, inverse_dynamics, revolutes), limits)
        return _standing(spline, step)
    points = path_grid(spline, grid)
    dense = path_rows(spline, refine(points, SUBSTEPS), limits, inverse_dynamics, revolutes)
    check_static_load(dense, limits)
    profile = _speed_profile(dense, limits)
    for _ in range(ROUNDS):
        trajectory = sample_motion(spline, profile, step)
        stretch = needed_stretch(trajectory, limits, inverse_dynamics, revolutes)
        if stretch <= 1.0:
            return trajectory
        profile = profile.slowed(stretch * (1.0 + 1e-9))
    raise explain_failure(dense, limits, int(np.argmax(np.max(np.abs(dense.c), axis=1))))


def sample_motion(spline: BSpline, profile: SpeedProfile, step: float) -> JointTrajectory:
    """Sample a path travelled at a speed profile: q̇ = q' ṡ, q̈ = q' s̈ + q'' ṡ²."""
    count = max(int(np.ceil(profile.duration / step - 1e-9)), LEAST_SAMPLES)
    time = np.linspace(0.0, profile.duration, count + 1)
    s, speed, growth = (values[:, None] for values in profile.at(time))
    s[[0, -1], 0], speed[[0, -1], 0] = (0.0, 1.0), 0.0
    poses = [np.asarray(spline(s[:, 0], nu)) for nu in range(3)]
    return JointTrajectory(time, poses[0], poses[1] * speed, poses[1] * growth + poses[2] * speed**2)


def needed_stretch(
    trajectory: JointTrajectory, limits: Limits, inverse_dynamics: InverseDynamics, revolutes: Revolutes
) -> float:
    """Factor on time that would bring every sample within the true limits; 1 or less when all are."""
    bends = 3 * np.arange(trajectory.bend_angles.shape[1]) + 1
    speed = float(np.max(np.abs(trajectory.bend_velocities) / limits.velocity[bends]))
    growth = float(np.max(np.abs(trajectory.bend_accelerations) / limits.acceleration[bends]))
    stretch = max(speed, float(np.sqrt(growth)))
    if limits.torque is None:
        return stretch
    motion = trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations
    q, qd, qdd = (revolutes(values) for values in motion)
    static = inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q)) / limits.torque
    moving = inverse_dynamics(q, qd, qdd) / limits.torque - static
    return max(stretch, slowing(moving, static, 1.0))


def _standing(spline: BSpline, step: float) -> JointTrajectory:
    bends = np.asarray(spline(np.array([0.0, 1.0])))
    return JointTrajectory(np.array([0.0, step]), bends, np.zeros_like(bends), np.zeros_like(bends))


def _speed_profile(dense: PathRows, limits: Limits) -> SpeedProfile:
    """The fastest profile that keeps the limits between the grid points too.

    Where TOPP-RA passes a limit inside an interval, the limits at its ends are tightened by as much and it runs again;
    what little remains after the last round is met by stretching time.
    """
    rows = dense.every(SUBSTEPS)
    cap = (GRID_SHARE / np.maximum(_widest(dense.speed), 1e-12)) ** 2
    tightened = np.zeros(len(rows.s))
    for _ in range(ROUNDS):
        profile = _solve(rows, _slack(rows, tightened), cap, limits)
        check = check_profile(profile, dense, SUBSTEPS, DENSE_SHARE)
        if check.stretch <= NEGLIGIBLE:
            break
        more = np.maximum(check.excess, 0.0)
        tightened += np.maximum(np.append(more, 0.0), np.append(0.0, more))
    return profile.slowed(check.stretch)


def _solve(rows: PathRows, slack: FloatArray, cap: FloatArray, limits: Limits) -> SpeedProfile:
    try:
        return SpeedProfile(rows.s, fastest_profile(rows, slack, cap))
    except NotControllable as failure:
        raise explain_failure(rows, limits, failure.index) from failure


def _slack(rows: PathRows, tightened: FloatArray) -> FloatArray:
    """What each row may reach: its share less the tightening, but always some room above the static part."""
    static = np.abs(rows.c)
    slack: FloatArray = np.maximum(GRID_SHARE - tightened[:, None], static + 0.25 * (1.0 - static))
    return slack


def _widest(speed: FloatArray) -> FloatArray:
    """Greatest |q'| share in the intervals beside each grid point; ṡ² is linear in an interval, so this bounds it."""
    inside = speed[:-1].reshape(-1, SUBSTEPS).max(axis=1)
    inside = np.maximum(inside, speed[SUBSTEPS::SUBSTEPS])
    widest: FloatArray = np.maximum(np.append(inside, 0.0), np.append(0.0, inside))
    return widest
