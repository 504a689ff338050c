"""Covering a taut string by few convex regions that overlap well."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.freespace.taut_stations import TautString
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import after_each, chords, intersection, nearest_on_segments, signed_area
from ccm_opt.ground.rounding import ROUNDING

UNUSABLE = -1.0
"""Marks a pair of regions whose overlap is away from the string: taken where nothing else leads on."""
WORTHLESS = 1e-7
"""Overlaps worse than this are as bad as none: rounding, 100 times what counts as touching [m]."""


@dataclass(frozen=True)
class RegionSpan:
    """A region with the part of a taut string that it covers.

    Attributes:
        region: convex and free.
        first: arc length of the taut string where it enters the region [m].
        last: where it leaves [m].
    """

    region: ConvexRegion
    first: float
    last: float

    @classmethod
    def around(
        cls, region: ConvexRegion, first: float, last: float, taut: TautString, slack: float = 0.0
    ) -> "RegionSpan":
        """A region with all of the string that it covers around a span known to be covered.

        Args:
            region: the region.
            first: where the known span begins [m].
            last: where it ends [m].
            taut: the string.
            slack: how far outside the string may run and still count as covered, except at its ends [m].
        """
        slacks = np.full(len(taut.stations), max(slack, ROUNDING))
        slacks[[0, -1]] = ROUNDING
        outside = taut.stations[np.max(taut.points @ region.normals.T - region.offsets, axis=1) > slacks]

        # The covered part reaches from the station after the last one outside before the known span to the station
        # before the first one outside behind it.
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
    """Looks for a short sequence of candidates that cover a taut string and overlap well.

    Attributes:
        candidates: in order along the string; each one's span meets that of the next.
        taut: the string.
        slack: how far outside the regions the string may run, and how far beside the portals pass [m].
        settings: numbers of the choice of portals.
    """

    candidates: Sequence[RegionSpan]
    taut: TautString
    slack: float = 0.0
    settings: FreeSpaceSettings = DEFAULT_FREE_SPACE

    @cached_property
    def _links(self) -> dict[tuple[int, int], "Link"]:
        return {}

    def link(self, here: int, there: int) -> "Link":
        """How two candidates overlap."""
        if (here, there) not in self._links:
            pair = self.candidates[here], self.candidates[there]
            self._links[here, there] = link_between(*pair, self.taut, self.slack, self.settings)
        return self._links[here, there]

    def portals(self, sequence: Sequence[int]) -> FloatArray:
        """Portals between following candidates, left end then right end, in order; shape (n - 1, 2, 2) [m]."""
        choices = [self.link(here, there).chords for here, there in itertools.pairwise(sequence)]
        return np.array([choice.ends for choice in _in_order(choices)]).reshape(-1, 2, 2)

    def sequence(self, wanted: float) -> list[int]:
        """Candidates that cover the string with overlaps of the quality wanted [m], or nearly the best there is.

        Raises:
            ValueError: when the spans of following candidates do not meet.
        """
        # Wide overlaps serve the curve's planner best, so ask for less only when nothing else leads through.
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
        """Depth-first search that tries the candidate that leads farthest first and enters each once."""
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
        """Those candidates that hold the string at ``reached`` [m], the one leading farthest last."""
        # Spans of candidates that follow each other must meet, or the string is uncovered between them.
        holding = [k for k in which if self.candidates[k].first <= reached <= self.candidates[k].last]
        return sorted(holding, key=lambda k: self.candidates[k].last)


@dataclass(frozen=True)
class Chord:
    """A chord of the overlap of two regions that a taut string crosses.

    Attributes:
        place: arc length of the string where it crosses [m].
        ends: left and right end as seen along the string, shape (2, 2) [m].
        score: width times squareness [m].
    """

    place: float
    ends: FloatArray
    score: float


@dataclass(frozen=True)
class Link:
    """How two regions overlap.

    Attributes:
        quality: width of the best portal, less when the overlap is thin [m].
        chords: portals to choose from, by increasing place.
    """

    quality: float
    chords: tuple[Chord, ...]


def link_between(
    here: RegionSpan,
    there: RegionSpan,
    taut: TautString,
    beside: float,
    settings: FreeSpaceSettings = DEFAULT_FREE_SPACE,
) -> Link:
    """The overlap of two regions whose spans meet; its chords pass the string by ``beside`` at most."""
    first = max(here.first, there.first)
    last = min(here.last, there.last)
    overlap = intersection(here.region.vertices, there.region.normals, there.region.offsets)
    normals = np.concatenate((here.region.normals, there.region.normals))
    offsets = np.concatenate((here.region.offsets, there.region.offsets))

    # Where the string runs beside the overlap, portals are tried at the nearest points of the overlap; they count in
    # full only where they pass the string by no more than is allowed.
    places = _trial_places(taut, first, last, settings.portal_trials)
    points = [_nearest_within(overlap, normals, offsets, taut.at(place)) for place in places]
    near = [k for k, place in enumerate(places) if np.linalg.norm(points[k] - taut.at(place)) <= beside + ROUNDING]
    trials = [
        (places[k], points[k], direction, squareness)
        for k in near or range(len(places))
        for direction, squareness in taut.directions_across(places[k])
    ]
    found = _chords(trials, normals, offsets)
    best = min(max(choice.score for choice in found), _thickness(overlap) / settings.overlap_thickness)
    return Link(best if near else UNUSABLE, found)


def _chords(
    trials: Sequence[tuple[float, FloatArray, FloatArray, float]], normals: FloatArray, offsets: FloatArray
) -> tuple[Chord, ...]:
    """Chords within half-planes, one for each place, point, direction and squareness tried."""
    places, points, directions, squareness = zip(*trials, strict=True)
    ends = chords(normals, offsets, np.array(points), np.array(directions))[:, ::-1]
    scores = np.array(squareness) * np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return tuple(Chord(place, pair, score) for place, pair, score in zip(places, ends, scores.tolist(), strict=True))


def _trial_places(taut: TautString, first: float, last: float, trials: int) -> list[float]:
    """Arc lengths where portals are tried: the ends and the middle of a span and some of the crossings in it."""
    crossings = taut.crossings_within(first, last)
    some = crossings[:: 1 + len(crossings) // trials]
    places: list[float] = np.unique(np.concatenate(([first, 0.5 * (first + last), last], some))).tolist()
    return places


def _in_order(links: Sequence[Sequence[Chord]]) -> list[Chord]:
    """One chord of each link, places not decreasing, with the greatest product of scores (dynamic programming)."""
    best: list[tuple[float, list[Chord]]] = [(0.0, [])]
    for options in links:
        # Options before every chain are of no use; should all be, the last is taken as it is.
        reached = min((chosen[-1].place for _, chosen in best if chosen), default=0.0)
        longer: list[tuple[float, list[Chord]]] = []
        for choice in [c for c in options if c.place >= reached] or options[-1:]:
            fitting = [pair for pair in best if not pair[1] or pair[1][-1].place <= choice.place] or best
            total, chosen = max(fitting, key=lambda pair: pair[0])
            longer.append((total + float(np.log(choice.score + WORTHLESS)), [*chosen, choice]))
        best = longer
    return max(best, key=lambda pair: pair[0])[1]


def _nearest_within(polygon: FloatArray, normals: FloatArray, offsets: FloatArray, point: FloatArray) -> FloatArray:
    """The point (2,) if the half-planes hold it or the polygon (m, 2) is empty, else the nearest of the polygon."""
    if len(polygon) == 0 or bool(np.all(normals @ point <= offsets + ROUNDING)):
        return point
    feet = nearest_on_segments(point, np.stack((polygon, after_each(polygon)), axis=1))
    nearest: FloatArray = feet[np.argmin(np.linalg.norm(feet - point, axis=1))]
    return nearest


def _thickness(overlap: FloatArray) -> float:
    """Twice the area over the perimeter of a polygon (m, 2) [m]: for a long one its mean thickness; of a point 0."""
    perimeter = float(np.sum(np.linalg.norm(overlap - after_each(overlap), axis=1))) if len(overlap) > 2 else 0.0
    return 2.0 * signed_area(overlap) / perimeter if perimeter > 0.0 else 0.0
