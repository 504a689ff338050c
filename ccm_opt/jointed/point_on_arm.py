"""A point of the arm, such as its tip, and how it moves in the plane with the arm's coordinates."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm


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
        return np.asarray(self.arm.coordinates.advance(q)[:, None] * self.arm.feed_direction)
