"""Checks of an arm's clearance from obstacles at all times: from edges in the plane, from triangles in space."""

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.length_words import short_length
from ccm_opt.core.native import NativeCall
from ccm_opt.problem.solution import Check, NearPlace
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import ROOM_NAME, Workspace
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.body_sides import depth_enclosed, separations
from ccm_opt.verification.chain_motion import ChainMotion, TimeIntervals
from ccm_opt.verification.consistency import distance_rounding
from ccm_opt.verification.gap_proof import (
    BLOCK,
    Measured,
    Nearest,
    Pairs,
    Verdict,
    least_allowed_gap,
    prove_gaps,
)
from ccm_opt.verification.selfcollision import link_number, link_word, segment_distances
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

TOUCHING = 1e-4
"""Gap, as a fraction of the arm's radius, up to which a report says that the arm touches."""
_PROBES = 8
"""Number of sample times at which the nearest surface is searched for first. Heuristic."""
_FAN = 8
"""Largest number of children of a box in the bounding-box tree."""
_ALONG = 0.01
"""Largest fraction of a link's travel that is sideways while the link still counts as sliding along its axis.
Heuristic."""


@dataclass(frozen=True, eq=False)
class CheckedSurfaces:
    """A bounding-box tree of wall edges (d = 2) or triangles (d = 3), stored level by level from the top.

    Each box of the last level holds a single edge or triangle (a part).

    Attributes:
        low: lower corners of the boxes, shape (nodes, d) [m].
        high: upper corners of the boxes, shape (nodes, d) [m].
        rounding: largest radius by which the parts in each box are inflated, shape (nodes,) [m].
        offsets: index of the first box of every level, followed by the number of boxes, shape (levels + 1,).
        parts: corners of the m parts in the order of the last level, shape (m, d, d) [m].
        owner: index of the obstacle to which each part belongs, shape (m,).
        names: names of the obstacles.
    """

    low: FloatArray
    high: FloatArray
    rounding: FloatArray
    offsets: IntArray
    parts: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @classmethod
    def from_workspace(cls, workspace: Workspace) -> "CheckedSurfaces":
        """Return the tree of all obstacles of a workspace, with parts of similar size and position in common boxes.

        In space the tree is built once for all motions among the same triangles.
        """
        if workspace.dimension == 2:
            return cls._over(*edges_of(workspace))
        soup = workspace.triangle_soup
        if soup not in _TREES:
            _TREES[soup] = cls._over(soup.triangles, soup.rounding, soup.owner, soup.names)
        return _TREES[soup]

    @classmethod
    def _over(
        cls, parts: FloatArray, rounding: FloatArray, owner: IntArray, names: tuple[str, ...]
    ) -> "CheckedSurfaces":
        order = _by_size_and_place(parts)
        parts = parts[order]
        levels = [(parts.min(axis=1), parts.max(axis=1), rounding[order])]
        while len(levels[-1][0]) > 1:
            low, high, radius = levels[-1]
            starts = np.arange(0, len(low), _FAN)
            above = (np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts))
            levels.append((*above, np.maximum.reduceat(radius, starts)))
        levels.reverse()
        low, high, radius = (np.concatenate(part) for part in zip(*levels, strict=True))
        offsets = np.cumsum([0, *(len(level[0]) for level in levels)])
        return cls(low, high, radius, offsets, parts, owner[order], names)

    @cached_property
    def size(self) -> float:
        """Greatest magnitude of any coordinate of a surface [m]."""
        return float(np.max(np.abs(self.parts)))

    def name_of(self, node: int) -> str:
        """Return the name of the obstacle whose edge or triangle is in a box of the last level."""
        return str(self.names[self.owner[node - self.offsets[-2]]])

    def is_single(self, node: IntArray) -> BoolArray:
        """Return a mask of the boxes that hold a single edge or triangle, shape (P,)."""
        return np.asarray(node >= self.offsets[-2])

    def children(self, node: IntArray) -> tuple[IntArray, IntArray]:
        """Return the position of each child's parent in `node`, and the children of the boxes, each of shape (Q,)."""
        level = np.searchsorted(self.offsets, node, side="right") - 1
        first = self.offsets[level + 1] + _FAN * (node - self.offsets[level])
        count = np.minimum(self.offsets[level + 2] - first, _FAN)
        place = np.repeat(np.arange(len(node)), count)
        within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
        return place, first[place] + within

    def bounds(self, node: IntArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds on the distances of P segments from the parts in one box each, each (P,) [m].

        The inflation of the parts is not subtracted.

        Args:
            node: indices of the boxes, shape (P,).
            start: starts of the segments, shape (P, d) [m].
            end: ends of the segments, shape (P, d) [m].
        """
        least, most = np.empty(len(node)), np.empty(len(node))
        NativeCall(
            "box_bounds", count=len(node), dimension=self.low.shape[1], node=node, start=start, end=end,
            low=self.low, high=self.high, least=least, most=most,
        )()  # fmt: skip
        return least, most

    def separations(self, node: IntArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return tight distance bounds of segments from the single parts in boxes; arguments as for ``bounds``."""
        return self.between(start, end, self.edge_parts(node))

    def edge_parts(self, node: IntArray) -> FloatArray:
        """Return the corners of the edges or triangles in P boxes of the last level, shape (P, d, d) [m]."""
        return np.asarray(self.parts[node - self.offsets[-2]])

    @staticmethod
    def between(start: FloatArray, end: FloatArray, parts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds on the distances of segments (P, d) from parts (P, d, d), each (P,) [m]."""
        if parts.shape[1] == 2:
            distance = segment_distances(start, end, parts[:, 0], parts[:, 1])
            return distance, distance
        return separations(start, end, parts)

    @cached_property
    def diagonals(self) -> FloatArray:
        """Lengths of the diagonals of all bounding boxes, shape (nodes,) [m]."""
        return lengths_of(self.high - self.low)


_TREES: WeakKeyDictionary[TriangleSoup, CheckedSurfaces] = WeakKeyDictionary()


def edges_of(workspace: Workspace) -> tuple[FloatArray, FloatArray, IntArray, tuple[str, ...]]:
    """Return end points, radii and wall indices of all edges in a planar workspace, and the names of the walls.

    End points have shape (E, 2, 2) [m], radii by which edges are inflated (E,) [m], and wall indices (E,).
    """
    walls = workspace.walls
    pieces = [np.concatenate([_part_edges(part) for part in shapely.get_parts(wall.core)]) for wall in walls]
    counts = [len(piece) for piece in pieces]
    rounding = np.repeat([wall.rounding for wall in walls], counts)
    owner = np.repeat(np.arange(len(walls)), counts)
    return np.concatenate(pieces), rounding, owner, tuple(wall.name for wall in walls)


def _part_edges(part: shapely.Geometry) -> FloatArray:
    """Return the edges of a polygon, line or point, shape (E, 2, 2) [m]; a point is an edge of zero length."""
    if isinstance(part, shapely.Polygon):
        return np.concatenate([_part_edges(ring) for ring in (part.exterior, *part.interiors)])
    points = shapely.get_coordinates(part)
    if len(points) == 1:
        return np.repeat(points[None], 2, axis=1)
    return np.stack((points[:-1], points[1:]), axis=1)


def _by_size_and_place(parts: FloatArray) -> IntArray:
    """Return an order of m edges or triangles with similar size and position next to each other, as indices (m,)."""
    low = parts.min(axis=1)
    high = parts.max(axis=1)
    extent = high.max(axis=0) - low.min(axis=0)
    span = max(float(extent.max()), np.finfo(np.float64).tiny)
    # Large triangles would enlarge the boxes of nearby fine meshes, so parts are grouped by size first.
    size = lengths_of(high - low) / span
    kind = np.floor(np.log2(np.maximum(size, 1e-6)) / 3.0)
    cells = ((0.5 * (low + high) - low.min(axis=0)) / span * 1023.0).astype(np.int64)
    number = np.zeros(len(parts), dtype=np.int64)
    dimension = cells.shape[1]
    for bit in range(10):
        for axis in range(dimension):
            number |= (cells[:, axis] >> bit & 1) << dimension * bit + axis
    return np.lexsort((number, kind))


def check_walls(
    motion: ChainMotion,
    workspace: Workspace,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check that the arm beyond its mount keeps the required clearance from every wall at all times."""
    found = nearest_wall(motion, workspace, settings)
    if found is None:
        mount = np.all(exposed_starts(motion.arm) == 1.0)
        why = "the whole arm counts as its mount" if mount else "there is no wall"
        return Check("wall clearance", np.inf, workspace.clearance, "m", why, passed=True)
    verdict, wall = found
    near = verdict.nearest
    remark = verdict.remark or touch_beside_mount(motion.arm, near.link, near.gap)
    # Contact at a flush mount hides the clearance of the links beyond it, so the remark adds it.
    if not verdict.remark and remark and (beyond := nearest_wall(motion, workspace, settings, near.link + 1)):
        remark += f"; links beyond it keep {short_length(beyond[0].nearest.gap)} from {beyond[1]!r}"
    name = link_word(motion.arm, near.link)
    where = f"{name} to {wall!r} at t = {near.time:.4f} s"
    return Check(
        "wall clearance",
        near.gap,
        workspace.clearance,
        "m",
        f"{where}: {remark}" if remark else where,
        passed=verdict.proved,
        place=NearPlace(
            near.gap - workspace.clearance,
            0.0,
            near.time,
            link_number(motion.arm, near.link),
            obstacle=wall,
            name=name,
        ),
    )


def nearest_wall(
    motion: ChainMotion,
    workspace: Workspace,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
    first: int = 0,
) -> tuple[Verdict, str] | None:
    """Return the verdict on the arm's clearance from walls, and the name of the nearest wall.

    The result is None if there is nothing to check, for example if the whole arm belongs to its mount.

    Args:
        motion: motion of the arm.
        workspace: the walls.
        settings: settings of the verifier.
        first: index of the first link to check, from 0.
    """
    exposed = exposed_starts(motion.arm)
    exposed[:first] = 1.0
    if motion.arm.tool_links is not None:
        exposed[motion.arm.tool_links.bare] = 1.0
    if np.all(exposed == 1.0) or is_empty(workspace):
        return None
    surfaces = CheckedSurfaces.from_workspace(workspace)
    least = least_allowed_gap(workspace.clearance, motion.arm.thinnest, settings)
    verdict = WallProof(motion, surfaces, exposed).prove(least, settings)
    return verdict, surfaces.name_of(verdict.nearest.other)


def exposed_starts(arm: Arm) -> FloatArray:
    """Return the fraction of each link that belongs to the mount and may touch walls, from 0 to 1, shape (links,).

    The exposed part of a link starts at this fraction. ``Arm.mount_end`` gives the end of the mount; the verifier
    deliberately does not use it.
    """
    shares = arm.lengths / arm.link_length
    bodies = arm.tool_links
    starts = np.cumsum(shares) - shares
    within = np.clip((arm.mount_length / arm.link_length - starts) / shares, 0.0, 1.0)
    if bodies is not None:
        # Links of the arm follow on each other, whatever is fixed to them; bodies are never part of the mount.
        own = bodies.own
        starts = np.cumsum(shares[own]) - shares[own]
        within[:] = 0.0
        within[own] = np.clip((arm.mount_length / arm.link_length - starts) / shares[own], 0.0, 1.0)
    # What rounding leaves of a link whose end is that of the mount is not there.
    return np.where(within > 1.0 - 1e-9, 1.0, within)


def touch_beside_mount(arm: Arm, link: int, gap: float) -> str:
    """Return a remark if a link with a given gap [m] touches a wall at the end of the mount; otherwise ""."""
    leaves = arm.joint_places[link] <= arm.mount_length < arm.joint_places[link + 1]
    return "touches it where it leaves the mount" if leaves and abs(gap) <= TOUCHING * arm.radii[link] else ""


def is_empty(workspace: Workspace) -> bool:
    """Return whether a workspace contains nothing that an arm could touch."""
    return workspace.dimension == 3 and len(workspace.triangle_soup) == 0


def link_axes(poses: FloatArray, pairs: Pairs, exposed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the starts and ends of link axes, without the parts that belong to the mount, each of shape (P, d) [m].

    Args:
        poses: positions of joints and tip in S poses, shape (S, links + 1, d) [m].
        pairs: P pairs; ``interval`` selects the pose and ``link`` the link.
        exposed: fraction of each link that belongs to the mount, shape (links,).
    """
    points = poses.reshape(-1, poses.shape[2])
    joint = pairs.interval * poses.shape[1] + pairs.link
    end = points.take(joint + 1, axis=0)
    start = points.take(joint, axis=0)
    start += exposed.take(pairs.link)[:, None] * (end - start)
    return start, end


class WallProof:
    """A proof, for all times of a motion, that links keep a gap to the surfaces of a scene.

    Args:
        motion: motion of the arm.
        surfaces: bounding-box tree of the scene's surfaces.
        exposed: fraction of each link that belongs to the mount and may touch walls, shape (links,).
    """

    def __init__(self, motion: ChainMotion, surfaces: CheckedSurfaces, exposed: FloatArray) -> None:
        self.motion = motion
        self.surfaces = surfaces
        self._exposed = exposed
        self._length_loss = motion.rounding + distance_rounding(max(surfaces.size, motion.size))

    def prove(self, least: float, settings: VerificationSettings, nearest: Nearest | None = None) -> Verdict:
        """Prove that all links keep a gap of at least ``least`` [m] from walls; see ``prove_gaps``."""
        samples = len(self.motion.time)
        # The least gap at a few moments bounds how far the full search must look.
        moments = self._all_link_pairs(TimeIntervals.moments(samples, _PROBES), least, settings, nearest)
        if moments.nearest.gap < least:
            return moments
        return self._all_link_pairs(TimeIntervals.blocks(samples, BLOCK), least, settings, moments.nearest)

    def _all_link_pairs(
        self, intervals: TimeIntervals, least: float, settings: VerificationSettings, nearest: Nearest | None
    ) -> Verdict:
        links = np.flatnonzero(self._exposed < 1.0)
        pairs = Pairs.in_all(len(intervals), links, np.zeros_like(links))
        return prove_gaps(self.motion, intervals, pairs, self.measure, least, settings, self.opened, nearest)

    def measure(
        self, intervals: TimeIntervals, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """Return bounds on the gaps of P links to bounding boxes, edges or triangles over time intervals.

        Args:
            intervals: S time intervals.
            poses: positions of joints and tip at mid-interval, shape (S, links + 1, d) [m].
            pairs: the pairs of a link and a box, each with its time interval.
            cutoff: gap above which bounds may be rough; a number or of shape (P,) [m].
        """
        arm, surfaces = self.motion.arm, self.surfaces
        least, most, travel = np.empty((3, len(pairs)))
        exact = np.empty(len(pairs), dtype=bool)
        cutoff = np.broadcast_to(cutoff, len(pairs))
        deviation = self.motion.deviation_bounds(intervals, pairs.interval, pairs.link)
        NativeCall(
            "link_boxes", count=len(pairs), dimension=poses.shape[2], joints=poses.shape[1],
            single=surfaces.offsets[-2], interval=pairs.interval, link=pairs.link, node=pairs.other, poses=poses,
            travels=self.motion.travels(intervals), exposed=self._exposed, radii=arm.radii, low=surfaces.low,
            high=surfaces.high, rounding=surfaces.rounding, loss=self._length_loss,
            deviation=np.broadcast_to(deviation, len(pairs)), cutoff=cutoff, least=least, most=most, travel=travel,
            near=exact,
        )()  # fmt: skip
        # Parts whose boxes are far enough away need no exact distance.
        chosen = np.flatnonzero(exact)
        near = pairs.where(chosen)
        start, end = link_axes(poses, near, self._exposed)
        low, high = surfaces.separations(near.other, start, end)
        thick = arm.radii.take(near.link) + surfaces.rounding.take(near.other)
        taken = thick + self._length_loss + np.broadcast_to(deviation, len(pairs))[chosen]
        low = low - taken
        moved = travel[chosen]
        if arm.base_axes:
            close = np.flatnonzero((low - moved < cutoff[chosen]) & (moved > 0.0))
            self._slide(intervals, near, close, start, end, taken, low, moved)
        least[chosen], most[chosen], travel[chosen] = low - moved, high - thick, moved
        return Measured(least, most, travel, exact)

    def _slide(
        self,
        intervals: TimeIntervals,
        pairs: Pairs,
        close: IntArray,
        start: FloatArray,
        end: FloatArray,
        taken: FloatArray,
        low: FloatArray,
        travel: FloatArray,
    ) -> None:
        """Tighten ``low`` and ``travel`` in place for links that slide along their own axis.

        Such a link, as in a guide tube, sweeps a longer link and hardly moves sideways, so its gap is that of the
        longer link, and its travel is the sideways part alone.
        """
        interval, link = pairs.interval[close], pairs.link[close]
        within = (intervals.high - intervals.low)[interval] <= 1.0
        close, interval, link = close[within], interval[within], link[within]
        if len(close) == 0:
            return
        chords = self.motion.poses(intervals.high) - self.motion.poses(intervals.low)
        line = end[close] - start[close]
        ahead = line / np.maximum(lengths_of(line), np.finfo(np.float64).tiny)[:, None]
        # From mid-interval to either end a joint moves half its chord; the component along the link is not sideways.
        aside = np.zeros(len(close))
        for joint in (link, link + 1):
            chord = chords[interval, joint]
            along = np.einsum("pd,pd->p", chord, ahead)
            across = lengths_of(chord - along[:, None] * ahead)
            aside = np.maximum(aside, travel[close] - 0.5 * (lengths_of(chord) - across))
        slides = aside < _ALONG * travel[close]
        close, ahead = close[slides], travel[close[slides], None] * ahead[slides]
        longer, _ = self.surfaces.separations(pairs.other[close], start[close] - ahead, end[close] + ahead)
        low[close] = longer - taken[close]
        travel[close] = aside[slides]

    def opened(self, pairs: Pairs, travel: FloatArray) -> tuple[Pairs, BoolArray]:
        """Return pairs with the children of boxes larger than their link's travel, and a mask of the boxes replaced."""
        surfaces = self.surfaces
        size = surfaces.diagonals.take(pairs.other)
        boxes = ~surfaces.is_single(pairs.other) & ((size > travel) | (size == 0.0))
        place, child = surfaces.children(pairs.other[boxes])
        closed = pairs.where(boxes)
        return Pairs(closed.interval[place], closed.link[place], child), boxes


def check_free_side(motion: ChainMotion, workspace: Workspace) -> Check:
    """Check that the arm lies inside the room and outside all solid obstacles.

    Testing one point of the arm is enough, since an arm that never meets a closed surface cannot change sides along its
    length or over time; and one point of every body of a tool that is not joined to what is before it.

    Returns:
        A check whose worst value is minus the depth of the tested points in forbidden space [m].
    """
    arm = motion.arm
    # The point is where the mount ends, since the mount itself may be inside a wall.
    ends = arm.joint_places[1:]
    k = min(int(np.searchsorted(ends, arm.mount_length, side="right")), arm.links - 1)
    share = float(exposed_starts(arm)[k])
    joints = motion.points[0]
    tested = [(k, joints[k] + share * (joints[k + 1] - joints[k]))]
    if arm.tool_links is not None:
        bare = arm.tool_links.bare
        tested += [(int(link), joints[link]) for link in np.flatnonzero(bare[:-1] & ~bare[1:]) + 1]
    depths_in = _depths if workspace.dimension == 2 else _depths_in_space
    depths = [(*found, link) for link, point in tested for found in depths_in(workspace, point)]
    depth, worst, link = max([*depths, (0.0, "", k)], key=lambda found: found[0])
    side = f", on the wrong side of {worst!r}" if depth > 0.0 else ""
    return Check("free side", 0.0 - depth, 0.0, "m", f"{link_word(arm, link)} at t = 0{side}", passed=depth <= 0.0)


def _depths(workspace: Workspace, point: FloatArray) -> list[tuple[float, str]]:
    place = shapely.points(point)
    # A point on the boundary has depth 0, which is allowed here; the clearance is checked elsewhere.
    depths = [
        (float(shapely.distance(shapely.boundary(each.core), place)), each.name)
        for each in workspace.obstacles
        if shapely.contains_properly(each.core, place)
    ]
    return [*depths, (float(shapely.distance(workspace.boundary, place)), workspace.walls[-1].name)]


def _depths_in_space(workspace: Workspace, point: FloatArray) -> list[tuple[float, str]]:
    solid = [each for each in workspace.obstacles if each.body.solid]
    depths = [(depth_enclosed(each.body.triangles, point), each.name) for each in solid]
    if workspace.bounds is not None:
        beyond = np.concatenate((workspace.bounds[0] - point, point - workspace.bounds[1]))
        depths.append((float(np.max(beyond)), ROOM_NAME))
    return depths
