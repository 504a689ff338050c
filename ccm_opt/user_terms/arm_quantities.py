"""What constraints and costs need of symbolic quantities, whether the arm is in the plane or in space."""

from abc import ABC, abstractmethod
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray


class ArmQuantities(ABC):
    """Quantities of an arm in CasADi's scalar symbols; lengths in metres, angles in radians.

    Attributes:
        arm: the arm, for its numbers: masses, lengths, base.
        base_feed: position of the base on its feed axis, a scalar [m]; 0 without one.
        path_parameter: u, how far the motion has come: 0 at the start, 1 at the goal.
        feed_rate: of the base on its feed axis, a scalar [m/s]; known on the finished motion only.
    """

    arm: Any
    base_feed: Any
    path_parameter: Any
    feed_rate: Any

    @property
    @abstractmethod
    def symbols(self) -> tuple[Any, Any, Any]:
        """The arm's shape, the feed and the path parameter: the symbols that the expression of a path may hold."""

    @property
    @abstractmethod
    def rates(self) -> tuple[Any, Any]:
        """Rates of the shape and of the feed."""

    @property
    @abstractmethod
    def joint_positions(self) -> Any:
        """Positions of the base, the other joints and the tip, shape (dimensions, links + 1) [m]."""

    @abstractmethod
    def in_poses(self, expression: Any) -> tuple[Any, Any]:
        """The symbols of a pose, as planning handles it, and an expression of a path in them and the path parameter."""

    @abstractmethod
    def parted(self, poses: FloatArray, feed: FloatArray | float) -> tuple[FloatArray, FloatArray | float]:
        """Shape and feed [m] of poses of shape (N, c); where they are shapes alone, with the feed that is given."""

    @abstractmethod
    def shapes(self, coordinates: FloatArray) -> FloatArray:
        """The arm's shape, shape (N, k) [rad], at coordinates of the arm, shape (N, c) [rad, m]."""

    @abstractmethod
    def shape_rates(self, rates: FloatArray) -> FloatArray:
        """The rates of the shape, shape (N, k) [rad/s], by those of the coordinates, shape (N, c) [rad/s, m/s]."""

    @property
    def timed_symbols(self) -> tuple[Any, Any, Any, Any, Any]:
        """The symbols that the expression of a timed motion may hold, those of a path, and the rates."""
        return *self.symbols, *self.rates

    def is_timed(self, expression: Any) -> bool:
        """Whether an expression holds speeds."""
        return bool(ca.depends_on(expression, ca.vertcat(*self.rates)))

    @property
    def tip(self) -> Any:
        """Position of the tip, shape (dimensions, 1) [m]."""
        return self.joint_positions[:, -1]

    def point_at(self, s: float) -> Any:
        """Position at arc length ``s`` from the base, shape (dimensions, 1) [m]."""
        link, fraction = self._link_at(s)
        points = self.joint_positions
        return (1.0 - fraction) * points[:, link] + fraction * points[:, link + 1]

    @property
    def tip_velocity(self) -> Any:
        """Velocity of the tip, shape (dimensions, 1) [m/s]; on the finished motion only."""
        return self._in_time(self.tip)

    def point_velocity(self, s: float) -> Any:
        """Velocity of the point at arc length ``s`` from the base [m/s]; on the finished motion only."""
        return self._in_time(self.point_at(s))

    def _in_time(self, point: Any) -> Any:
        """Derivative of a point by time."""
        # The chain rule: ṗ = ∂p/∂(shape, feed) times their rates, as one product in forward mode.
        shape, feed, _ = self.symbols
        return ca.jtimes(point, ca.vertcat(shape, feed), ca.vertcat(*self.rates))

    def _link_at(self, s: float) -> tuple[int, float]:
        """The link at an arc length, and how much of that link lies before it."""
        links = self._checked(s) / self.arm.link_length
        # The very tip belongs to the last link, not to one beyond it.
        link = min(int(links), self.arm.links - 1)
        return link, links - link

    def _checked(self, s: float) -> float:
        """An arc length, or a refusal of what is none; rounding beyond the ends of the arm is forgiven."""
        length = self.arm.length
        rounding = 1e-9 * length
        if not isinstance(s, int | float | np.floating) or not -rounding <= s <= length + rounding:
            raise ProblemError(f"an arc length must be a number from 0 to the arm's length {length:g} m, got {s!r}")
        return float(min(max(s, 0.0), length))
