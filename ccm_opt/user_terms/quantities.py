"""The symbolic quantities that users' constraints and costs are written in, all built on the link headings φ."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import counter_clockwise, half_planes, is_convex
from ccm_opt.jointed.arm import Arm
from ccm_opt.user_terms.arm_quantities import ArmQuantities


@dataclass(frozen=True, eq=False)
class Quantities(ArmQuantities):
    """Quantities of the arm in CasADi's scalar symbols; lengths in metres, angles in radians, points as (2, 1) columns.

    The curve is read off the links: it passes through the joints, its heading is that of a link at the link's middle,
    its curvature at a joint is bend over link length; between these places both are linear.

    Attributes:
        arm: the arm, for its numbers: masses, lengths, base.
        link_headings: φ, shape (links, 1) [rad].
        base_feed: position of the base on its feed axis, a scalar [m]; 0 without one.
        path_parameter: u, how far the motion has come: 0 at the start, 1 at the goal.
        heading_rates: of the links, shape (links, 1) [rad/s]; known on the finished motion only, for a path has no
            speed.
        feed_rate: of the base on its feed axis, a scalar [m/s]; likewise.
    """

    arm: Arm
    link_headings: Any
    base_feed: Any
    path_parameter: Any
    heading_rates: Any
    feed_rate: Any

    @classmethod
    def from_arm(cls, arm: Arm) -> "Quantities":
        """Fresh symbols for an arm."""
        return cls(
            arm,
            ca.SX.sym("heading", arm.links),
            ca.SX.sym("feed"),
            ca.SX.sym("path_parameter"),
            ca.SX.sym("heading_rate", arm.links),
            ca.SX.sym("feed_rate"),
        )

    @property
    def symbols(self) -> tuple[Any, Any, Any]:
        """Link headings, feed and path parameter, the symbols that the expression of a path may hold."""
        return self.link_headings, self.base_feed, self.path_parameter

    @property
    def rates(self) -> tuple[Any, Any]:
        """Rates of the link headings and of the feed."""
        return self.heading_rates, self.feed_rate

    def in_poses(self, expression: Any) -> tuple[Any, Any]:
        """The symbols of a pose and an expression of a path in them and the path parameter.

        A pose has the headings of the links [rad] and then how far the base is carried, in link lengths.
        """
        axes = len(self.arm.base_axes)
        carried = ca.SX.sym("carried", axes)
        feed = self.arm.link_length * ca.sum1(carried) if axes else ca.SX(0.0)
        return ca.vertcat(self.link_headings, carried), ca.substitute(expression, self.base_feed, feed)

    def parted(self, poses: FloatArray, feed: FloatArray | float) -> tuple[FloatArray, FloatArray | float]:
        """Link headings and the feed of poses; where they are headings alone, with the feed that is given [m].

        Args:
            poses: shape (N, links) or (N, c) [rad, link lengths].
            feed: shape (N,) or scalar [m].
        """
        links = self.arm.links
        if poses.shape[-1] == links:
            return poses, feed
        return poses[..., :links], self.arm.link_length * np.sum(poses[..., links:], axis=-1)

    def shapes(self, coordinates: FloatArray) -> FloatArray:
        """Headings of the links at coordinates of the arm, shape (N, links) [rad]."""
        return self.arm.headings(coordinates[:, self.arm.coordinates.bends])

    def shape_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of the headings, shape (N, links) [rad/s]."""
        # Headings are running sums of the bends, and so are their rates.
        return np.cumsum(rates[:, self.arm.coordinates.bends], axis=1)

    @cached_property
    def joint_angles(self) -> Any:
        """Bend of every joint, the first against the base heading, shape (links, 1) [rad]."""
        return self.link_headings - ca.vertcat(self.arm.base_heading, self.link_headings[:-1])

    @cached_property
    def joint_positions(self) -> Any:
        """Positions of the base, the other joints and the tip, shape (2, links + 1) [m]."""
        base = ca.SX(ca.DM(self.arm.base))
        # For a fixed arm the expression does not contain the feed at all.
        for _ in self.arm.base_axes:
            base += self.base_feed * ca.DM(self.arm.feed_direction)
        steps = self.arm.link_length * ca.horzcat(ca.cos(self.link_headings), ca.sin(self.link_headings)).T
        points = [base]
        for link in range(self.arm.links):
            points.append(points[-1] + steps[:, link])
        return ca.horzcat(*points)

    @property
    def tip_heading(self) -> Any:
        """Heading of the last link [rad]; whole turns count."""
        return self.link_headings[-1]

    def heading_at(self, s: float) -> Any:
        """Heading at arc length ``s`` from the base [rad]."""
        # A link's heading stands at its middle, half a link after its beginning.
        return _linear(self.link_headings, self._checked(s) / self.arm.link_length - 0.5)

    def curvature_at(self, s: float) -> Any:
        """Curvature at arc length ``s`` from the base [1/m]; the bend at the base itself does not count."""
        if self.arm.links < 2:
            raise ProblemError("an arm of one link has no curvature")
        # Joint k stands k links from the base; the base itself is left out, so entries begin at one link.
        return _linear(self.joint_angles[1:], self._checked(s) / self.arm.link_length - 1.0) / self.arm.link_length

    def inside(self, region: shapely.Polygon, point: Any = None) -> Any:
        """Distances of a point inside every side of a convex region, shape (sides, 1) [m]: membership is all ≥ 0.

        Args:
            region: convex polygon.
            point: shape (2, 1); the tip when None.
        """
        normals, offsets = _half_planes(region)
        return ca.DM(offsets) - ca.DM(normals) @ (self.tip if point is None else point)


def _linear(values: Any, at: float) -> Any:
    """Linear interpolation between the entries of a column, constant beyond both ends."""
    last = int(values.shape[0]) - 1
    place = min(max(at, 0.0), float(last))
    k = min(int(place), max(last - 1, 0))
    following = min(k + 1, last)
    return values[k] + (place - k) * (values[following] - values[k])


def _half_planes(region: shapely.Polygon) -> tuple[FloatArray, FloatArray]:
    """Outward unit normals and offsets of the sides of a convex polygon.

    Raises:
        ProblemError: the region is not a convex polygon.
    """
    if not isinstance(region, shapely.Polygon) or region.is_empty or region.interiors:
        raise ProblemError(f"a region must be a convex polygon without holes, got {region}")
    corners = counter_clockwise(np.asarray(region.exterior.coords)[:-1])
    if not is_convex(corners, 1e-9):
        raise ProblemError(f"a region must be convex, got {region}; split it, or take its convex_hull")
    return half_planes(corners)
