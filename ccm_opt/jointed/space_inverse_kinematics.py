"""Inverse kinematics of an arm in space, joint by joint: from where links point, or joints are, to the bends."""

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.inverse_kinematics import aim
from ccm_opt.jointed.jointed_settings import DEFAULT_MAPPING
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import bend_rotations


def bends_from_directions(arm: SpaceArm, directions: FloatArray) -> FloatArray:
    """Bends that let the links point in given directions; the rolls of the links follow.

    In the axes of the link before a link points along (cos a cos b, sin a cos b, −sin b). Of the two solutions the one
    with a within ±90° is taken.

    Args:
        arm: the arm.
        directions: unit vectors, shape (..., links, 3).

    Returns:
        Shape (..., links, 2) [rad].
    """
    bends = np.zeros((*directions.shape[:-1], 2))
    rotation = np.broadcast_to(arm.base_rotation, (*directions.shape[:-2], 3, 3))
    for link in range(arm.links):
        local = np.einsum("...ij,...i->...j", rotation, directions[..., link, :])
        bends[..., link, 0], bends[..., link, 1] = aim(local)
        rotation = rotation @ bend_rotations(bends[..., link, :])
    return bends


def configuration_from_positions(
    arm: SpaceArm, positions: FloatArray, tolerance: float = DEFAULT_MAPPING.length_tolerance
) -> FloatArray:
    """The configuration that places joints and tip at given positions, shape (..., c) [rad, m].

    Args:
        arm: the arm.
        positions: of joints and tip, shape (..., links + 1, 3) [m]; the first is the base, or lies on its feed axis.
        tolerance: how far the base and the link lengths may be off, as a share of a link.

    Raises:
        ProblemError: the shape, the base or a link length does not fit the arm.
    """
    if positions.ndim < 2 or positions.shape[-2:] != (arm.links + 1, 3):
        raise ProblemError(
            f"positions have shape {positions.shape}; expected (..., {arm.links + 1}, 3): the {arm.links} joints "
            "and the tip"
        )
    carried = np.clip((positions[..., 0, :] - arm.base) @ arm.direction, *arm.base_range)
    off = positions[..., 0, :] - arm.base - carried[..., None] * arm.direction
    allowed = tolerance * arm.link_length
    if not float(np.max(np.abs(off), initial=0.0)) <= allowed:  # so written, a NaN is refused too
        raise ProblemError(
            f"the first position lies {float(np.max(np.abs(off))):.3g} m off the arm's base; it must be the base itself"
        )
    steps = np.diff(positions, axis=-2)
    lengths = np.linalg.norm(steps, axis=-1)
    worst = float(np.max(np.abs(lengths - arm.link_length), initial=0.0))
    if not worst <= allowed:
        raise ProblemError(
            f"a link would be {worst:.3g} m longer or shorter than {arm.link_length:.6g} m: place the joints by a "
            "mapping that keeps link lengths"
        )
    bends = bends_from_directions(arm, steps / lengths[..., None])
    flat = bends.reshape(*bends.shape[:-2], 2 * arm.links)
    return np.concatenate((flat, carried[..., None] * np.ones(len(arm.base_axes))), axis=-1)
