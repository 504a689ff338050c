"""The walls as flat arrays of edges and vertices, ready for vectorised distances, with indices over them."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.box_tree import BoxTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccm_opt.freespace.obstacle import Obstacle


@dataclass(frozen=True)
class Walls:
    """Edges and vertices of every wall of a workspace.

    Attributes:
        names: of the walls.
        edges: end points, shape (E, 2, 2) [m].
        edge_wall: wall of each edge, shape (E,).
        vertices: shape (V, 2) [m].
        vertex_wall: wall of each vertex, shape (V,).
        rounding: radius of the disc that sweeps each wall's core, shape (walls,) [m].
    """

    names: tuple[str, ...]
    edges: FloatArray
    edge_wall: IntArray
    vertices: FloatArray
    vertex_wall: IntArray
    rounding: FloatArray

    @classmethod
    def of(cls, walls: "Sequence[Obstacle]") -> "Walls":
        """Flatten walls: polygons with their rings, lines, and points."""
        cores: Any = np.array([wall.core for wall in walls])
        lines, owner = _lines_and_points(cores)
        points, line = shapely.get_coordinates(lines, return_index=True)
        joined = line[1:] == line[:-1]
        edges = np.stack((points[:-1][joined], points[1:][joined]), axis=1)

        # A ring repeats its first point at the end; every line's points are sorted, and repeats left out.
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
        """Index of the edges."""
        return BoxTree.over(self.edges.min(axis=1), self.edges.max(axis=1))

    @cached_property
    def edge_lines(self) -> shapely.STRtree:
        """The edges as lines, for questions about what crosses them."""
        return shapely.STRtree(np.asarray(shapely.linestrings(self.edges)))

    @cached_property
    def vertex_tree(self) -> BoxTree:
        """Index of the vertices."""
        return BoxTree.over(self.vertices, self.vertices)


def _lines_and_points(cores: Any) -> tuple[Any, IntArray]:
    """The rings of polygons, and all else as it is, with the number of the core that each belongs to; in order."""
    kinds = shapely.get_type_id(cores)
    areas = np.flatnonzero(kinds == shapely.GeometryType.POLYGON)
    others = np.flatnonzero(kinds != shapely.GeometryType.POLYGON)
    rings, ring_of = shapely.get_rings(cores[areas], return_index=True)
    owner = np.concatenate((areas[ring_of], others)).astype(np.intp)
    order = np.argsort(owner, kind="stable")
    return np.concatenate((rings, cores[others]))[order], owner[order]
