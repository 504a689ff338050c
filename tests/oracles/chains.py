"""Positions, rotations and derivatives of the links of arms in space, by NumPy."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import bend_rotations


def positions_of_links(arm: Arm, q: FloatArray, rotations: FloatArray) -> FloatArray:
    """Return the positions of joints and tip for given link rotations, shape (..., links + 1, 3) [m].

    Args:
        arm: the arm.
        q: configurations, of which only the feed is used, shape (..., c) [rad, m].
        rotations: rotations of the links, shape (..., links, 3, 3).
    """
    positions = np.zeros((*q.shape[:-1], arm.links + 1, 3))
    np.cumsum(arm.link_length * rotations[..., 0], axis=-2, out=positions[..., 1:, :])
    positions += arm.base
    if arm.base_axes:
        positions += arm.coordinates.advance(q)[..., None, None] * arm.direction
    return positions


def rotations_by_numpy(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the rotations of the links, as ``Arm.link_rotations``, shape (..., links, 3, 3)."""
    turns = bend_rotations(arm.bend_pairs(q))
    rotations = np.empty_like(turns)
    latest = np.broadcast_to(arm.base_rotation, (*q.shape[:-1], 3, 3))
    for link in range(arm.links):
        latest = latest @ turns[..., link, :, :]
        rotations[..., link, :, :] = latest
    return rotations


def space_chain_by_numpy(arm: Arm, q: FloatArray, slopes: FloatArray) -> Pose:
    """Return positions, rotations and derivatives of the links, as ``poses_with``; its p unknowns are set to zero.

    Args:
        arm: the arm.
        q: configuration, shape (c,) [rad, m].
        slopes: derivatives of the configuration with respect to the unknowns, shape (c, p).
    """
    base = arm.base_rotation
    n = arm.links
    p = slopes.shape[1]
    points = np.zeros((n + 1, 3))
    rotations = np.zeros((n, 3, 3))
    turning = np.zeros((n, 3, p))
    moving = np.zeros((n + 1, 3, p))
    points[0] = arm.base
    if arm.base_axes:
        points[0] += base[:, 0] * q[2 * n]
        moving[0] = np.outer(base[:, 0], slopes[2 * n])
    before = base
    turned = np.zeros((3, p))
    for j in range(n):
        a = q[2 * j]
        b = q[2 * j + 1]
        about_z = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
        about_y = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
        after = before @ about_z @ about_y
        turned = turned + np.outer(before[:, 2], slopes[2 * j]) + np.outer(after[:, 1], slopes[2 * j + 1])
        rotations[j] = after
        turning[j] = turned
        step = arm.link_length * after[:, 0]
        points[j + 1] = points[j] + step
        moving[j + 1] = moving[j] + np.cross(turned, step[:, None], axisa=0, axisb=0, axisc=0)
        before = after
    return Pose(np.zeros(p), q, slopes, points, moving, turning, rotations)
