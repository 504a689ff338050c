"""A plain arm for tests: equal links on a fixed base, and whatever a test wants otherwise."""

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.newton_euler import drive_efforts


def plain_arm(links: int = 6, link_length: float = 0.1, radius: float = 0.02, **changes: object) -> Arm:
    """An arm at the origin along x, without a mount; 0.1 kg a link, joints to 2 rad, the base all round."""
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
    """A problem of an arm in a room of which nothing else counts."""
    one = np.ones(3 * arm.links)
    still = JointPose(np.zeros(arm.links), min(max(arm.base_range[0], 0.0), arm.base_range[1]))
    fed = {"feed_velocity": 1.0, "feed_acceleration": 1.0} if arm.base_axes else {}
    return Problem("bare", workspace, arm, Limits(one, one, **fed), still, still)


def joint_torques(arm: Arm, gravity: FloatArray, *states: FloatArray) -> FloatArray:
    """Torques of all revolutes by the verifier, for positions, velocities and accelerations, shape (T, 3 * links)."""
    return drive_efforts(arm, gravity, *states)[0]


def held_bends(arm: Arm, feed: FloatArray | float) -> npt.NDArray[np.bool_]:
    """Which bends a guide tube of the base still holds at zero, k a joint, shape (..., k links)."""
    return np.repeat(arm.held(feed), arm.bends_a_joint, axis=-1)


def limits_at(arm: Arm, feed: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value of every coordinate where the base is, both of shape (..., c); held bends are zero."""
    held = held_bends(arm, feed)
    bends = np.where(held, 0.0, arm.bend_limits)
    base = arm.coordinates.base
    highest = np.broadcast_to(arm.upper_limits[base], (*held.shape[:-1], len(arm.base_axes)))
    lowest = np.broadcast_to(arm.lower_limits[base], highest.shape)
    return np.concatenate((-bends, lowest), axis=-1), np.concatenate((bends, highest), axis=-1)
