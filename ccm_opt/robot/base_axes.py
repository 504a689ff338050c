"""The axes between the ground and an arm, such as those of a gantry, a turntable or a robot that carries the arm.

An axis is prismatic or revolute. Directions and points of the axes are those in the world where all axes are at zero,
so that an axis k at q_k moves everything beyond it by the rigid motion E_k(q_k) about them. The arm's base, which is at
T_0 where all axes are at zero, is then at E_1(q_1) … E_k(q_k) T_0 (product of exponentials; Lynch and Park, Modern
Robotics, section 4.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.core.arrays import FloatArray

MOST_AXES = 6
"""Greatest number of axes between the ground and an arm."""


@dataclass(frozen=True)
class Feed:
    """A linear axis that carries an arm's base through a guide tube, along the heading of the straight arm.

    Positions on the axis are measured from ``Arm.base``.

    Attributes:
        low: lower bound on the position of the base [m].
        high: upper bound on the position of the base [m].
        hole: position of the far end of the guide tube [m]; joints still inside the tube are held straight.
    """

    low: float
    high: float
    hole: float

    unit = "m"
    inertia = 0.0


@dataclass(frozen=True, eq=False)
class BaseAxis:
    """An axis between the ground and an arm; its direction and its point are those where all axes are at zero.

    Attributes:
        direction: direction of the axis in the world, a unit vector, shape (3,).
        low: lower bound on its position [m, rad].
        high: upper bound on its position [m, rad].
        revolute: whether the axis is revolute; else it is prismatic.
        point: a point of a revolute axis in the world, shape (3,) [m].
        inertia: inertia of the drive and of what the axis carries beside the arm, felt at the axis [kg, kg m²].
    """

    direction: FloatArray
    low: float
    high: float
    revolute: bool = field(kw_only=True)
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: float = 0.0

    hole = -np.inf

    @property
    def unit(self) -> str:
        """Unit of positions on the axis, "rad" or "m"."""
        return "rad" if self.revolute else "m"


def axis_rows(axes: Sequence[BaseAxis]) -> FloatArray:
    """Return 1 for a revolute and 0 for a prismatic axis, its direction and its point, for each axis, shape (k, 7)."""
    rows = [np.concatenate(([float(axis.revolute)], axis.direction, axis.point)) for axis in axes]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def axis_reaches(axes: Sequence[BaseAxis], place: FloatArray, length: float) -> tuple[float, ...]:
    """Return bounds on how far a unit of each axis moves any point of an arm that the axes carry [m, m/rad].

    Args:
        axes: the axes.
        place: position of the arm's base where all axes are at zero, shape (3,) [m].
        length: length of the arm [m].
    """
    reaches = []
    # The farthest that a point of the arm may be from a place that the axes so far do not move relative to the next.
    farthest, origin = length, place
    for axis in reversed(axes):
        if axis.revolute:
            farthest += float(np.linalg.norm(origin - axis.point))
            origin = axis.point
            reaches.append(farthest)
        else:
            farthest += max(abs(axis.low), abs(axis.high))
            reaches.append(1.0)
    return tuple(reversed(reaches))


def base_frames(axes: FloatArray, place: FloatArray, rotation: FloatArray, values: FloatArray) -> "BaseFrames":
    """Return where axes carry a base, and where the axes themselves are.

    Args:
        axes: rows of the k axes, as ``axis_rows`` gives them, shape (k, 7).
        place: position of the base where all axes are at zero, shape (3,) [m].
        rotation: rotation of the base where all axes are at zero, shape (3, 3).
        values: positions of the axes, shape (..., k) [m, rad].
    """
    shape = values.shape[:-1]
    turn = np.broadcast_to(np.eye(3), (*shape, 3, 3))
    shift = np.zeros((*shape, 3))
    directions, points = np.empty((2, *shape, len(axes), 3))
    for k, axis in enumerate(axes):
        direction, point = axis[1:4], axis[4:]
        directions[..., k, :] = turn @ direction
        points[..., k, :] = turn @ point + shift
        value = values[..., k, None]
        if axis[0] == 0.0:
            shift = shift + value * directions[..., k, :]
            continue
        turned = turn @ _rotations(direction, values[..., k])
        shift = shift + (turn - turned) @ point
        turn = turned
    return BaseFrames(turn @ place + shift, turn @ rotation, directions, points)


@dataclass(frozen=True, eq=False)
class BaseFrames:
    """Where axes carry an arm's base in the world, and where the k axes themselves are.

    Attributes:
        place: positions of the base, shape (..., 3) [m].
        rotation: rotations of the base, shape (..., 3, 3).
        directions: directions of the axes, unit vectors, shape (..., k, 3).
        points: a point on each axis, shape (..., k, 3) [m].
    """

    place: FloatArray
    rotation: FloatArray
    directions: FloatArray
    points: FloatArray


def _rotations(unit: FloatArray, angle: FloatArray) -> FloatArray:
    """Return the rotations about a unit vector by angles (...) [rad], shape (..., 3, 3)."""
    x, y, z = unit
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.asarray(np.eye(3) + sine * hat + (1.0 - cosine) * (hat @ hat))
