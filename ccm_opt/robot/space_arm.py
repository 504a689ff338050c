"""The arm in space: equal links with a joint of two bends at the base of each, and where they are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Axes
from ccm_opt.robot.coordinates import FEED, Coordinates, space_coordinates
from ccm_opt.robot.link_chain import Feed, LinkChain


@dataclass(frozen=True)
class SpaceArm(LinkChain):
    """An arm in space and what its dynamics need; angles in radians, lengths in metres.

    A joint turns what is beyond it by a about its z axis and then by b about the new y axis; its link lies along the
    new x axis: R_i = R_(i−1) Rz(a_i) Ry(b_i). This is a ball joint of the order ``zyx`` whose roll stays at zero. A
    configuration q is a row (a_1, b_1, a_2, b_2, …, a_n, b_n), and then the position of the feed if there is one. In
    the plane of ``direction`` and the left, every b is zero and the a are the bends of ``Arm``.

    Attributes:
        links: number of links.
        link_length: l [m].
        radius: radius of the links, cylinders with round ends [m]; 0 is allowed.
        base: position of the first joint, shape (3,) [m].
        direction: of the straight arm, a unit vector, shape (3,).
        up: the z axis of the first joint, a unit vector across the direction, shape (3,).
        joint_limit: bound on each of the two bends of every joint but the first [rad].
        base_limit: bound on each of the two bends of the first joint [rad].
        self_collision: whether distant links must keep ``2 * radius`` apart.
        mount_length: arm length from the base that may touch obstacles [m].
        masses: shape (links,) [kg].
        inertia_axial: about the link's axis, shape (links,) [kg m²].
        inertia_transverse: about the link's centre, across its axis, shape (links,) [kg m²].
        axes: order of the three revolutes of a ball joint; in space only ``zyx`` keeps the roll at zero.
        feed: the axis that carries the base along the direction, or None when the base is fixed.
        payload: mass of a point carried at the tip [kg].
        rotor_inertia: of the drives as seen at the joints, one number or shape (3 * links,) [kg m²].
        friction: viscous, of the joints, one number or shape (3 * links,) [N m s/rad].
        stray: error of the arm's curvature for which planning leaves room, as in ``Arm`` [rad/m].
        clamped_joints: number of joints from the base that planning leaves straight.
    """

    links: int
    link_length: float
    radius: float
    base: FloatArray
    direction: FloatArray
    up: FloatArray
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
    stray: float = 0.0
    clamped_joints: int = 0

    @property
    def coordinates(self) -> Coordinates:
        """What the columns of a configuration are, c of them."""
        return space_coordinates(self.links, tuple(FEED for _ in self.base_axes))

    @property
    def bend_limits(self) -> FloatArray:
        """Bound on the absolute value of each bend, in the order of the coordinates, shape (2 * links,) [rad]."""
        limits = np.full(2 * self.links, self.joint_limit)
        limits[:2] = self.base_limit
        limits[: 2 * self.clamped_joints] = 0.0
        return limits

    @property
    def lower_limits(self) -> FloatArray:
        """Least value of every coordinate, shape (c,) [rad, m]."""
        return np.concatenate((-self.bend_limits, [axis.low for axis in self.base_axes]))

    @property
    def upper_limits(self) -> FloatArray:
        """Greatest value of every coordinate, shape (c,) [rad, m]."""
        return np.concatenate((self.bend_limits, [axis.high for axis in self.base_axes]))

    @cached_property
    def base_rotation(self) -> FloatArray:
        """Columns direction, left (up × direction) and up of the straight arm in the world, shape (3, 3)."""
        return np.column_stack((self.direction, np.cross(self.up, self.direction), self.up))

    @property
    def base_position(self) -> FloatArray:
        """Position of the first joint in the world, shape (3,) [m]."""
        return self.base

    def embedded(self, points: FloatArray) -> FloatArray:
        """World coordinates of points, which are their own; shape (..., 3) [m]."""
        return points

    def joint_positions_at(self, q: FloatArray) -> FloatArray:
        """Positions of the joints and the tip in configurations, shape (..., links + 1, 3) [m].

        Args:
            q: shape (..., c) [rad, m].
        """
        return self._poses(q)[0]

    def link_rotations(self, q: FloatArray) -> FloatArray:
        """Rotations world ← link, R_i = R_(i−1) Rz(a_i) Ry(b_i), whose first columns are the directions of the links.

        Args:
            q: configurations, shape (..., c) [rad, m].

        Returns:
            Shape (..., links, 3, 3).
        """
        return self._poses(q)[1]

    def _poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (..., links + 1, 3) [m] and rotations (..., links, 3, 3) of configurations of shape (..., c)."""
        links = self.links
        if q.shape[-1:] != (len(self.coordinates),):
            raise ValueError(f"configurations have the shape {q.shape}; expected (..., {len(self.coordinates)})")
        positions = np.empty((*q.shape[:-1], links + 1, 3))
        rotations = np.empty((*q.shape[:-1], links, 3, 3))
        NativeCall(
            "space_poses",
            poses=q.size // q.shape[-1], links=links, coordinates=q.shape[-1], link_length=self.link_length,
            base=self.base, rotation=self.base_rotation, q=q, positions=positions, rotations=rotations,
        )()  # fmt: skip
        return positions, rotations

    def bend_pairs(self, q: FloatArray) -> FloatArray:
        """The two bends of every joint in configurations of shape (..., c), shape (..., links, 2) [rad]."""
        return q[..., : 2 * self.links].reshape(*q.shape[:-1], self.links, 2)

    def configuration(self, bends: FloatArray, feed: float) -> FloatArray:
        """The configuration of given bends, shape (links, 2) [rad], and position of the base [m]; shape (c,)."""
        return np.append(np.ravel(bends), [feed for _ in self.base_axes])

    def held_bends(self, feed: FloatArray | float) -> FloatArray:
        """Which bends a guide tube of the base still holds at zero, shape (..., 2 * links), boolean.

        Args:
            feed: position of the base on its feed axis, shape (...) [m].
        """
        return np.repeat(self.held(feed), 2, axis=-1)

    def limits_at(self, feed: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Least and greatest value of every coordinate where the base is, both of shape (..., c) [rad, m].

        A joint that has not passed the hole is held straight: both of its bends are zero.

        Args:
            feed: position of the base on its feed axis, shape (...) [m].
        """
        held = self.held_bends(feed)
        bends = np.where(held, 0.0, self.bend_limits)
        base = np.broadcast_to(self.upper_limits[2 * self.links :], (*held.shape[:-1], len(self.base_axes)))
        lowest = np.broadcast_to(self.lower_limits[2 * self.links :], base.shape)
        return np.concatenate((-bends, lowest), axis=-1), np.concatenate((bends, base), axis=-1)


def bend_rotations(bends: FloatArray) -> FloatArray:
    """Rz(a) Ry(b) of pairs of bends, shape (..., 2) to (..., 3, 3)."""
    cos = np.cos(bends)
    sin = np.sin(bends)
    ca = cos[..., 0]
    cb = cos[..., 1]
    sa = sin[..., 0]
    sb = sin[..., 1]
    turns = np.empty((*bends.shape[:-1], 3, 3))
    turns[..., 0, :] = np.stack((ca * cb, -sa, ca * sb), axis=-1)
    turns[..., 1, :] = np.stack((sa * cb, ca, sa * sb), axis=-1)
    turns[..., 2, :] = np.stack((-sb, np.zeros_like(sb), cb), axis=-1)
    return turns
