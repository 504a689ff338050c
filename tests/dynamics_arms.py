"""Arms and motions that the tests of frames, dynamics and simulation share."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm, Axes


def swan_neck(links: int = 12, axes: Axes = "zyx", *, varied: bool = False) -> Arm:
    """The swan's neck (section 5.4) with any number of links; ``varied`` gives every link its own mass and inertia."""
    h = 0.05
    r = 0.025
    masses = np.linspace(0.2, 0.05, links) if varied else np.full(links, 0.1)
    axial = masses * r**2 / 2
    return Arm(
        links=links,
        link_length=h,
        radius=r,
        base=np.array([0.1, -0.2]),
        base_heading=0.4,
        joint_limit=float(np.deg2rad(60.0)),
        base_limit=2 * np.pi,
        self_collision=True,
        mount_length=r,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=masses * (3 * r**2 + h**2) / 12,
        axes=axes,
    )


def loose_limits(arm: Arm, torque: float | None = None) -> Limits:
    """The same limit for all revolutes."""
    n = 3 * arm.links
    return Limits(np.full(n, 2.0), np.full(n, 10.0), None if torque is None else np.full(n, torque))


def smooth_trajectory(bends: FloatArray, duration: float = 1.0, interval: float = 4e-3) -> JointTrajectory:
    """Rest-to-rest motion from straight to given bends by the quintic s = 10 u³ − 15 u⁴ + 6 u⁵."""
    time = np.linspace(0.0, duration, round(duration / interval) + 1)
    u = (time / duration)[:, None]
    s = u**3 * (10 - 15 * u + 6 * u**2)
    rate = 30 * u**2 * (1 - u) ** 2 / duration
    curve = 60 * u * (1 - u) * (1 - 2 * u) / duration**2
    return JointTrajectory(time, s * bends, rate * bends, curve * bends)


def carried(arm: Arm, bends: JointTrajectory, base: JointTrajectory) -> JointTrajectory:
    """A motion of an arm on a feed axis, from that of its bends and that of its base."""
    pairs = [
        np.column_stack((getattr(bends, name), getattr(base, name)))
        for name in ("positions", "velocities", "accelerations")
    ]
    return JointTrajectory(bends.time, *pairs, arm.coordinates)


def random_states(joints: int, count: int = 4, seed: int = 0) -> FloatArray:
    """Three random states with angles within 1 rad, shape (3, count, joints)."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (3, count, joints))
