"""The walls taken apart into straight edges, and those of many edges into runs, for the verifier alone."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.rounding import distance_rounding
from ccm_opt.verification.selfcollision import segment_distances

_MANY_EDGES = 64
"""Walls with as many edges are looked at in runs of them first. Taste."""
_EDGES_A_RUN = 16
"""Edges in a run. Taste: their chord is near all of them, and few runs are near the arm."""


@dataclass(frozen=True)
class Boxes:
    """Boxes with sides along the axes.

    Attributes:
        low: shape (B, 2) [m].
        high: shape (B, 2) [m].
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def around(cls, start: FloatArray, end: FloatArray, radius: FloatArray) -> "Boxes":
        """Boxes around segments swept by discs; start and end of shape (B, 2), radius of shape (B,) [m]."""
        grow = radius[:, None]
        return cls(np.minimum(start, end) - grow, np.maximum(start, end) + grow)

    def tree(self) -> shapely.STRtree:
        """Spatial index of the boxes."""
        return shapely.STRtree(shapely.box(self.low[:, 0], self.low[:, 1], self.high[:, 0], self.high[:, 1]))

    def in_groups(self, width: int, first: IntArray) -> "Boxes":
        """Boxes around several rows each, column by column.

        Args:
            width: boxes in a row.
            first: the first row of each group, shape (G,).

        Returns:
            One box for each group and column, G * width in all.
        """
        low, high = (bound.reshape(-1, width, 2) for bound in (self.low, self.high))
        grown = Boxes(np.minimum.reduceat(low, first), np.maximum.reduceat(high, first))
        return Boxes(grown.low.reshape(-1, 2), grown.high.reshape(-1, 2))


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
        return Boxes.around(self.start, self.end, self.rounding).tree()

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
    def boxes(self) -> Boxes:
        """The runs' boxes, each grown by its radius."""
        return Boxes.around(self.start, self.end, self.radius)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the boxes."""
        return self.boxes.tree()

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the chords."""
        return _line_tree(self.start, self.end)

    def edges_of(self, runs: IntArray) -> tuple[IntArray, IntArray]:
        """All edges of some runs, shape (k,): each edge's place in ``runs``, and its number; each of shape (m,)."""
        place, within = _numbered(self.first[runs + 1] - self.first[runs])
        return place, self.first[runs][place] + within

    def meeting(self, boxes: Boxes, width: int, rows: int) -> tuple[IntArray, IntArray]:
        """Pairs of a box and a run whose boxes meet.

        Args:
            boxes: row after row; those of a column hardly move from one row to the next.
            width: boxes in a row.
            rows: how many the tree is asked for at once.

        Returns:
            Numbers of the boxes and of the runs, each of shape (m,).
        """
        count = len(boxes.low) // width
        first = np.arange(0, count, rows)
        groups = boxes.in_groups(width, first)
        # The tree asks for boxes alone, and a diagonal, which is made sooner, has the same box as its rectangle.
        found, run = self.tree.query(shapely.linestrings(np.stack((groups.low, groups.high), axis=1)))
        group, column = np.divmod(found, width)
        place, within = _numbered(np.minimum(rows, count - first[group]))
        box = (first[group][place] + within) * width + column[place]
        run = run[place]
        apart = (boxes.low[box] > self.boxes.high[run]) | (boxes.high[box] < self.boxes.low[run])
        meets = ~np.any(apart, axis=1)
        return box[meets], run[meets]


def _numbered(counts: IntArray) -> tuple[IntArray, IntArray]:
    """So many things of each of several kinds: each one's kind, and its number among its kind; each of shape (m,)."""
    kind = np.repeat(np.arange(len(counts)), counts)
    return kind, np.arange(len(kind)) - np.repeat(np.cumsum(counts) - counts, counts)


def _line_tree(start: FloatArray, end: FloatArray) -> shapely.STRtree:
    return shapely.STRtree(np.asarray(shapely.linestrings(np.stack((start, end), axis=1))))


def edge_runs(edges: WallEdges) -> EdgeRuns:
    """Walls with many edges in runs, all others edge by edge."""
    number = np.arange(len(edges.owner))
    begins = np.flatnonzero(np.diff(edges.owner, prepend=-1))
    count = np.diff([*begins, len(number)])
    place = number - np.repeat(begins, count)
    length = np.where(np.repeat(count, count) >= _MANY_EDGES, _EDGES_A_RUN, 1)
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
    spare = np.where(last > first, distance_rounding(edges.size), 0.0)
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
