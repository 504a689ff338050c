"""The jointed arm: equal links with a ball joint at the base of each, seen in its plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ccm_opt.core.arguments import Arguments
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.coordinates import FEED, Coordinates, planar_coordinates
from ccm_opt.robot.link_bodies import DEFAULT_LINK_MASS, cylinder_inertia
from ccm_opt.robot.link_chain import Feed, LinkChain

Axes = Literal["zyx", "zyz"]
MappingName = Literal["least-squares", "even-joints"]


@dataclass(frozen=True)
class Arm(LinkChain):
    """A planar view of the arm plus what its dynamics need; angles in radians, lengths in metres.

    A configuration q is a row of the arm's ``coordinates``: the bends of the joints, then the positions of the axes
    that carry the base. A pose is what planning handles: the headings of the links, and then how far the base is
    carried, in link lengths, so that every column moves the tip by about one link length a unit.

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
        stray: error of the arm's curvature for which planning leaves room, an error of every joint over the length of
            a link [rad/m]; 0 unless the motion has to survive such errors. Of no matter to what judges motions.
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
    stray: float = 0.0

    @classmethod
    def snake(
        cls,
        *,
        length: float,
        links: int,
        radius: float,
        unit: LengthUnit = "m",
        base: Sequence[float] | FloatArray = (0.0, 0.0),
        heading_deg: float = 0.0,
        joint_limit_deg: float = 60.0,
        base_limit_deg: float = 360.0,
        mount_length: float | None = None,
        self_collision: bool = True,
        link_mass: float | Sequence[float] | FloatArray = DEFAULT_LINK_MASS,
        payload: float = 0.0,
        axes: Axes = "zyx",
        feed: Sequence[float] | FloatArray | None = None,
        hole: float | None = None,
    ) -> "Arm":
        """An arm from its overall figures, in the unit of length that suits; links are solid cylinders.

        Args:
            length: of the whole arm.
            links: how many, all alike; an even number.
            radius: of the links; 0 is allowed.
            unit: of all lengths in this call: "m", "mm" or "in".
            base: where the first joint is, (x, y).
            heading_deg: of the straight arm, counter-clockwise from x [deg].
            joint_limit_deg: bound on the bend of every joint but the first [deg].
            base_limit_deg: the same of the first joint [deg].
            mount_length: of arm from the base that may touch obstacles; the radius when None.
            self_collision: whether distant links must keep apart.
            link_mass: of every link, or of each [kg].
            payload: mass of a point carried at the tip [kg].
            axes: order of the three revolutes of a ball joint, "zyx" or "zyz".
            feed: range (least, greatest) of the axis that carries the base along its heading; none when None.
            hole: where its guide tube ends; at its greatest position when None.

        Raises:
            ProblemError: with all that is wrong with these figures.
        """
        given = Arguments("this arm", unit)
        count = given.whole("links", links, 2)
        given.must(count % 2 == 0, f"links: expected an even number, got {links}")
        link_length = given.length("length", length, above=0.0) / count
        thickness = given.length("radius", radius, least=0.0)
        place = given.metres * given.numbers("base", base, 2, "numbers (x, y)")
        heading = given.number("heading_deg", heading_deg)
        limit = given.number("joint_limit_deg", joint_limit_deg, above=0.0)
        given.must(not limit > 180.0, f"joint_limit_deg: expected at most 180, got {joint_limit_deg}")
        base_limit = given.number("base_limit_deg", base_limit_deg, above=0.0)
        mount = thickness if mount_length is None else given.length("mount_length", mount_length, least=0.0)
        given.flag("self_collision", self_collision)
        masses = given.each("link_mass", link_mass, count, above=0.0)
        carried = given.number("payload", payload, least=0.0)
        given.choice("axes", axes, get_args(Axes))
        axis = None if feed is None else _feed_axis(given, feed, hole)
        given.must(feed is not None or hole is None, "hole: only allowed together with feed")
        given.refuse()
        axial, transverse = cylinder_inertia(masses, thickness, link_length)
        return cls(
            links=count,
            link_length=link_length,
            radius=thickness,
            base=place,
            base_heading=float(np.deg2rad(heading)),
            joint_limit=float(np.deg2rad(limit)),
            base_limit=float(np.deg2rad(base_limit)),
            self_collision=self_collision,
            mount_length=mount,
            masses=masses,
            inertia_axial=axial,
            inertia_transverse=transverse,
            axes=axes,
            feed=axis,
            payload=carried,
        )

    @property
    def direction(self) -> FloatArray:
        """Unit vector of the straight arm, along which a feed axis runs, shape (2,)."""
        return unit_vector(self.base_heading)

    @property
    def coordinates(self) -> Coordinates:
        """What the columns of a configuration are, c of them."""
        return planar_coordinates(self.links, tuple(FEED for _ in self.base_axes))

    @property
    def bend_limits(self) -> FloatArray:
        """Bound on the absolute bend of each joint, shape (links,) [rad]."""
        limits = np.full(self.links, self.joint_limit)
        limits[0] = self.base_limit
        return limits

    @property
    def lower_limits(self) -> FloatArray:
        """Least value of every coordinate, shape (c,) [rad, m]."""
        return np.concatenate((-self.bend_limits, [axis.low for axis in self.base_axes]))

    @property
    def upper_limits(self) -> FloatArray:
        """Greatest value of every coordinate, shape (c,) [rad, m]."""
        return np.concatenate((self.bend_limits, [axis.high for axis in self.base_axes]))

    @property
    def base_rotation(self) -> FloatArray:
        """Rotation from the base to the world, by −base_heading about world +y; shape (3, 3)."""
        c = np.cos(self.base_heading)
        s = np.sin(self.base_heading)
        return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])

    @property
    def base_position(self) -> FloatArray:
        """Position of the first ball in the world, shape (3,) [m]; the plane is x-z."""
        return np.array([self.base[0], 0.0, self.base[1]])

    def embedded(self, points: FloatArray) -> FloatArray:
        """World coordinates of points in the plane, which is x-z; shape (..., 2) to (..., 3) [m]."""
        return np.stack((points[..., 0], np.zeros(points.shape[:-1]), points[..., 1]), axis=-1)

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
            feed: how far the base is carried along the base heading, shape (...) [m].
        """
        steps = self.link_length * np.stack((np.cos(headings), np.sin(headings)), axis=-1)
        start = np.zeros((*steps.shape[:-2], 1, 2))
        positions: FloatArray = self.base + np.concatenate((start, np.cumsum(steps, axis=-2)), axis=-2)
        if isinstance(feed, float) and feed == 0.0:  # what the planners' inner loops ask for
            return positions
        return positions + np.asarray(feed)[..., None, None] * self.direction

    def poses(self, q: FloatArray) -> FloatArray:
        """Poses of configurations: link headings [rad], then the base in link lengths; both of shape (..., c)."""
        base = q[..., self.links :] / self.link_length
        return np.concatenate((self.headings(q[..., : self.links]), base), axis=-1)

    def configurations(self, poses: FloatArray) -> FloatArray:
        """Configurations of poses, the inverse of ``poses``, shape (..., c) [rad, m]."""
        base = poses[..., self.links :] * self.link_length
        return np.concatenate((self.bends(poses[..., : self.links]), base), axis=-1)

    def points(self, poses: FloatArray) -> FloatArray:
        """Positions of the joints and the tip in poses, shape (..., links + 1, 2) [m].

        Args:
            poses: link headings, and perhaps the base, shape (..., links) or (..., c) [rad, link lengths].
        """
        if poses.shape[-1] == self.links:
            return self.joint_positions(poses)
        carried = self.link_length * np.sum(poses[..., self.links :], axis=-1)
        return self.joint_positions(poses[..., : self.links], carried)

    def joint_positions_at(self, q: FloatArray) -> FloatArray:
        """Positions of the joints and the tip in configurations, shape (..., links + 1, 2) [m].

        Args:
            q: shape (..., c) [rad, m].
        """
        return self.joint_positions(self.headings(q[..., : self.links]), self.coordinates.advance(q))

    def link_rotations(self, q: FloatArray) -> FloatArray:
        """Rotations plane ← link, whose first columns are the directions of the links, shape (..., links, 2, 2).

        Args:
            q: configurations, shape (..., c) [rad, m].
        """
        headings = self.headings(q[..., : self.links])
        cos = np.cos(headings)
        sin = np.sin(headings)
        return np.stack((np.stack((cos, -sin), axis=-1), np.stack((sin, cos), axis=-1)), axis=-2)

    def configuration(self, bends: FloatArray, feed: float) -> FloatArray:
        """The configuration of given bends [rad] and position of the base [m], shape (c,)."""
        return np.append(bends, [feed for _ in self.base_axes])


def _feed_axis(given: Arguments, ends: object, hole: object) -> Feed:
    """A feed axis from its range and the end of its guide tube."""
    low, high = given.metres * given.numbers("feed", ends, 2, "numbers (least, greatest)")
    given.must(low < high or low == high == 0.0, f"feed: expected (least, greatest) with least < greatest, got {ends}")
    end = high if hole is None else given.length("hole", hole)
    return Feed(float(low), float(high), end)
