"""Quantities of an arm as CasADi expressions, from which users build their constraints and costs."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import casadi as ca
import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polygons import counter_clockwise, half_planes, is_convex
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True, eq=False)
class ArmQuantities(ABC):
    """Quantities of an arm as CasADi expressions of its configuration, for users' constraints and costs.

    Attributes:
        arm: the arm, for parameters such as masses, lengths and base.
        bends: bends of all joints, in space the two bends of a joint next to each other, shape (k, 1) [rad].
        base_feed: position of the base on its feed axis, a scalar [m]; 0 without a feed axis.
        path_parameter: progress u along the motion, 0 at the start and 1 at the goal, a scalar.
        bend_rates: time derivatives of the bends, shape (k, 1) [rad/s]; known on the finished motion only, since a path
            has no speed.
        feed_rate: velocity of the base on its feed axis, a scalar [m/s]; known on the finished motion only.
        tip_symbols: symbols for the tip position and for the heading or direction of the last link, if these are
            variables of their own instead of functions of the bends; else None.
    """

    arm: Arm
    bends: Any
    base_feed: Any
    path_parameter: Any
    bend_rates: Any
    feed_rate: Any
    tip_symbols: tuple[Any, Any] | None = None

    @classmethod
    def from_arm(cls, arm: Arm) -> Self:
        """Return the quantities of an arm, with new symbols."""
        size = len(arm.bend_limits)
        return cls(
            arm,
            ca.SX.sym("bend", size),
            ca.SX.sym("feed"),
            ca.SX.sym("path_parameter"),
            ca.SX.sym("bend_rate", size),
            ca.SX.sym("feed_rate"),
        )

    @property
    def symbols(self) -> tuple[Any, Any, Any]:
        """Symbols of bends, feed and path parameter, on which an expression of a path may depend."""
        return self.bends, self.base_feed, self.path_parameter

    @property
    def rates(self) -> tuple[Any, Any]:
        """Symbols of the bend rates and the feed rate."""
        return self.bend_rates, self.feed_rate

    def places(self, q: FloatArray) -> tuple[Any, Any]:
        """Return the bends (k, N) and the feed (1, N) of N configurations (N, c), one column per configuration.

        Rates of configurations are split likewise into rates of the bends and of the feed.
        """
        return ca.DM(q[:, : len(self.arm.bend_limits)].T), ca.DM(self.arm.coordinates.advance(q)).T

    @property
    @abstractmethod
    def link_directions(self) -> Any:
        """Directions of the links, unit vectors, shape (d, links)."""

    @property
    @abstractmethod
    def pointing(self) -> Any:
        """Heading of the last link in the plane [rad], or direction of the last link in space, shape (3, 1)."""

    @cached_property
    def joint_positions(self) -> Any:
        """Positions of the joints, base first, and of the tip, shape (d, links + 1) [m]."""
        point = ca.SX(ca.DM(self.arm.base))
        # The expression of a fixed arm does not depend on the feed at all.
        for _ in self.arm.base_axes:
            point += self.base_feed * ca.DM(self.arm.direction)
        steps = self.link_directions * ca.repmat(ca.DM(self.arm.lengths).T, self.arm.dimension, 1)
        points = [point]
        for link in range(self.arm.links):
            points.append(points[-1] + steps[:, link])
        if self.tip_symbols is not None:
            points[-1] = self.tip_symbols[0]
        return ca.horzcat(*points)

    def heading_slopes(self, slopes: FloatArray) -> FloatArray:
        """Convert derivatives with respect to a configuration into derivatives with respect to link turns, both (m, c).

        A link turn is the turn of one link about a bend axis while all other links keep their directions: the bend of
        the link's joint grows by the turn, and that of the next joint decreases by as much. The derivatives with
        respect to the base position are multiplied by the arm's length.
        """
        bends, k = len(self.arm.bend_limits), self.arm.bends_a_joint
        turned: FloatArray = np.concatenate((slopes[:, :bends], self.arm.length * slopes[:, bends:]), axis=1)
        turned[:, : bends - k] -= slopes[:, k:bends]
        return turned

    def in_configurations(self, expression: Any) -> tuple[Any, Any]:
        """Return symbols of a configuration, shape (c, 1) [rad, m], and an expression rewritten in these symbols."""
        carried = ca.SX.sym("carried", len(self.arm.base_axes))
        inserted = ca.substitute(expression, self.base_feed, ca.densify(ca.sum1(carried)))
        return ca.vertcat(self.bends, carried), inserted

    @property
    def timed_symbols(self) -> tuple[Any, Any, Any, Any, Any]:
        """Symbols on which an expression for a timed motion may depend (bends, feed, path parameter and rates)."""
        return *self.symbols, *self.rates

    def is_timed(self, expression: Any) -> bool:
        """Return whether an expression depends on the rates of bends or feed."""
        return bool(ca.depends_on(expression, ca.vertcat(*self.rates)))

    @property
    def tip(self) -> Any:
        """Position of the tip, shape (d, 1) [m]."""
        return self.joint_positions[:, -1]

    def point_at(self, s: float) -> Any:
        """Return the position of the arm's axis at arc length ``s`` [m] from the base, shape (d, 1) [m]."""
        link, fraction = self._link_at_arc_length(s)
        points = self.joint_positions
        return (1.0 - fraction) * points[:, link] + fraction * points[:, link + 1]

    @property
    def tip_velocity(self) -> Any:
        """Velocity of the tip on the finished motion, shape (d, 1) [m/s]."""
        return self._in_time(self.tip)

    def point_velocity(self, s: float) -> Any:
        """Return the velocity, on the finished motion, of the point at arc length ``s`` [m], shape (d, 1) [m/s]."""
        return self._in_time(self.point_at(s))

    def _in_time(self, point: Any) -> Any:
        """Return the time derivative of a point's position, shape (d, 1)."""
        # The chain rule: ṗ = ∂p/∂(bends, feed) times their rates, as one product in forward mode.
        return ca.jtimes(point, ca.vertcat(self.bends, self.base_feed), ca.vertcat(*self.rates))

    def _link_at_arc_length(self, s: float) -> tuple[int, float]:
        """Return the index of the link that contains an arc length [m], and the fraction of the link before it."""
        links = float(np.interp(self._checked(s), self.arm.joint_places, np.arange(self.arm.links + 1)))
        # The tip itself belongs to the last link, not to a link beyond it.
        link = min(int(links), self.arm.links - 1)
        return link, links - link

    def _checked(self, s: float) -> float:
        """Return an arc length [m] clipped to the arm.

        Raises:
            ProblemError: the value is not a number, or lies outside the arm by more than rounding.
        """
        length = self.arm.length
        rounding = 1e-9 * length
        if not isinstance(s, int | float | np.floating) or not -rounding <= s <= length + rounding:
            raise ProblemError(f"an arc length must be a number from 0 to the arm's length {length:g} m, got {s!r}")
        return float(min(max(s, 0.0), length))


@dataclass(frozen=True, eq=False)
class Quantities(ArmQuantities):
    """Quantities of a planar arm as CasADi expressions, for users' constraints and costs; points are (2, 1) columns.

    Heading and curvature of the arm as a curve are interpolated linearly from the links: the heading in the middle of a
    link is that of the link, the curvature at a joint is its bend over the mean length of its two links.
    """

    @cached_property
    def link_headings(self) -> Any:
        """Headings of the links, shape (links, 1) [rad]."""
        headings = self.arm.base_heading + ca.cumsum(self.bends)
        return headings if self.tip_symbols is None else ca.vertcat(headings[:-1], self.tip_symbols[1])

    @property
    def heading_rates(self) -> Any:
        """Time derivatives of the link headings on the finished motion, shape (links, 1) [rad/s]."""
        return ca.cumsum(self.bend_rates)

    @property
    def joint_angles(self) -> Any:
        """Bend of every joint, the first relative to the base heading, shape (links, 1) [rad]."""
        return self.bends

    @property
    def link_directions(self) -> Any:
        """Directions of the links, unit vectors, shape (2, links)."""
        return ca.horzcat(ca.cos(self.link_headings), ca.sin(self.link_headings)).T

    @property
    def pointing(self) -> Any:
        """Heading of the last link [rad]."""
        return self.tip_heading

    @property
    def tip_heading(self) -> Any:
        """Heading of the last link, whole turns included [rad]."""
        return self.link_headings[-1]

    def heading_at(self, s: float) -> Any:
        """Return the heading of the arm at arc length ``s`` [m] from the base [rad], linear between link midpoints."""
        # A link's heading belongs to its middle.
        at = float(np.interp(self._checked(s), self.arm.link_middles, np.arange(self.arm.links)))
        return _linear(self.link_headings, at)

    def curvature_at(self, s: float) -> Any:
        """Return the curvature of the arm at arc length ``s`` [m] from the base [1/m], linear between joints.

        The bend at the base is left out.

        Raises:
            ProblemError: the arm has a single link.
        """
        if self.arm.links < 2:
            raise ProblemError("an arm of one link has no curvature")
        # The base itself is left out, so entries begin at the end of the first link.
        at = float(np.interp(self._checked(s), self.arm.joint_places[1:-1], np.arange(self.arm.links - 1)))
        around = 0.5 * (self.arm.lengths[1:] + self.arm.lengths[:-1])
        return _linear(self.joint_angles[1:] / ca.DM(around), at)

    def inside(self, region: shapely.Polygon, point: Any = None) -> Any:
        """Return the signed distances of a point from the sides of a convex region, positive inside, (sides, 1) [m].

        The point is in the region if all distances are ≥ 0.

        Args:
            region: a convex polygon.
            point: position of the point, shape (2, 1) [m]; the tip if None.
        """
        normals, offsets = _half_planes(region)
        return ca.DM(offsets) - ca.DM(normals) @ (self.tip if point is None else point)


def _linear(values: Any, at: float) -> Any:
    """Return a column's value at a fractional index ``at``, interpolated linearly and constant beyond both ends."""
    last = int(values.shape[0]) - 1
    place = min(max(at, 0.0), float(last))
    k = min(int(place), max(last - 1, 0))
    following = min(k + 1, last)
    return values[k] + (place - k) * (values[following] - values[k])


def _half_planes(region: shapely.Polygon) -> tuple[FloatArray, FloatArray]:
    """Return the outward unit normals (sides, 2) and the offsets (sides,) of a convex polygon's half-planes n · x ≤ b.

    Raises:
        ProblemError: the region is not a convex polygon.
    """
    if not isinstance(region, shapely.Polygon) or region.is_empty or region.interiors:
        raise ProblemError(f"a region must be a convex polygon without holes, got {region}")
    corners = counter_clockwise(np.asarray(region.exterior.coords)[:-1])
    if not is_convex(corners, 1e-9):
        raise ProblemError(f"a region must be convex, got {region}; split it, or take its convex_hull")
    return half_planes(corners)


_OF_THE_PLANE = {
    "tip_heading": "tip_direction",
    "heading_at": "direction_at(s)",
    "link_headings": "link_directions",
    "curvature_at": "joint_angles, bends over link length",
}
"""Quantities that exist in the plane only, and what to use instead in space."""


@dataclass(frozen=True, eq=False)
class SpaceQuantities(ArmQuantities):
    """Quantities of an arm in space as CasADi expressions, for users' constraints and costs.

    Points and directions are (3, 1) columns in world axes.
    """

    @property
    def joint_angles(self) -> Any:
        """Both bends of every joint, shape (2, links) [rad]."""
        return ca.reshape(self.bends, 2, self.arm.links)

    @cached_property
    def link_rotations(self) -> list[Any]:
        """Rotation matrices of the links, from link to world coordinates, each of shape (3, 3)."""
        rotation = ca.SX(ca.DM(self.arm.base_rotation))
        found = []
        for link in range(self.arm.links):
            rotation = rotation @ _turn(self.bends[2 * link], self.bends[2 * link + 1])
            found.append(rotation)
        return found

    @property
    def link_directions(self) -> Any:
        """Directions of the links in space, unit vectors, shape (3, links)."""
        return ca.horzcat(*(rotation[:, 0] for rotation in self.link_rotations))

    @property
    def tip_direction(self) -> Any:
        """Direction of the last link, a unit vector, shape (3, 1)."""
        return self.link_rotations[-1][:, 0] if self.tip_symbols is None else self.tip_symbols[1]

    @property
    def pointing(self) -> Any:
        """Direction of the last link in space, a unit vector, shape (3, 1)."""
        return self.tip_direction

    def direction_at(self, s: float) -> Any:
        """Return the direction of the link at arc length ``s`` [m] from the base, a unit vector, shape (3, 1)."""
        link, _ = self._link_at_arc_length(s)
        return self.link_rotations[link][:, 0]

    def inside(self, normals: FloatArray, offsets: FloatArray, point: Any = None) -> Any:
        """Return the signed distances of a point from bounding planes, positive inside, shape (sides, 1) [m].

        The point satisfies all half-spaces if all distances are ≥ 0.

        Args:
            normals: outward unit normals n, shape (sides, 3).
            offsets: offsets b of the half-spaces n · x ≤ b, shape (sides,) [m].
            point: position of the point, shape (3, 1) [m]; the tip if None.
        """
        return ca.DM(offsets) - ca.DM(normals) @ (self.tip if point is None else point)

    def __getattr__(self, name: str) -> Any:
        """Raise an error for a quantity that exists in the plane only, naming the quantity to use instead in space.

        Raises:
            ProblemError: the quantity exists in the plane only.
            AttributeError: no arm has the quantity.
        """
        if name in _OF_THE_PLANE:
            raise ProblemError(f"an arm in space has no '{name}'; use {_OF_THE_PLANE[name]}")
        raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")


def _turn(a: Any, b: Any) -> Any:
    """Return the symbolic rotation matrix Rz(a) Ry(b), shape (3, 3), for bends a and b [rad]."""
    ca_ = ca.cos(a)
    sa = ca.sin(a)
    cb = ca.cos(b)
    sb = ca.sin(b)
    return ca.vertcat(
        ca.horzcat(ca_ * cb, -sa, ca_ * sb),
        ca.horzcat(sa * cb, ca_, sa * sb),
        ca.horzcat(-sb, 0, cb),
    )
