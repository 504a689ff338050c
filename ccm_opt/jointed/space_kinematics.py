"""Where the joints of an arm in space are, and how its links are turned."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.compiled_poses import compiled_poses
from ccm_opt.jointed.space_arm import SpaceArm


def joint_positions(arm: SpaceArm, q: FloatArray) -> FloatArray:
    """Positions of the joints and the tip in configurations of shape (..., c), shape (..., links + 1, 3) [m]."""
    found = compiled_poses(arm, q)
    return positions_of_links(arm, q, rotations_by_numpy(arm, q)) if found is None else found[0]


def positions_of_links(arm: SpaceArm, q: FloatArray, rotations: FloatArray) -> FloatArray:
    """Positions of the joints and the tip where the links are turned so, shape (..., links + 1, 3) [m].

    Args:
        arm: the arm.
        q: configurations, shape (..., c), of which only the feed counts.
        rotations: of their links, shape (..., links, 3, 3).
    """
    positions = np.zeros((*q.shape[:-1], arm.links + 1, 3))
    np.cumsum(arm.link_length * rotations[..., 0], axis=-2, out=positions[..., 1:, :])
    positions += arm.base
    if arm.base_axes:
        positions += arm.coordinates.advance(q)[..., None, None] * arm.direction
    return positions


def exposed_links(arm: SpaceArm, points: FloatArray) -> tuple[int, FloatArray]:
    """Index of the first link beyond the mount, and the axes of the links from its end on.

    Args:
        arm: the arm.
        points: joints and tip of one pose or of several, shape (..., links + 1, 3) [m].

    Returns:
        The index, and axes of shape (..., k, 2, 3) [m]; none where the whole arm is mount.
    """
    first, share = arm.mount_end
    if share > 1.0 - ROUNDING:
        return arm.links, np.zeros((*points.shape[:-2], 0, 2, 3))
    axes = np.stack((points[..., first:-1, :], points[..., first + 1 :, :]), axis=-2)
    axes[..., 0, 0, :] += share * (axes[..., 0, 1, :] - axes[..., 0, 0, :])
    return first, axes


def link_rotations(arm: SpaceArm, q: FloatArray) -> FloatArray:
    """Rotations world ← link, R_i = R_(i−1) Rz(a_i) Ry(b_i), whose first columns are the directions of the links.

    Args:
        arm: the arm.
        q: configurations, shape (..., c) [rad, m].

    Returns:
        Shape (..., links, 3, 3).
    """
    found = compiled_poses(arm, q)
    return rotations_by_numpy(arm, q) if found is None else found[1]


def rotations_by_numpy(arm: SpaceArm, q: FloatArray) -> FloatArray:
    """The same where nothing is compiled."""
    turns = bend_rotations(arm.bend_pairs(q))
    rotations = np.empty_like(turns)
    latest = np.broadcast_to(arm.base_rotation, (*q.shape[:-1], 3, 3))
    for link in range(arm.links):
        latest = latest @ turns[..., link, :, :]
        rotations[..., link, :, :] = latest
    return rotations


def bend_rotations(bends: FloatArray) -> FloatArray:
    """Rz(a) Ry(b) of pairs of bends, shape (..., 2) to (..., 3, 3)."""
    cos = np.cos(bends)
    sin = np.sin(bends)
    ca = cos[..., 0]
    cb = cos[..., 1]
    sa = sin[..., 0]
    sb = sin[..., 1]
    turns = np.empty((*bends.shape[:-1], 3, 3))
    turns[..., 0, :] = np.stack((ca * cb, -sa, ca * sb), axis=-1)
    turns[..., 1, :] = np.stack((sa * cb, ca, sa * sb), axis=-1)
    turns[..., 2, :] = np.stack((-sb, np.zeros_like(sb), cb), axis=-1)
    return turns
