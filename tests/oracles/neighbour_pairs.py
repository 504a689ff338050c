"""Pairs of links and walls, and of two links, that are near each other, by NumPy.

A neighbour list as in molecular dynamics (Verlet, 1967) reduces the work: pairs within a reach plus a slack are
collected once and used until a joint has moved by about half of the slack.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import WALL, Contacts, WallFinder
from ccm_opt.scene.walls import Walls
from tests.oracles.plane_segments import closest_on_segments, segments_cross

_SLACK = 1.5
"""Slack of the neighbour list beyond the reach, as a multiple of the reach."""
_MOVED = 0.35
"""Fraction of the slack by which a coordinate of a joint may change before the list is renewed: below 1/√8, so that two
joints approach each other by less than the slack."""


@dataclass(frozen=True)
class PairQuestion:
    """Arguments of a ``WallFinder``: an arm, walls, and the distances that define near pairs."""

    arm: Arm
    walls: Walls
    clearance: float
    margin: float
    reach: float

    @property
    def finder(self) -> WallFinder:
        """The ``WallFinder`` with these arguments."""
        return WallFinder(self.arm, self.walls, self.clearance, self.margin, self.reach)

    @cached_property
    def wall_gap(self) -> FloatArray:
        """Distances between the arm's axis and the core of each wall at contact, shape (walls,) [m]."""
        return self.arm.radius + self.clearance + self.walls.rounding

    @cached_property
    def pair_margin(self) -> FloatArray:
        """Margins between two links i < j, as a function of j − i, shape (links,) [m]."""
        apart = np.arange(self.arm.links)
        return self.arm.link_margins(np.zeros_like(apart), apart, self.margin)


@dataclass
class _NeighbourList:
    """Indices of the pairs within reach plus slack of a reference pose."""

    points: FloatArray
    link_vertex: tuple[IntArray, IntArray]
    joint_edge: tuple[IntArray, IntArray]
    link_edge: tuple[IntArray, IntArray]
    link_link: tuple[IntArray, IntArray]


class NeighbourPairs:
    """Finder of near pairs with the results of ``WallFinder``.

    Args:
        question: arm, walls and distances.
    """

    def __init__(self, question: PairQuestion) -> None:
        self._question = question
        self._arm = question.arm
        self._walls = question.walls
        self._slack = _SLACK * question.reach
        self._renewed_at = _MOVED * self._slack
        self._mount_link, self._mount_at = question.arm.mount_end
        self._pairs = question.arm.self_pairs
        self._near: _NeighbourList | None = None
        self._edge_mid = question.walls.edges.mean(axis=1)
        self._edge_half = 0.5 * np.linalg.norm(np.diff(question.walls.edges, axis=1)[:, 0], axis=1)
        self._edge_gap = question.wall_gap[question.walls.edge_wall]
        self._vertex_gap = question.wall_gap[question.walls.vertex_wall]

    def contacts(self, points: FloatArray) -> Contacts:
        """Return all pairs with a clearance below the reach, for joints and tip of a pose, shape (links + 1, 2) [m]."""
        near = self._neighbours(points)
        parts = [self._link_vertex(points, near), self._joint_edge(points, near), self._link_link(points, near)]
        contacts = Contacts(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Contacts)))
        return contacts.take(contacts.gap < self._question.reach)

    def crosses(self, points: FloatArray) -> bool:
        """Return whether any link crosses an edge of a wall or a distant link."""
        near = self._neighbours(points)
        i, e = near.link_edge
        start, end = self._link_ends(points, i)
        if bool(np.any(segments_cross(start, end, self._walls.edges[e, 0], self._walls.edges[e, 1]))):
            return True
        a, b = near.link_link
        return bool(np.any(segments_cross(points[a], points[a + 1], points[b], points[b + 1])))

    def _neighbours(self, points: FloatArray) -> _NeighbourList:
        near = self._near
        if near is None or float(np.max(np.abs(points - near.points))) > self._renewed_at:
            near = self._collect(points)
            self._near = near
        return near

    def _collect(self, points: FloatArray) -> _NeighbourList:
        """Return all pairs whose bounding discs are within reach plus slack of each other."""
        half = 0.5 * self._arm.link_length
        middles = 0.5 * (points[:-1] + points[1:])
        reach = self._question.reach + self._slack
        free = np.arange(self._mount_link, self._arm.links)

        to_edge = _distances(middles[free], self._edge_mid) - half - self._edge_half - self._edge_gap
        to_vertex = _distances(middles[free], self._walls.vertices) - half - self._vertex_gap
        near_edge = to_edge < reach
        i, e = np.nonzero(near_edge)
        a, v = np.nonzero(to_vertex < reach)
        i = free[i]
        a = free[a]

        # Joints are tested against the edges that are near either of their links; (link, edge) pairs serve for
        # crossings.
        near_joint = np.zeros((self._arm.links + 1, near_edge.shape[1]), dtype=bool)
        near_joint[free] = near_edge
        near_joint[free + 1] |= near_edge
        joint_edge = np.nonzero(near_joint)

        p, q = self._pairs
        far = 2.0 * (self._arm.radius + half) + reach
        close = np.linalg.norm(middles[p] - middles[q], axis=1) < far
        return _NeighbourList(points.copy(), (a, v), (joint_edge[0], joint_edge[1]), (i, e), (p[close], q[close]))

    def _link_ends(self, points: FloatArray, link: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the end points of links, without the part inside the mount."""
        start = points[link]
        end = points[link + 1]
        at = np.where(link == self._mount_link, self._mount_at, 0.0)[:, None]
        return start + at * (end - start), end

    def _link_vertex(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        link, vertex = near.link_vertex
        target = self._walls.vertices[vertex]
        start = points[link]
        end = points[link + 1]
        least = np.where(link == self._mount_link, self._mount_at, 0.0)

        # The foot of the perpendicular from the vertex: all links have the same length, so its square divides.
        along = np.einsum("ij,ij->i", target - start, end - start) / self._arm.link_length**2
        at = np.clip(along, least, 1.0)
        keep = (along < 1.0) | (link == self._arm.links - 1)  # else the next link reports the shared joint
        link = link[keep]
        vertex = vertex[keep]
        at = at[keep]
        target = target[keep]
        apart = points[link] + at[:, None] * (points[link + 1] - points[link]) - target
        return self._wall_contacts(link, at, apart, self._walls.vertex_wall[vertex])

    def _joint_edge(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        joint, edge = near.joint_edge
        place = points[joint]
        mounted = joint == self._mount_link
        if mounted.any():
            p = points[self._mount_link]
            q = points[self._mount_link + 1]
            place = np.where(mounted[:, None], p + self._mount_at * (q - p), place)
        a = self._walls.edges[edge, 0]
        b = self._walls.edges[edge, 1]
        along = np.einsum("ij,ij->i", place - a, b - a) / np.maximum(np.einsum("ij,ij->i", b - a, b - a), 1e-30)
        # Where the foot lies beyond the edge, its vertex is nearer, and ``_link_vertex`` reports that one.
        keep = (along > 0.0) & (along < 1.0)
        joint = joint[keep]
        edge = edge[keep]
        along = along[keep]
        place = place[keep]
        apart = place - (a[keep] + along[:, None] * (b - a)[keep])
        link = np.minimum(joint, self._arm.links - 1)
        # The tip is the far end of the last link; every other joint is the near end of its own.
        at = np.where(joint == self._arm.links, 1.0, np.where(joint == self._mount_link, self._mount_at, 0.0))
        return self._wall_contacts(link, at, apart, self._walls.edge_wall[edge])

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
            distance - self._question.wall_gap[wall],
            np.full(m, self._question.margin),
            wall,
        )

    def _link_link(self, points: FloatArray, near: _NeighbourList) -> Contacts:
        i, j = near.link_link
        at_i, at_j, apart = closest_on_segments(points[i], points[i + 1], points[j], points[j + 1])
        distance = np.hypot(apart[:, 0], apart[:, 1])
        normal = apart / np.maximum(distance, 1e-12)[:, None]
        wall = np.full(len(i), len(self._walls.names))
        gap = distance - 2.0 * self._arm.radius
        return Contacts(i, at_i, j, at_j, normal, gap, self._question.pair_margin[j - i], wall)


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
