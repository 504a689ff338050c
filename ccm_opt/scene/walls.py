"""Walls of a planar workspace as inflated segments, and bounding-box trees over them.

The items of a tree are ordered along a Morton curve (Morton, 1966), so that neighbours in the order are neighbours in
the plane; every box of a level encloses two boxes of the level below. No balancing and no pointers are needed: the
children of box k are boxes 2 k and 2 k + 1 of the level below.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccm_opt.scene.workspace import Obstacle

_BITS = 16


@dataclass(frozen=True)
class BoxTree:
    """A binary tree of bounding boxes over n items in the plane.

    Attributes:
        items: indices of the items in the order of the lowest level, shape (n,).
        boxes: boxes of all levels from the top, each as low x, low y, high x, high y, shape (nodes, 4) [m].
        offsets: index of the first box of every level, then the total number of boxes, shape (levels + 1,).
    """

    items: IntArray
    boxes: FloatArray
    offsets: IntArray

    @classmethod
    def over(cls, low: FloatArray, high: FloatArray) -> "BoxTree":
        """Build the tree over items with bounding boxes from `low` to `high`, each of shape (n, 2) [m]."""
        items = np.argsort(_morton(0.5 * (low + high)), kind="stable")
        levels = [np.hstack((low[items], high[items]))]
        while len(levels[-1]) > 1:
            below = levels[-1]
            if len(below) % 2:
                below = np.vstack((below, below[-1]))
            pairs = below.reshape(-1, 2, 4)
            levels.append(np.hstack((pairs[:, :, :2].min(axis=1), pairs[:, :, 2:].max(axis=1))))
        levels.reverse()
        offsets = np.cumsum([0, *(len(level) for level in levels)])
        return cls(items, np.ascontiguousarray(np.concatenate(levels)), offsets)

    def for_c(self) -> dict[str, Any]:
        """Return the tree as named fields of ``Tree`` in box_tree.h."""
        levels = len(self.offsets) - 1 if len(self.items) else 0
        return {"levels": levels, "items": self.items, "boxes": self.boxes, "offsets": self.offsets}

    def meeting(self, low: FloatArray, high: FloatArray) -> IntArray:
        """Return the sorted indices of items whose boxes meet a box from `low` to `high`, each (2,) [m]."""
        level = len(self.offsets) - 2
        nodes = np.zeros(min(1, len(self.boxes)), dtype=np.intp)
        for k in range(level + 1):
            boxes = self.boxes[self.offsets[k] + nodes]
            nodes = nodes[np.all((boxes[:, :2] <= high) & (boxes[:, 2:] >= low), axis=1)]
            if k < level:
                nodes = (2 * nodes[:, None] + np.arange(2)).ravel()
                nodes = nodes[nodes < self.offsets[k + 2] - self.offsets[k + 1]]
        return np.sort(self.items[nodes])


def _morton(places: FloatArray) -> IntArray:
    """Return the positions of n points (n, 2) along the Morton curve through their bounding box, shape (n,)."""
    if len(places) == 0:
        return np.zeros(0, dtype=np.intp)
    low = places.min(axis=0)
    span = max(float(np.max(places.max(axis=0) - low)), np.finfo(np.float64).tiny)
    cells = ((places - low) / span * (2**_BITS - 1)).astype(np.int64)
    number = np.zeros(len(places), dtype=np.int64)
    for bit in range(_BITS):
        number |= ((cells[:, 0] >> bit) & 1) << (2 * bit) | ((cells[:, 1] >> bit) & 1) << (2 * bit + 1)
    return number


@dataclass(frozen=True)
class Walls:
    """Edges and vertices of every wall of a workspace.

    Attributes:
        names: names of the walls.
        edges: end points of the edges, shape (E, 2, 2) [m].
        edge_wall: index of the wall of each edge, shape (E,).
        vertices: positions of the vertices, shape (V, 2) [m].
        vertex_wall: index of the wall of each vertex, shape (V,).
        rounding: radius by which the core of each wall is inflated, shape (walls,) [m].
    """

    names: tuple[str, ...]
    edges: FloatArray
    edge_wall: IntArray
    vertices: FloatArray
    vertex_wall: IntArray
    rounding: FloatArray

    @classmethod
    def from_obstacles(cls, walls: "Sequence[Obstacle]") -> "Walls":
        """Extract the edges and vertices of walls, which may be polygons with all their rings, lines, or points."""
        cores: Any = np.array([wall.core for wall in walls])
        lines, owner = _lines_and_points(cores)
        points, line = shapely.get_coordinates(lines, return_index=True)
        joined = line[1:] == line[:-1]
        edges = np.stack((points[:-1][joined], points[1:][joined]), axis=1)

        # A ring repeats its first point at the end; sort each line's points to drop duplicates.
        order = np.lexsort((points[:, 1], points[:, 0], line))
        same = (line[order][1:] == line[order][:-1]) & np.all(points[order][1:] == points[order][:-1], axis=1)
        kept = order[np.concatenate(([True], ~same))]
        return cls(
            tuple(wall.name for wall in walls),
            edges,
            owner[line[:-1][joined]],
            points[kept],
            owner[line[kept]],
            np.array([wall.rounding for wall in walls]),
        )

    @cached_property
    def edge_tree(self) -> BoxTree:
        """Bounding-box tree over the edges of all walls."""
        return BoxTree.over(self.edges.min(axis=1), self.edges.max(axis=1))

    @cached_property
    def edge_lines(self) -> shapely.STRtree:
        """Spatial index of the edges as line geometries, for crossing queries."""
        return shapely.STRtree(np.asarray(shapely.linestrings(self.edges)))

    @cached_property
    def vertex_tree(self) -> BoxTree:
        """Bounding-box tree over the vertices of all walls."""
        return BoxTree.over(self.vertices, self.vertices)


def _lines_and_points(cores: Any) -> tuple[Any, IntArray]:
    """Return the rings of polygons, single points of scans, and other cores, in order, each with its core's index."""
    kinds = shapely.get_type_id(cores)
    areas = np.flatnonzero(kinds == shapely.GeometryType.POLYGON)
    others = np.flatnonzero(kinds != shapely.GeometryType.POLYGON)
    rings, ring_of = shapely.get_rings(cores[areas], return_index=True)
    parts, part_of = shapely.get_parts(cores[others], return_index=True)
    owner = np.concatenate((areas[ring_of], others[part_of])).astype(np.intp)
    order = np.argsort(owner, kind="stable")
    return np.concatenate((rings, parts))[order], owner[order]


@dataclass(frozen=True)
class WallSegments:
    """Edges of all walls, and the points of walls without edges, as E segments inflated by a radius.

    Attributes:
        ends: end points of the segments, shape (E, 2, 2) [m].
        rounding: radius by which each segment is inflated, shape (E,) [m].
        owner: index of the wall of each segment, shape (E,).
        solids: index of the first segment of every wall whose core has an inside, and one past the index of its last
            segment, shape (S, 2).
    """

    ends: FloatArray
    rounding: FloatArray
    owner: IntArray
    solids: IntArray

    @classmethod
    def from_obstacles(cls, obstacles: "Sequence[Obstacle]", walls: Walls) -> "WallSegments":
        """Build the segments of walls, given both as obstacles and as arrays of edges and vertices."""
        # A round obstacle is an inflated point: it has no edge, and becomes a segment of zero length.
        lone = ~np.isin(walls.vertex_wall, walls.edge_wall)
        points = np.repeat(walls.vertices[lone][:, None], 2, axis=1)
        owner = np.concatenate((walls.edge_wall, walls.vertex_wall[lone]))

        # Edges are stored wall by wall; the edge of the room is a line, not a solid.
        cores: Any = np.array([obstacle.core for obstacle in obstacles])
        solid = np.flatnonzero(shapely.get_type_id(cores) == shapely.GeometryType.POLYGON)
        solids = np.stack([np.searchsorted(walls.edge_wall, solid, side=side) for side in ("left", "right")], axis=1)
        return cls(np.concatenate((walls.edges, points)), walls.rounding[owner], owner, solids)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the segments of all walls."""
        # A line of zero length is not a valid geometry, so such segments enter the tree as points.
        lone = np.all(self.ends[:, 0] == self.ends[:, 1], axis=1)
        lines: Any = shapely.linestrings(self.ends)
        lines[lone] = shapely.points(self.ends[lone, 0])
        return shapely.STRtree(lines)

    @cached_property
    def boxes(self) -> BoxTree:
        """Bounding-box tree over the segments of all walls, as flat arrays for C."""
        return BoxTree.over(self.ends.min(axis=1), self.ends.max(axis=1))

    @cached_property
    def solid_boxes(self) -> BoxTree:
        """Bounding-box tree over the walls whose cores have an inside."""
        if len(self.solids) == 0:
            return BoxTree.over(np.zeros((0, 2)), np.zeros((0, 2)))
        # Outlines are closed, so the start points of their segments are all their points. Other segments may lie
        # between the runs of two solids: every second run is a solid.
        places = self.ends[: self.solids[-1, 1], 0]
        runs = self.solids.ravel()[:-1]
        low = np.minimum.reduceat(places, runs)[::2]
        high = np.maximum.reduceat(places, runs)[::2]
        return BoxTree.over(low, high)
