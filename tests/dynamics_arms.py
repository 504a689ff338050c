"""Planar arms and motions for tests of frames, dynamics and simulation."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.link_layout import Proportions


def swan_neck(links: int = 12, axes: Axes = "zyx", *, varied: bool = False) -> Arm:
    """Return the arm of the swan's neck (section 5.4) with any number of links.

    Args:
        links: number of links.
        axes: order of the revolute axes of a ball joint.
        varied: whether every link has its own length, radius, mass and inertia.
    """
    shares = Proportions(np.ones(links), np.ones(links), np.ones(links))
    if varied:
        shares = Proportions(np.linspace(1.4, 0.6, links), np.linspace(1.0, 0.4, links), np.ones(links))
    h = 0.05 * shares.lengths
    r = 0.025 * shares.radii
    masses = np.linspace(0.2, 0.05, links) if varied else np.full(links, 0.1)
    axial = masses * r**2 / 2
    return Arm(
        links=links,
        link_length=0.05,
        radius=0.025,
        base=np.array([0.1, -0.2]),
        base_heading=0.4,
        joint_limit=float(np.deg2rad(60.0)),
        base_limit=2 * np.pi,
        self_collision=True,
        mount_length=0.025,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=masses * (3 * r**2 + h**2) / 12,
        axes=axes,
        proportions=shares if varied else None,
    )


def loose_limits(arm: Arm, torque: float | None = None) -> Limits:
    """Return equal limits for all revolute joints, with a torque limit [N m] if given."""
    n = 3 * arm.links
    return Limits(np.full(n, 2.0), np.full(n, 10.0), None if torque is None else np.full(n, torque))


def smooth_trajectory(bends: FloatArray, duration: float = 1.0, interval: float = 4e-3) -> JointTrajectory:
    """Return a rest-to-rest motion from straight to given bend angles, by the quintic s = 10 u³ − 15 u⁴ + 6 u⁵.

    Args:
        bends: final bend angles, shape (links,) [rad].
        duration: duration [s].
        interval: time between samples [s].
    """
    time = np.linspace(0.0, duration, round(duration / interval) + 1)
    u = (time / duration)[:, None]
    s = u**3 * (10 - 15 * u + 6 * u**2)
    rate = 30 * u**2 * (1 - u) ** 2 / duration
    curve = 60 * u * (1 - u) * (1 - 2 * u) / duration**2
    return JointTrajectory(time, s * bends, rate * bends, curve * bends)


def carried(arm: Arm, bends: JointTrajectory, base: JointTrajectory) -> JointTrajectory:
    """Return the motion of an arm on a feed axis, from the trajectories of its bend angles and its base."""
    pairs = [
        np.column_stack((getattr(bends, name), getattr(base, name)))
        for name in ("positions", "velocities", "accelerations")
    ]
    return JointTrajectory(bends.time, *pairs, arm.coordinates)


def random_states(joints: int, count: int = 4, seed: int = 0) -> FloatArray:
    """Return random angles, velocities and accelerations in [-1, 1], shape (3, count, joints)."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (3, count, joints))
