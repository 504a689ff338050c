"""Where the joints of an arm in space are, and how its links are turned."""

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.space_arm import SpaceArm


def joint_positions(arm: SpaceArm, q: FloatArray) -> FloatArray:
    """Positions of the joints and the tip in configurations of shape (..., c), shape (..., links + 1, 3) [m]."""
    return _poses(arm, q)[0]


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
    return _poses(arm, q)[1]


def _poses(arm: SpaceArm, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (..., links + 1, 3) [m] and rotations (..., links, 3, 3) of configurations of shape (..., c)."""
    links = arm.links
    if q.shape[-1:] != (len(arm.coordinates),):
        raise ValueError(f"configurations have the shape {q.shape}; expected (..., {len(arm.coordinates)})")
    positions = np.empty((*q.shape[:-1], links + 1, 3))
    rotations = np.empty((*q.shape[:-1], links, 3, 3))
    NativeCall(
        "space_poses",
        poses=q.size // q.shape[-1], links=links, coordinates=q.shape[-1], link_length=arm.link_length,
        base=arm.base, rotation=arm.base_rotation, q=q, positions=positions, rotations=rotations,
    )()  # fmt: skip
    return positions, rotations


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
