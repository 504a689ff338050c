"""Triangulation of planar free space, and its partition into convex cells.

No vertex is added inside free space, so the dual graph (triangles joined across their common edges) is a deformation
retract of free space: walks in the dual graph without immediate returns are exactly the homotopy classes of paths.

The number of cells is at most four times the least possible.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
import shapely
from scipy.sparse.csgraph import connected_components

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.polygons import cross, nearest_on_segments

WALL = -1
"""Value that replaces the index of the neighbouring triangle across an edge that is a wall."""


@dataclass(frozen=True)
class Triangulation:
    """Triangles that tile free space, with their neighbours.

    Attributes:
        vertices: positions of the vertices, shape (V, 2) [m]; all lie on the edge of free space.
        triangles: vertex indices, counter-clockwise, shape (T, 3).
        neighbours: index of the triangle across the edge from corner e to corner e + 1, or -1 for a wall, shape (T, 3).
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
        """Centroids of the triangles, shape (T, 2) [m]."""
        return np.asarray(self.corners.mean(axis=1), dtype=np.float64)

    @cached_property
    def components(self) -> IntArray:
        """Index of the connected component of free space of each triangle, shape (T,)."""
        triangle, edge = np.nonzero(self.neighbours >= 0)
        links = (np.ones(len(triangle)), (triangle, self.neighbours[triangle, edge]))
        graph = scipy.sparse.coo_array(links, shape=(len(self), len(self)))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)

    @cached_property
    def walls(self) -> FloatArray:
        """Boundary edges of free space, with free space on their left, shape (W, 2, 2) [m]."""
        triangle, edge = np.nonzero(self.neighbours < 0)
        return np.stack((self.corners[triangle, edge], self.corners[triangle, (edge + 1) % 3]), axis=1)

    @cached_property
    def adjacency(self) -> list[list[int]]:
        """Indices of the neighbours of each triangle as lists, which are faster than arrays to walk through."""
        lists: list[list[int]] = self.neighbours.tolist()
        return lists

    @cached_property
    def corner_lists(self) -> list[list[list[float]]]:
        """Corner points of each triangle as lists, which are faster than arrays to walk through."""
        lists: list[list[list[float]]] = self.corners.tolist()
        return lists

    @cached_property
    def walk_cache(self) -> dict[tuple[float, float, float, float, int], list[int]]:
        """Triangle walks already found, by both ends of a straight line (four coordinates) [m] and allowed halvings."""
        return {}

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(list(shapely.get_parts(shapely.polygons(self.corners))))

    def locate(self, points: FloatArray) -> IntArray:
        """Return the index of the triangle that contains each point (m, 2), or -1 outside free space, shape (m,).

        If several triangles contain a point, the lowest index is returned.
        """
        found = np.full(len(points), len(self), dtype=np.intp)
        which, triangle = self._tree.query(shapely.points(points), predicate="intersects")
        np.minimum.at(found, which, triangle)
        found[found == len(self)] = WALL
        return found

    def nearest(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the nearest triangle and the nearest free point of each of m points.

        Args:
            points: shape (m, 2) [m]; points in free space stay in place.

        Returns:
            Triangle indices, shape (m,), and free points, shape (m, 2) [m].

        Raises:
            ValueError: there is no free space at all.
        """
        if len(self) == 0:
            raise ValueError("free space is empty: radius and clearance fill the whole workspace")
        triangles = self.locate(points)
        free = np.array(points, dtype=np.float64)
        outside = np.flatnonzero(triangles < 0)
        if len(outside):
            # Of equally near triangles take the lowest index, so that results never depend on the order of a tree.
            which, found = self._tree.query_nearest(shapely.points(free[outside]), all_matches=True)
            triangles[outside] = len(self)
            np.minimum.at(triangles, outside[which], found)
            free[outside] = _nearest_on_edges(self.corners[triangles[outside]], free[outside])
        return triangles, free

    def portals(self, sleeve: tuple[int, ...]) -> FloatArray:
        """Return left and right ends of the edges crossed by a sequence of n triangles, shape (n - 1, 2, 2) [m]."""
        here = np.array(sleeve[:-1], dtype=np.intp)
        edges = np.argmax(self.neighbours[here] == np.array(sleeve[1:], dtype=np.intp)[:, None], axis=1)
        return np.stack((self.corners[here, (edges + 1) % 3], self.corners[here, edges]), axis=1)


def triangulate(free: shapely.MultiPolygon) -> Triangulation:
    """Return the constrained Delaunay triangulation of planar polygons with holes."""
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.get_parts(free)))
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    corners = _oriented(corners)
    keys, numbers = np.unique(corners[..., 0] + 1j * corners[..., 1], return_inverse=True)
    triangles = numbers.reshape(-1, 3).astype(np.intp)
    return Triangulation(np.column_stack((keys.real, keys.imag)), triangles, _neighbours(triangles, len(keys)))


def _oriented(corners: FloatArray) -> FloatArray:
    """Return triangles (T, 3, 2) with their corners in counter-clockwise order."""
    clockwise = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) < 0.0
    corners = corners.copy()
    corners[clockwise] = corners[clockwise, ::-1]
    return corners


def _neighbours(triangles: IntArray, vertices: int) -> IntArray:
    """Return the index of the triangle across each edge, or -1 for a wall, shape (T, 3).

    Edges of two triangles are paired if they join the same two vertices.
    """
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
    """Return the point on the edges of each of m triangles (m, 3, 2) nearest to a point each, shape (m, 2)."""
    feet = nearest_on_segments(points[:, None], np.stack((corners, np.roll(corners, -1, axis=1)), axis=2))
    best = np.argmin(np.linalg.norm(points[:, None] - feet, axis=2), axis=1)
    return np.asarray(feet[np.arange(len(points)), best], dtype=np.float64)


@dataclass(frozen=True)
class Partition:
    """Convex cells that tile free space.

    Attributes:
        cells: counter-clockwise vertices of each cell, shape (m, 2) [m] each.
        cell_of: index of the cell that contains each triangle, shape (T,).
    """

    cells: tuple[FloatArray, ...]
    cell_of: IntArray


def merge(triangulation: Triangulation) -> Partition:
    """Return a partition of free space into convex cells.

    Edges between triangles are removed, longest first, if the merged cell is convex.
    """
    faces = _Faces(triangulation)
    for half_edge in _longest_first(triangulation):
        faces.remove_if_convex(int(half_edge))
    return faces.partition()


def _longest_first(mesh: Triangulation) -> IntArray:
    """Return one half-edge, as index 3 t + e, per edge between two triangles, the longest edge first."""
    triangle, edge = np.nonzero(mesh.neighbours > np.arange(len(mesh))[:, None])
    length = np.linalg.norm(mesh.corners[triangle, edge] - mesh.corners[triangle, (edge + 1) % 3], axis=1)
    return (3 * triangle + edge)[np.argsort(-length, kind="stable")]


class _Faces:
    """Faces of a planar subdivision as rings of half-edges, for merging triangles into convex cells.

    Half-edge 3 t + e leads from corner e of triangle t to corner e + 1.
    """

    def __init__(self, mesh: Triangulation) -> None:
        size = 3 * len(mesh)
        self.points: list[list[float]] = mesh.corners.reshape(-1, 2).tolist()
        self.following = [h + 1 if h % 3 < 2 else h - 2 for h in range(size)]
        self.before = [h - 1 if h % 3 > 0 else h + 2 for h in range(size)]
        self.twin = _twins(mesh)
        self.parent = list(range(len(mesh)))
        self.removed = [False] * size

    def remove_if_convex(self, half_edge: int) -> None:
        """Merge the faces on both sides of an edge unless a corner at either end of the edge would turn right."""
        twin = self.twin[half_edge]
        # Without the edge, its predecessor is followed by the successor of its twin, and vice versa.
        corners = (
            (self.before[half_edge], self.following[twin]),
            (self.before[twin], self.following[half_edge]),
        )
        one = self._face(half_edge // 3)
        other = self._face(twin // 3)
        if one == other or not all(self._turns_left(tail, head) for tail, head in corners):
            return
        for tail, head in corners:
            self.following[tail] = head
            self.before[head] = tail
        # One of the two faces disappears; its triangles find their face through its parent.
        self.parent[other] = one
        self.removed[half_edge] = self.removed[twin] = True

    def partition(self) -> Partition:
        """Return the remaining faces as convex cells, ordered by the index of their root triangle."""
        faces = [self._face(t) for t in range(len(self.parent))]
        roots, cell_of = np.unique(np.array(faces, dtype=np.intp), return_inverse=True)
        first: dict[int, int] = {}
        for half_edge, gone in enumerate(self.removed):
            if not gone:
                first.setdefault(faces[half_edge // 3], half_edge)
        return Partition(tuple(self._ring(first[int(root)]) for root in roots), cell_of.reshape(-1).astype(np.intp))

    def _face(self, triangle: int) -> int:
        """Return the root triangle of the face to which a triangle belongs now (union-find with path halving)."""
        while self.parent[triangle] != triangle:
            self.parent[triangle] = self.parent[self.parent[triangle]]
            triangle = self.parent[triangle]
        return triangle

    def _turns_left(self, tail: int, head: int) -> bool:
        """Return whether two consecutive half-edges do not turn right, up to rounding."""
        ax, ay = self.points[tail]
        bx, by = self.points[head]
        cx, cy = self.points[self.following[head]]
        longer = max(abs(bx - ax) + abs(by - ay), abs(cx - bx) + abs(cy - by))
        # A corner that is concave only by rounding counts as convex.
        return (bx - ax) * (cy - by) - (by - ay) * (cx - bx) >= -TINY * longer

    def _ring(self, half_edge: int) -> FloatArray:
        ring = [half_edge]
        while self.following[ring[-1]] != half_edge:
            ring.append(self.following[ring[-1]])
        return np.array([self.points[h] for h in ring])


def _twins(mesh: Triangulation) -> list[int]:
    """Return for each half-edge the opposite half-edge; at a wall, the half-edge itself."""
    twins = np.arange(3 * len(mesh))
    triangle, edge = np.nonzero(mesh.neighbours >= 0)
    other = mesh.neighbours[triangle, edge]
    back = np.argmax(mesh.neighbours[other] == triangle[:, None], axis=1)
    twins[3 * triangle + edge] = 3 * other + back
    numbers: list[int] = twins.tolist()
    return numbers
