"""The axes between the ground and an arm, such as those of a gantry, a turntable or a robot that carries the arm.

An axis is prismatic or revolute. Directions and points of the axes are those in the world where all axes are at zero,
so that an axis k at q_k moves everything beyond it by the rigid motion E_k(q_k) about them. The arm's base, which is at
T_0 where all axes are at zero, is then at E_1(q_1) … E_k(q_k) T_0 (product of exponentials; Lynch and Park, Modern
Robotics, section 4.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from ccm_opt.core.arrays import FloatArray

MOST_AXES = 6
"""Greatest number of axes between the ground and an arm."""
_SWEEPS = 30
"""Most times that every axis is moved to bring the base near a point. Heuristic: some five are enough mostly."""
_SETTLED = 1e-9
"""Change of the positions of axes that counts as none [m, rad]."""


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


@dataclass(frozen=True)
class ShortAxis:
    """An axis that would bring an arm's base near enough to a point, had it a wider range.

    Attributes:
        number: index of the axis.
        limit: end of its range at which it stands [m, rad].
        missing: how far beyond that end it would have to go [m, rad].
    """

    number: int
    limit: float
    missing: float


def nearest_base(axes: Sequence[BaseAxis], place: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    """Return the positions of axes at which the base is nearest to a point, shape (k,) [m, rad], and its distance [m].

    One axis after the other is moved to its best position, from the middle and from all ends of the ranges; the result
    is exact if all axes are prismatic.

    Args:
        axes: the axes.
        place: position of the arm's base where all axes are at zero, shape (3,) [m].
        target: the point, shape (3,) [m].
    """
    rows = axis_rows(axes)
    ends = [(axis.low, axis.high) for axis in axes]
    values = np.vstack((np.mean(ends, axis=1), list(product(*ends))))
    for _ in range(_SWEEPS):
        before = values.copy()
        for k, axis in enumerate(axes):
            best, _ = _best_positions(axes, place, target, values, k, 0.0)
            values[:, k] = np.clip(best, axis.low, axis.high)
        if np.allclose(values, before, rtol=0.0, atol=_SETTLED):
            break
    distances = np.linalg.norm(base_frames(rows, place, np.eye(3), values).place - target, axis=1)
    nearest = int(np.argmin(distances))
    return values[nearest], float(distances[nearest])


def short_axes(
    axes: Sequence[BaseAxis], place: FloatArray, target: FloatArray, values: FloatArray, within: float
) -> tuple[ShortAxis, ...]:
    """Return the axes each of which alone would bring the base within a distance of a point, had it a wider range.

    Args:
        axes: the axes.
        place: position of the arm's base where all axes are at zero, shape (3,) [m].
        target: the point, shape (3,) [m].
        values: positions of the axes at which the base is nearest to the point, shape (k,) [m, rad].
        within: the distance [m].
    """
    found = []
    for k, axis in enumerate(axes):
        best, spare = (float(each[0]) for each in _best_positions(axes, place, target, values[None], k, within))
        limit = min(max(best, axis.low), axis.high)
        missing = abs(best - limit) - spare
        if missing > 0.0:  # not if no position is near enough, where the spare is not a number
            found.append(ShortAxis(k, limit, missing))
    return tuple(found)


def _best_positions(
    axes: Sequence[BaseAxis], place: FloatArray, target: FloatArray, values: FloatArray, k: int, within: float
) -> tuple[FloatArray, FloatArray]:
    """Return the positions of axis k at which the base is nearest to a point while the other axes stand.

    The second result is how far from there the axis may be for the base to be within a distance of the point; it is not
    a number where no position is near enough. Ranges play no part, but angles are those nearest to the middle of the
    range. Both have shape (m,) [m, rad].
    """
    axis = axes[k]
    frames = base_frames(axis_rows(axes), place, np.eye(3), values)
    along, point = frames.directions[:, k], frames.points[:, k]
    with np.errstate(invalid="ignore", divide="ignore"):
        if not axis.revolute:
            off = target - frames.place
            ahead = np.sum(off * along, axis=1)
            return values[:, k] + ahead, np.sqrt(within**2 - (np.sum(off**2, axis=1) - ahead**2))
        base, goal = frames.place - point, target - point
        lift = np.sum((goal - base) * along, axis=1)
        base, goal = (each - np.sum(each * along, axis=1)[:, None] * along for each in (base, goal))
        turn = np.arctan2(np.sum(along * np.cross(base, goal), axis=1), np.sum(base * goal, axis=1))
        middle = 0.5 * (axis.low + axis.high)
        best = middle + (values[:, k] + turn - middle + np.pi) % (2.0 * np.pi) - np.pi
        squares = np.sum(base**2, axis=1) + np.sum(goal**2, axis=1) + lift**2 - within**2
        return best, np.arccos(squares / (2.0 * np.linalg.norm(base, axis=1) * np.linalg.norm(goal, axis=1)))


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
