"""Jacobians of the joints and the tip of an arm in the three-dimensional world.

A revolute about the unit vector z through the point o moves a point p with velocity z × (p − o) and turns everything
beyond it about z (Craig, Introduction to Robotics, section 5.7). In a standard Denavit–Hartenberg table joint j turns
about the z axis of frame j − 1.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import frame_transforms


def point_jacobians(arm: Arm, angles: FloatArray) -> FloatArray:
    """Return the Jacobians of the positions of all ball joints and of the tip of an arm.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Derivatives in the world, shape (..., links + 1, 3, columns); the first columns are for the axes that carry the
        base, the others for the revolutes [m/rad].
    """
    axes, origins, points = _axes_and_points(arm, angles)
    lever = points[..., :, None, :] - origins[..., None, :, :]
    turns = np.cross(np.broadcast_to(axes[..., None, :, :], lever.shape), lever)
    beyond = (
        np.arange(arm.links + 1)[:, None] > np.arange(3 * arm.links) // 3
    )  # the revolutes of ball k move points k + 1 onwards
    return _with_base(arm, np.swapaxes(np.where(beyond[..., None], turns, 0.0), -1, -2), moved=1.0)


def tip_jacobian(arm: Arm, angles: FloatArray) -> FloatArray:
    """Return the geometric Jacobian of an arm's tip in world axes: linear velocity above, angular velocity below.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Shape (..., 6, columns), with columns as in ``point_jacobians``.
    """
    axes, origins, points = _axes_and_points(arm, angles)
    linear = np.cross(axes, points[..., -1:, :] - origins)
    angular = _with_base(arm, np.swapaxes(axes, -1, -2), moved=0.0)
    return np.concatenate((_with_base(arm, np.swapaxes(linear, -1, -2), moved=1.0), angular), axis=-2)


def _axes_and_points(arm: Arm, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the axes of all revolutes, a point on each axis, and the positions of ball joints and tip in the world.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Unit vectors and points, each (..., 3 * links, 3), and positions, (..., links + 1, 3) [m].
    """
    frames = frame_transforms(arm, angles)
    return frames[..., :-1, :3, 2], frames[..., :-1, :3, 3], frames[..., ::3, :3, 3]


def _with_base(arm: Arm, columns: FloatArray, *, moved: float) -> FloatArray:
    """Return a Jacobian with a column prepended for each linear axis that carries the base along the base heading.

    Args:
        arm: the arm.
        columns: Jacobian for the revolutes, shape (..., 3, 3 * links).
        moved: length of the new columns: 1 for linear velocity, 0 for angular velocity.
    """
    direction = moved * arm.base_rotation[:, 0]
    first = np.broadcast_to(direction[:, None], (*columns.shape[:-1], len(arm.base_axes)))
    return np.concatenate((first, columns), axis=-1)
