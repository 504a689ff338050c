"""Reports on a pose of the arm and its Jacobian.

A revolute about the unit vector z through the point o moves a point p at z × (p − o) and turns what is beyond it about
z (Craig, Introduction to Robotics, section 5.7). In a standard Denavit–Hartenberg table joint j turns about the z axis
of frame j − 1.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import frame_transforms, joint_names

_LEAST_DETERMINANT = 0.05
"""Determinant of a ball's axes below which the ball counts as singular; 1 is best, 0 is singular. Taste."""


@dataclass(frozen=True)
class PoseIssue:
    """One thing wrong with a ball joint.

    Attributes:
        joint: name of its second revolute.
        kind: "limit" or "singular".
        value: its deflection [rad], or the determinant of its axes.
        bound: what that is held against.
        text: all of it in words.
    """

    joint: str
    kind: str
    value: float
    bound: float
    text: str


def pose_issues(arm: Arm, angles: FloatArray) -> tuple[PoseIssue, ...]:
    """Everything wrong with a pose, from the base outward.

    A link's deflection is the angle between it and the link before, acos(cos θ1 cos θ2) with θ3 turning about itself;
    the determinant of a ball's three axes is cos θ2 under ``zyx`` and sin θ2 under ``zyz``, which is singular whenever
    it is straight.

    Args:
        arm: the arm; its bend limits are taken as limits on deflections.
        angles: revolute angles, shape (3 * links,) [rad].
    """
    yaw = angles[0::3]
    bend = angles[1::3]
    deflections = np.arccos(np.clip(np.cos(yaw) * np.cos(bend), -1.0, 1.0))
    determinants = np.abs(np.cos(bend) if arm.axes == "zyx" else np.sin(bend))
    where = "a bend of 90 deg" if arm.axes == "zyx" else "a bend of 0"
    issues = []
    for ball, name in enumerate(joint_names(arm)[1::3]):
        limit = float(arm.bend_limits[ball])
        deflection, determinant = float(deflections[ball]), float(determinants[ball])
        if deflection > limit:
            bent = f"the link is bent by {np.rad2deg(deflection):.4g} deg, its limit is {np.rad2deg(limit):.4g}"
            issues.append(PoseIssue(name, "limit", deflection, limit, f"{name}: {bent}"))
        if determinant < _LEAST_DETERMINANT:
            singular = f"the {arm.axes} ball is nearly singular, determinant {determinant:.2g}; it is so at {where}"
            issues.append(PoseIssue(name, "singular", determinant, _LEAST_DETERMINANT, f"{name}: {singular}"))
    return tuple(issues)


def point_jacobians(arm: Arm, angles: FloatArray) -> FloatArray:
    """Jacobians of the positions of all balls and of the tip.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Derivatives by the axes that carry the base, in the first columns, and by the revolutes, shape
        (..., links + 1, 3, columns) [m].
    """
    axes, origins, points = _axes_and_points(arm, angles)
    lever = points[..., :, None, :] - origins[..., None, :, :]
    turns = np.cross(np.broadcast_to(axes[..., None, :, :], lever.shape), lever)
    beyond = (
        np.arange(arm.links + 1)[:, None] > np.arange(3 * arm.links) // 3
    )  # revolutes of ball k move points k + 1 on
    return _with_base(arm, np.swapaxes(np.where(beyond[..., None], turns, 0.0), -1, -2), moved=1.0)


def tip_jacobian(arm: Arm, angles: FloatArray) -> FloatArray:
    """Geometric Jacobian of the tip: its velocity [m] over the angular velocity of the last link.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Shape (..., 6, columns), columns as in ``point_jacobians``.
    """
    axes, origins, points = _axes_and_points(arm, angles)
    linear = np.cross(axes, points[..., -1:, :] - origins)
    angular = _with_base(arm, np.swapaxes(axes, -1, -2), moved=0.0)
    return np.concatenate((_with_base(arm, np.swapaxes(linear, -1, -2), moved=1.0), angular), axis=-2)


def _axes_and_points(arm: Arm, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Axes of the revolutes, points on them, and balls and tip, all in the world."""
    frames = frame_transforms(arm, angles)
    return frames[..., :-1, :3, 2], frames[..., :-1, :3, 3], frames[..., ::3, :3, 3]


def _with_base(arm: Arm, columns: FloatArray, *, moved: float) -> FloatArray:
    """The same columns after those of the axes that carry the base, if any; all run along the base heading."""
    direction = moved * arm.base_rotation[:, 0]
    first = np.broadcast_to(direction[:, None], (*columns.shape[:-1], len(arm.base_axes)))
    return np.concatenate((first, columns), axis=-1)
