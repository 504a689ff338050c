"""Points of an arm by their arc length, of whatever arm can be driven.

Joint i turns by a about the z axis of the link before and by b about its own y axis, so that with the axes z and y of
those links, x along a link and a dash for a derivative in time or along a path (Craig, Introduction to Robotics,
section 5.5):

    ω_i = ω_(i−1) + a' z + b' y                α_i = α_(i−1) + a'' z + a' ω_(i−1) × z + b'' y + b' ω_i × y
    x' = ω × x                                 x'' = α × x + ω × (ω × x)
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True)
class PointOnArm:
    """A point at a fixed arc length along the links.

    Positions are linear in (cos φ, sin φ) of the link headings φ, so derivatives in time and derivatives along a path
    follow the same formulas.

    Attributes:
        arm: the arm.
        levers: how much of every link lies between the base and the point, shape (links,) [m].
    """

    arm: Arm
    levers: FloatArray

    @classmethod
    def from_arc_length(cls, arm: Arm, at: float | None) -> "PointOnArm":
        """The point at an arc length from the base [m]; the tip when None.

        Raises:
            ProblemError: the arm is not so long.
        """
        return cls(arm, arm.levers_to(at))

    def position(self, q: FloatArray) -> FloatArray:
        """Where the point is, shape (N, 2) [m].

        Args:
            q: coordinates of the arm, shape (N, c) [rad, m].
        """
        cos, sin = self._directions(q)
        along = np.stack((cos @ self.levers, sin @ self.levers), axis=1)
        return np.asarray(self.arm.base + self._carried(q) + along)

    def velocity(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """First derivative of the position, shape (N, 2), for first derivatives of the coordinates, shape (N, c)."""
        cos, sin = self._directions(q)
        turning = np.cumsum(qd[:, : self.arm.links], axis=1) * self.levers
        across = np.stack((-np.sum(turning * sin, axis=1), np.sum(turning * cos, axis=1)), axis=1)
        return np.asarray(self._carried(qd) + across)

    def acceleration(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Second derivative of the position, shape (N, 2), for both derivatives of the coordinates."""
        cos, sin = self._directions(q)
        inward = np.cumsum(qd[:, : self.arm.links], axis=1) ** 2 * self.levers
        turning = np.cumsum(qdd[:, : self.arm.links], axis=1) * self.levers
        x = np.sum(-turning * sin - inward * cos, axis=1)
        y = np.sum(turning * cos - inward * sin, axis=1)
        return np.asarray(self._carried(qdd) + np.stack((x, y), axis=1))

    def most_jerk(self, q: FloatArray, qd: FloatArray, step: FloatArray) -> FloatArray:
        """Bound on the third derivative of the position while coordinates are linear in time, shape (N,) [m/s³].

        Args:
            q: coordinates at the start of each step, shape (N, c); headings turn evenly, wherever they begin.
            qd: their rates over the step, shape (N, c).
            step: its length, shape (N,) [s].
        """
        del q, step
        return np.asarray(np.abs(np.cumsum(qd[:, : self.arm.links], axis=1)) ** 3 @ self.levers)

    def _directions(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        headings = self.arm.headings(q[:, : self.arm.links])
        return np.cos(headings), np.sin(headings)

    def _carried(self, q: FloatArray) -> FloatArray:
        """How far the base is carried, shape (N, 2) [m]; linear, so it serves derivatives too."""
        return np.asarray(self.arm.coordinates.advance(q)[:, None] * self.arm.direction)


@dataclass(frozen=True)
class PointInSpace:
    """A point at a fixed arc length along the links; derivatives in time and along a path follow the same formulas.

    Attributes:
        arm: the arm.
        levers: how much of every link lies between the base and the point, shape (links,) [m].
    """

    arm: Arm
    levers: FloatArray

    @classmethod
    def from_arc_length(cls, arm: Arm, at: float | None) -> "PointInSpace":
        """The point at an arc length from the base [m]; the tip when None.

        Raises:
            ProblemError: the arm is not so long.
        """
        return cls(arm, arm.levers_to(at))

    def position(self, q: FloatArray) -> FloatArray:
        """Where the point is, shape (N, 3) [m].

        Args:
            q: coordinates of the arm, shape (N, c) [rad, m].
        """
        along = self.arm.link_rotations(q)[..., 0]
        return self.arm.base + self._carried(q) + self._summed(along)

    def velocity(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """First derivative of the position, shape (N, 3), for first derivatives of the coordinates, shape (N, c)."""
        axes = self._axes(q)
        omega = np.cumsum(_turning(axes, self.arm.bend_pairs(qd)), axis=-2)
        return self._carried(qd) + self._summed(np.cross(omega, axes.along))

    def acceleration(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Second derivative of the position, shape (N, 3), for both derivatives of the coordinates."""
        axes = self._axes(q)
        rates = self.arm.bend_pairs(qd)
        omega = np.cumsum(_turning(axes, rates), axis=-2)
        # ω of the link before; the base does not turn.
        before = np.concatenate((np.zeros_like(omega[..., :1, :]), omega[..., :-1, :]), axis=-2)
        carried = rates[..., :1] * np.cross(before, axes.first) + rates[..., 1:] * np.cross(omega, axes.second)
        alpha = np.cumsum(_turning(axes, self.arm.bend_pairs(qdd)) + carried, axis=-2)
        inward = np.cross(omega, np.cross(omega, axes.along))
        return self._carried(qdd) + self._summed(np.cross(alpha, axes.along) + inward)

    def most_jerk(self, q: FloatArray, qd: FloatArray, step: FloatArray) -> FloatArray:
        """Bound on the third derivative of the position while coordinates are linear in time, shape (N,) [m/s³].

        With bounds S, A and J on |ω|, |α| and |α'| of a link, |x'''| is at most J + 3 A S + S³. The bound on |ω| is its
        value at the start of the step and what it may change by in its course.

        Args:
            q: coordinates at the start of each step, shape (N, c) [rad, m].
            qd: their rates over the step, shape (N, c).
            step: its length, shape (N,) [s].
        """
        rates = self.arm.bend_pairs(qd)
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
            # The second axis is carried by the link before and by the first bend.
            turning = speed + a
            swing = change + a * speed
            growth = growth + a * (change + speed**2) + b * (swing + turning**2)
            change = change + a * speed + b * turning
            speed = np.minimum(speed + np.hypot(a, b), omega[:, link] + step * change)
            jerk += self.levers[link] * (growth + 3.0 * change * speed + speed**3)
        return jerk

    def _axes(self, q: FloatArray) -> "_Axes":
        rotations = self.arm.link_rotations(q)
        base = np.broadcast_to(self.arm.base_rotation[:, 2], (*q.shape[:-1], 1, 3))
        first = np.concatenate((base, rotations[..., :-1, :, 2]), axis=-2)
        return _Axes(first, rotations[..., 1], rotations[..., 0])

    def _summed(self, of_links: FloatArray) -> FloatArray:
        """Sum over the links by their levers, shape (N, links, 3) to (N, 3)."""
        return np.asarray(np.einsum("...lk,l->...k", of_links, self.levers))

    def _carried(self, q: FloatArray) -> FloatArray:
        """How far the base is carried, shape (N, 3) [m]; linear, so it serves derivatives too."""
        return np.asarray(self.arm.coordinates.advance(q)[..., None] * self.arm.direction)


class _Axes(NamedTuple):
    """Axes of the two bends of every joint, and the directions of the links, each of shape (N, links, 3)."""

    first: FloatArray
    second: FloatArray
    along: FloatArray


def _turning(axes: _Axes, rates: FloatArray) -> FloatArray:
    """What every joint adds to the turning of its link, shape (N, links, 3)."""
    return rates[..., :1] * axes.first + rates[..., 1:] * axes.second


MovingPoint: TypeAlias = PointOnArm | PointInSpace
"""A point of an arm, with two components in the plane and three in space."""


def point_of(arm: Arm, at: float | None) -> MovingPoint:
    """The point of an arm at an arc length from its base [m]; the tip when None.

    Raises:
        ProblemError: the arm is not so long.
    """
    if arm.dimension == 3:
        return PointInSpace.from_arc_length(arm, at)
    return PointOnArm.from_arc_length(arm, at)
