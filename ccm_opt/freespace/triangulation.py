"""Constrained Delaunay triangulation of free space, with neighbours and point location.

No vertex is added inside free space, so the dual graph (triangles joined across their common edges) is a deformation
retract of it: walks in the dual graph without immediate returns are exactly the homotopy classes of paths.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
import shapely
from scipy.sparse.csgraph import connected_components

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.polygons import cross, nearest_on_segments

WALL = -1
"""Stands for the triangle across an edge that is a wall."""


@dataclass(frozen=True)
class Triangulation:
    """Triangles that tile free space.

    Attributes:
        vertices: shape (V, 2) [m]; all lie on the edge of free space.
        triangles: vertex numbers, counter-clockwise, shape (T, 3).
        neighbours: the triangle across the edge from corner e to corner e + 1, or -1 for a wall, shape (T, 3).
    """

    vertices: FloatArray
    triangles: IntArray
    neighbours: IntArray

    def __len__(self) -> int:
        return len(self.triangles)

    @cached_property
    def corners(self) -> FloatArray:
        """Corner points of every triangle, shape (T, 3, 2) [m]."""
        return self.vertices[self.triangles]

    @cached_property
    def centroids(self) -> FloatArray:
        """Centroids, shape (T, 2) [m]."""
        return np.asarray(self.corners.mean(axis=1), dtype=np.float64)

    @cached_property
    def components(self) -> IntArray:
        """The number of the connected component that each triangle belongs to, shape (T,)."""
        triangle, edge = np.nonzero(self.neighbours >= 0)
        links = (np.ones(len(triangle)), (triangle, self.neighbours[triangle, edge]))
        graph = scipy.sparse.coo_array(links, shape=(len(self), len(self)))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)

    @cached_property
    def walls(self) -> FloatArray:
        """The edges of free space, free space on their left, shape (W, 2, 2) [m]."""
        triangle, edge = np.nonzero(self.neighbours < 0)
        return np.stack((self.corners[triangle, edge], self.corners[triangle, (edge + 1) % 3]), axis=1)

    @cached_property
    def adjacency(self) -> list[list[int]]:
        """``neighbours`` as lists, for walks from triangle to triangle."""
        lists: list[list[int]] = self.neighbours.tolist()
        return lists

    @cached_property
    def corner_lists(self) -> list[list[list[float]]]:
        """``corners`` as lists, for walks from triangle to triangle."""
        lists: list[list[list[float]]] = self.corners.tolist()
        return lists

    @cached_property
    def known_walks(self) -> dict[tuple[float, float, float, float, int], list[int]]:
        """Walks that were made already, by the ends of a straight piece of a path [m] and how often it was halved."""
        return {}

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(list(shapely.get_parts(shapely.polygons(self.corners))))

    def locate(self, points: FloatArray) -> IntArray:
        """The triangle that holds each point (m, 2), the lowest number where several do, -1 outside; shape (m,)."""
        found = np.full(len(points), len(self), dtype=np.intp)
        which, triangle = self._tree.query(shapely.points(points), predicate="intersects")
        np.minimum.at(found, which, triangle)
        found[found == len(self)] = WALL
        return found

    def nearest(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """The nearest triangle and the nearest free point.

        Args:
            points: shape (m, 2) [m]; points in free space stay where they are.

        Returns:
            Triangle numbers, shape (m,), and free points, shape (m, 2) [m].

        Raises:
            ValueError: when there is no free space at all.
        """
        if len(self) == 0:
            raise ValueError("free space is empty: its inflation leaves the arm no room")
        triangles = self.locate(points)
        free = np.array(points, dtype=np.float64)
        outside = np.flatnonzero(triangles < 0)
        if len(outside):
            # Of equally near triangles the lowest number, so that results never depend on the order of a tree.
            which, found = self._tree.query_nearest(shapely.points(free[outside]), all_matches=True)
            triangles[outside] = len(self)
            np.minimum.at(triangles, outside[which], found)
            free[outside] = _nearest_on_edges(self.corners[triangles[outside]], free[outside])
        return triangles, free

    def portals(self, sleeve: tuple[int, ...]) -> FloatArray:
        """Left and right ends of the edges crossed by a sleeve of n triangles, shape (n - 1, 2, 2) [m]."""
        here = np.array(sleeve[:-1], dtype=np.intp)
        edges = np.argmax(self.neighbours[here] == np.array(sleeve[1:], dtype=np.intp)[:, None], axis=1)
        return np.stack((self.corners[here, (edges + 1) % 3], self.corners[here, edges]), axis=1)


def triangulate(free: shapely.MultiPolygon) -> Triangulation:
    """The constrained Delaunay triangulation of a polygon set, holes included."""
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.get_parts(free)))
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    corners = _oriented(corners)
    keys, numbers = np.unique(corners[..., 0] + 1j * corners[..., 1], return_inverse=True)
    triangles = numbers.reshape(-1, 3).astype(np.intp)
    return Triangulation(np.column_stack((keys.real, keys.imag)), triangles, _neighbours(triangles, len(keys)))


def _oriented(corners: FloatArray) -> FloatArray:
    """Triangles (T, 3, 2) turned counter-clockwise."""
    clockwise = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) < 0.0
    corners = corners.copy()
    corners[clockwise] = corners[clockwise, ::-1]
    return corners


def _neighbours(triangles: IntArray, vertices: int) -> IntArray:
    """Pair the half-edges that join the same two vertices."""
    heads = triangles
    tails = np.roll(triangles, -1, axis=1)
    key = (np.minimum(heads, tails) * vertices + np.maximum(heads, tails)).ravel()
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero(np.diff(key[order]) == 0)
    one = order[pair]
    other = order[pair + 1]
    neighbours = np.full(key.size, WALL, dtype=np.intp)
    neighbours[one] = other // 3
    neighbours[other] = one // 3
    return neighbours.reshape(-1, 3)


def _nearest_on_edges(corners: FloatArray, points: FloatArray) -> FloatArray:
    """The nearest point to each of ``points`` (m, 2) on the edges of its triangle (m, 3, 2)."""
    feet = nearest_on_segments(points[:, None], np.stack((corners, np.roll(corners, -1, axis=1)), axis=2))
    best = np.argmin(np.linalg.norm(points[:, None] - feet, axis=2), axis=1)
    return np.asarray(feet[np.arange(len(points)), best], dtype=np.float64)
