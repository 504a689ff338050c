"""The jointed arm: equal links with a ball joint at the base of each, seen in its plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.arrays import FloatArray

Axes = Literal["zyx", "zyz"]
MappingName = Literal["least-squares", "even-joints"]


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

    def joint_positions(self, headings: FloatArray) -> FloatArray:
        """Positions of the joints and the tip from link headings, shape (..., links + 1, 2) [m]."""
        steps = self.link_length * np.stack((np.cos(headings), np.sin(headings)), axis=-1)
        start = np.zeros((*steps.shape[:-2], 1, 2))
        positions: FloatArray = self.base + np.concatenate((start, np.cumsum(steps, axis=-2)), axis=-2)
        return positions
