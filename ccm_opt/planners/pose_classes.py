"""Whether two poses at one goal pass all obstacles on the same sides: then one can be bent into the other."""

import numpy as np
import shapely

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm

HALF_TURN = np.pi
"""Poses whose last links differ by more than this differ by a whole turn."""


def landmarks(workspace: Workspace) -> FloatArray:
    """A point in every obstacle, shape (m, 2) [m]."""
    inside = [shapely.get_coordinates(shapely.point_on_surface(obstacle.core))[0] for obstacle in workspace.obstacles]
    return np.array(inside).reshape(-1, 2)


def same_class(arm: Arm, obstacles: FloatArray, first: FloatArray, second: FloatArray) -> bool:
    """Whether two poses with the tip in one place have the same whole turns and no obstacle between their axes.

    The axis of one and back along the other is a closed loop. Obstacles that it winds round are passed on different
    sides; a loop round two of them that undoes itself is not told apart from none.

    Args:
        arm: the arm.
        obstacles: a point in every obstacle, from ``landmarks``, shape (m, 2) [m].
        first: link headings, shape (links,) [rad].
        second: likewise.
    """
    if abs(float(first[-1] - second[-1])) > HALF_TURN:
        return False
    there = arm.joint_positions(first)
    back = arm.joint_positions(second)[::-1]
    loop = np.concatenate((there, back, there[:1]))
    return not np.any(windings(loop, obstacles))


def windings(loop: FloatArray, points: FloatArray) -> FloatArray:
    """How often a closed polyline goes round points, (k, 2) and (m, 2) to (m,)."""
    apart = loop - points[:, None]
    headings = np.arctan2(apart[..., 1], apart[..., 0])
    turns = np.diff(headings, axis=1)
    wrapped = (turns + np.pi) % (2.0 * np.pi) - np.pi
    whole: FloatArray = np.round(wrapped.sum(axis=1) / (2.0 * np.pi))
    return whole
