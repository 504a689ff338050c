"""Paths, limits and toy dynamics that the tests of retiming share."""

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
    """The limits with those of a feed axis."""
    return replace(limits, feed_velocity=0.1, feed_acceleration=0.5, feed_force=force)


def make_path(control: FloatArray) -> JointPath:
    """A clamped uniform cubic spline over [0, 1] with given control points, shape (m ≥ 4, links)."""
    control = np.asarray(control, dtype=np.float64)
    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, len(control) - 2), np.ones(3)))
    return JointPath(BSpline(knots, control, 3), control, ())


def straight_path(end: FloatArray) -> JointPath:
    """A straight line in joint space at even pace."""
    return make_path(np.linspace(0.0, 1.0, 4)[:, None] * np.atleast_1d(end))


def to_revolutes(bends: FloatArray) -> FloatArray:
    """Bends to three revolutes a ball, the second turning the other way."""
    angles = np.zeros((len(bends), 3 * bends.shape[1]))
    angles[:, 1::3] = -bends
    return angles


def weightless(angles: FloatArray, _rates: FloatArray, _growth: FloatArray) -> FloatArray:
    """Inverse dynamics of an arm without mass."""
    return np.zeros_like(angles)


def pendulums(angles: FloatArray, _rates: FloatArray, growth: FloatArray) -> FloatArray:
    """Inverse dynamics of independent point-mass pendulums: τ = m l² q̈ + m g l cos q on every bend axis."""
    torques = np.zeros_like(angles)
    torques[:, 1::3] = MASS * LENGTH**2 * growth[:, 1::3] + MASS * GRAVITY * LENGTH * np.cos(angles[:, 1::3])
    return torques


def sticky_pendulums(angles: FloatArray, rates: FloatArray, growth: FloatArray) -> FloatArray:
    """The same with viscous friction in every bend axis."""
    torques = pendulums(angles, rates, growth)
    torques[:, 1::3] += FRICTION * rates[:, 1::3]
    return torques


def even_limits(links: int, velocity: float, acceleration: float, torque: float | None = None) -> Limits:
    """The same limits for all revolutes."""
    one = np.ones(3 * links)
    return Limits(velocity * one, acceleration * one, None if torque is None else torque * one)


def run(path: JointPath, limits: Limits, dynamics=weightless, **options: float) -> JointTrajectory:  # noqa: ANN001
    """Retime with the toy revolutes."""
    return retime(path, limits, dynamics, revolutes=to_revolutes, **options)


def slim_arm(links: int, length: float) -> Arm:
    """An arm that bends as far as it likes."""
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
    """Greatest share of the velocity and acceleration limits at the samples."""
    speed = np.abs(trajectory.bend_velocities) / limits.velocity[1::3]
    growth = np.abs(trajectory.bend_accelerations) / limits.acceleration[1::3]
    return float(speed.max()), float(growth.max())


def random_control(seed: int, links: int) -> FloatArray:
    """Control points of a winding path, some legs halved as the planner does, some points repeated."""
    rng = np.random.default_rng(seed)
    control = np.cumsum(rng.normal(0.0, 0.3, (int(rng.integers(4, 30)), links)), axis=0)
    halved = rng.integers(1, len(control), 3)
    control = np.insert(control, halved, 0.5 * (control[halved] + control[halved - 1]), axis=0)
    return np.repeat(control, rng.choice([1, 2], len(control), p=[0.9, 0.1]), axis=0)
