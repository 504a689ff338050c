"""The walls taken apart into straight edges, and those of many edges into runs, for the verifier alone."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.verification.segments import segment_distances
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


@dataclass(frozen=True)
class WallEdges:
    """The walls taken apart into straight edges; a circle's centre is an edge of no length.

    Attributes:
        start: shape (E, 2) [m].
        end: shape (E, 2) [m].
        rounding: radius of the disc that sweeps the edge, shape (E,) [m].
        owner: number of the wall an edge belongs to, shape (E,).
        names: of the walls.
    """

    start: FloatArray
    end: FloatArray
    rounding: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @cached_property
    def size(self) -> float:
        """What no coordinate of the walls exceeds [m]."""
        return float(max(np.max(np.abs(self.start), initial=0.0), np.max(np.abs(self.end), initial=0.0)))

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the edges' boxes, each grown by its rounding."""
        return _box_tree(self.start, self.end, self.rounding)

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the edges themselves."""
        return _line_tree(self.start, self.end)

    @cached_property
    def runs(self) -> "EdgeRuns":
        """Runs of edges that follow each other along a wall."""
        return edge_runs(self)


@dataclass(frozen=True)
class EdgeRuns:
    """Runs of edges of walls with very many, each as its chord swept by a disc that contains them; else single edges.

    Attributes:
        first: number of each run's first edge, shape (R + 1,), the number of edges at its end.
        start: of the chord, shape (R, 2) [m].
        end: of the chord, shape (R, 2) [m].
        radius: of the disc, roundings of the edges included, shape (R,) [m].
    """

    first: IntArray
    start: FloatArray
    end: FloatArray
    radius: FloatArray

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the runs' boxes, each grown by its radius."""
        return _box_tree(self.start, self.end, self.radius)

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the chords."""
        return _line_tree(self.start, self.end)

    def edges_of(self, runs: IntArray) -> tuple[IntArray, IntArray]:
        """All edges of some runs, shape (k,): each edge's place in ``runs``, and its number; each of shape (m,)."""
        counts = self.first[runs + 1] - self.first[runs]
        place = np.repeat(np.arange(len(runs)), counts)
        within = np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts)
        return place, self.first[runs][place] + within


def _box_tree(start: FloatArray, end: FloatArray, radius: FloatArray) -> shapely.STRtree:
    low = np.minimum(start, end) - radius[:, None]
    high = np.maximum(start, end) + radius[:, None]
    return shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))


def _line_tree(start: FloatArray, end: FloatArray) -> shapely.STRtree:
    return shapely.STRtree(np.asarray(shapely.linestrings(np.stack((start, end), axis=1))))


def edge_runs(edges: WallEdges, settings: VerificationSettings = DEFAULT_VERIFICATION) -> EdgeRuns:
    """Walls with many edges in runs, all others edge by edge."""
    number = np.arange(len(edges.owner))
    begins = np.flatnonzero(np.diff(edges.owner, prepend=-1))
    count = np.diff([*begins, len(number)])
    place = number - np.repeat(begins, count)
    length = np.where(np.repeat(count, count) >= settings.many_edges, settings.edges_a_run, 1)
    # A ring's last edge and the next ring's first one need not meet: a run ends there.
    broken = np.concatenate(([True], np.any(edges.start[1:] != edges.end[:-1], axis=1)))
    first = np.flatnonzero((place % length == 0) | (broken & (length > 1)))
    last = np.append(first[1:], len(number)) - 1
    start = edges.start[first]
    end = edges.end[last]
    # Distance from a segment is convex, so that no point of an edge is farther from the chord than the edge's ends.
    run = np.repeat(np.arange(len(first)), last - first + 1)
    away = segment_distances(edges.end, edges.end, start[run], end[run]) * (number != last[run])
    sag = np.zeros(len(first))
    np.maximum.at(sag, run, away)
    spare = np.where(last > first, settings.run_spare * (1.0 + np.abs(start).max(axis=1)), 0.0)
    return EdgeRuns(np.append(first, len(number)), start, end, sag + spare + edges.rounding[first])


def wall_edges(workspace: Workspace) -> WallEdges:
    """The edges of everything the arm must keep away from."""
    walls = workspace.walls
    pieces = [np.concatenate([_edges_of(part) for part in shapely.get_parts(wall.core)]) for wall in walls]
    counts = [len(piece) for piece in pieces]
    edges = np.concatenate(pieces)
    rounding = np.repeat([wall.rounding for wall in walls], counts)
    return WallEdges(
        edges[:, 0], edges[:, 1], rounding, np.repeat(np.arange(len(walls)), counts), tuple(wall.name for wall in walls)
    )


def _edges_of(part: shapely.Geometry) -> FloatArray:
    """Edges of a polygon, line or point, shape (E, 2, 2) [m]."""
    if isinstance(part, shapely.Polygon):
        return np.concatenate([_edges_of(ring) for ring in (part.exterior, *part.interiors)])
    points = shapely.get_coordinates(part)
    if len(points) == 1:  # the centre of a circle
        return np.repeat(points[None], 2, axis=1)
    return np.stack((points[:-1], points[1:]), axis=1)
