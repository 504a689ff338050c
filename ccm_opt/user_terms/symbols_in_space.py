"""The symbolic quantities of an arm in space that users' constraints and costs are written in."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.user_terms.arm_quantities import ArmQuantities

_OF_THE_PLANE = {
    "tip_heading": "tip_direction",
    "heading_at": "direction_at(s)",
    "link_headings": "link_directions",
    "curvature_at": "joint_angles, bends over link length",
}
"""Quantities of the plane that space has no numbers for, and what to use there."""


@dataclass(frozen=True, eq=False)
class SpaceQuantities(ArmQuantities):
    """Quantities of an arm in space in CasADi's scalar symbols; lengths in metres, angles in radians.

    Points and directions are (3, 1) columns in the axes of the world.

    Attributes:
        arm: the arm, for its numbers: masses, lengths, base.
        bends: (a, b) of every joint one after the other, shape (2 links, 1) [rad].
        base_feed: position of the base on its feed axis, a scalar [m]; 0 without one.
        path_parameter: u, how far the motion has come: 0 at the start, 1 at the goal.
        bend_rates: of the bends, shape (2 links, 1) [rad/s]; known on the finished motion only.
        feed_rate: of the base on its feed axis, a scalar [m/s]; likewise.
    """

    arm: SpaceArm
    bends: Any
    base_feed: Any
    path_parameter: Any
    bend_rates: Any
    feed_rate: Any

    @classmethod
    def from_arm(cls, arm: SpaceArm) -> "SpaceQuantities":
        """Fresh symbols for an arm."""
        return cls(
            arm,
            ca.SX.sym("bend", 2 * arm.links),
            ca.SX.sym("feed"),
            ca.SX.sym("path_parameter"),
            ca.SX.sym("bend_rate", 2 * arm.links),
            ca.SX.sym("feed_rate"),
        )

    @property
    def symbols(self) -> tuple[Any, Any, Any]:
        """Bends, feed and path parameter, the symbols that the expression of a path may hold."""
        return self.bends, self.base_feed, self.path_parameter

    @property
    def rates(self) -> tuple[Any, Any]:
        """Rates of the bends and of the feed."""
        return self.bend_rates, self.feed_rate

    def in_poses(self, expression: Any) -> tuple[Any, Any]:
        """The symbols of a configuration, bends [rad] and the feed [m] where there is one, and the expression."""
        if self.arm.base_axes:
            return ca.vertcat(self.bends, self.base_feed), expression
        return self.bends, ca.substitute(expression, self.base_feed, ca.SX(0.0))

    def parted(self, poses: FloatArray, feed: FloatArray | float) -> tuple[FloatArray, FloatArray | float]:
        """Bends and feed of configurations; where they are bends alone, with the feed that is given [m].

        Args:
            poses: shape (N, 2 links) or (N, c) [rad, m].
            feed: shape (N,) or scalar [m].
        """
        bends = 2 * self.arm.links
        if poses.shape[-1] == bends:
            return poses, feed
        return poses[..., :bends], np.asarray(np.sum(poses[..., bends:], axis=-1))

    def shapes(self, coordinates: FloatArray) -> FloatArray:
        """Both bends of every joint at coordinates of the arm, shape (N, 2 links) [rad]."""
        return coordinates[:, : 2 * self.arm.links]

    def shape_rates(self, rates: FloatArray) -> FloatArray:
        """Rates of the bends, shape (N, 2 links) [rad/s]."""
        return rates[:, : 2 * self.arm.links]

    @property
    def joint_angles(self) -> Any:
        """Both bends of every joint, shape (2, links) [rad]."""
        return ca.reshape(self.bends, 2, self.arm.links)

    @cached_property
    def link_rotations(self) -> list[Any]:
        """Rotations world ← link of all links, each of shape (3, 3)."""
        rotation = ca.SX(ca.DM(self.arm.base_rotation))
        found = []
        for link in range(self.arm.links):
            rotation = rotation @ _turn(self.bends[2 * link], self.bends[2 * link + 1])
            found.append(rotation)
        return found

    @property
    def link_directions(self) -> Any:
        """Directions of the links, shape (3, links)."""
        return ca.horzcat(*(rotation[:, 0] for rotation in self.link_rotations))

    @cached_property
    def joint_positions(self) -> Any:
        """Positions of the base, the other joints and the tip, shape (3, links + 1) [m]."""
        point = ca.SX(ca.DM(self.arm.base))
        # For a fixed arm the expression does not contain the feed at all.
        for _ in self.arm.base_axes:
            point += self.base_feed * ca.DM(self.arm.feed_direction)
        points = [point]
        for rotation in self.link_rotations:
            points.append(points[-1] + self.arm.link_length * rotation[:, 0])
        return ca.horzcat(*points)

    @property
    def tip_direction(self) -> Any:
        """Direction of the last link, a unit vector, shape (3, 1)."""
        return self.link_rotations[-1][:, 0]

    def direction_at(self, s: float) -> Any:
        """Direction of the link at arc length ``s`` from the base, a unit vector, shape (3, 1)."""
        link, _ = self._link_at(s)
        return self.link_rotations[link][:, 0]

    def inside(self, normals: FloatArray, offsets: FloatArray, point: Any = None) -> Any:
        """Distances of a point inside half-spaces, shape (sides, 1) [m]: membership is all ≥ 0.

        Args:
            normals: unit, outwards, shape (sides, 3).
            offsets: of n · x ≤ offset, shape (sides,) [m].
            point: shape (3, 1); the tip when None.
        """
        return ca.DM(offsets) - ca.DM(normals) @ (self.tip if point is None else point)

    def __getattr__(self, name: str) -> Any:
        """Refuse quantities of the plane by what stands for them in space."""
        if name in _OF_THE_PLANE:
            raise ProblemError(f"an arm in space has no '{name}'; use {_OF_THE_PLANE[name]}")
        raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")


def _turn(a: Any, b: Any) -> Any:
    """Rz(a) Ry(b), shape (3, 3)."""
    ca_ = ca.cos(a)
    sa = ca.sin(a)
    cb = ca.cos(b)
    sb = ca.sin(b)
    return ca.vertcat(
        ca.horzcat(ca_ * cb, -sa, ca_ * sb),
        ca.horzcat(sa * cb, ca_, sa * sb),
        ca.horzcat(-sb, 0, cb),
    )
