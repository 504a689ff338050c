"""An arm some of whose links are its tool and other bodies, with which planning and diagnosis need neither.

A tool becomes further links beyond the last, whose joints are locked: a polyline along the axes of the tool's capsules,
which ends at the tool's tip, in the tool's direction. Each of these *tool links* has a constant rotation relative to
the link before it. Parts of the polyline between capsules are *bare*: they have no body. The polyline of a body on any
other link leaves that link's end and returns to it, before the next link. So goals, distances, certificates and trees
apply to tools and bodies as they are.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.polyline import wrap
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.couplings import CoupledJoints
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import TOOL, RigidBody, Tool, ToolLinks
from ccm_opt.scene.distances.enclosures import segment_distances

_END = 0.1
"""Length of the last tool link where the tool points another way than its polyline arrives, in mean link lengths.
Heuristic."""
_BALL = 1e-3
"""Length of the axis that a ball gets, in mean link lengths. Heuristic."""
_TOGETHER = 1e-6
"""Distance of points that count as one, in mean link lengths. Derived: far below the tolerance of contact."""
_TURNED = 1e-9
"""Largest 1 - cos of the angle between directions that count as equal. Derived: rounding."""
APART_AT_REST = 0.05
"""Gap between a body and a link of the straight arm above which the two are kept apart, as a fraction of the sum of
their radii. Heuristic: bodies that are nearer to each other are neighbours around a bend."""
_MASSLESS = 1e-9
"""Mass and moments of inertia of a tool link [kg, kg m²]: hardly any, since dynamics take the bodies themselves."""


@dataclass(frozen=True, eq=False)
class BodyLine:
    """The polyline that runs along the capsules of a rigid body, from the end of its link and, but for a tool, back.

    Attributes:
        corners: corners in the frame of the link, beginning with its end, shape (k + 1, d) [m].
        radii: radius of each of the k parts, NaN for a bare part, shape (k,) [m].
        masses: mass at the middle of each part, shape (k,) [kg].
    """

    corners: FloatArray
    radii: FloatArray
    masses: FloatArray

    @classmethod
    def along(cls, body: RigidBody, unit: float, dimension: int, *, weighed: bool = False) -> "BodyLine":
        """Return the polyline of a rigid body.

        Args:
            body: the body.
            unit: mean length of the arm's links [m].
            dimension: number of coordinates, d.
            weighed: whether a short bare part at the centre of mass carries the mass.
        """
        corners = [np.zeros(dimension)]
        radii: list[float] = []
        masses: list[float] = []

        def lead_to(place: FloatArray, radius: float = np.nan, mass: float = 0.0) -> None:
            if np.linalg.norm(place - corners[-1]) > _TOGETHER * unit:
                corners.append(place)
                radii.append(radius)
                masses.append(mass)

        ahead = body.direction if isinstance(body, Tool) else np.eye(dimension)[0]
        half = 0.5 * _BALL * unit * ahead
        for capsule in body.bodies:
            start, end = capsule.start, capsule.end
            if np.linalg.norm(end - start) < _BALL * unit:
                start, end = 0.5 * (start + end) - half, 0.5 * (start + end) + half
            if np.linalg.norm(end - corners[-1]) < np.linalg.norm(start - corners[-1]):
                start, end = end, start
            lead_to(start)
            lead_to(end, capsule.radius)
        if weighed and body.mass:
            centre = np.zeros(dimension) if body.centre is None else body.centre
            lead_to(centre - half)
            lead_to(centre + half, mass=body.mass)
        if isinstance(body, Tool):
            last = body.tip - corners[-1]
            arrives = last if np.linalg.norm(last) > _TOGETHER * unit else _last_direction(corners)
            if arrives @ body.direction < (1.0 - _TURNED) * np.linalg.norm(arrives):
                lead_to(body.tip - _END * unit * body.direction)
            lead_to(body.tip)
        else:
            lead_to(np.zeros(dimension))
        return cls(np.array(corners), np.array(radii), np.array(masses))

    def __len__(self) -> int:
        return len(self.radii)


def _last_direction(corners: list[FloatArray]) -> FloatArray:
    """Return the direction of the last part of a polyline, or of the link itself if there is none, shape (d,)."""
    return corners[-1] - corners[-2] if len(corners) > 1 else np.eye(len(corners[0]))[0]


@dataclass(frozen=True, eq=False)
class BodyChain:
    """The links of an arm and the parts of the polylines of its bodies, m in all, in the order of the chain.

    Attributes:
        arm: the arm.
        carriers: index of the link that each is or is fixed to, shape (m,).
        names: name of the body of each part; empty for links.
        starts: start of each in the frame of the carrier, from its end, shape (m, d) [m].
        ends: likewise its end, shape (m, d) [m].
        radii: radius of each, NaN for bare parts, shape (m,) [m].
        masses: mass at the middle of each part, shape (m,) [kg].
    """

    arm: Arm
    carriers: IntArray
    names: tuple[str, ...]
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    masses: FloatArray

    @classmethod
    def of(cls, arm: Arm, *, weighed: bool = False) -> "BodyChain":
        """Return the chain of an arm and its bodies; arguments as for ``BodyLine.along``."""
        d = arm.dimension
        on: list[list[tuple[str, BodyLine]]] = [[] for _ in range(arm.links)]
        for body in arm.rigid_bodies:
            link = body.link % arm.links
            name = TOOL if isinstance(body, Tool) else f"the body {_where(arm, link)}"
            on[link].append((name, BodyLine.along(body, arm.link_length, d, weighed=weighed)))
        ahead = np.eye(d)[0]
        rows: list[tuple[int, str, FloatArray, FloatArray, float, float]] = []
        for link, lines in enumerate(on):
            rows.append((link, "", -arm.lengths[link] * ahead, 0.0 * ahead, float(arm.radii[link]), 0.0))
            for name, line in lines:
                parts = zip(line.corners[:-1], line.corners[1:], line.radii, line.masses, strict=True)
                rows += [(link, name, *part) for part in parts]
        if rows[-1][1] not in {"", TOOL}:
            # The last part points along the link.
            back = -_END * arm.link_length * ahead
            rows += [
                (arm.links - 1, rows[-1][1], *ends, np.nan, 0.0) for ends in ((0.0 * ahead, back), (back, 0.0 * ahead))
            ]
        carriers, names, starts, ends, radii, masses = zip(*rows, strict=True)
        return cls(arm, np.array(carriers), names, np.array(starts), np.array(ends), np.array(radii), np.array(masses))

    @cached_property
    def own(self) -> BoolArray:
        """Mask of the arm's own links, shape (m,)."""
        return np.array([not name for name in self.names])

    @cached_property
    def bare(self) -> BoolArray:
        """Mask of the parts without a body, shape (m,)."""
        return np.isnan(self.radii)

    @cached_property
    def turns(self) -> FloatArray:
        """Rotation of each relative to the one before it, angles (m,) [rad] in the plane, else (m, 3, 3)."""
        parts = self.ends - self.starts
        if parts.shape[1] == 2:
            headings = np.where(self.own, 0.0, np.arctan2(parts[:, 1], parts[:, 0]))
            return np.asarray(wrap(np.diff(headings, prepend=0.0)))
        frame = np.eye(3)
        found = np.empty((len(parts), 3, 3))
        for k, part in enumerate(parts):
            found[k] = frame.T if self.own[k] else _rotation_of_x(frame.T @ part)
            frame = np.eye(3) if self.own[k] else frame @ found[k]
        return found

    @cached_property
    def rest_gaps(self) -> FloatArray:
        """Gaps between all surfaces while the arm is straight, NaN where one is bare, shape (m, m) [m]."""
        ahead = np.eye(self.starts.shape[1])[0]
        places = self.arm.joint_places[1:][self.carriers, None] * ahead
        first, second = np.divmod(np.arange(len(self.own) ** 2), len(self.own))
        starts, ends = places + self.starts, places + self.ends
        distances = segment_distances(starts[first], ends[first], starts[second], ends[second])[2]
        return np.asarray(distances.reshape(len(starts), -1) - self.radii[:, None] - self.radii)

    @cached_property
    def clear_at_rest(self) -> BoolArray:
        """Mask of the pairs with a body that are fixed to different links and clear of each other at rest, (m, m)."""
        moves = self.carriers[:, None] != self.carriers
        both = self.radii[:, None] + self.radii
        return np.asarray(moves & ~(self.own[:, None] & self.own) & (self.rest_gaps > APART_AT_REST * both))

    @cached_property
    def distant(self) -> BoolArray:
        """Mask of the pairs i < j that could collide, (m, m): links as without bodies, others if clear at rest."""
        distant = np.triu(self.clear_at_rest)
        own = np.flatnonzero(self.own)
        distant[np.ix_(own, own)] = self.arm.distant_links
        return distant

    @cached_property
    def near(self) -> tuple[FloatArray, FloatArray]:
        """Places where each starts and ends that give no pair a greater distance than at rest, both (m,) [m]."""
        starts, ends = self.arm.joint_places[:-1][self.carriers], self.arm.joint_places[1:][self.carriers]
        apart = self.rest_gaps + np.nan_to_num(self.radii[:, None] + self.radii)
        pairs = self.distant & ~(self.own[:, None] & self.own)
        for k in np.flatnonzero(~self.own & ~self.bare):
            later = np.flatnonzero(pairs[k] & self.own)
            ends[k] = np.min(starts[later] - apart[k, later], initial=ends[k])
        for k in np.flatnonzero(~self.own & ~self.bare):
            before = np.flatnonzero(pairs[:, k])
            starts[k] = np.min(ends[before] + apart[before, k], initial=np.inf)
        return np.where(np.isfinite(starts), starts, 0.0), ends


def _rotation_of_x(along: FloatArray) -> FloatArray:
    """Return a rotation, shape (3, 3), that turns the x axis into the direction of a vector, shape (3,)."""
    x = along / np.linalg.norm(along)
    beside = np.eye(3)[2] if abs(x[2]) < abs(x[1]) else np.eye(3)[1]
    if x[0] > 0.0 and np.hypot(x[1], x[2]) < _TURNED:
        return np.eye(3)
    y = np.cross(np.cross(x, beside), x)
    y /= np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def with_tool_links(arm: Arm, *, weighed: bool = False) -> Arm:
    """Return an arm some of whose links are its tool and other bodies, or the arm itself if it has none.

    The tool links have no mass: dynamics are those of the arm with its bodies.

    Args:
        arm: the arm.
        weighed: whether tool links carry the masses of the bodies, for static torques.
    """
    if not arm.rigid_bodies:
        return arm
    chain = BodyChain.of(arm, weighed=weighed)
    own = chain.own
    if np.all(own) and (arm.tool is None or arm.tool.up is None):
        return replace(arm, tool=None, bodies=())
    lengths = np.linalg.norm(chain.ends - chain.starts, axis=1)
    lengths[own] = arm.lengths
    radii = np.nan_to_num(chain.radii)
    mean, widest = float(np.mean(lengths)), float(np.max(radii))
    k = arm.bends_a_joint
    shares = np.ones(k * arm.links) if arm.proportions is None else arm.proportions.limits
    starts, ends = chain.near
    tool = arm.tool
    return replace(
        arm,
        links=len(own),
        link_length=mean,
        radius=widest,
        masses=_among(arm.masses, own, 1, np.maximum(chain.masses, _MASSLESS)[~own]),
        inertia_axial=_among(arm.inertia_axial, own, 1, _MASSLESS),
        inertia_transverse=_among(arm.inertia_transverse, own, 1, _MASSLESS),
        rotor_inertia=_of_revolutes(arm.rotor_inertia, own),
        friction=_of_revolutes(arm.friction, own),
        proportions=Proportions(lengths / mean, radii / (widest or 1.0), _among(shares, own, k, 0.0)),
        sections=None if arm.sections is None else _arcs_among(arm.sections, own),
        coupled=None if arm.coupled is None else _coupled_among(arm.coupled, own),
        bodies=(),
        tool=None,
        tool_links=ToolLinks(
            chain.carriers,
            chain.names,
            chain.turns,
            chain.bare,
            chain.distant,
            starts / mean,
            ends / mean,
            arm.ahead_in_last_link,
            np.eye(3)[2] if tool is None or arm.dimension == 2 else tool.up_axis,
        ),
    )


def _where(arm: Arm, link: int) -> str:
    """Return in words where the end of a link is."""
    if arm.sections is None:
        return f"on link {link + 1}"
    section, at = arm.sections.place_of(link)
    return f"at {at:.4g} of section {section + 1}"


def _arcs_among(sections: ArcSections, own: BoolArray) -> ArcSections:
    """Return sections that bend evenly none of whose arcs are about the joints of tool links."""
    bends = np.zeros(len(own), dtype=bool)
    bends[own] = sections.section_of_joint >= 0
    return replace(sections, straight=tuple(np.flatnonzero(~bends)[1:].tolist()))


def _coupled_among(coupled: CoupledJoints, own: BoolArray) -> CoupledJoints:
    """Return the coupling of an arm's joints to drives, which move none of the tool links."""
    moved = len(coupled.names)
    return replace(
        coupled,
        ratios=_among(coupled.ratios.ravel(), own, 2 * moved, 0.0).reshape(-1, moved),
        limits=_among(coupled.limits, own, 2, 0.0),
        link_lengths=_among(coupled.link_lengths, own, 1, 1.0),
    )


def _among(values: FloatArray, own: BoolArray, each: int, others: FloatArray | float) -> FloatArray:
    """Return values of an arm's own links, ``each`` a link, among those of its tool links."""
    found = np.empty(each * len(own))
    mask = np.repeat(own, each)
    found[mask], found[~mask] = values, others
    return found


def _of_revolutes(values: FloatArray | float, own: BoolArray) -> FloatArray | float:
    """Return one number, or values per revolute, with zeros for the revolutes of tool links."""
    return _among(values, own, 3, 0.0) if isinstance(values, np.ndarray) and values.ndim else values


def points_with_tool(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the positions of joints, tip and the corners of the polylines of bodies, shape (..., m + 1, d) [m].

    They are in the order of the chain of the arm and its bodies, so the last is the tool's tip.

    Args:
        arm: the arm.
        q: configurations, shape (..., c) [rad, m].
    """
    points = arm.joint_positions_at(q)
    if not arm.rigid_bodies:
        return points
    chain = BodyChain.of(arm)
    beyond = np.einsum("...kij,kj->...ki", arm.link_rotations(q)[..., chain.carriers, :, :], chain.ends)
    return np.concatenate((points[..., :1, :], points[..., 1:, :][..., chain.carriers, :] + beyond), axis=-2)


def own_joints(arm: Arm) -> IntArray:
    """Return the indices, among ``points_with_tool``, of the arm's own joints and the end of its last link."""
    if not arm.rigid_bodies:
        return np.arange(arm.links + 1)
    return np.append(0, np.flatnonzero(BodyChain.of(arm).own) + 1)


def body_corners(arm: Arm) -> list[list[list[float]]]:
    """Return the corners of the polylines of bodies on each link, in its frame; empty without bodies [m]."""
    if not arm.rigid_bodies:
        return []
    chain = BodyChain.of(arm)
    return [chain.ends[~chain.own & (chain.carriers == link)].tolist() for link in range(arm.links)]


def drawn_radii(arm: Arm) -> FloatArray:
    """Return the radii of the links and the parts of bodies, 0 for bare parts, shape (m,) [m]."""
    return np.nan_to_num(BodyChain.of(arm).radii) if arm.rigid_bodies else arm.radii


def colliding_at_rest(arm: Arm) -> tuple[int, int, str] | None:
    """Return a capsule of a body that is too near to another part of the straight arm to be compared with it later.

    A capsule may touch a link other than its own if it is joined to its own, reaches no farther towards the other than
    its own does, and the two links are neighbours: within two links or π times the greatest radius of arm in between.

    Returns:
        Index of the body, of its capsule and the name of what it is too near to; None if there is none.
    """
    capsules = [(k, number) for k, body in enumerate(arm.rigid_bodies) for number in range(len(body.bodies))]
    if not capsules:
        return None
    chain = _capsules_alone(arm, capsules)
    gaps, own = chain.rest_gaps, chain.own
    for row in np.flatnonzero(~own):
        link = int(chain.carriers[row])
        # Where a body divides a link, both parts are its own.
        divided = arm.sections is not None and link + 1 in arm.sections.straight
        ahead = float(arm.lengths[link + 1]) if divided else 0.0
        joined = gaps[link, row] <= 0.0 or (divided and gaps[link + 1, row] <= 0.0)
        for other in np.flatnonzero(~chain.clear_at_rest[row] & (chain.carriers != link)):
            near = int(chain.carriers[other])
            if own[other] and divided and near == link + 1:
                continue
            if own[other] and joined and _are_neighbours(arm, link, near, float(chain.radii[row])):
                x = np.array([chain.starts[row, 0], chain.ends[row, 0]])
                if (x.min() >= -arm.lengths[link] - _TOGETHER) if near < link else (x.max() <= ahead + _TOGETHER):
                    continue
            return (*capsules[row - arm.links], chain.names[other] or arm.link_name(near))
    return None


def _capsules_alone(arm: Arm, capsules: list[tuple[int, int]]) -> BodyChain:
    """Return the links of an arm, followed by capsules of its bodies, given by the index of body and capsule."""
    bodies = arm.rigid_bodies
    each = [bodies[k].bodies[number] for k, number in capsules]
    ahead = np.eye(arm.dimension)[0]
    links = [bodies[k].link % arm.links for k, _ in capsules]
    return BodyChain(
        arm,
        np.append(np.arange(arm.links), links),
        ("",) * arm.links + tuple(f"arm.bodies[{k}]" if k < len(arm.bodies) else TOOL for k, _ in capsules),
        np.concatenate((-arm.lengths[:, None] * ahead, [capsule.start for capsule in each])),
        np.concatenate((0.0 * arm.lengths[:, None] * ahead, [capsule.end for capsule in each])),
        np.concatenate((arm.radii, [capsule.radius for capsule in each])),
        np.zeros(arm.links + len(each)),
    )


def _are_neighbours(arm: Arm, link: int, other: int, radius: float) -> bool:
    """Return whether two links are so near to each other along the arm that one with a body may touch the other."""
    first, last = sorted((link, other))
    thickest = max(float(np.max(arm.radii[first : last + 1])), radius)
    between = float(arm.joint_places[last] - arm.joint_places[first + 1])
    return last - first < 3 or between < np.pi * thickest
