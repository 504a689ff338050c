"""Overlapping convex regions of planar free space that cover a route.

A region is grown from a convex cell: each wall is excluded by one half-plane through the wall's point nearest to the
cell, nearest walls first, skipping walls that are already outside. This is the first step of IRIS (Deits & Tedrake,
2015) with the cell in place of the ellipse, so the result contains the cell.

Candidates are the regions grown from the cells on the route and from the edges between them. Each covers a span of the
taut string, the shortest path of the route. The fewest candidates that overlap well are kept, and each overlap gets a
portal, a chord of the overlap that the taut string crosses.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, SHORTEST, BoolArray, FloatArray, IntArray
from ccm_opt.core.polygons import (
    after_each,
    chords,
    clip,
    half_planes,
    intersection,
    nearest_on_segments,
    signed_area,
    without_short_edges,
)
from ccm_opt.scene.corridor import ConvexRegion, Corridor, Route
from ccm_opt.scene.sleeve import TautString
from ccm_opt.scene.triangulation import Partition, Triangulation, merge

_WALLS_FIRST = 48
"""Number of walls that are excluded from a growing region before all others are checked.

These walls usually hide all others, so the number affects only the time. Heuristic.
"""
_PORTAL_WIDTH = 0.5
"""Width that a portal should have, as a fraction of the narrowest triangle edge on the route. Heuristic."""
_PORTAL_TRIALS = 6
"""Largest number of edge crossings of a taut string at which a portal is tried. Heuristic."""
_OVERLAP_THICKNESS = 0.2
"""Least thickness of the overlap of two regions, as a fraction of the wanted width of its portal. Heuristic."""

UNUSABLE = -1.0
"""Quality given to two regions that overlap only beside the taut string; such pairs are used as a last resort."""
WORTHLESS = 1e-7
"""Quality below which an overlap counts as none [m]: 100 times the distance that counts as touching."""


@dataclass(frozen=True)
class RegionSpan:
    """A convex region and the part of a taut string that lies in the region.

    Attributes:
        region: a convex free region.
        first: arc length at which the taut string enters the region [m].
        last: arc length at which the taut string leaves the region [m].
    """

    region: ConvexRegion
    first: float
    last: float

    @classmethod
    def around(
        cls, region: ConvexRegion, first: float, last: float, taut: TautString, slack: float = 0.0
    ) -> "RegionSpan":
        """Return a region with the longest part of a taut string in that region that contains a known span.

        Args:
            region: the convex free region.
            first: arc length at which the known span begins [m].
            last: arc length at which the known span ends [m].
            taut: the taut string.
            slack: distance by which the string may leave the region and still count as inside, except at its ends [m].
        """
        slacks = np.full(len(taut.stations), max(slack, ROUNDING))
        slacks[[0, -1]] = ROUNDING
        outside = taut.stations[np.max(taut.points @ region.normals.T - region.offsets, axis=1) > slacks]

        # The covered part reaches from the station after the last one outside before the known span to the station
        # before the first one outside after it.
        entered = 0.0
        left = taut.length
        before = outside[outside < first]
        if len(before):
            entered = float(taut.stations[np.searchsorted(taut.stations, before[-1], side="right")])
        after = outside[outside > last]
        if len(after):
            left = float(taut.stations[np.searchsorted(taut.stations, after[0]) - 1])
        return cls(region, min(first, entered), max(last, left))


@dataclass(frozen=True)
class Cover:
    """Search for a short sequence of convex regions that cover a taut string and overlap well.

    Attributes:
        candidates: regions in order along the string; the span of each meets that of the next.
        taut: the taut string.
        slack: distance by which the string may leave the regions, and by which it may miss the portals [m].
    """

    candidates: Sequence[RegionSpan]
    taut: TautString
    slack: float = 0.0

    @cached_property
    def _links(self) -> dict[tuple[int, int], "Link"]:
        return {}

    def link(self, here: int, there: int) -> "Link":
        """Return the overlap of two candidate regions, given by their indices; results are cached."""
        if (here, there) not in self._links:
            pair = self.candidates[here], self.candidates[there]
            self._links[here, there] = link_between(*pair, self.taut, self.slack)
        return self._links[here, there]

    def portals(self, sequence: Sequence[int]) -> FloatArray:
        """Return the portals between consecutive candidates, given by n indices, shape (n - 1, 2, 2) [m].

        Each portal is given by its left, then its right end.
        """
        choices = [self.link(here, there).chords for here, there in itertools.pairwise(sequence)]
        return np.array([choice.ends for choice in _in_order(choices)]).reshape(-1, 2, 2)

    def sequence(self, wanted: float) -> list[int]:
        """Return the indices of few candidates that together cover the string and overlap with a wanted quality [m].

        If there are none, the wanted quality is reduced step by step.

        Raises:
            ValueError: the spans of consecutive candidates do not meet.
        """
        # Wide overlaps suit the curve planner best, so less is accepted only if there is no other cover.
        wanted = min(wanted, self.taut.length)
        while wanted > WORTHLESS:
            found = self._search(wanted)
            if found:
                return found
            wanted *= 0.5
        found = self._search(0.0) or self._search(UNUSABLE)
        if not found:
            raise ValueError(f"got {len(self.candidates)} regions that leave gaps on a route, expected spans that meet")
        return found

    def _search(self, wanted: float) -> list[int]:
        """Return a sequence of candidates that covers the string, by depth-first search; empty if there is none.

        The candidate that reaches farthest is tried first, and each candidate is visited once.
        """
        seen: set[int] = set()
        stack = [[k] for k in self._nearest_first(range(len(self.candidates)), 0.0)]
        while stack:
            path = stack.pop()
            here = path[-1]
            if here in seen or (len(path) > 1 and self.link(path[-2], here).quality < wanted):
                continue
            seen.add(here)
            if self.candidates[here].last >= self.taut.length:
                return path
            onwards = self._nearest_first(range(here + 1, len(self.candidates)), self.candidates[here].last)
            stack += [[*path, k] for k in onwards]
        return []

    def _nearest_first(self, which: Sequence[int], reached: float) -> list[int]:
        """Return the candidates that contain the string at arc length ``reached`` [m], the farthest-reaching last."""
        # Spans of consecutive candidates must meet, or the string would be uncovered between them.
        holding = [k for k in which if self.candidates[k].first <= reached <= self.candidates[k].last]
        return sorted(holding, key=lambda k: self.candidates[k].last)


@dataclass(frozen=True)
class Chord:
    """A chord of the overlap of two regions, crossed by a taut string.

    Attributes:
        place: arc length at which the string crosses the chord [m].
        ends: left and right end as seen along the string, shape (2, 2) [m].
        score: width of the chord times its squareness, the cosine of its angle from perpendicular to the string [m].
    """

    place: float
    ends: FloatArray
    score: float


@dataclass(frozen=True)
class Link:
    """The overlap of two convex regions, with candidates for the portal.

    Attributes:
        quality: width of the best portal, reduced if the overlap is thin [m].
        chords: possible portals, sorted by arc length.
    """

    quality: float
    chords: tuple[Chord, ...]


def link_between(
    here: RegionSpan,
    there: RegionSpan,
    taut: TautString,
    beside: float,
) -> Link:
    """Return the overlap of two regions, with chords that pass near a taut string as candidates for the portal.

    Args:
        here: first region, with the span of the string in the region.
        there: second region, whose span meets that of the first.
        taut: the taut string.
        beside: largest distance of a portal from the string [m]; if all chords are farther away, the quality of the
            overlap is ``UNUSABLE``.
    """
    first = max(here.first, there.first)
    last = min(here.last, there.last)
    overlap = intersection(here.region.vertices, there.region.normals, there.region.offsets)
    normals = np.concatenate((here.region.normals, there.region.normals))
    offsets = np.concatenate((here.region.offsets, there.region.offsets))

    # Where the string runs next to the overlap, portals are tried at the overlap's nearest points; they count in full
    # only if they pass the string within the allowed distance.
    places = _trial_places(taut, first, last, _PORTAL_TRIALS)
    points = [_nearest_within(overlap, normals, offsets, taut.at(place)) for place in places]
    near = [k for k, place in enumerate(places) if np.linalg.norm(points[k] - taut.at(place)) <= beside + ROUNDING]
    trials = [
        (places[k], points[k], direction, squareness)
        for k in near or range(len(places))
        for direction, squareness in taut.directions_across(places[k])
    ]
    found = _chords(trials, normals, offsets)
    best = min(max(choice.score for choice in found), _thickness(overlap) / _OVERLAP_THICKNESS)
    return Link(best if near else UNUSABLE, found)


def _chords(
    trials: Sequence[tuple[float, FloatArray, FloatArray, float]], normals: FloatArray, offsets: FloatArray
) -> tuple[Chord, ...]:
    """Return the chords that a convex polygon, given by half-planes, cuts from lines.

    Each trial gives a line: an arc length on the taut string, a point, a direction, and the line's squareness.
    """
    places, points, directions, squareness = zip(*trials, strict=True)
    ends = chords(normals, offsets, np.array(points), np.array(directions))[:, ::-1]
    scores = np.array(squareness) * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return tuple(Chord(place, pair, score) for place, pair, score in zip(places, ends, scores.tolist(), strict=True))


def _trial_places(taut: TautString, first: float, last: float, trials: int) -> list[float]:
    """Return the arc lengths at which portals are tried in a span: its ends, its middle and some edge crossings."""
    crossings = taut.crossings_within(first, last)
    some = crossings[:: 1 + len(crossings) // trials]
    places: list[float] = np.unique(np.concatenate(([first, 0.5 * (first + last), last], some))).tolist()
    return places


def _in_order(links: Sequence[Sequence[Chord]]) -> list[Chord]:
    """Choose one chord per overlap of regions so that they are in order along the taut string.

    Of all such choices, that with the greatest product of the chords' scores is returned.

    The choice is made by dynamic programming.
    """
    best: list[tuple[float, list[Chord]]] = [(0.0, [])]
    for options in links:
        # Options that precede every chain are useless; if all do, the last is used anyway.
        reached = min((chosen[-1].place for _, chosen in best if chosen), default=0.0)
        longer: list[tuple[float, list[Chord]]] = []
        for choice in [c for c in options if c.place >= reached] or options[-1:]:
            fitting = [pair for pair in best if not pair[1] or pair[1][-1].place <= choice.place] or best
            total, chosen = max(fitting, key=lambda pair: pair[0])
            longer.append((total + float(np.log(choice.score + WORTHLESS)), [*chosen, choice]))
        best = longer
    return max(best, key=lambda pair: pair[0])[1]


def _nearest_within(polygon: FloatArray, normals: FloatArray, offsets: FloatArray, point: FloatArray) -> FloatArray:
    """Return the point of a convex polygon (m, 2) nearest to a point (2,).

    A point within the half-planes, or any point if the polygon is empty, is returned unchanged.
    """
    if len(polygon) == 0 or bool(np.all(normals @ point <= offsets + ROUNDING)):
        return point
    feet = nearest_on_segments(point, np.stack((polygon, after_each(polygon)), axis=1))
    nearest: FloatArray = feet[np.argmin(np.linalg.norm(feet - point, axis=1))]
    return nearest


def _thickness(overlap: FloatArray) -> float:
    """Return the mean thickness of a long polygon (m, 2), twice its area over its perimeter [m]; 0 for a point."""
    perimeter = float(np.sum(np.linalg.norm(overlap - after_each(overlap), axis=1))) if len(overlap) > 2 else 0.0
    return 2.0 * signed_area(overlap) / perimeter if perimeter > 0.0 else 0.0


def make_region(vertices: FloatArray) -> ConvexRegion:
    """Return the convex region with given counter-clockwise vertices, shape (m, 2) [m]."""
    vertices = without_short_edges(vertices, ROUNDING)
    return ConvexRegion(vertices, *half_planes(vertices))


def grow(cell: FloatArray, walls: FloatArray, room: FloatArray) -> ConvexRegion:
    """Return a convex free region that contains a convex free cell and is as large as walls allow.

    Args:
        cell: counter-clockwise vertices, shape (m, 2) [m]; m = 2 for a segment.
        walls: edges of free space, with free space on their left, shape (w, 2, 2) [m].
        room: a convex polygon that contains free space, counter-clockwise, shape (r, 2) [m].

    Returns:
        The region; it contains the cell and meets no wall, both within 1e-9 m.
    """
    near = _nearest_first(cell, walls)[:_WALLS_FIRST]
    region = _shut_out(cell, walls[near], room)
    normals, offsets = half_planes(without_short_edges(region, ROUNDING))
    left_over = ~np.any(np.all(walls @ normals.T >= offsets - ROUNDING, axis=1), axis=1)
    return make_region(_shut_out(cell, walls[left_over], region) if np.any(left_over) else region)


def _nearest_first(cell: FloatArray, walls: FloatArray) -> IntArray:
    """Return indices of walls, sorted by a lower bound on their distance from the centre of a cell."""
    middles = walls.mean(axis=1)
    halves = 0.5 * np.linalg.norm(walls[:, 1] - walls[:, 0], axis=1)
    return np.argsort(np.linalg.norm(middles - cell.mean(axis=0), axis=1) - halves, kind="stable")


def _shut_out(cell: FloatArray, walls: FloatArray, region: FloatArray) -> FloatArray:
    """Return the part of a convex region around a convex cell that remains when walls are cut off, nearest first."""
    gaps, on_cell, on_wall = nearest_points(cell, walls)
    inside = np.ones(len(walls), dtype=bool)
    for wall in np.argsort(gaps, kind="stable"):
        if not inside[wall]:
            continue
        # A nearer wall is excluded by the line of an edge: its nearest point gives no reliable direction.
        if gaps[wall] > SHORTEST:
            normal = (on_wall[wall] - on_cell[wall]) / gaps[wall]
            offset = float(normal @ on_wall[wall])
        else:
            normal, offset = _touching_half_plane(cell, walls[wall], region)
        region = clip(region, normal, offset)
        # Walls that this half-plane also excludes need no half-plane of their own.
        inside &= np.any(walls @ normal < offset - ROUNDING, axis=1)
        inside[wall] = False
    return region


def nearest_points(cell: FloatArray, walls: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distances of a convex cell from walls that do not cross it, and the nearest points of both.

    Args:
        cell: vertices of the cell, shape (m, 2) [m].
        walls: end points of the walls, shape (w, 2, 2) [m].

    Returns:
        Distances, shape (w,) [m], nearest points on the cell, shape (w, 2) [m], and on the walls, shape (w, 2) [m].
    """
    edges = np.stack((cell, after_each(cell)), axis=1)
    feet_on_walls = nearest_on_segments(cell[:, None], walls[None])  # (m, w, 2)
    feet_on_cell = nearest_on_segments(walls[None], edges[:, None, None])  # (m, w, 2 ends, 2)
    cell_side = np.concatenate(
        (np.broadcast_to(cell[:, None], feet_on_walls.shape), feet_on_cell[:, :, 0], feet_on_cell[:, :, 1])
    )
    wall_ends = np.broadcast_to(walls, (len(cell), *walls.shape))
    wall_side = np.concatenate((feet_on_walls, wall_ends[:, :, 0], wall_ends[:, :, 1]))
    gaps = np.linalg.norm(wall_side - cell_side, axis=2)
    best = np.argmin(gaps, axis=0)
    which = np.arange(len(walls))
    return gaps[best, which], cell_side[best, which], wall_side[best, which]


def _touching_half_plane(cell: FloatArray, wall: FloatArray, region: FloatArray) -> tuple[FloatArray, float]:
    """Return the half-plane, between a cell and a wall that touch, that keeps the largest part of a region.

    Two convex sets that do not overlap are separated by the line of an edge of one of them (separating axis theorem);
    perpendiculars to the wall at its ends are tried as well. If the cell is a segment, a line along the segment keeps
    only the region on one side, so such a line is the last resort.
    """
    normals, offsets = _separators(cell, wall)
    overlap = np.maximum(
        np.max(normals @ cell.T - offsets[:, None], axis=1), np.max(offsets[:, None] - normals @ wall.T, axis=1)
    )
    valid = np.flatnonzero(overlap <= max(ROUNDING, 1.01 * float(overlap.min())))
    area_left = [_area(clip(region, normals[i], float(offsets[i]))) for i in valid]
    one_sided = [bool(np.all(cell @ normals[i] >= offsets[i] - ROUNDING)) for i in valid]
    best = valid[max(range(len(valid)), key=lambda k: (not one_sided[k], area_left[k]))]
    return normals[best], float(offsets[best])


def _separators(cell: FloatArray, wall: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return candidate separating half-planes, normals (k, 2) and offsets (k,), for a cell (m, 2) and a wall (2, 2)."""
    wall_normals, wall_offsets = half_planes(wall)
    cell_normals, cell_offsets = half_planes(cell)
    squares = wall_normals[:, ::-1] * (-1.0, 1.0)
    normals = np.concatenate((wall_normals, cell_normals, squares))
    return normals, np.concatenate((wall_offsets, cell_offsets, np.sum(squares * wall, axis=1)))


def _area(vertices: FloatArray) -> float:
    return signed_area(vertices) if len(vertices) > 2 else 0.0


def contains(region: ConvexRegion, points: FloatArray, tolerance: float = ROUNDING) -> BoolArray:
    """Return a mask of the points (..., 2) that lie in a region, within ``tolerance`` [m], shape (...)."""
    return np.asarray(np.all(points @ region.normals.T <= region.offsets + tolerance, axis=-1), dtype=np.bool_)


@dataclass(frozen=True)
class CorridorMaker:
    """Makes corridors in one triangulated free space; cells and grown regions are cached for later routes.

    Attributes:
        triangulation: triangulation of free space.
        slack: distance by which the taut string may leave the regions at cut corners [m]; must be less than the
            inflation of the obstacles, so that no obstacle fits in between.
    """

    triangulation: Triangulation
    slack: float = 0.0

    @cached_property
    def partition(self) -> Partition:
        """Partition of free space into convex cells."""
        return merge(self.triangulation)

    @cached_property
    def _room(self) -> FloatArray:
        """Bounding box of free space, counter-clockwise, shape (4, 2) [m]."""
        x0, y0 = self.triangulation.vertices.min(axis=0)
        x1, y1 = self.triangulation.vertices.max(axis=0)
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])

    @cached_property
    def _grown(self) -> dict[bytes, ConvexRegion]:
        return {}

    def grown(self, seed: FloatArray) -> ConvexRegion:
        """Return the region grown from a convex free polygon or segment with vertices (m, 2) [m]; cached."""
        key = seed.tobytes()
        if key not in self._grown:
            self._grown[key] = grow(seed, self.triangulation.walls, self._room)
        return self._grown[key]

    def corridor_along(self, route: Route, path: FloatArray | None = None) -> Corridor:
        """Return the corridor of a route, with the fewest regions that overlap well.

        Args:
            route: the route; the triangles that it crosses determine the cells.
            path: the free part of the route's taut string, shape (k, 2) [m]; the whole string by default.

        Returns:
            Regions in order, the first containing the start of the string, the last its end, and their directed
            portals.
        """
        edges = self.triangulation.portals(route.sleeve)
        taut = TautString.through(edges, route.taut if path is None else path)
        # Portals need not be wider than the route allows; if no edge is crossed, any width suffices.
        narrowest = float(np.min(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1), initial=np.inf))
        cover = Cover(self._candidates(route.sleeve, edges, taut), taut, self.slack)
        kept = cover.sequence(_PORTAL_WIDTH * narrowest)
        return Corridor(route, tuple(cover.candidates[k].region for k in kept), cover.portals(kept))

    def _candidates(self, sleeve: tuple[int, ...], edges: FloatArray, taut: TautString) -> list[RegionSpan]:
        """Return regions grown from the cells along a triangle sequence, and from the edges between cells."""
        cells = self.partition.cell_of[list(sleeve)]
        changes = np.flatnonzero(np.diff(cells))
        times = np.concatenate(([0.0], taut.crossings[changes], [taut.length]))
        found: list[RegionSpan] = []
        for k, cell in enumerate(cells[np.concatenate((changes, [len(cells) - 1]))]):
            inside = self.grown(self.partition.cells[cell])
            found.append(RegionSpan.around(inside, times[k], times[k + 1], taut, self.slack))
            if k < len(changes):
                # A region grown from the edge itself overlaps both neighbours, whose own overlap may be thin.
                across = self.grown(edges[changes[k]])
                found.append(RegionSpan.around(across, times[k + 1], times[k + 1], taut, self.slack))
        return found
