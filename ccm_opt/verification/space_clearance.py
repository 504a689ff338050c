"""Clearance of an arm in space at all times: from surfaces, and of its links from each other."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.surfaces import SurfaceSoup
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution import Check, NearPlace
from ccm_opt.verification.body_sides import depth_enclosed, separations
from ccm_opt.verification.consistency import distance_rounding
from ccm_opt.verification.space_chain_motion import SpaceChainMotion, TimeStretches, lengths_of
from ccm_opt.verification.stretch_proof import (
    DEFAULT_SPACE_PROOF,
    Measured,
    Nearest,
    SpaceProofSettings,
    StretchPairs,
    Verdict,
    least_allowed_gap,
    prove_stretches,
)
from ccm_opt.verification.verification_settings import VerificationSettings
from ccm_opt.verification.wall_clearance import gap_beyond, touch_beside_mount

_PROBES = 8
"""Moments at which the nearest surface is looked for first. Taste."""


def check_contact(
    motion: SpaceChainMotion, settings: VerificationSettings, proof: SpaceProofSettings = DEFAULT_SPACE_PROOF
) -> Check:
    """Check that links far apart along the arm never touch, and that nearer ones do not cross."""
    arm = motion.arm
    distant = first_apart(arm.link_length, arm.radius)
    blocks = TimeStretches.blocks(len(motion.time), proof.block)
    crossing = _crossing(motion, distant, settings)
    if distant >= arm.links:
        where = crossing or "the arm is too short to meet itself"
        return Check("self-collision", np.inf, 0.0, "m", where, passed=not crossing)
    first, second = np.triu_indices(arm.links, distant)
    stretch = np.repeat(np.arange(len(blocks)), len(first))
    pairs = StretchPairs(stretch, np.tile(first, len(blocks)), np.tile(second, len(blocks)))
    thickness = 2.0 * arm.radius
    least = least_allowed_gap(0.0, thickness, settings)
    verdict = _prove(motion, blocks, pairs, thickness, least, settings)
    near = verdict.nearest
    where = f"link {near.link + 1} to link {near.other + 1} at t = {near.time:.4f} s"
    where = "; ".join(part for part in (where, verdict.remark, crossing) if part)
    place = NearPlace(near.gap, 0.0, near.time, near.link + 1, second_link=near.other + 1)
    passed = verdict.proved and not crossing
    return Check("self-collision", near.gap, 0.0, "m", where, passed=passed, place=place)


def first_apart(link_length: float, radius: float) -> int:
    """Least j − i of links that must keep apart: the least d with (d − 1) l ≥ max(2 l, π r)."""
    reach = max(2.0 * link_length, np.pi * radius)
    return next(apart for apart in range(1, 10**6) if (apart - 1) * link_length >= reach * (1.0 - 1e-12))


def _prove(
    motion: SpaceChainMotion,
    stretches: TimeStretches,
    pairs: StretchPairs,
    thickness: float,
    least: float,
    settings: VerificationSettings,
) -> Verdict:
    lost = 2.0 * motion.rounding + distance_rounding(float(np.max(np.abs(motion.points))))

    def measure(some: TimeStretches, poses: FloatArray, which: StretchPairs, _cutoff: float) -> Measured:
        k = which.stretch
        i = which.link
        j = which.other
        distance = axis_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1]) - thickness
        travel = relative_travels(motion, some, which)
        off = motion.off(some, k, i) + motion.off(some, k, j)
        return Measured(distance - lost - off, distance, travel, np.ones(len(which), dtype=bool))

    return prove_stretches(motion, stretches, pairs, measure, least, settings)


def relative_travels(motion: SpaceChainMotion, stretches: TimeStretches, pairs: StretchPairs) -> FloatArray:
    """How much nearer two links may come than they are at the middle, shape (P,) [m]."""
    travels = motion.travels(stretches)
    k = pairs.stretch
    i = pairs.link
    j = pairs.other
    apart = np.maximum(travels[k, i], travels[k, i + 1]) + np.maximum(travels[k, j], travels[k, j + 1])
    # Within an interval what both do alike does not count.
    within = np.flatnonzero((stretches.high - stretches.low)[k] <= 1.0)
    chords = motion.poses(stretches.high) - motion.poses(stretches.low)
    bows = 2.0 * travels - lengths_of(chords)
    k, i, j = k[within], i[within], j[within]
    relative = np.zeros(len(within))
    for first in (i, i + 1):
        for second in (j, j + 1):
            chord = lengths_of(chords[k, first] - chords[k, second])
            relative = np.maximum(relative, 0.5 * (chord + bows[k, first] + bows[k, second]))
    apart[within] = np.minimum(apart[within], relative)
    return np.asarray(apart)


def axis_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Distances of segments a–b from segments c–d, all shape (P, 3), shape (P,) [m].

    The squared distance is convex in both shares: either it is least inside of both, or on an end of one of them.
    """
    ends = [_from_segment(point, start, end) for point, start, end in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]
    line = b - a
    other = d - c
    offset = a - c
    normal = np.cross(line, other)
    square = np.einsum("pd,pd->p", normal, normal)
    safe = np.where(square > 0.0, square, 1.0)
    share = -np.einsum("pd,pd->p", np.cross(offset, other), normal) / safe
    at = -np.einsum("pd,pd->p", np.cross(offset, line), normal) / safe
    inside = (square > 0.0) & (share >= 0.0) & (share <= 1.0) & (at >= 0.0) & (at <= 1.0)
    between = lengths_of(offset + share[:, None] * line - at[:, None] * other)
    return np.asarray(np.minimum(np.min(ends, axis=0), np.where(inside, between, np.inf)))


def _from_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    line = end - start
    square = np.einsum("pd,pd->p", line, line)
    share = np.einsum("pd,pd->p", point - start, line) / np.where(square > 0.0, square, 1.0)
    return lengths_of(start + np.clip(share, 0.0, 1.0)[:, None] * line - point)


def _crossing(motion: SpaceChainMotion, distant: int, settings: VerificationSettings) -> str:
    """Where two links cross that share no joint and are too near along the arm to be kept apart; empty if none do.

    Axes that meet close a polygon, which turns by 2 π at least (Fenchel), of which the bends between them are all but
    half a turn: where these add up to less than π nothing is to be proved.
    """
    links = motion.arm.links
    bends = np.abs(motion.positions[:, : 2 * links]).reshape(-1, links, 2).sum(axis=2)
    total = np.concatenate((np.zeros((len(bends), 1)), np.cumsum(bends, axis=1)), axis=1)
    found = [np.zeros((3, 0), dtype=np.intp)]
    for apart in range(2, min(distant, links)):
        between = total[:, 1 + apart :] - total[:, 1:-apart]
        # Sizes of bends are convex in time between samples, so that they are greatest at one of these.
        interval, link = np.nonzero(np.maximum(between[:-1], between[1:]) >= np.pi - settings.half_turn_rounding)
        found.append(np.stack((interval, link, link + apart)))
    interval, first, second = np.concatenate(found, axis=1)
    if len(interval) == 0:
        return ""
    kept, stretch = np.unique(interval, return_inverse=True)
    stretches = TimeStretches(kept.astype(np.float64), kept + 1.0)
    pairs = StretchPairs(stretch, first, second)
    verdict = _prove(motion, stretches, pairs, 0.0, settings.touch, settings)
    near = verdict.nearest
    does = "may cross" if verdict.remark else "crosses"
    return "" if verdict.proved else f"link {near.link + 1} {does} link {near.other + 1} at t = {near.time:.4f} s"


_FAN = 8
"""Boxes in a box."""


@dataclass(frozen=True, eq=False)
class CheckedSurfaces:
    """Boxes level by level from the top, of which the last are those of single triangles.

    Attributes:
        low: lower corners of the boxes, shape (nodes, 3) [m].
        high: upper corners, likewise.
        rounding: the largest radius of what is about the triangles in a box, shape (nodes,) [m].
        offsets: number of the first box of every level, then that of all boxes, shape (levels + 1,).
        triangles: in the order of the last level, shape (m, 3, 3) [m].
        owner: number of the triangles' owners, likewise, shape (m,).
    """

    low: FloatArray
    high: FloatArray
    rounding: FloatArray
    offsets: IntArray
    triangles: FloatArray
    owner: IntArray

    @classmethod
    def of(cls, soup: SurfaceSoup) -> "CheckedSurfaces":
        """The boxes over at least one triangle: of about one size and place in the lower levels."""
        order = _by_size_and_place(soup.triangles)
        triangles = soup.triangles[order]
        levels = [(triangles.min(axis=1), triangles.max(axis=1), soup.rounding[order])]
        while len(levels[-1][0]) > 1:
            low, high, rounding = levels[-1]
            starts = np.arange(0, len(low), _FAN)
            above = (np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts))
            levels.append((*above, np.maximum.reduceat(rounding, starts)))
        levels.reverse()
        low, high, rounding = (np.concatenate(part) for part in zip(*levels, strict=True))
        offsets = np.cumsum([0, *(len(level[0]) for level in levels)])
        return cls(low, high, rounding, offsets, triangles, soup.owner[order])

    def is_triangle(self, node: IntArray) -> BoolArray:
        """Which nodes are single triangles, shape (P,)."""
        return np.asarray(node >= self.offsets[-2])

    def children(self, node: IntArray) -> tuple[IntArray, IntArray]:
        """Places in the list of nodes, and the children of these, each of shape (Q,)."""
        level = np.searchsorted(self.offsets, node, side="right") - 1
        first = self.offsets[level + 1] + _FAN * (node - self.offsets[level])
        count = np.minimum(self.offsets[level + 2] - first, _FAN)
        place = np.repeat(np.arange(len(node)), count)
        within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
        return place, first[place] + within

    def bounds(self, node: IntArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far segments (P, 3) are from what is in boxes, at least and at most, without rounding, each (P,) [m]."""
        # Numpy takes rows in a quarter of the time in which it indexes them.
        low = self.low.take(node, axis=0)
        high = self.high.take(node, axis=0)
        beyond = np.maximum(low - np.maximum(start, end), np.minimum(start, end) - high)
        apart = lengths_of(np.maximum(beyond, 0.0))
        line = end - start
        centre = 0.5 * (low + high)
        square = np.einsum("pd,pd->p", line, line)
        share = np.einsum("pd,pd->p", centre - start, line) / np.where(square > 0.0, square, 1.0)
        from_centre = lengths_of(start + np.clip(share, 0.0, 1.0)[:, None] * line - centre)
        half = 0.5 * self.size(node)
        return np.maximum(apart, from_centre - half), from_centre + half

    def size(self, node: IntArray) -> FloatArray:
        """Diagonals of boxes, shape (P,) [m]."""
        return self._sizes.take(node)

    @cached_property
    def _sizes(self) -> FloatArray:
        """Of all boxes, shape (nodes,) [m]."""
        return lengths_of(self.high - self.low)


def _by_size_and_place(triangles: FloatArray) -> IntArray:
    """An order in which neighbours are alike in size and near each other, shape (m,)."""
    low = triangles.min(axis=1)
    high = triangles.max(axis=1)
    extent = high.max(axis=0) - low.min(axis=0)
    span = max(float(extent.max()), np.finfo(np.float64).tiny)
    # Walls of few large triangles would blow up the boxes of fine meshes beside them.
    size = lengths_of(high - low) / span
    kind = np.floor(np.log2(np.maximum(size, 1e-6)) / 3.0)
    cells = ((0.5 * (low + high) - low.min(axis=0)) / span * 1023.0).astype(np.int64)
    number = np.zeros(len(triangles), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            number |= (cells[:, axis] >> bit & 1) << 3 * bit + axis
    return np.lexsort((number, kind))


def check_surfaces(
    motion: SpaceChainMotion,
    workspace: Workspace,
    settings: VerificationSettings,
    proof: SpaceProofSettings = DEFAULT_SPACE_PROOF,
) -> Check:
    """Check that the arm beyond its mount keeps the clearance from every surface at all times."""
    exposed = exposed_shares(motion.arm)
    if len(workspace.soup) == 0 or not np.any(exposed < 1.0):
        why = "there is no wall" if len(workspace.soup) == 0 else "the whole arm counts as its mount"
        return Check("wall clearance", np.inf, workspace.clearance, "m", why, passed=True)
    surfaces = CheckedSurfaces.of(workspace.soup)
    least = least_allowed_gap(workspace.clearance, motion.arm.radius, settings)
    verdict = SurfaceProof(motion, surfaces, exposed).prove(least, settings, proof)
    near = verdict.nearest
    names = np.array(workspace.soup.names)[surfaces.owner]
    wall = str(names[near.other - surfaces.offsets[-2]])
    where = f"link {near.link + 1} to {wall!r} at t = {near.time:.4f} s"
    remark = verdict.remark or touch_beside_mount(motion.arm, near.link, near.gap)
    exposed[: near.link + 1] = 1.0
    if not verdict.remark and remark and np.any(exposed < 1.0):
        beyond = SurfaceProof(motion, surfaces, exposed).prove(least, settings, proof).nearest
        remark += gap_beyond(beyond.gap, str(names[beyond.other - surfaces.offsets[-2]]))
    where = f"{where}: {remark}" if remark else where
    place = NearPlace(near.gap - workspace.clearance, 0.0, near.time, near.link + 1, obstacle=wall)
    return Check("wall clearance", near.gap, workspace.clearance, "m", where, passed=verdict.proved, place=place)


def exposed_shares(arm: Arm) -> FloatArray:
    """Share of each link that belongs to the mount and may touch walls, shape (links,); 1 for a whole link."""
    return np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)


class SurfaceProof:
    """Proves that links keep a gap to the surfaces of a scene, by measuring them against boxes of these.

    Args:
        motion: of the arm.
        surfaces: of the scene.
        exposed: share of each link that may touch walls.
    """

    def __init__(self, motion: SpaceChainMotion, surfaces: CheckedSurfaces, exposed: FloatArray) -> None:
        self.motion = motion
        self.surfaces = surfaces
        self._exposed = exposed
        size = max(float(np.max(np.abs(surfaces.triangles))), float(np.max(np.abs(motion.points))))
        self._lost = motion.rounding + distance_rounding(size)

    def prove(self, least: float, settings: VerificationSettings, proof: SpaceProofSettings) -> Verdict:
        """Prove that all links keep a gap."""
        samples = len(self.motion.time)
        few = np.unique(np.linspace(0, samples - 1, _PROBES).astype(int)).astype(np.float64)
        # At a few moments the nearest surface is looked for alone, to know how far the search must look.
        moments = self._of_all_links(TimeStretches(few, few), least, settings, None)
        if moments.nearest.gap < least:
            return moments
        blocks = TimeStretches.blocks(samples, proof.block)
        return self._of_all_links(blocks, least, settings, moments.nearest)

    def _of_all_links(
        self, stretches: TimeStretches, least: float, settings: VerificationSettings, nearest: Nearest | None
    ) -> Verdict:
        links = np.flatnonzero(self._exposed < 1.0)
        stretch = np.repeat(np.arange(len(stretches)), len(links))
        link = np.tile(links, len(stretches))
        pairs = StretchPairs(stretch, link, np.zeros(len(link), dtype=np.intp))
        return prove_stretches(self.motion, stretches, pairs, self.measure, least, settings, self._opened, nearest)

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: StretchPairs, cutoff: FloatArray | float
    ) -> Measured:
        """What is known of the gaps of pairs; beyond the cutoff, one number or of shape (P,) [m], not exactly."""
        travels = self.motion.travels(stretches).ravel()
        points = poses.reshape(-1, 3)
        joint = pairs.stretch * poses.shape[1] + pairs.link
        travel = np.maximum(travels.take(joint), travels.take(joint + 1))
        end = points.take(joint + 1, axis=0)
        start = points.take(joint, axis=0)
        start += self._exposed.take(pairs.link)[:, None] * (end - start)
        low, high = self.surfaces.bounds(pairs.other, start, end)
        thick = self.motion.arm.radius + self.surfaces.rounding.take(pairs.other)
        off = self.motion.off(stretches, pairs.stretch, pairs.link)
        # Triangles whose boxes are far enough need not be measured.
        exact = self.surfaces.is_triangle(pairs.other) & (low - thick - self._lost - off - travel < cutoff)
        triangles = self.surfaces.triangles[pairs.other[exact] - self.surfaces.offsets[-2]]
        low[exact], high[exact] = separations(start[exact], end[exact], triangles)
        # A box may hold triangles of less rounding than the largest, which are farther.
        most = high - np.where(exact, thick, self.motion.arm.radius)
        return Measured(low - thick - self._lost - off, most, travel, exact)

    def _opened(self, pairs: StretchPairs, travel: FloatArray) -> tuple[StretchPairs, BoolArray]:
        surfaces = self.surfaces
        boxes = ~surfaces.is_triangle(pairs.other)
        size = surfaces.size(pairs.other)
        boxes &= (size > travel) | (size == 0.0)
        place, child = surfaces.children(pairs.other[boxes])
        closed = pairs.where(boxes)
        return StretchPairs(closed.stretch[place], closed.link[place], child), boxes


def check_side(motion: SpaceChainMotion, workspace: Workspace) -> Check:
    """Check that the arm lies inside the room and outside of all solid obstacles.

    One point decides: an arm that never meets a closed surface cannot change sides, neither along itself nor over time.
    """
    arm = motion.arm
    # The point where the mount ends: what lies before it may be inside a wall.
    k = min(int(arm.mount_length // arm.link_length), arm.links - 1)
    share = min(arm.mount_length / arm.link_length - k, 1.0)
    joints = motion.points[0]
    point = joints[k] + share * (joints[k + 1] - joints[k])
    depths = {each.name: depth_enclosed(each.body.triangles, point) for each in workspace.obstacles if each.body.solid}
    if workspace.bounds is not None:
        depths["room"] = float(np.max(np.concatenate((workspace.bounds[0] - point, point - workspace.bounds[1]))))
    worst = max(depths, key=lambda name: depths[name], default="")
    depth = max(depths.get(worst, 0.0), 0.0)
    side = f", on the wrong side of {worst!r}" if depth > 0.0 else ""
    return Check("free side", 0.0 - depth, 0.0, "m", f"link {k + 1} at t = 0{side}", passed=depth <= 0.0)
