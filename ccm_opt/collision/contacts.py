"""Near pairs of the arm with walls and with itself: gap, direction, and where on which link.

A neighbour list in the manner of molecular dynamics (Verlet, 1967) keeps the work local: pairs nearer than a reach
are collected once and used until some joint has moved by half of the list's slack.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.collision.collision_settings import DEFAULT_CONTACTS, ContactSettings
from ccm_opt.collision.walls import Walls
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.jointed.arm import Arm

WALL = -1
"""Stands for the second link of a contact with a wall."""


@dataclass(frozen=True)
class Contacts:
    """Near pairs of one pose.

    Attributes:
        first: link of the point that ``normal`` pushes away, shape (m,).
        first_at: its place on the link in [0, 1], shape (m,).
        second: the other link, or ``WALL``, shape (m,).
        second_at: place on the other link, shape (m,).
        normal: unit direction from the other body to the first point, shape (m, 2).
        gap: distance between the surfaces beyond the clearance asked for, shape (m,) [m].
        margin: gap to keep while planning, shape (m,) [m].
        wall: index of the wall, or the number of walls for self-contacts, shape (m,).
    """

    first: IntArray
    first_at: FloatArray
    second: IntArray
    second_at: FloatArray
    normal: FloatArray
    gap: FloatArray
    margin: FloatArray
    wall: IntArray

    def __len__(self) -> int:
        return len(self.gap)

    def take(self, mask: BoolArray) -> "Contacts":
        """The contacts selected by a mask."""
        return Contacts(*(getattr(self, name)[mask] for name in self.__dataclass_fields__))

    def shortfall(self) -> float:
        """Largest excess of the planning margin over the gap [m]; negative when every margin is kept."""
        return float(np.max(self.margin - self.gap, initial=-np.inf))


def joined_contacts(parts: list[Contacts]) -> Contacts:
    """All contacts of several lists."""
    return Contacts(*(np.concatenate([getattr(p, name) for p in parts]) for name in Contacts.__dataclass_fields__))


@dataclass
class _NeighbourList:
    """Pairs within reach of a reference pose."""

    points: FloatArray
    link_vertex: tuple[IntArray, IntArray]
    joint_edge: tuple[IntArray, IntArray]
    link_edge: tuple[IntArray, IntArray]
    link_link: tuple[IntArray, IntArray]


class ContactFinder:
    """Finds the contacts of poses of one arm among fixed walls.

    Args:
        arm: the arm.
        walls: the walls.
        clearance: gap to keep to walls beyond the radius [m].
        margin: planning margin m on top of it [m].
        reach: pairs with a gap below this are reported [m].
        settings: of the neighbour list and of margins between links.
    """

    def __init__(
        self,
        arm: Arm,
        walls: Walls,
        clearance: float,
        margin: float,
        reach: float,
        settings: ContactSettings = DEFAULT_CONTACTS,
    ) -> None:
        self.arm = arm
        self.walls = walls
        self.margin = margin
        self.reach = reach
        self.settings = settings
        self._slack = settings.slack * reach
        self._renewed_at = settings.moved * self._slack
        self._wall_gap = arm.radius + clearance + walls.rounding
        self._mount_link, self._mount_at = arm.mount_end
        i, j = arm.self_pairs
        self._pairs = i, j
        self._self_margin = np.zeros((arm.links, arm.links))
        self._self_margin[i, j] = arm.link_margins(i, j, margin, settings.link_margins)
        # Against a wall all joints up to a link move it, against another link those between the two.
        self._error_room = arm.room_for_errors(np.arange(1, arm.links + 1))
        self._pair_room = np.zeros((arm.links, arm.links))
        self._pair_room[i, j] = arm.room_for_errors(j - i)
        self._near: _NeighbourList | None = None
        self._latest: tuple[FloatArray, Contacts] | None = None
        self._edge_mid = self.walls.edges.mean(axis=1)
        self._edge_half = 0.5 * np.linalg.norm(np.diff(self.walls.edges, axis=1)[:, 0], axis=1)
        self._edge_gap = self._wall_gap[walls.edge_wall]
        self._vertex_gap = self._wall_gap[walls.vertex_wall]

    def find(self, points: FloatArray) -> Contacts:
        """Contacts of a pose with a gap below the reach.

        Args:
            points: joint and tip positions, shape (links + 1, 2) [m].
        """
        # By identity, not by value: a step and its check ask for the same array twice. Arrays of points must not be
        # changed in place.
        if self._latest is not None and self._latest[0] is points:
            return self._latest[1]
        near = self._neighbours(points)
        parts = [self._link_vertex(points, near), self._joint_edge(points, near), self._link_link(points, near)]
        contacts = joined_contacts(parts)
        contacts = contacts.take(contacts.gap < self.reach)
        self._latest = (points, contacts)
        return contacts

    def describe(self, contacts: Contacts) -> str:
        """The contact that is furthest inside its margin, in words."""
        tightest = self.tightest(contacts)
        if tightest is None:
            return "nothing near"
        link, other, gap = tightest
        return f"link {link} and {other}, gap {1e3 * gap:.2f} mm"

    def tightest(self, contacts: Contacts) -> tuple[int, str, float] | None:
        """Of the contact that is furthest inside its margin: link from 1, what it is near to, gap [m]; None if none."""
        if len(contacts) == 0:
            return None
        k = int(np.argmin(contacts.gap - contacts.margin))
        wall = contacts.second[k] == WALL
        other = f"'{self.walls.names[contacts.wall[k]]}'" if wall else f"link {contacts.second[k] + 1}"
        return int(contacts.first[k]) + 1, other, float(contacts.gap[k])

    def crosses(self, points: FloatArray) -> bool:
        """Whether any link cuts an edge of a wall or a distant link."""
        near = self._neighbours(points)
        i, e = near.link_edge
        start, end = self._link_ends(points, i)
        if bool(np.any(_cut(start, end, self.walls.edges[e, 0], self.walls.edges[e, 1]))):
            return True
        a, b = near.link_link
        return bool(np.any(_cut(points[a], points[a + 1], points[b], points[b + 1])))

    def _neighbours(self, points: FloatArray) -> _NeighbourList:
        near = self._near
        if near is None or float(np.max(np.abs(points - near.points))) > self._renewed_at:
            near = self._collect(points)
            self._near = near
        return near

    def _collect(self, points: FloatArray) -> _NeighbourList:
        """All pairs whose bounding discs come within reach plus slack of each other."""
        half = 0.5 * self.arm.link_length
        middles = 0.5 * (points[:-1] + points[1:])
        reach = self.reach + self._slack
        free = np.arange(self._mount_link, self.arm.links)

        to_edge = _distances(middles[free], self._edge_mid) - half - self._edge_half - self._edge_gap
        to_edge -= self._error_room[free, None]
        to_vertex = _distances(middles[free], self.walls.vertices) - half - self._vertex_gap
        to_vertex -= self._error_room[free, None]
        near_edge = to_edge < reach
        i, e = np.nonzero(near_edge)
        a, v = np.nonzero(to_vertex < reach)
        i = free[i]
        a = free[a]

        # Joints are tested against the edges that are near either of their links; (link, edge) pairs serve for
        # crossings.
        near_joint = np.zeros((self.arm.links + 1, near_edge.shape[1]), dtype=bool)
        near_joint[free] = near_edge
        near_joint[free + 1] |= near_edge
        joint_edge = np.nonzero(near_joint)

        p, q = self._pairs
        far = 2.0 * (self.arm.radius + half) + reach + self._pair_room[p, q]
        close = np.linalg.norm(middles[p] - middles[q], axis=1) < far
        return _NeighbourList(points.copy(), (a, v), (joint_edge[0], joint_edge[1]), (i, e), (p[close], q[close]))

    def _link_ends(self, points: FloatArray, link: IntArray) -> tuple[FloatArray, FloatArray]:
        """End points of links, the mount cut off."""
        start = points[link]
        end = points[link + 1]
        at = np.where(link == self._mount_link, self._mount_at, 0.0)[:, None]
        return start + at * (end - start), end

    def _link_vertex(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        link, vertex = near.link_vertex
        target = self.walls.vertices[vertex]
        start = points[link]
        end = points[link + 1]
        least = np.where(link == self._mount_link, self._mount_at, 0.0)

        # The foot of the perpendicular from the vertex: all links have the same length, so its square divides.
        along = np.einsum("ij,ij->i", target - start, end - start) / self.arm.link_length**2
        at = np.clip(along, least, 1.0)
        keep = (along < 1.0) | (link == self.arm.links - 1)  # else the next link reports the shared joint
        link = link[keep]
        vertex = vertex[keep]
        at = at[keep]
        target = target[keep]
        apart = points[link] + at[:, None] * (points[link + 1] - points[link]) - target
        return self._wall_contacts(link, at, apart, self.walls.vertex_wall[vertex])

    def _joint_edge(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        joint, edge = near.joint_edge
        place = points[joint]
        mounted = joint == self._mount_link
        if mounted.any():
            p = points[self._mount_link]
            q = points[self._mount_link + 1]
            place = np.where(mounted[:, None], p + self._mount_at * (q - p), place)
        a = self.walls.edges[edge, 0]
        b = self.walls.edges[edge, 1]
        along = np.einsum("ij,ij->i", place - a, b - a) / np.maximum(np.einsum("ij,ij->i", b - a, b - a), 1e-30)
        # Where the foot lies beyond the edge, its vertex is nearer, and ``_link_vertex`` reports that one.
        keep = (along > 0.0) & (along < 1.0)
        joint = joint[keep]
        edge = edge[keep]
        along = along[keep]
        place = place[keep]
        apart = place - (a[keep] + along[:, None] * (b - a)[keep])
        link = np.minimum(joint, self.arm.links - 1)
        # The tip is the far end of the last link; every other joint is the near end of its own.
        at = np.where(joint == self.arm.links, 1.0, np.where(joint == self._mount_link, self._mount_at, 0.0))
        return self._wall_contacts(link, at, apart, self.walls.edge_wall[edge])

    def _wall_contacts(self, link: IntArray, at: FloatArray, apart: FloatArray, wall: IntArray) -> Contacts:
        distance = np.hypot(apart[:, 0], apart[:, 1])
        normal = apart / np.maximum(distance, 1e-12)[:, None]
        m = len(link)
        return Contacts(
            link,
            at,
            np.full(m, WALL),
            np.zeros(m),
            normal,
            distance - self._wall_gap[wall] - self._error_room[link],
            np.full(m, self.margin),
            wall,
        )

    def _link_link(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        i, j = near.link_link
        at_i, at_j, apart = closest_on_segments(points[i], points[i + 1], points[j], points[j + 1])
        distance = np.hypot(apart[:, 0], apart[:, 1])
        normal = apart / np.maximum(distance, 1e-12)[:, None]
        wall = np.full(len(i), len(self.walls.names))
        gap = distance - 2.0 * self.arm.radius - self._pair_room[i, j]
        return Contacts(i, at_i, j, at_j, normal, gap, self._self_margin[i, j], wall)


def closest_on_segments(
    p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Closest points of segments pq and rs that do not cross: the least of four end-to-segment distances.

    Returns:
        Place on pq, place on rs, and the vector from the point on rs to the point on pq; shapes (m,), (m,), (m, 2).
    """
    d = q - p
    e = s - r
    dd = np.maximum(np.einsum("ij,ij->i", d, d), 1e-30)
    ee = np.maximum(np.einsum("ij,ij->i", e, e), 1e-30)

    w = p - r
    dw = np.einsum("ij,ij->i", d, w)
    ew = np.einsum("ij,ij->i", e, w)
    de = np.einsum("ij,ij->i", d, e)
    zero = np.zeros_like(dw)
    one = np.ones_like(dw)
    # An end of one segment is nearest to the other at its projection, clipped; all four ends are tried.
    on_first = np.stack((np.clip(-dw / dd, 0, 1), np.clip((de - dw) / dd, 0, 1), zero, one))
    on_second = np.stack((zero, one, np.clip(ew / ee, 0, 1), np.clip((ew + de) / ee, 0, 1)))

    apart = w + on_first[..., None] * d - on_second[..., None] * e
    best = np.argmin(np.einsum("kij,kij->ki", apart, apart), axis=0)
    columns = np.arange(len(p))
    return on_first[best, columns], on_second[best, columns], apart[best, columns]


def _cut(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> BoolArray:
    """Whether segments properly cross; the boxes around collinear ones, whose sides are rounding, are apart."""
    # Each segment's ends lie on opposite sides of the other's line; an end that touches counts as no crossing.
    opposite = (_side(p, q, r) * _side(p, q, s) < 0.0) & (_side(r, s, p) * _side(r, s, q) < 0.0)
    low = np.maximum(np.minimum(p, q), np.minimum(r, s))
    high = np.minimum(np.maximum(p, q), np.maximum(r, s))
    return np.asarray(opposite & np.all(low <= high, axis=1))


def _side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    # Twice the signed area of the triangle: positive where r lies to the left of pq.
    return (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
