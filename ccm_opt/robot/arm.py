"""The jointed arm in the plane or in space: links, each with a joint at its base."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import Literal, get_args

import numpy as np

from ccm_opt.core.arguments import Arguments, is_number
from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.core.native import NativeCall
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.base_axes import MOST_AXES, BaseAxis, BaseFrames, Feed, axis_reaches, axis_rows, base_frames
from ccm_opt.robot.coordinates import FEED, Coordinates, joint_coordinates
from ccm_opt.robot.couplings import CoupledJoints, DriveCoupling
from ccm_opt.robot.link_bodies import DEFAULT_LINK_MASS, cylinder_inertia
from ccm_opt.robot.link_layout import LinkLayout, Proportions, fixed
from ccm_opt.robot.tool import RigidBody, Tool, ToolLinks

Axes = Literal["zyx", "zyz"]
MappingName = Literal["least-squares", "even-joints"]
HELD_TOLERANCE = ROUNDING
"""Distance before the end of the guide tube within which a joint counts as having left the tube [m]."""


@dataclass(frozen=True)
class Arm(LinkLayout):
    """An arm with its dynamic parameters; angles in radians, lengths in metres, points with d coordinates (2 or 3).

    A configuration q is a row of the arm's ``coordinates``: the bends of the joints, followed by the positions of the
    axes that carry the base. In the plane a joint has one bend, counter-clockwise. In space it has two: the joint turns
    everything beyond it by a about its z axis and then by b about the new y axis, and its link lies along the new x
    axis, R_i = R_(i−1) Rz(a_i) Ry(b_i), like a ball joint in ``zyx`` order whose roll stays at zero.

    In the plane, a pose is a row of the link headings [rad] followed by the displacement of the base in link lengths.
    Distances between poses weigh turning and feeding alike: one unit in any column moves the arm by about one link
    length.

    Attributes:
        links: number of links; a problem requires an even number if all links are equal.
        link_length: length l of a link, or the mean length if links are unequal [m].
        radius: radius of the links, whose ends are round, or the greatest if links are unequal [m]; 0 is allowed.
        base: position of the first joint, shape (d,) [m].
        joint_limit: bound on the absolute value of each bend of every joint except the first [rad]; the greatest of
            these bounds if they are unequal.
        base_limit: bound on the absolute value of each bend of the first joint [rad].
        self_collision: whether the axes of links that could collide, those far enough apart along the arm, must keep a
            distance of the sum of their radii.
        mount_length: length of arm, measured from the base, that may touch obstacles [m].
        masses: mass of each link, shape (links,) [kg].
        inertia_axial: moment of inertia of each link about its long axis, shape (links,) [kg m²].
        inertia_transverse: moment of inertia of each link about a transverse axis through its centre, shape (links,)
            [kg m²].
        base_heading: heading of the straight arm in the plane [rad]; taken from ``direction`` if omitted. 0 in space.
        direction: direction of the straight arm, a unit vector of shape (d,), along which a feed axis runs; in the
            plane it follows from the heading if that is given.
        up: z axis of the first joint in space, a unit vector perpendicular to the direction, shape (3,).
        axes: order of the three revolute axes of a ball joint; in space only ``zyx`` keeps the roll at zero.
        feed: the axis that moves the base along the direction through a guide tube, or None if there is none.
        carrier: up to six axes between the ground and the base, from the ground, each prismatic or revolute; base,
            direction and up are then those where all of them are at zero. Not together with ``feed``.
        payload: point mass carried at the tip [kg].
        rotor_inertia: inertia of the drives, reflected to the joints, one number or shape (3 * links,) [kg m²].
        friction: viscous friction of the joints, one number or shape (3 * links,) [N m s/rad].
        clamped_joints: number of joints, counted from the base, whose bends are limited to zero.
        proportions: lengths, radii and limits that differ between links; None if all links are equal.
        sections: division of an arm into sections that bend evenly, whose joints turn by the rotation vector
            (0, b, a), in the plane by one bend, and whose links are tangents of arcs; None if joints bend
            independently. Radii then include the distance of the arcs from the links.
        coupled: coupling of joints in space that turn by constant ratios of their drives; None if there is none. Not
            together with ``sections``.
        bodies: rigid bodies on links, beside the tool.
        tool: rigid tool on the last link; None if there is none.
        tool_links: what is particular to an arm whose last links stand for its tool; None for all others.
    """

    links: int
    link_length: float
    radius: float
    base: FloatArray
    joint_limit: float
    base_limit: float
    self_collision: bool
    mount_length: float
    masses: FloatArray
    inertia_axial: FloatArray
    inertia_transverse: FloatArray
    base_heading: float = np.nan
    direction: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0]))
    up: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    axes: Axes = "zyx"
    feed: Feed | None = None
    carrier: tuple[BaseAxis, ...] = ()
    payload: float = 0.0
    rotor_inertia: FloatArray | float = 0.0
    friction: FloatArray | float = 0.0
    clamped_joints: int = 0
    proportions: Proportions | None = None
    sections: ArcSections | None = None
    coupled: CoupledJoints | None = None
    bodies: tuple[RigidBody, ...] = ()
    tool: Tool | None = None
    tool_links: ToolLinks | None = None

    def __post_init__(self) -> None:
        # A value that is not a number or a vector is refused later, by the problem that uses the arm.
        if np.shape(self.base) == (3,):
            object.__setattr__(self, "base_heading", 0.0)
        elif is_number(self.base_heading):
            object.__setattr__(self, "direction", unit_vector(self.base_heading))
        elif isinstance(self.base_heading, float) and np.isnan(self.base_heading):
            object.__setattr__(self, "base_heading", float(np.arctan2(self.direction[1], self.direction[0])))

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
        """Return a planar arm of solid cylindrical links from its overall dimensions.

        Args:
            length: length of the whole arm.
            links: number of links, all alike; must be even.
            radius: radius of the links; 0 is allowed.
            unit: unit of all lengths in this call: "m", "mm" or "in".
            base: position of the first joint, (x, y).
            heading_deg: heading of the straight arm, counter-clockwise from x [deg].
            joint_limit_deg: bound on the absolute bend of every joint except the first [deg].
            base_limit_deg: bound on the absolute bend of the first joint [deg].
            mount_length: length of arm, measured from the base, that may touch obstacles; the radius if None.
            self_collision: whether links far apart along the arm must not touch each other.
            link_mass: mass of every link, or one mass per link [kg].
            payload: point mass carried at the tip [kg].
            axes: order of the three revolute axes of a ball joint, "zyx" or "zyz".
            feed: range (least, greatest) of the axis that carries the base along its heading; no feed axis if None.
            hole: where the guide tube of the feed axis ends; at the greatest position of the axis if None.

        Raises:
            ProblemError: one or more of these values are invalid; the message lists all of them.
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
            joint_limit=float(np.deg2rad(limit)),
            base_limit=float(np.deg2rad(base_limit)),
            self_collision=self_collision,
            mount_length=mount,
            masses=masses,
            inertia_axial=axial,
            inertia_transverse=transverse,
            base_heading=float(np.deg2rad(heading)),
            axes=axes,
            feed=axis,
            payload=carried,
        )

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point, 2 in the plane, 3 in space."""
        return len(self.base)

    @property
    def bends_a_joint(self) -> int:
        """Number of bends of every joint, 1 in the plane, 2 in space."""
        return self.dimension - 1

    @property
    def arcs(self) -> FloatArray | None:
        """Half the length of the arc about each joint, 0 for the tip, shape (links + 1,) [m]; None without sections."""
        return None if self.sections is None else self.sections.arcs

    @property
    def drives(self) -> DriveCoupling | None:
        """The drives that move several joints together; None where every bend has its own."""
        return self.coupled if self.sections is None else self.sections

    @property
    def unsimulated(self) -> str:
        """Reason why the closed loop of an arm of this kind is not modelled; empty if it is."""
        if self.carrier and self.dimension == 2:
            return "the dynamics of planar arms on base axes other than a feed axis are not simulated"
        for number, axis in enumerate(self.carrier, start=1):
            # A ball joint on the axis turns with it or against it, whatever the torques, if nothing is between them.
            if axis.revolute and axis.inertia == 0.0:
                return f"base axis {number} turns without inertia of its own; give its inertia to have it simulated"
        return ""

    @property
    def longest_link(self) -> float:
        """Greatest length of a link within the joint limits [m]."""
        if self.sections is None:
            return float(np.max(self.lengths))
        return float(max(np.max(self.lengths), np.max(self.sections.longest_links())))

    def key(self, name: str) -> str:
        """Return the key of problem files, for messages, that gives a value of links: the arm's or its sections'."""
        if self.sections is not None and name == "joint_limit_deg":
            name = "bend_limit_deg"
        return f"arm.{name}" if self._has_equal_links else f"{name} in arm.sections"

    @property
    def _has_equal_links(self) -> bool:
        """Whether all links are equal but for those that stand for bodies."""
        if self.proportions is None or self.tool_links is None:
            return self.proportions is None
        own = self.tool_links.own
        each = (self.lengths[own], self.radii[own], self.proportions.limits.reshape(self.links, -1)[own])
        return all(np.all(np.ptp(values, axis=0) <= ROUNDING * np.max(values)) for values in each)

    def with_links(self, links: int) -> "Arm":
        """Return an arm of the same length and total mass with another number of links, all of them equal."""
        share = self.links / links
        length = self.length / links
        mass = share * float(np.mean(self.masses))
        # Of a link of another length, without what its mass along its axis contributes.
        around = np.maximum(self.inertia_transverse - self.masses * self.lengths**2 / 12.0, 0.0)
        return replace(
            self,
            links=links,
            link_length=length,
            masses=np.full(links, mass),
            inertia_axial=np.full(links, share * float(np.mean(self.inertia_axial))),
            inertia_transverse=np.full(links, share * float(np.mean(around)) + mass * length**2 / 12.0),
            clamped_joints=int(np.ceil(self.clamped_joints / self.links * links)),
            proportions=None,
        )

    def beyond(self, first: int) -> "Arm":
        """Return the outer part of an arm, from link ``first`` on; its base stays where that of the whole arm is.

        The mount loses the length of the links left out, and each joint keeps its limit.
        """

        def each_revolute(values: FloatArray | float) -> FloatArray | float:
            return values[3 * first :] if isinstance(values, np.ndarray) and values.ndim else values

        k = self.bends_a_joint
        part = replace(
            self,
            links=self.links - first,
            base_limit=self.base_limit if first == 0 else float(np.max(self.bend_limits[k * first : k * (first + 1)])),
            mount_length=max(self.mount_length - float(self.joint_places[first]), 0.0),
            masses=self.masses[first:],
            inertia_axial=self.inertia_axial[first:],
            inertia_transverse=self.inertia_transverse[first:],
            rotor_inertia=each_revolute(self.rotor_inertia),
            friction=each_revolute(self.friction),
        )
        if self.proportions is None or first == 0:
            return part
        lengths, radii = self.proportions.lengths[first:], self.proportions.radii[first:]
        limits = self.proportions.limits[k * first :].copy()
        limits[:k] = self.bend_limits[k * first : k * (first + 1)] / (part.base_limit or 1.0)
        mean, widest, greatest = (
            float(np.mean(lengths)),
            float(np.max(radii)),
            float(np.max(limits[k:], initial=0.0)) or 1.0,
        )
        limits[k:] /= greatest
        own = Proportions(lengths / mean, radii / widest if widest else np.ones_like(radii), limits)
        return replace(
            part,
            link_length=self.link_length * mean,
            radius=self.radius * widest,
            joint_limit=self.joint_limit * greatest,
            proportions=own,
        )

    @cached_property
    def coordinates(self) -> Coordinates:
        """Layout of the arm's configurations, with name, unit and drive of each of their c coordinates."""
        names = tuple(f"axis_{number}" for number in range(1, len(self.carrier) + 1)) or tuple(
            FEED for _ in self.base_axes
        )
        units = tuple(axis.unit for axis in self.base_axes)
        return joint_coordinates(self.links, self.bends_a_joint, names, units, self._axis_reaches)

    @cached_property
    def _axis_reaches(self) -> tuple[float, ...]:
        return axis_reaches(self.carrier, self.base_position, self.length) if self.carrier else ()

    @cached_property
    def bending_places(self) -> FloatArray:
        """Arc length that has to be out of a guide tube for each joint to bend, shape (links,) [m].

        It is that of the joint, or of the beginning of the arc that stands for it.
        """
        return fixed(self.joint_places[:-1] - (0.0 if self.arcs is None else self.arcs[:-1]))

    @property
    def base_travel(self) -> float:
        """Bound on how far axes move the base from where it is when all of them are at zero [m]; 0 if it is fixed."""
        moved = (
            2.0 * (reach - self.length) if axis.revolute else max(abs(axis.low), abs(axis.high))
            for axis, reach in zip(self.carrier, self._axis_reaches, strict=True)
        )
        return sum(moved, max(map(abs, self.base_range)))

    @cached_property
    def bend_limits(self) -> FloatArray:
        """Bound on the absolute value of each bend, joint by joint, shape (k links,) for k bends per joint [rad]."""
        k = self.bends_a_joint
        limits = np.full(k * self.links, self.joint_limit)
        limits[:k] = self.base_limit
        if self.proportions is not None:
            limits *= self.proportions.limits
        limits[: k * self.clamped_joints] = 0.0
        limits.flags.writeable = False
        return limits

    @cached_property
    def locked_joints(self) -> BoolArray:
        """Mask of the joints that may not bend, shape (links,)."""
        return np.asarray(np.all(self.bend_limits.reshape(self.links, -1) == 0.0, axis=1))

    @cached_property
    def limit_shares(self) -> FloatArray:
        """Mean limit of each joint's bends over the arm's joint limit, shape (links,); for guesses, not for checks."""
        if self.proportions is None:
            return np.ones(self.links)
        return fixed(self.proportions.limits.reshape(self.links, -1).mean(axis=1))

    @cached_property
    def lower_limits(self) -> FloatArray:
        """Lower bound of every coordinate of a configuration, shape (c,) [rad, m]."""
        limits = np.concatenate((-self.bend_limits, [axis.low for axis in self.base_axes]))
        limits.flags.writeable = False
        return limits

    @cached_property
    def upper_limits(self) -> FloatArray:
        """Upper bound of every coordinate of a configuration, shape (c,) [rad, m]."""
        limits = np.concatenate((self.bend_limits, [axis.high for axis in self.base_axes]))
        limits.flags.writeable = False
        return limits

    @cached_property
    def base_rotation(self) -> FloatArray:
        """Rotation whose columns are the straight arm's direction, left and up in world coordinates, shape (3, 3).

        The plane is world x-z, so a planar arm is turned by −base_heading about world +y, and its left is world y.
        """
        if self.dimension == 2:
            c, s = np.cos(self.base_heading), np.sin(self.base_heading)
            return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        return np.column_stack((self.direction, np.cross(self.up, self.direction), self.up))

    @property
    def base_position(self) -> FloatArray:
        """Position of the first joint in the world, shape (3,) [m]."""
        return self.embedded(self.base)

    def embedded(self, points: FloatArray) -> FloatArray:
        """Return points of the arm's plane or space, shape (..., d), in world coordinates, shape (..., 3) [m].

        The plane (x, y) is world x-z; points in space are returned unchanged.
        """
        if self.dimension == 3:
            return points
        return np.stack((points[..., 0], np.zeros(points.shape[:-1]), points[..., 1]), axis=-1)

    def configuration(self, bends: FloatArray, feed: FloatArray | float) -> FloatArray:
        """Return the configuration with given bends and a given position of the base, shape (c,) [rad, m].

        Args:
            bends: bends of the joints, shape (links,) in the plane and (links, 2) in space [rad].
            feed: position of the base on its feed axis [m], or of the axes that carry it, shape (k,) [m, rad]; ignored
                if the base is fixed.
        """
        return np.append(np.ravel(bends), np.broadcast_to(feed, len(self.base_axes)) if self.base_axes else [])

    def joint_positions_at(self, q: FloatArray) -> FloatArray:
        """Return the positions of the joints and the tip, shape (..., links + 1, d) [m].

        Args:
            q: configurations, shape (..., c) [rad, m].
        """
        if self.dimension == 3:
            return self._in_space(q)[0]
        if self.carrier:
            base = self.carried(q)
            headings = self.headings(q[..., : self.links]) + (self.turned_base(q) - self.base_heading)[..., None]
            return self.joint_positions(headings) + (base.place[..., None, [0, 2]] - self.base)
        return self.joint_positions(self.headings(q[..., : self.links]), self.coordinates.advance(q))

    def link_rotations(self, q: FloatArray) -> FloatArray:
        """Return the rotation matrices of the links; the first column of each is the direction of the link.

        They map link coordinates to world coordinates in space, and to plane coordinates in the plane.

        Args:
            q: configurations, shape (..., c) [rad, m].

        Returns:
            Shape (..., links, d, d).
        """
        if self.dimension == 3:
            return self._in_space(q)[1]
        headings = self.headings(q[..., : self.links])
        if self.carrier:
            headings = headings + (self.turned_base(q) - self.base_heading)[..., None]
        cos = np.cos(headings)
        sin = np.sin(headings)
        return np.stack((np.stack((cos, -sin), axis=-1), np.stack((sin, cos), axis=-1)), axis=-2)

    def _in_space(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the joint and tip positions and the link rotations of configurations in space, shape (..., c).

        Positions have shape (..., links + 1, 3) [m], rotations (..., links, 3, 3).

        Raises:
            ValueError: the configurations do not have c coordinates.
        """
        links = self.links
        if q.shape[-1:] != (len(self.coordinates),):
            raise ValueError(f"configurations have the shape {q.shape}; expected (..., {len(self.coordinates)})")
        positions = np.empty((*q.shape[:-1], links + 1, 3))
        rotations = np.empty((*q.shape[:-1], links, 3, 3))
        NativeCall(
            "places",
            poses=q.size // q.shape[-1], links=links, lengths=self.lengths, turns=self.turns, arcs=self.arcs,
            carrier=self.carrier_for_c, q=q, points=positions, rotations=rotations,
        )()  # fmt: skip
        return positions, rotations

    @property
    def tip_up(self) -> FloatArray:
        """Direction that is up for the tool, or z without one, in the frame of the last link in space, shape (3,).

        In an arm with tool links, it is the frame of the last of them.
        """
        if self.tool_links is None:
            return self.up_in_last_link
        # The tool's frame is that of the last link, from which the rotations of tool links lead on.
        return np.asarray(reduce(np.matmul, self.tool_links.turns).T @ self.tool_links.up)

    @property
    def up_in_last_link(self) -> FloatArray:
        """Direction that is up for the tool, or z without one, in the frame of the last link but tool links, (3,)."""
        if self.tool_links is not None:
            return self.tool_links.up
        return np.eye(3)[2] if self.tool is None else self.tool.up_axis

    @property
    def ahead_in_last_link(self) -> FloatArray:
        """Direction in which the tool points, or x without one, in the frame of the last link but tool links, (d,)."""
        if self.tool_links is not None:
            return self.tool_links.direction
        return np.eye(self.dimension)[0] if self.tool is None else self.tool.direction

    @property
    def rigid_bodies(self) -> tuple[RigidBody, ...]:
        """All rigid bodies on links, the tool last."""
        return self.bodies if self.tool is None else (*self.bodies, self.tool)

    @property
    def moved_mass(self) -> float:
        """Mass of the links, the bodies on them and the payload [kg]."""
        return float(np.sum(self.masses)) + sum(body.mass for body in self.rigid_bodies) + self.payload

    @property
    def turns(self) -> FloatArray | None:
        """Constant rotation of each link relative to the link before it, as in ``ToolLinks``; None if there is none."""
        return None if self.tool_links is None else self.tool_links.turns

    def bend_pairs(self, q: FloatArray) -> FloatArray:
        """Return the bends of configurations in space, shape (..., c), as one pair per joint, (..., links, 2) [rad]."""
        return q[..., : 2 * self.links].reshape(*q.shape[:-1], self.links, 2)

    def headings(self, q: FloatArray) -> FloatArray:
        """Return the link headings of a planar arm, the cumulative sums of its bends, shape (..., links) [rad].

        Args:
            q: bends, shape (..., links), or configurations, shape (..., c).
        """
        headings: FloatArray = self.base_heading + np.cumsum(q[..., : self.links], axis=-1)
        return headings if self.tool_links is None else headings + np.cumsum(self.tool_links.turns)

    def bends(self, headings: FloatArray) -> FloatArray:
        """Return the joint bends of a planar arm for given link headings, both of shape (..., links) [rad].

        The first bend is relative to the base heading.
        """
        bends: FloatArray = np.diff(headings, axis=-1, prepend=self.base_heading)
        return bends if self.tool_links is None else bends - self.tool_links.turns

    def joint_positions(self, headings: FloatArray, feed: FloatArray | float = 0.0) -> FloatArray:
        """Return the positions of the joints and the tip in the plane, shape (..., links + 1, 2) [m].

        Args:
            headings: link headings, shape (..., links) [rad].
            feed: displacement of the base along the base heading, shape (...) [m].
        """
        lengths = self.lengths if self.sections is None else self.sections.tangents(self.bends(headings), self.lengths)
        steps = lengths[..., None] * np.stack((np.cos(headings), np.sin(headings)), axis=-1)
        start = np.zeros((*steps.shape[:-2], 1, 2))
        positions: FloatArray = self.base + np.concatenate((start, np.cumsum(steps, axis=-2)), axis=-2)
        if isinstance(feed, float) and feed == 0.0:  # the case in the planners' inner loops
            return positions
        return positions + np.asarray(feed)[..., None, None] * self.direction

    def poses(self, q: FloatArray) -> FloatArray:
        """Return the link headings [rad] and the base displacements in link lengths of planar configurations.

        Configurations and results have shape (..., c); the headings come first.
        """
        base = q[..., self.links :] / self.link_length
        return np.concatenate((self.headings(q[..., : self.links]), base), axis=-1)

    @property
    def base_axes(self) -> tuple[Feed | BaseAxis, ...]:
        """Axes that carry the base, in the order of their coordinates; empty if the base is fixed."""
        return self.carrier if self.feed is None else (self.feed,)

    @cached_property
    def axis_rows(self) -> FloatArray:
        """Kind, direction and point of each axis that carries the base, in the world, shape (k, 7); see ``axis_rows``.

        Raises:
            ProblemError: there are too many.
        """
        if len(self.carrier) > MOST_AXES:
            raise ProblemError(f"an arm has at most {MOST_AXES} base axes, got {len(self.carrier)}")
        along = self.base_rotation[:, 0]
        if self.feed is None:
            return axis_rows(self.carrier)
        return axis_rows([BaseAxis(along, self.feed.low, self.feed.high, revolute=False)])

    @cached_property
    def carrier_for_c(self) -> dict[str, object]:
        """The axes that carry the base as the fields of ``Carrier`` in link_places.h."""
        return {
            "count": len(self.axis_rows),
            "axes": self.axis_rows,
            "start": self.base_position,
            "rotation": self.base_rotation,
        }

    def carried(self, q: FloatArray) -> BaseFrames:
        """Return where the base, and the axes that carry it, are in the world in configurations of shape (..., c)."""
        return base_frames(self.axis_rows, self.base_position, self.base_rotation, q[..., self.coordinates.base])

    def turned_base(self, q: FloatArray) -> FloatArray:
        """Return the heading of the base of a planar arm in configurations (..., c), shape (...) [rad]."""
        sense = -self.axis_rows[:, 2] * self.axis_rows[:, 0]  # counter-clockwise in the plane is about -y of the world
        return np.asarray(self.base_heading + q[..., self.coordinates.base] @ sense)

    @property
    def base_range(self) -> tuple[float, float]:
        """Minimum and maximum feed of the base along its heading [m]; both 0 without a feed axis."""
        return (0.0, 0.0) if self.feed is None else (self.feed.low, self.feed.high)

    @property
    def hole(self) -> float:
        """Distance from ``base`` to the end of the last guide tube [m]; −∞ if there is none."""
        return -np.inf if self.feed is None else self.feed.hole

    def held(self, feed: FloatArray | float) -> BoolArray:
        """Return for each joint whether it is still inside the guide tube, which holds it straight.

        Without a guide tube, no joint is held.

        Args:
            feed: position of the base on its feed axis, shape (...) [m].

        Returns:
            Boolean array of shape (..., links).
        """
        along = np.asarray(feed)[..., None] + self.bending_places
        held: BoolArray = along < self.hole - HELD_TOLERANCE
        return held


def _feed_axis(given: Arguments, ends: object, hole: object) -> Feed:
    """Return the feed axis for user input; invalid values are collected in ``given``.

    Args:
        given: collector of argument errors, which also converts lengths to metres.
        ends: range (least, greatest) of the base position, in the user's unit of length.
        hole: end of the guide tube, in the user's unit; None for the greatest position.
    """
    low, high = given.metres * given.numbers("feed", ends, 2, "numbers (least, greatest)")
    given.must(low < high or low == high == 0.0, f"feed: expected (least, greatest) with least < greatest, got {ends}")
    end = high if hole is None else given.length("hole", hole)
    return Feed(float(low), float(high), end)
