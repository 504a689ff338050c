"""A plain planar arm for tests, with equal links and a fixed base, of which any parameter can be changed."""

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.newton_euler import drive_efforts


def plain_arm(links: int = 6, link_length: float = 0.1, radius: float = 0.02, **changes: object) -> Arm:
    """Return an arm at the origin, straight along x, without mount; mass 0.1 kg per link, joint limit 2 rad.

    The base can rotate to any heading.

    Args:
        links: number of links.
        link_length: length of a link [m].
        radius: radius of the arm [m].
        **changes: further fields of the arm that differ from those of the plain arm.
    """
    values: dict[str, object] = {
        "links": links,
        "link_length": link_length,
        "radius": radius,
        "base": np.zeros(2),
        "base_heading": 0.0,
        "joint_limit": 2.0,
        "base_limit": 6.3,
        "self_collision": True,
        "mount_length": 0.0,
        "masses": np.full(links, 0.1),
        "inertia_axial": np.full(links, 3e-5),
        "inertia_transverse": np.full(links, 4e-5),
    }
    return Arm(**(values | changes))  # type: ignore[arg-type]


def bare_problem(arm: Arm, workspace: Workspace) -> Problem:
    """Return a problem with a given arm and workspace, a straight arm as start and goal, and limits of 1."""
    one = np.ones(3 * arm.links)
    still = JointPose(np.zeros(arm.links), min(max(arm.base_range[0], 0.0), arm.base_range[1]))
    fed = {"feed_velocity": 1.0, "feed_acceleration": 1.0} if arm.base_axes else {}
    return Problem("bare", workspace, arm, Limits(one, one, **fed), still, still)


def joint_torques(arm: Arm, gravity: FloatArray, *states: FloatArray) -> FloatArray:
    """Return the torques of all revolute joints as the verifier computes them, shape (T, 3 links) [N m].

    Args:
        arm: the arm.
        gravity: gravitational acceleration, shape (d,) [m/s²].
        *states: configurations, velocities and accelerations at T samples.
    """
    return drive_efforts(arm, gravity, *states)[0]


def held_bends(arm: Arm, feed: FloatArray | float) -> npt.NDArray[np.bool_]:
    """Return a mask of the bend angles that a guide tube at the base keeps at zero, k per joint, shape (..., k links).

    Args:
        arm: the arm.
        feed: feed positions, shape (...) [m].
    """
    return np.repeat(arm.held(feed), arm.bends_a_joint, axis=-1)


def limits_at(arm: Arm, feed: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper limits of configurations at given feed positions, both of shape (..., c).

    Limits of bend angles that a guide tube keeps at zero are zero.

    Args:
        arm: the arm.
        feed: feed positions, shape (...) [m].
    """
    held = held_bends(arm, feed)
    bends = np.where(held, 0.0, arm.bend_limits)
    base = arm.coordinates.base
    highest = np.broadcast_to(arm.upper_limits[base], (*held.shape[:-1], len(arm.base_axes)))
    lowest = np.broadcast_to(arm.lower_limits[base], highest.shape)
    return np.concatenate((-bends, lowest), axis=-1), np.concatenate((bends, highest), axis=-1)
