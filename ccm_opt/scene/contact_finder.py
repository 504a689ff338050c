"""Contacts of the links of an arm in one pose with walls and with each other."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.length_words import short_length
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import LINK_MARGIN_SHARE
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.walls import Walls

WALL = -1
"""Value that replaces the index of the second link in a contact with a wall."""


@dataclass(frozen=True)
class Contacts:
    """The m pairs of bodies, each a link and a wall or another link, that are close to each other in one pose.

    Attributes:
        first: index of the link that ``normal`` pushes away, shape (m,).
        first_at: nearest point on the first link, as a fraction of its length in [0, 1], shape (m,).
        second: index of the other link, or ``WALL``, shape (m,).
        second_at: nearest point on the other link, as a fraction of its length in [0, 1], shape (m,).
        normal: unit direction from the other body to the nearest point of the first link, shape (m, d).
        gap: distance between the surfaces less the required clearance, shape (m,) [m].
        margin: gap that planning keeps at each contact, shape (m,) [m].
        wall: index of the wall, or the number of walls for contacts between links, shape (m,).
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
        """Return the contacts selected by a mask, shape (m,)."""
        return Contacts(*(getattr(self, each.name)[mask] for each in fields(Contacts)))

    def shortfall(self) -> float:
        """Return the largest excess of the planning margin over the gap [m]; negative if every margin is kept."""
        return float(np.max(self.margin - self.gap, initial=-np.inf))


@dataclass(frozen=True)
class CertificateSettings:
    """Number of bisections and tolerances of collision-free certificates.

    Attributes:
        depth: number of bisections of an interval before its certificate is refused. Heuristic: the chord deviation
            falls four-fold at each.
        touch: gap that even an arm of zero width keeps [arm lengths]. Derived: above the rounding error in a room of up
            to a hundred thousand arm lengths; if ``proof_rounding`` is larger, that is used.
        rounding: depth of contact [arm lengths], and bend beyond a joint limit [rad], that are ignored at either end of
            a motion. Derived: as for ``touch``.
        contact: depth of contact [arm lengths] allowed for motions that start or end in contact, if the arm has
            non-zero width. Derived: half of what the verifier allows; if the problem sets another tolerance for the
            verifier, half of that.
    """

    depth: int = 7
    touch: float = 1e-9
    rounding: float = 1e-9
    contact: float = 5e-7


DEFAULT_CERTIFICATE = CertificateSettings()
"""Default number of bisections and tolerances of certificates."""


_PLANES = 14
"""Largest number of contacts (free half-spaces) per link in space."""
_RUN = 8
"""Number of links per group in the search for near pairs, equal to ``RUN`` of near_pairs.c."""


class ContactFinder(ABC):
    """Finds the contacts of an arm in given poses; not safe for use by two threads at once.

    Args:
        arm: the arm.
        names: names of the obstacles that the arm may touch.
        margin: gap beyond the required clearance that planning keeps [m].
        reach: gap below which contacts are reported [m].
    """

    def __init__(self, arm: Arm, names: Sequence[str], margin: float, reach: float) -> None:
        self.arm = arm
        self.names = names
        self.margin = margin
        self.reach = reach
        self._latest: tuple[FloatArray, Contacts] | None = None

    def find(self, points: FloatArray) -> Contacts:
        """Return the contacts in a pose with a gap below the search distance ``reach``.

        Args:
            points: joint and tip positions, shape (links + 1, d) [m].
        """
        # By identity, not by value: a step and its check ask about the same array twice. Callers must not change arrays
        # of points in place.
        if self._latest is None or self._latest[0] is not points:
            self._latest = (points, self._found(points))
        return self._latest[1]

    @abstractmethod
    def _found(self, points: FloatArray) -> Contacts:
        """Return what ``find`` does, for points about which it was not asked last."""

    def crosses(self, points: FloatArray) -> bool:
        """Return whether a link crosses an obstacle, or a link far along the arm, although no gap shows this.

        By default the result is False: in space, the distance from a crossed triangle is 0, so the gaps show it.

        Args:
            points: joint and tip positions, shape (links + 1, d) [m].
        """
        del points
        return False

    def describe(self, contacts: Contacts) -> str:
        """Return text on the contact with the least gap beyond its margin; "nothing near" without contacts."""
        tightest = self.tightest(contacts)
        if tightest is None:
            return "nothing near"
        return describe_clearance(*tightest)

    def tightest(self, contacts: Contacts) -> tuple[str, str, float] | None:
        """Return the contact with the least gap beyond its margin; None without contacts.

        The contact is given as the name of the link, that of the obstacle or link near it, and the gap [m].
        """
        if len(contacts) == 0:
            return None
        return self.named(contacts, int(np.argmin(contacts.gap - contacts.margin)))

    def named(self, contacts: Contacts, k: int) -> tuple[str, str, float]:
        """Return the name of the link of contact k, that of the obstacle or link near it, and the gap [m]."""
        wall = contacts.second[k] == WALL
        other = f"'{self.names[contacts.wall[k]]}'" if wall else self.arm.link_name(contacts.second[k])
        return self.arm.link_name(contacts.first[k]), other, float(contacts.gap[k])


def describe_clearance(link: str, other: str, gap: float) -> str:
    """Return text on the gap [m] between a link and a body, given by their names; a negative gap is "too near"."""
    if gap < 0.0:
        return f"{link} is {short_length(-gap)} too near to {other}"
    return f"{link} to {other}, clearance {short_length(gap)}"


class WallFinder(ContactFinder):
    """Finds contacts of a planar arm with walls, and between its links.

    Args:
        arm: the arm.
        walls: the walls.
        clearance: clearance required from walls beyond the radius [m].
        margin: gap beyond the required clearance that planning keeps [m].
        reach: gap below which contacts are reported [m].
    """

    def __init__(self, arm: Arm, walls: Walls, clearance: float, margin: float, reach: float) -> None:
        super().__init__(arm, walls.names, margin, reach)
        self.walls = walls
        link, at = arm.mount_end
        self._points = np.empty((arm.links + 1, 2))
        self._call = NativeCall(
            "near_pairs",
            links=arm.links, mount_link=link, mount_at=at, mean_length=arm.link_length, lengths=arm.lengths,
            longest=float(np.max(arm.lengths)), radii=arm.radii, thickest=arm.radius,
            next_pair=arm.next_self_pairs, reach=reach, margin=margin,
            starts=arm.margin_starts, ends=arm.margin_ends, pair_share=LINK_MARGIN_SHARE,
            edge_tree=walls.edge_tree.for_c(), vertex_tree=walls.vertex_tree.for_c(),
            edges=walls.edges, vertices=walls.vertices, edge_wall=walls.edge_wall, vertex_wall=walls.vertex_wall,
            walls=len(walls.names), clearance=clearance, rounding=walls.rounding,
            most_rounding=float(walls.rounding.max()),
            found=np.zeros(max(len(walls.edges), len(walls.vertices)), dtype=np.int64),
            runs=np.zeros(4 * (arm.links // _RUN + 1)),
            points=self._points,
        )  # fmt: skip
        self._grow_capacity(64)

    def _found(self, points: FloatArray) -> Contacts:
        """Return the contacts in a pose with a gap below ``reach``; points have shape (links + 1, 2) [m]."""
        self._points[:] = points
        self._call()
        m = self._call.fields.count
        if m > self._call.fields.capacity:
            self._grow_capacity(2 * m)
            self._call()
        return Contacts(*(getattr(self._room, each.name)[:m].copy() for each in fields(Contacts)))

    def crosses(self, points: FloatArray) -> bool:
        """Return whether any link crosses an edge of a wall or another link; points have shape (links + 1, 2) [m]."""
        self.find(points)
        return bool(self._call.fields.crosses)

    def _grow_capacity(self, capacity: int) -> None:
        """Allocate result arrays for a given number of contacts."""
        first, second, wall = np.empty((3, capacity), dtype=np.int64)
        first_at, second_at, gap, margin = np.empty((4, capacity))
        normal = np.empty((capacity, 2))
        self._room = Contacts(first, first_at, second, second_at, normal, gap, margin, wall)
        self._call.set(
            capacity=capacity, first=first, second=second, wall=wall, first_at=first_at, second_at=second_at, gap=gap,
            pair_margins=margin, normal=normal,
        )  # fmt: skip


class SurfaceFinder(ContactFinder):
    """Finds contacts of an arm in space with surfaces, and between its links.

    Args:
        arm: the arm.
        tree: distance tree of the surfaces.
        names: names of the obstacles to which the surfaces belong.
        clearance: clearance required from surfaces beyond the radius [m].
        margin: gap beyond the required clearance that planning keeps [m].
        reach: gap below which contacts are reported [m].
    """

    def __init__(
        self, arm: Arm, tree: SurfaceTree, names: Sequence[str], clearance: float, margin: float, reach: float
    ) -> None:
        super().__init__(arm, names, margin, reach)
        self.tree = tree
        self.kept = arm.radii + clearance
        self._pairs = NativeCall("near_links", links=arm.links, next_pair=arm.next_self_pairs)
        self._grow_capacity(256)

    def _found(self, points: FloatArray) -> Contacts:
        """Return the contacts in a pose with a gap below ``reach``; points have shape (links + 1, 3) [m].

        Each contact with a surface comes from a half-space that contains the link and is free of surfaces.
        """
        mounted, segments = self.arm.exposed_links(points)
        begins = self.arm.mount_end[1]
        planes = self.tree.planes(segments, float(np.max(self.kept)) + self.reach, _PLANES)
        share = np.where(planes.link == 0, begins + (1.0 - begins) * planes.share, planes.share)
        count = len(planes.gap)
        link = planes.link + mounted
        walls = Contacts(
            link, share, np.full(count, WALL), np.zeros(count), planes.normal, planes.gap - self.kept[link],
            np.full(count, self.margin), planes.owner,
        )  # fmt: skip
        if self.arm.proportions is not None:
            walls = walls.take(walls.gap < self.reach)
        if not self.arm.self_collision:
            return walls
        links = self.near_links(points, self.reach)
        joined = ([getattr(part, each.name) for part in (walls, links)] for each in fields(Contacts))
        return Contacts(*(np.concatenate(parts) for parts in joined))

    def near_links(self, points: FloatArray, reach: float) -> Contacts:
        """Return the contacts between links far enough apart along the arm to collide, with a gap below ``reach`` [m].

        ``points`` are the positions of the joints and the tip, shape (links + 1, 3) [m].
        """
        self._pairs.set(points=checked_joints(self.arm, points[None])[0], reach=2.0 * self.arm.radius + reach)
        self._pairs()
        if self._pairs.fields.count > self._pairs.fields.capacity:
            self._grow_capacity(2 * self._pairs.fields.count)
            self._pairs()
        k = self._pairs.fields.count
        first, second = self._numbers[:, :k].copy()
        first_at, second_at, distance = self._reals[:, :k].copy()
        margin = self.arm.link_margins(first, second, self.margin)
        normal = self._normals[:k].copy()
        gap = distance - (self.arm.radii[first] + self.arm.radii[second])
        links = Contacts(first, first_at, second, second_at, normal, gap, margin, np.full(k, len(self.names)))
        return links if self.arm.proportions is None else links.take(gap < reach)

    def _grow_capacity(self, capacity: int) -> None:
        """Allocate result arrays for a given number of pairs of links."""
        self._numbers = np.zeros((2, capacity), dtype=np.int64)
        self._reals = np.zeros((3, capacity))
        self._normals = np.zeros((capacity, 3))
        first, second = self._numbers
        first_at, second_at, distance = self._reals
        self._pairs.set(
            capacity=capacity, first=first, second=second, first_at=first_at, second_at=second_at, distance=distance,
            normal=self._normals,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class NearestLinks:
    """The nearest pair of links in each of T poses in space, among pairs far enough apart along the arm to collide.

    Attributes:
        first: index of the link nearer to the base; −1 if no pair is within the search distance, shape (T,).
        second: index of the other link; −1 if no pair is within the search distance, shape (T,).
        gap: gap between the surfaces, capped at the search distance, shape (T,) [m].
    """

    first: IntArray
    second: IntArray
    gap: FloatArray


def nearest_links(arm: Arm, points: FloatArray, reach: float) -> NearestLinks:
    """Return, for every pose, the nearest pair of links that are far enough apart along the arm to collide.

    Of equally near pairs, the first counts.

    Args:
        arm: the arm.
        points: joints and tip in T poses, shape (T, links + 1, 3) [m].
        reach: search distance; pairs with at least this gap between their surfaces are left out [m].
    """
    poses = len(checked_joints(arm, points))
    first, second = np.full((2, poses), -1, dtype=np.int64)
    nearest = NearestLinks(first, second, np.full(poses, float(reach)))
    NativeCall(
        "nearest_links",
        links=arm.links, next_pair=arm.next_self_pairs, poses=poses, reach=reach, radii=arm.radii,
        points=points, **vars(nearest),
    )()  # fmt: skip
    return nearest


def checked_joints(arm: Arm, points: FloatArray) -> FloatArray:
    """Return joint and tip positions unchanged, after checking their shape for the C code.

    Raises:
        ValueError: the shape is not (T, links + 1, 3).
    """
    if points.ndim != 3 or points.shape[1:] != (arm.links + 1, 3):
        raise ValueError(f"joints have the shape {points.shape[1:]}; expected ({arm.links + 1}, 3)")
    return points
