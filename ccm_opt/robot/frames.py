"""Frames of ball joints made of three revolutes each, from a standard Denavit–Hartenberg table (section 5.2, Figure 6).

An arm in space bends each ball joint ("ball") by its first two revolutes, and the third stays at zero. A planar arm
uses only the second.

The plane (x, y) of the planner is world x–z. A counter-clockwise turn from x towards z is a turn by *minus* that angle
about world +y. The fixed base transform contains the base position and base heading, so that zero angles are the
straight arm along the base heading. θ2 of every ball is minus its planar bend, for both orders of axes:

- ``zyx`` (yaw, bend, roll): R = Rz(θ1) Ry(θ2) Rx(θ3), singular at |θ2| = 90°.
- ``zyz``, the paper's own table: R = Rz(θ1) Ry(θ2) Rz(θ3), singular at θ2 = 0, the straight arm.
"""

from typing import NamedTuple

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.base_axes import base_frames

REVOLUTE_NAMES: dict[Axes, tuple[str, str, str]] = {"zyx": ("yaw", "bend", "roll"), "zyz": ("yaw", "bend", "spin")}
_QUARTER = 0.5 * np.pi


class DhRow(NamedTuple):
    """One row of a standard Denavit–Hartenberg table, with the transform Rz(θ + offset) Tz(d) Tx(a) Rx(α).

    Attributes:
        offset: constant that is added to the joint angle θ [rad].
        d: shift along the joint axis [m].
        a: shift along the x axis after the joint's turn [m].
        alpha: twist α about the x axis after the joint's turn [rad].
    """

    offset: float
    d: float
    a: float
    alpha: float


def joint_names(arm: Arm) -> tuple[str, ...]:
    """Return the names of all 3 * links revolutes of an arm from the base outwards, such as ``ball01_bend``.

    For sections that bend evenly they are the components of the joints' rotation vectors, such as ``arc01_y``.
    """
    width = max(2, len(str(arm.links)))
    kinds, joint = (REVOLUTE_NAMES[arm.axes], "ball") if arm.sections is None else (("z", "y", "x"), "arc")
    return tuple(f"{joint}{ball:0{width}d}_{kind}" for ball in range(1, arm.links + 1) for kind in kinds)


def revolute_angles(arm: Arm, bends: FloatArray) -> FloatArray:
    """Return the angles of all revolutes of an arm for given joint bends, shape (..., 3 * links) [rad].

    In the plane θ2 = −bend (section 5.2); in space the bends are θ1 and θ2. All other angles are 0. The map is linear,
    so it also applies to velocities and accelerations.

    Args:
        arm: the arm.
        bends: joint bends in coordinate order, shape (..., links) in the plane and (..., 2 * links) in space [rad].

    Returns:
        Angles, shape (..., 3 * links) [rad].
    """
    coordinates = arm.coordinates
    angles = np.zeros((*bends.shape[:-1], coordinates.revolutes))
    # Added to zero so that a zero bend gives +0.0, whatever its sense.
    angles[..., coordinates.drive_numbers[coordinates.bends]] = 0.0 + coordinates.sense * bends
    return angles


def coupling_of_revolutes(arm: Arm) -> FloatArray | None:
    """Return the derivatives of the angles of all revolutes by the values of the m drives that move them together.

    Returns:
        Shape (3 * links, m); None for an arm whose revolutes each have their own drive.
    """
    return None if arm.drives is None else revolute_angles(arm, arm.drives.coupling.T).T


def drive_values(arm: Arm, angles: FloatArray) -> FloatArray:
    """Return the values of the m drives that bend an arm, from the angles of all revolutes, shape (..., 3 * links).

    They are the same unless drives move several revolutes together; then the shape is (..., m). The map is linear, so
    it also applies to velocities and accelerations.
    """
    return angles if arm.drives is None else arm.drives.drives(bends_from_revolutes(arm, angles))


def angles_from_drives(arm: Arm, values: FloatArray) -> FloatArray:
    """Return the angles of all revolutes for values of the drives that bend an arm, the inverse of ``drive_values``."""
    coupling = coupling_of_revolutes(arm)
    return values if coupling is None else np.asarray(values @ coupling.T)


def drive_names(arm: Arm) -> tuple[str, ...]:
    """Return the names of the m drives that bend an arm: those of the revolutes, or of what moves several."""
    return joint_names(arm) if arm.drives is None else arm.drives.drive_names


def drive_torques(arm: Arm, torques: FloatArray) -> FloatArray:
    """Return the torques of the m drives that bend an arm, from those of all revolutes, shape (..., 3 * links) [N m].

    They are the same unless drives move several revolutes together; then the shape is (..., m).
    """
    coupling = coupling_of_revolutes(arm)
    return torques if coupling is None else np.asarray(torques @ coupling)


def drive_torque_limits(arm: Arm, limits: FloatArray) -> FloatArray:
    """Return the torque limits of the drives that bend an arm, in the order of ``drive_torques`` [N m].

    Args:
        arm: the arm.
        limits: limits of all revolutes, shape (3 * links,); those that one drive moves have its limit.
    """
    return limits if arm.drives is None else arm.drives.of_drives(limits)


def bends_from_revolutes(arm: Arm, angles: FloatArray) -> FloatArray:
    """Return the joint bends for given revolute angles, the inverse of ``revolute_angles``.

    Revolutes that bend no joint are ignored.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Bends in coordinate order, shape (..., links) in the plane and (..., 2 * links) in space [rad].
    """
    coordinates = arm.coordinates
    return np.asarray(0.0 + coordinates.sense * angles[..., coordinates.drive_numbers[coordinates.bends]])


def dh_table(arm: Arm) -> tuple[DhRow, ...]:
    """Return the standard Denavit–Hartenberg rows of all 3 * links revolutes of an arm.

    With axes in ``zyx`` order the third frame of a ball joint has its y axis along the link, so the yaw of every ball
    but the first has an offset of a quarter turn, which aligns x with the link again.
    """
    return tuple(row for ball in range(arm.links) for row in _ball_rows(arm, ball))


def _ball_rows(arm: Arm, ball: int) -> tuple[DhRow, DhRow, DhRow]:
    h = float(arm.lengths[ball])
    if arm.axes == "zyz":
        return DhRow(0.0, 0.0, 0.0, -_QUARTER), DhRow(0.0, 0.0, 0.0, _QUARTER), DhRow(0.0, 0.0, h, 0.0)
    yaw = DhRow(0.0 if ball == 0 else _QUARTER, 0.0, 0.0, -_QUARTER)
    return yaw, DhRow(_QUARTER, 0.0, 0.0, _QUARTER), DhRow(-_QUARTER, h, 0.0, _QUARTER)


def frame_transforms(arm: Arm, angles: FloatArray) -> FloatArray:
    """Return the transforms from the base frame and from every Denavit–Hartenberg frame of an arm to the world.

    The base is at its zero position on the feed axis, if any.

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].

    Returns:
        Homogeneous transforms world ← frame, shape (..., 3 * links + 1, 4, 4).
    """
    transforms = np.zeros((*angles.shape[:-1], 3 * arm.links + 1, 4, 4))
    transforms[..., 0, :3, :3] = arm.base_rotation
    transforms[..., 0, :3, 3] = arm.base_position
    transforms[..., 0, 3, 3] = 1.0
    for j, row in enumerate(dh_table(arm)):
        transforms[..., j + 1, :, :] = transforms[..., j, :, :] @ dh_transform(row, angles[..., j])
    return transforms


def dh_transform(row: DhRow, angle: FloatArray) -> FloatArray:
    """Return the homogeneous transforms Rz(θ + offset) Tz(d) Tx(a) Rx(α) of a Denavit–Hartenberg row.

    Args:
        row: the row.
        angle: joint angles θ, shape (...) [rad].

    Returns:
        Shape (..., 4, 4).
    """
    c = np.cos(angle + row.offset)
    s = np.sin(angle + row.offset)
    ca = np.cos(row.alpha)
    sa = np.sin(row.alpha)
    matrix = np.zeros((*np.shape(angle), 4, 4))
    matrix[..., 0, :] = np.stack((c, -s * ca, s * sa, row.a * c), axis=-1)
    matrix[..., 1, :] = np.stack((s, c * ca, -c * sa, row.a * s), axis=-1)
    matrix[..., 2, :] = [0.0, sa, ca, row.d]
    matrix[..., 3, 3] = 1.0
    return matrix


def joint_positions_3d(arm: Arm, angles: FloatArray, base: FloatArray | None = None) -> FloatArray:
    """Return the positions of the joints and of the tip in the world, shape (..., links + 1, 3) [m].

    Args:
        arm: the arm.
        angles: revolute angles, shape (..., 3 * links) [rad].
        base: positions of the k axes that carry the base, shape (..., k) [m, rad]; None for all at zero.
    """
    place = np.zeros(len(arm.base_axes)) if base is None else base
    if arm.sections is not None:
        bends = bends_from_revolutes(arm, angles)
        moved = np.broadcast_to(place, (*bends.shape[:-1], len(arm.base_axes)))
        return arm.embedded(arm.joint_positions_at(np.concatenate((bends, moved), axis=-1)))
    positions = frame_transforms(arm, angles)[..., ::3, :3, 3]
    if not arm.carrier:
        return np.asarray(positions + np.sum(place, axis=-1)[..., None, None] * arm.base_rotation[:, 0])
    frames = base_frames(arm.axis_rows, arm.base_position, arm.base_rotation, place)
    turn = frames.rotation @ arm.base_rotation.T
    return np.asarray((positions - arm.base_position) @ np.swapaxes(turn, -1, -2) + frames.place[..., None, :])
