"""The verifier's own kinematics of the axes that carry an arm's base: where they carry it, and how fast.

All vectors are in the world, in which a planar arm moves in x-z. A rigid motion of everything beyond an axis is applied
to what the axes after it have moved already, from the last axis to the first.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True)
class BaseMotion:
    """Where k axes carry the base in T configurations, and where the axes themselves are.

    Attributes:
        place: positions of the base, shape (T, 3) [m].
        ahead: directions of the straight arm, shape (T, 3).
        left: directions to its left, shape (T, 3).
        up: directions up from it, shape (T, 3).
        axes: directions of the axes, shape (T, k, 3); for a feed axis, that of the arm.
        points: a point on each axis, shape (T, k, 3) [m].
        turns: 1 for each revolute axis and 0 for each prismatic one, shape (k,).
    """

    place: FloatArray
    ahead: FloatArray
    left: FloatArray
    up: FloatArray
    axes: FloatArray
    points: FloatArray
    turns: FloatArray

    @classmethod
    def from_configurations(cls, arm: Arm, positions: FloatArray) -> "BaseMotion":
        """Compute the motion of the base for configurations of shape (T, c)."""
        ahead, left, up = (np.tile(axis, (len(positions), 1)) for axis in arm.base_rotation.T)
        at_zero = arm.base if arm.dimension == 3 else np.array([arm.base[0], 0.0, arm.base[1]])
        place = np.tile(at_zero, (len(positions), 1))
        values = positions[:, arm.coordinates.base]
        if arm.feed is not None:
            along = np.array(arm.base_rotation[:, 0])
            axes = np.tile(along, (len(positions), 1, 1))
            return cls(place + values * along, ahead, left, up, axes, axes, np.zeros(1))
        axes, points = (
            np.tile(np.array([getattr(axis, name) for axis in arm.carrier]).reshape(-1, 3), (len(positions), 1, 1))
            for name in ("direction", "point")
        )
        for k in range(len(arm.carrier) - 1, -1, -1):
            axis, value = arm.carrier[k], values[:, k, None]
            if not axis.revolute:
                place = place + value * axis.direction
                points[:, k + 1 :] += (value * axis.direction)[:, None]
                continue
            cosine, sine = np.cos(value), np.sin(value)
            ahead, left, up = (_turned(vector, axis.direction, cosine, sine) for vector in (ahead, left, up))
            place = axis.point + _turned(place - axis.point, axis.direction, cosine, sine)
            for beyond in range(k + 1, len(arm.carrier)):
                axes[:, beyond] = _turned(axes[:, beyond], axis.direction, cosine, sine)
                points[:, beyond] = axis.point + _turned(points[:, beyond] - axis.point, axis.direction, cosine, sine)
        return cls(place, ahead, left, up, axes, points, np.array([float(axis.revolute) for axis in arm.carrier]))

    def rates(self, velocities: FloatArray, accelerations: FloatArray) -> "BaseRates":
        """Return how fast the base moves, from velocities and accelerations of the axes, each of shape (T, k)."""
        rate, growth, speed, gain = np.zeros((4, *self.place.shape))
        last = np.zeros_like(self.place)  # the point of the body beyond the axis whose speed and gain are known
        for k, turns in enumerate(self.turns):
            axis, point = self.axes[:, k], self.points[:, k]
            velocity, acceleration = velocities[:, k, None], accelerations[:, k, None]
            if turns == 0.0:
                speed = speed + velocity * axis
                gain = gain + acceleration * axis + 2.0 * velocity * cross(rate, axis)
                continue
            speed, gain = _at_point(rate, growth, speed, gain, point - last)
            last = point
            growth = growth + acceleration * axis + velocity * cross(rate, axis)
            rate = rate + velocity * axis
        speed, gain = _at_point(rate, growth, speed, gain, self.place - last)
        return BaseRates(rate, growth, speed, gain)

    def efforts(self, force: FloatArray, moment: FloatArray) -> FloatArray:
        """Return the efforts of the axes that a force on the base and a moment about it require, shape (T, k) [N, N m].

        Args:
            force: force on the base, shape (T, 3) [N].
            moment: moment about the base, shape (T, 3) [N m].
        """
        efforts = np.empty(self.axes.shape[:2])
        for k, turns in enumerate(self.turns):
            axis = self.axes[:, k]
            about = moment + cross(self.place - self.points[:, k], force)
            efforts[:, k] = np.sum((about if turns else force) * axis, axis=1)
        return efforts


@dataclass(frozen=True)
class BaseRates:
    """How fast a base moves in the world, each of shape (T, 3).

    Attributes:
        rate: angular velocities [rad/s].
        growth: angular accelerations [rad/s²].
        speed: velocities of the base's origin [m/s].
        gain: accelerations of the base's origin [m/s²].
    """

    rate: FloatArray
    growth: FloatArray
    speed: FloatArray
    gain: FloatArray


def base_bounds(arm: Arm, motion: BaseMotion, middle: FloatArray, steps: FloatArray) -> tuple[FloatArray, ...]:
    """Return bounds on the motion of the base over N motions at constant rates of the coordinates.

    Derivatives are with respect to the fraction s of the motion, from 0 to 1.

    Args:
        arm: the arm.
        motion: where the axes are at s = ½.
        middle: configurations at s = ½, shape (N, c) [rad, m].
        steps: changes of the coordinates, shape (N, c) [rad, m].

    Returns:
        Angular rates at s = ½, shape (N, 3); bounds on their derivatives, on their norms, and on the second derivatives
        of the base's position, each of shape (N,).
    """
    values, changes = np.abs(middle[:, arm.coordinates.base]), steps[:, arm.coordinates.base]
    rate = np.zeros((len(steps), 3))
    gain, fastest, bow, reach = np.zeros((4, len(steps)))
    last: FloatArray | None = None
    for k, turns in enumerate(motion.turns):
        change = np.abs(changes[:, k])
        if turns == 0.0:
            # It is moved out by at most this, along a direction that turns with the axes before it.
            reach = reach + values[:, k] + 0.5 * change
            bow = bow + 2.0 * fastest * change
            continue
        point = arm.carrier[k].point
        if last is not None:
            reach = reach + float(np.linalg.norm(point - last))
        bow = bow + reach * (fastest**2 + gain)
        reach, last = np.zeros(len(steps)), point
        rate = rate + changes[:, k, None] * motion.axes[:, k]
        gain = gain + fastest * change
        fastest = np.sqrt(np.sum(rate**2, axis=1)) + 0.5 * gain
    if last is not None:
        at_zero = arm.base if arm.dimension == 3 else np.array([arm.base[0], 0.0, arm.base[1]])
        reach = reach + float(np.linalg.norm(at_zero - last))
        bow = bow + reach * (fastest**2 + gain)
    return rate, gain, fastest, bow


def base_reach(arm: Arm) -> float:
    """Return a bound on the distance of the base from every revolute axis that carries it, in all poses [m]."""
    return max(
        (lever - arm.length for axis, lever in zip(arm.carrier, axis_levers(arm), strict=True) if axis.revolute),
        default=0.0,
    )


def axis_levers(arm: Arm) -> FloatArray:
    """Return bounds on how far a unit of each axis of a carrier moves any point of the arm, shape (k,) [m, m/rad]."""
    at_zero = arm.base if arm.dimension == 3 else np.array([arm.base[0], 0.0, arm.base[1]])
    levers = np.ones(len(arm.carrier))
    for k, axis in enumerate(arm.carrier):
        if not axis.revolute:
            continue
        # From the axis over the points of the revolute axes beyond it, and out along the prismatic ones.
        beyond = arm.carrier[k + 1 :]
        places = np.array([axis.point, *(each.point for each in beyond if each.revolute), at_zero])
        out = sum(max(abs(each.low), abs(each.high)) for each in beyond if not each.revolute)
        levers[k] = arm.length + out + float(np.sum(lengths_of(np.diff(places, axis=0))))
    return levers


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Return the Euclidean lengths of vectors (..., d), three times as fast as ``numpy.linalg.norm`` for small d."""
    return np.asarray(np.sqrt(np.einsum("...d,...d->...", vectors, vectors)))


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross products of vectors (..., 3), in a third of the time of ``numpy.cross``."""
    x, y, z = (first[..., k] for k in range(3))
    u, v, w = (second[..., k] for k in range(3))
    return vectors(y * w - z * v, z * u - x * w, x * v - y * u)


def vectors(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Return vectors (..., 3) of given components, which are kept apart in memory, where they are computed faster."""
    return np.moveaxis(np.stack((x, y, z)), 0, -1)


def _at_point(
    rate: FloatArray, growth: FloatArray, speed: FloatArray, gain: FloatArray, away: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return velocities and accelerations of points of rigid bodies, away from points where both are known."""
    turned = cross(rate, away)
    return speed + turned, gain + cross(growth, away) + cross(rate, turned)


def _turned(vectors: FloatArray, unit: FloatArray, cosine: FloatArray, sine: FloatArray) -> FloatArray:
    """Return vectors (T, 3) turned about a unit vector by angles, given by cosines and sines of shape (T, 1)."""
    along = (vectors @ unit)[:, None] * unit
    across = vectors - along
    return np.asarray(along + cosine * across + sine * cross(unit, across))
