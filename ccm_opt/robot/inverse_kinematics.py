"""Joint angles of an arm from given joint positions or link directions, in the plane and in space."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import bend_rotations

LENGTH_TOLERANCE = 1e-6
"""Allowed difference of two lengths that should be equal, as a fraction of the length. The length of a curve is known
to about this accuracy. Heuristic."""


def ball_angles(arm: Arm, positions: FloatArray, tolerance: float = LENGTH_TOLERANCE) -> FloatArray:
    """Return the revolute angles with which ball joints and tip have given positions, with θ3 = 0.

    In the base frame of its ball a link points along Rz(θ1) Ry(θ2) x̂ = (c1 c2, s1 c2, −s2), for both ``zyx`` and
    ``zyz``. Of the two solutions the one with θ1 within ±90° is returned. In the plane this is the paper's own formula,
    θ2 = atan2(−p_z, p_x), θ1 = θ3 = 0 (section 5.2).

    Args:
        arm: the arm.
        positions: positions of the balls and the tip, shape (..., links + 1, 2) in the plane or (..., links + 1, 3) in
            the world [m]; the first must be the arm's base, or lie on its feed axis.
        tolerance: allowed error of the base position and of the link lengths, as a fraction of the link length.

    Returns:
        Angles in (−π, π], shape (..., 3 * links) [rad].

    Raises:
        ProblemError: the shape, the base or a link length does not fit the arm.
    """
    directions, _ = _link_directions(arm, _world_points(arm, positions), tolerance * arm.link_length)
    bends = bends_from_directions(arm, directions)
    angles = np.concatenate((bends, np.zeros((*bends.shape[:-1], 1))), axis=-1)
    return angles.reshape(*bends.shape[:-2], -1)


def aim(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the angles θ1 and θ2 with which Rz(θ1) Ry(θ2) turns x̂ into given unit directions [rad].

    The directions have shape (..., 3), both results shape (...). Of the two solutions, the one with θ1 within ±90° is
    returned.
    """
    x, y, z = np.moveaxis(direction, -1, 0)
    side = np.where(x < 0.0, -1.0, 1.0)
    # A link that points backwards bends by more than 90° rather than swinging its yaw around.
    return np.arctan2(side * y, np.abs(x)), np.arctan2(-z, side * np.hypot(x, y))


def _world_points(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return joint and tip positions in world coordinates, shape (..., links + 1, 3) [m].

    Args:
        arm: the arm.
        positions: positions in the plane, (..., links + 1, 2), or in the world, (..., links + 1, 3) [m].

    Raises:
        ProblemError: the shape does not fit the arm.
    """
    shape = (arm.links + 1, arm.dimension)
    if positions.ndim < 2 or positions.shape[-2:] not in {shape, (arm.links + 1, 3)}:
        raise ProblemError(
            f"positions have shape {positions.shape}; expected (..., {shape[0]}, {shape[1]}), or 3 coordinates in the "
            f"world: the {arm.links} joints and the tip"
        )
    return positions if positions.shape[-1] == 3 else arm.embedded(positions)


def _link_directions(arm: Arm, points: FloatArray, tolerance: float) -> tuple[FloatArray, FloatArray]:
    """Return the link directions and the displacement of the base for given positions of joints and tip.

    Args:
        arm: the arm.
        points: positions in the world, shape (..., links + 1, 3) [m].
        tolerance: allowed error of the base position and of the link lengths [m].

    Returns:
        Unit vectors in the world, shape (..., links, 3), and the displacement of the base, shape (...) [m].

    Raises:
        ProblemError: the base position or a link length does not fit the arm.
    """
    axis = arm.base_rotation[:, 0]
    off = points[..., 0, :] - arm.base_position
    # A carried base may be anywhere on its axis: only the offset from the axis counts.
    carried = np.clip(off @ axis, *arm.base_range)
    offset = float(np.max(np.abs(off - carried[..., None] * axis), initial=0.0))
    if not offset <= tolerance:  # "not <=" refuses NaN too
        raise ProblemError(f"the first position lies {offset:.3g} m off the arm's base; it must be the base itself")
    steps = np.diff(points, axis=-2)
    lengths = np.linalg.norm(steps, axis=-1)
    errors = np.abs(lengths - arm.lengths)
    if not np.all(errors <= tolerance):
        worst = np.unravel_index(int(np.argmax(np.nan_to_num(errors, nan=np.inf))), errors.shape)
        raise ProblemError(
            f"link {worst[-1] + 1} would be {lengths[worst]:.6g} m long, not {arm.lengths[worst[-1]]:.6g} m: "
            "place the joints by a mapping that keeps link lengths"
        )
    return np.asarray(steps / lengths[..., None]), np.asarray(carried)


def bends_from_directions(arm: Arm, directions: FloatArray) -> FloatArray:
    """Return the bends that make the links of an arm point in given directions.

    In the axes of the previous link, a link with the bends a and b points along (cos a cos b, sin a cos b, −sin b). Of
    the two solutions the one with a within ±90° is returned. The roll of every link follows from the bends.

    Args:
        arm: the arm.
        directions: unit vectors in the world, shape (..., links, 3).

    Returns:
        Bends, shape (..., links, 2) [rad].
    """
    bends = np.zeros((*directions.shape[:-1], 2))
    rotation = np.broadcast_to(arm.base_rotation, (*directions.shape[:-2], 3, 3))
    for link in range(arm.links):
        local = np.einsum("...ij,...i->...j", rotation, directions[..., link, :])
        bends[..., link, 0], bends[..., link, 1] = aim(local)
        rotation = rotation @ bend_rotations(bends[..., link, :])
    return bends


def configuration_from_positions(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the configuration with joints and tip at given positions, shape (..., c) [rad, m].

    Args:
        arm: the arm.
        positions: positions of joints and tip, shape (..., links + 1, 3) [m]; the first is the base, or lies on its
            feed axis.

    Raises:
        ProblemError: the shape, the base or a link length does not fit the arm.
    """
    directions, carried = _link_directions(arm, _world_points(arm, positions), LENGTH_TOLERANCE * arm.link_length)
    bends = bends_from_directions(arm, directions)
    flat = bends.reshape(*bends.shape[:-2], -1)
    return np.concatenate((flat, carried[..., None] * np.ones(len(arm.base_axes))), axis=-1)
