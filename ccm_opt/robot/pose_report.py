"""What is wrong with a pose in 3-D: joints bent too far, and balls so near a singularity that they cannot be driven."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names

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
    issues = []
    for ball, name in enumerate(joint_names(arm)[1::3]):
        limit = float(arm.bend_limits[ball])
        if deflections[ball] > limit:
            issues.append(_beyond_limit(name, float(deflections[ball]), limit))
        if determinants[ball] < _LEAST_DETERMINANT:
            issues.append(_singular(arm, name, float(determinants[ball]), _LEAST_DETERMINANT))
    return tuple(issues)


def _beyond_limit(name: str, value: float, limit: float) -> PoseIssue:
    text = f"{name}: the link is bent by {np.rad2deg(value):.4g} deg, its limit is {np.rad2deg(limit):.4g}"
    return PoseIssue(name, "limit", value, limit, text)


def _singular(arm: Arm, name: str, value: float, bound: float) -> PoseIssue:
    where = "a bend of 90 deg" if arm.axes == "zyx" else "a bend of 0"
    text = f"{name}: the {arm.axes} ball is nearly singular, determinant {value:.2g}; it is so at {where}"
    return PoseIssue(name, "singular", value, bound, text)
