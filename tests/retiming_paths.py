"""Joint paths, limits and simple dynamics for tests of retiming."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming import retime
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm

from .arms import plain_arm

GRAVITY = 9.81
MASS = 2.0
LENGTH = 0.5
FRICTION = 3.0


def on_feed(limits: Limits, force: float | None = None) -> Limits:
    """Return limits with limits of a feed axis added."""
    return replace(limits, feed_velocity=0.1, feed_acceleration=0.5, feed_force=force)


def make_path(control: FloatArray) -> JointPath:
    """Return a clamped uniform cubic B-spline over [0, 1] with given control points, shape (m ≥ 4, links) [rad]."""
    control = np.asarray(control, dtype=np.float64)
    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, len(control) - 2), np.ones(3)))
    return JointPath(BSpline(knots, control, 3), control, ())


def straight_path(end: FloatArray) -> JointPath:
    """Return a straight joint path of constant speed from zero to given bend angles, shape (links,) [rad]."""
    return make_path(np.linspace(0.0, 1.0, 4)[:, None] * np.atleast_1d(end))


def to_revolutes(bends: FloatArray) -> FloatArray:
    """Return the angles of three revolute joints per ball joint, shape (T, 3 links), from bend angles (T, links) [rad].

    Of the three, only the second is nonzero, with opposite sign.
    """
    angles = np.zeros((len(bends), 3 * bends.shape[1]))
    angles[:, 1::3] = -bends
    return angles


def weightless(angles: FloatArray, _rates: FloatArray, _growth: FloatArray) -> FloatArray:
    """Return the torques of an arm without mass, all zero."""
    return np.zeros_like(angles)


def pendulums(angles: FloatArray, _rates: FloatArray, growth: FloatArray) -> FloatArray:
    """Return the torques of independent point-mass pendulums, τ = m l² q̈ + m g l cos q on every bend axis [N m]."""
    torques = np.zeros_like(angles)
    torques[:, 1::3] = MASS * LENGTH**2 * growth[:, 1::3] + MASS * GRAVITY * LENGTH * np.cos(angles[:, 1::3])
    return torques


def sticky_pendulums(angles: FloatArray, rates: FloatArray, growth: FloatArray) -> FloatArray:
    """Return the torques of independent point-mass pendulums with viscous friction in every bend axis [N m]."""
    torques = pendulums(angles, rates, growth)
    torques[:, 1::3] += FRICTION * rates[:, 1::3]
    return torques


def even_limits(links: int, velocity: float, acceleration: float, torque: float | None = None) -> Limits:
    """Return equal limits for all revolute joints."""
    one = np.ones(3 * links)
    return Limits(velocity * one, acceleration * one, None if torque is None else torque * one)


def run(path: JointPath, limits: Limits, dynamics=weightless, **options: float) -> JointTrajectory:  # noqa: ANN001
    """Return a timed joint path, by the package's retiming and the simple mapping to revolute joints."""
    return retime(path, limits, dynamics, revolutes=to_revolutes, **options)


def slim_arm(links: int, length: float) -> Arm:
    """Return an arm with practically unlimited bend angles, without self-collision."""
    return plain_arm(
        links,
        length,
        radius=0.01,
        base_heading=0.3,
        joint_limit=99.0,
        base_limit=99.0,
        self_collision=False,
        inertia_axial=np.full(links, 1e-5),
        inertia_transverse=np.full(links, 1e-4),
    )


def used(trajectory: JointTrajectory, limits: Limits) -> tuple[float, float]:
    """Return the maximum fractions of the velocity and of the acceleration limits that a trajectory uses."""
    speed = np.abs(trajectory.bend_velocities) / limits.velocity[1::3]
    growth = np.abs(trajectory.bend_accelerations) / limits.acceleration[1::3]
    return float(speed.max()), float(growth.max())


def random_control(seed: int, links: int) -> FloatArray:
    """Return control points of a random joint path, several of them midpoints or repeated, shape (m, links) [rad]."""
    rng = np.random.default_rng(seed)
    control = np.cumsum(rng.normal(0.0, 0.3, (int(rng.integers(4, 30)), links)), axis=0)
    halved = rng.integers(1, len(control), 3)
    control = np.insert(control, halved, 0.5 * (control[halved] + control[halved - 1]), axis=0)
    return np.repeat(control, rng.choice([1, 2], len(control), p=[0.9, 0.1]), axis=0)
