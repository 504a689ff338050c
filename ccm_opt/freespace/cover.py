"""Covering a taut string by few convex regions that overlap well."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.freespace.regions import contains
from ccm_opt.freespace.taut_stations import TautString
from ccm_opt.geometry.polygons import chord, intersection, signed_area

TRIALS = 9  # places tried for each portal
THICK_ENOUGH = 0.2  # least thickness of an overlap, as a share of the width that its portal should have
WORTHLESS = 1e-7  # overlaps worse than this are as bad as none [m]


@dataclass(frozen=True)
class Candidate:
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
    def around(cls, region: ConvexRegion, first: float, last: float, taut: TautString) -> "Candidate":
        """A region with all of the string that it covers around a span [first, last] known to be covered [m]."""
        outside = taut.stations[~contains(region, taut.points)]
        before, after = outside[outside < first], outside[outside > last]
        entered = taut.stations[np.searchsorted(taut.stations, before[-1], side="right")] if len(before) else 0.0
        left = taut.stations[np.searchsorted(taut.stations, after[0]) - 1] if len(after) else taut.length
        return cls(region, min(first, float(entered)), max(last, float(left)))


@dataclass(frozen=True)
class Cover:
    """Looks for a short sequence of candidates that cover a taut string and overlap well.

    Attributes:
        candidates: in order along the string; each one's span meets that of the next.
        taut: the string.
    """

    candidates: Sequence[Candidate]
    taut: TautString

    @cached_property
    def _links(self) -> dict[tuple[int, int], tuple[float, FloatArray]]:
        return {}

    def link(self, here: int, there: int) -> tuple[float, FloatArray]:
        """The quality [m] of the overlap of two candidates, and its portal."""
        if (here, there) not in self._links:
            one, other = self.candidates[here], self.candidates[there]
            portal = portal_between(one, other, self.taut)
            self._links[here, there] = min(_width(portal), _thickness(one.region, other.region) / THICK_ENOUGH), portal
        return self._links[here, there]

    def sequence(self, wanted: float) -> list[int]:
        """Candidates that cover the string with overlaps of the quality wanted [m], or nearly the best there is."""
        wanted = min(wanted, self.taut.length)
        found = self._search(wanted)
        while not found:
            wanted = 0.5 * wanted if wanted > WORTHLESS else -1.0
            found = self._search(wanted)
        return found

    def _search(self, wanted: float) -> list[int]:
        """Depth-first search that tries the candidate that leads farthest first and enters each once."""
        seen: set[int] = set()
        stack = [[k] for k in self._nearest_first(range(len(self.candidates)), 0.0)]
        while stack:
            path = stack.pop()
            here = path[-1]
            if here in seen or (len(path) > 1 and self.link(path[-2], here)[0] < wanted):
                continue
            seen.add(here)
            if self.candidates[here].last >= self.taut.length:
                return path
            onwards = self._nearest_first(range(here + 1, len(self.candidates)), self.candidates[here].last)
            stack += [[*path, k] for k in onwards]
        return []

    def _nearest_first(self, which: Sequence[int], reached: float) -> list[int]:
        """Those candidates that hold the string at ``reached`` [m], the one leading farthest last."""
        holding = [k for k in which if self.candidates[k].first <= reached <= self.candidates[k].last]
        return sorted(holding, key=lambda k: self.candidates[k].last)


def portal_between(here: Candidate, there: Candidate, taut: TautString) -> FloatArray:
    """The widest chord of the overlap of two regions among those through places where the taut string runs in both.

    Args:
        here: the region before.
        there: the region after; its span meets that of ``here``.
        taut: the string.

    Returns:
        Left end and right end as seen along the string, shape (2, 2) [m].
    """
    first, last = max(here.first, there.first), min(here.last, there.last)
    normals = np.concatenate((here.region.normals, there.region.normals))
    offsets = np.concatenate((here.region.offsets, there.region.offsets))
    chords = [
        chord(normals, offsets, taut.at(place), direction)
        for place in (*np.linspace(first, last, TRIALS).tolist(), *taut.crossings_within(first, last).tolist())
        for direction in taut.directions_across(place)
    ]
    return max(chords, key=_width)[::-1]


def _width(portal: FloatArray) -> float:
    return float(np.linalg.norm(portal[0] - portal[1]))


def _thickness(here: ConvexRegion, there: ConvexRegion) -> float:
    """Twice the area over the perimeter of the overlap of two regions [m]: for a long overlap its mean thickness."""
    overlap = intersection(here.vertices, there.normals, there.offsets)
    if len(overlap) < 3:
        return 0.0
    return 2.0 * signed_area(overlap) / float(np.sum(np.linalg.norm(overlap - np.roll(overlap, 1, axis=0), axis=1)))
