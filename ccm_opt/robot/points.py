"""Position, velocity, acceleration and jerk of points at fixed arc lengths along an arm, in the plane and in space.

Joint i turns by a about the z axis of link i − 1 and by b about the y axis of link i. With these axes z and y, x along
a link and a prime for a derivative with respect to time or a path parameter (Craig, Introduction to Robotics, section
5.5):

    ω_i = ω_(i−1) + a' z + b' y                α_i = α_(i−1) + a'' z + a' ω_(i−1) × z + b'' y + b' ω_i × y
    x' = ω × x                                 x'' = α × x + ω × (ω × x)
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray, in_space
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True)
class MovingPoint:
    """A point of an arm at a fixed arc length, with its derivatives with respect to time or a path parameter.

    Attributes:
        arm: the arm.
        levers: length of the part of each link that lies between the base and the point, shape (links,) [m].
    """

    arm: Arm
    levers: FloatArray

    def position(self, q: FloatArray) -> FloatArray:
        """Return the position of the point, shape (N, d) [m].

        Args:
            q: configurations, shape (N, c) [rad, m].
        """
        return self.arm.base + self._carried(q) + self._summed(self.arm.link_rotations(q)[..., 0])

    def velocity(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the first derivative of the point's position, shape (N, d).

        Args:
            q: configurations, shape (N, c) [rad, m].
            qd: first derivatives of the configurations, shape (N, c).
        """
        axes = self._axes(q)
        omega = np.cumsum(_turning(axes, self._rates(qd)), axis=-2)
        return self._carried(qd) + self._summed(np.cross(omega, axes.along))

    def acceleration(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Return the second derivative of the point's position, shape (N, d).

        Args:
            q: configurations, shape (N, c) [rad, m].
            qd: first derivatives of the configurations, shape (N, c).
            qdd: second derivatives of the configurations, shape (N, c).
        """
        axes = self._axes(q)
        rates = self._rates(qd)
        omega = np.cumsum(_turning(axes, rates), axis=-2)
        # ω of the previous link; the base does not turn.
        before = np.concatenate((np.zeros_like(omega[..., :1, :]), omega[..., :-1, :]), axis=-2)
        carried = rates[..., :1] * np.cross(before, axes.first) + rates[..., 1:] * np.cross(omega, axes.second)
        alpha = np.cumsum(_turning(axes, self._rates(qdd)) + carried, axis=-2)
        inward = np.cross(omega, np.cross(omega, axes.along))
        return self._carried(qdd) + self._summed(np.cross(alpha, axes.along) + inward)

    def most_jerk(self, q: FloatArray, qd: FloatArray, step: FloatArray) -> FloatArray:
        """Return an upper bound on the point's jerk over N time steps in which the coordinates change linearly.

        With bounds S, A and J on |ω|, |α| and |α'| of a link, |x'''| is at most J + 3 A S + S³. The bound on |ω| is its
        value at the start of the step plus its greatest change during the step.

        Args:
            q: configuration at the start of each step, shape (N, c) [rad, m].
            qd: constant rates of the coordinates in each step, shape (N, c) [rad/s, m/s].
            step: duration of each step, shape (N,) [s].

        Returns:
            Bounds, shape (N,) [m/s³].
        """
        rates = self._rates(qd)
        if self.arm.dimension == 2:  # headings turn at constant rates, whatever their values
            return np.asarray(np.abs(np.cumsum(rates[..., 1], axis=-1)) ** 3 @ self.levers)
        omega = np.linalg.norm(np.cumsum(_turning(self._axes(q), rates), axis=-2), axis=-1)
        first = np.abs(rates[..., 0])
        second = np.abs(rates[..., 1])
        speed = np.zeros(len(q))
        change = np.zeros(len(q))
        growth = np.zeros(len(q))
        jerk = np.zeros(len(q))
        for link in range(self.arm.links):
            a = first[:, link]
            b = second[:, link]
            # The second axis is turned by the previous link and by the first bend.
            turning = speed + a
            swing = change + a * speed
            growth = growth + a * (change + speed**2) + b * (swing + turning**2)
            change = change + a * speed + b * turning
            speed = np.minimum(speed + np.hypot(a, b), omega[:, link] + step * change)
            jerk += self.levers[link] * (growth + 3.0 * change * speed + speed**3)
        return jerk

    def _rates(self, qd: FloatArray) -> FloatArray:
        """Return the rates of both bends of every joint, shape (N, links, 2), from coordinate rates, shape (N, c).

        In the plane the first is zero.
        """
        if self.arm.dimension == 3:
            return self.arm.bend_pairs(qd)
        bends = qd[..., : self.arm.links]
        return np.stack((np.zeros_like(bends), bends), axis=-1)

    def _axes(self, q: FloatArray) -> "_Axes":
        rotations = self.arm.link_rotations(q)
        if self.arm.dimension == 2:  # about the normal of the plane
            normal = np.broadcast_to([0.0, 0.0, 1.0], (*rotations.shape[:-2], 3))
            return _Axes(normal, normal, in_space(rotations[..., 0]))
        base = np.broadcast_to(self.arm.base_rotation[:, 2], (*q.shape[:-1], 1, 3))
        first = np.concatenate((base, rotations[..., :-1, :, 2]), axis=-2)
        return _Axes(first, rotations[..., 1], rotations[..., 0])

    def _summed(self, of_links: FloatArray) -> FloatArray:
        """Return the sum of one vector per link, weighted by the levers, shape (N, d).

        ``of_links`` are the vectors, shape (N, links, 2 or 3).
        """
        return np.asarray(np.einsum("...lk,l->...k", of_links, self.levers)[..., : self.arm.dimension])

    def _carried(self, q: FloatArray) -> FloatArray:
        """Return the displacement of the base, shape (N, d) [m], in configurations q, shape (N, c).

        The map is linear, so it also applies to derivatives.
        """
        return np.asarray(self.arm.coordinates.advance(q)[..., None] * self.arm.direction)


class _Axes(NamedTuple):
    """Axes of the first and second bend of every joint and directions of the links, each of shape (N, links, 3)."""

    first: FloatArray
    second: FloatArray
    along: FloatArray


def _turning(axes: _Axes, rates: FloatArray) -> FloatArray:
    """Return the angular velocity of every link relative to the previous link, shape (N, links, 3).

    Args:
        axes: axes of the joints.
        rates: rates of the two bends of every joint, shape (N, links, 2).
    """
    return rates[..., :1] * axes.first + rates[..., 1:] * axes.second


def point_at_arc_length(arm: Arm, at: float | None) -> MovingPoint:
    """Return the point of an arm at an arc length from its base [m], or the tip for None.

    Raises:
        ProblemError: the arc length is negative or exceeds the length of the arm.
    """
    length = arm.length if at is None else at
    if not 0.0 <= length <= arm.length * (1.0 + ROUNDING):
        raise ProblemError(f"a point of the arm must be from 0 to {arm.length:g} m along it, got {length:g} m")
    before = arm.joint_places[:-1]
    return MovingPoint(arm, np.clip(length - before, 0.0, arm.lengths))
