"""The jointed arm: equal links with a ball joint at the base of each, seen in its plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.arrays import BoolArray, FloatArray

Axes = Literal["zyx", "zyz"]
MappingName = Literal["least-squares", "even-joints"]
HELD_TOLERANCE = 1e-9
"""A joint as near as this to the hole counts as having passed it [m]."""


@dataclass(frozen=True)
class Feed:
    """A linear axis along the base heading that carries the base through a guide; distances from ``Arm.base`` [m].

    Attributes:
        low: least position of the base on the axis.
        high: greatest position.
        hole: where the guide ends; joints that have not passed it are held straight.
    """

    low: float
    high: float
    hole: float


@dataclass(frozen=True)
class Arm:
    """A planar view of the arm plus what its dynamics need; angles in radians, lengths in metres.

    Attributes:
        links: number of links, even.
        link_length: l [m].
        radius: radius of the disc swept along the links [m]; 0 is allowed.
        base: position of the first joint, shape (2,) [m].
        base_heading: heading of the straight arm [rad].
        joint_limit: bound on the bend of every joint but the first [rad].
        base_limit: bound on the bend of the first joint [rad].
        self_collision: whether distant links must keep ``2 * radius`` apart.
        mount_length: arm length from the base that may touch obstacles [m].
        masses: shape (links,) [kg].
        inertia_axial: about the link's axis, shape (links,) [kg m²].
        inertia_transverse: about the link's centre, across its axis, shape (links,) [kg m²].
        axes: order of the three revolutes of a ball joint.
        feed: the axis that carries the base, or None when the base is fixed.
        payload: mass of a point carried at the tip [kg].
        rotor_inertia: of the drives as seen at the joints, one number or shape (3 * links,) [kg m²].
        friction: viscous, of the joints, one number or shape (3 * links,) [N m s/rad].
    """

    links: int
    link_length: float
    radius: float
    base: FloatArray
    base_heading: float
    joint_limit: float
    base_limit: float
    self_collision: bool
    mount_length: float
    masses: FloatArray
    inertia_axial: FloatArray
    inertia_transverse: FloatArray
    axes: Axes = "zyx"
    feed: Feed | None = None
    payload: float = 0.0
    rotor_inertia: FloatArray | float = 0.0
    friction: FloatArray | float = 0.0

    @property
    def length(self) -> float:
        """Total length L = links · l [m]."""
        return self.links * self.link_length

    @property
    def bend_limits(self) -> FloatArray:
        """Bound on the absolute bend of each joint, shape (links,) [rad]."""
        limits = np.full(self.links, self.joint_limit)
        limits[0] = self.base_limit
        return limits

    @property
    def first_self_pair(self) -> int:
        """Least difference j − i of the indices of links whose axes must keep two radii apart.

        Links are neighbours round a bend unless ``(|i − j| − 1) l ≥ max(2 l, π r)``.
        """
        reach = max(2.0 * self.link_length, np.pi * self.radius)
        return int(np.ceil(reach / self.link_length - 1e-9)) + 1

    def headings(self, bends: FloatArray) -> FloatArray:
        """Link headings φ from joint bends, shape (..., links) [rad]."""
        return self.base_heading + np.cumsum(bends, axis=-1)

    def bends(self, headings: FloatArray) -> FloatArray:
        """Joint bends from link headings, shape (..., links) [rad]; the first is relative to the base heading."""
        return np.diff(headings, axis=-1, prepend=self.base_heading)

    def joint_positions(self, headings: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
        """Positions of the joints and the tip, shape (..., links + 1, 2) [m].

        Args:
            headings: of the links, shape (..., links) [rad].
            feed: position of the base on its feed axis, shape (...) [m]; 0 when the base is fixed.
        """
        steps = self.link_length * np.stack((np.cos(headings), np.sin(headings)), axis=-1)
        start = np.zeros((*steps.shape[:-2], 1, 2))
        positions: FloatArray = self.base + np.concatenate((start, np.cumsum(steps, axis=-2)), axis=-2)
        if self.feed is None:
            return positions
        return positions + np.asarray(feed)[..., None, None] * self.feed_direction

    @property
    def feed_direction(self) -> FloatArray:
        """Unit vector of the base heading, along which a feed axis runs, shape (2,)."""
        return np.array([np.cos(self.base_heading), np.sin(self.base_heading)])

    def held(self, feed: FloatArray | float) -> BoolArray:
        """Which joints the guide of the feed axis still holds straight, shape (..., links), boolean; none without one.

        Args:
            feed: position of the base on its feed axis, shape (...) [m].
        """
        if self.feed is None:
            return np.zeros((*np.shape(feed), self.links), dtype=bool)
        along = np.asarray(feed)[..., None] + self.link_length * np.arange(self.links)
        held: BoolArray = along < self.feed.hole - HELD_TOLERANCE
        return held
