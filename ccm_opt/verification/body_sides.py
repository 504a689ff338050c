"""Distances between segments and triangles, and a test whether a triangle mesh encloses a point.

Any unit vector n proves a lower bound on the distance of a segment from a triangle: the least n · p over the segment
minus the greatest n · q over the triangle, both attained at corners. Here n joins the nearest of several candidate
pairs of points. The candidates include the true nearest pair; if they did not, the bound would be too small but still
valid.

A consistently oriented mesh encloses a point if its winding number at the point exceeds one half. For other meshes,
rays are cast from the point, most of which must cross an odd number of triangles. The test is applied to the whole
mesh, which may be open, and, since overlapping bodies may cancel, to each set of triangles connected through corners.
"""

from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.native import NativeCall
from ccm_opt.verification.base_motion import cross


def separations(start: FloatArray, end: FloatArray, triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds on the distances of segments from triangles.

    Args:
        start: starts of P segments, shape (P, 3) [m].
        end: ends of the segments, shape (P, 3) [m].
        triangles: corners of one triangle per segment, shape (P, 3, 3) [m].

    Returns:
        Proved lower bounds, and distances of a pair of points as upper bounds; each of shape (P,) [m].
    """
    _, lower, upper = _nearest(start, end, triangles)
    return lower, upper


def nearest_lines(start: FloatArray, end: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return unit vectors from triangles to segments between their nearest points, zero where they touch, (P, 3).

    Args:
        start: starts of P segments, shape (P, 3) [m].
        end: ends of the segments, shape (P, 3) [m].
        triangles: corners of one triangle per segment, shape (P, 3, 3) [m].
    """
    return _nearest(start, end, triangles)[0]


def _nearest(start: FloatArray, end: FloatArray, triangles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unit vectors, shape (P, 3), and the lower and upper bounds on the distances, each (P,) [m]."""
    count = len(start)
    normal, lower, upper = np.empty((count, 3)), np.empty(count), np.empty(count)
    NativeCall(
        "segment_triangles", count=count, start=start, end=end, triangles=triangles,
        normal=normal, lower=lower, upper=upper,
    )()  # fmt: skip
    return normal, lower, upper


_GRID = 1e-6
"""Cell width of the grid in which nearby corners are merged, as a fraction of the mesh's extent."""
_RAYS = 9
_MOST = 0.75
"""Fraction of rays with an odd number of crossings above which a mesh without common orientation encloses a point.

For a closed mesh the fraction is 0 or 1, except for rays that graze an edge.
"""
_WHOLE = 1e-3
"""Largest difference of a closed mesh's winding number from an integer, small cracks included."""
_PROBES = 200
"""Approximate number of points of a surface that are tested for being inside another surface."""


def depth_enclosed(triangles: FloatArray, point: FloatArray) -> float:
    """Return the depth of a point below the surface of a closed triangle mesh [m]; 0 outside the mesh.

    Args:
        triangles: corners of the m triangles, shape (m, 3, 3) [m].
        point: the point, shape (3,) [m].
    """
    corners = triangles.reshape(-1, 3)
    if np.any(point < corners.min(axis=0)) or np.any(point > corners.max(axis=0)):
        return 0.0
    if not _is_enclosed(triangles, point):
        return 0.0
    both = np.broadcast_to(point, (len(triangles), 3))
    return float(np.min(separations(both, both, triangles)[1]))


def _is_enclosed(triangles: FloatArray, point: FloatArray) -> bool:
    triangles = triangles[_heights(triangles) > _GRID * float(np.max(np.ptp(triangles, axis=(0, 1))))]
    if not len(triangles):
        return False
    corner = _corner_numbers(triangles)
    if _Piece(triangles, corner).encloses(point):
        return True
    piece = _piece_numbers(corner)
    order = np.argsort(piece, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(piece))[:-1])
    if len(parts) == 1:
        return False
    about = [each for part in parts if (each := _Piece(triangles[part], corner[part])).goes_round(point)]
    return bool(about) and not _leave_a_cavity(about, point)


def _leave_a_cavity(about: "list[_Piece]", point: FloatArray) -> bool:
    """Return whether the closed surfaces around a point form a cavity that contains the point.

    They do if they are an even number of nested surfaces, each oriented opposite to the next.
    """
    about.sort(key=lambda each: -abs(each.volume))
    return len(about) % 2 == 0 and all(
        outer.alike and inner.alike and outer.turns(point) * inner.turns(point) < 0.0 and outer.contains(inner)
        for outer, inner in pairwise(about)
    )


class _Piece:
    """A set of triangles connected through their corners.

    Args:
        triangles: corners of the m triangles, shape (m, 3, 3) [m].
        corner: index of each corner after merging coincident corners, shape (m, 3).
    """

    def __init__(self, triangles: FloatArray, corner: IntArray) -> None:
        self.triangles = triangles
        self.alike = _turn_alike(corner)

    @property
    def volume(self) -> float:
        """Enclosed volume [m³], negative if the triangles face inwards."""
        a, b, c = (self.triangles[:, k] - self.triangles[0, 0] for k in range(3))
        return float(np.einsum("md,md->", a, cross(b, c))) / 6.0

    def encloses(self, point: FloatArray) -> bool:
        """Return whether the mesh encloses a point, by winding number or, if not oriented, by a majority of rays."""
        if self._is_beyond(point):
            return False
        return abs(self.turns(point)) > 0.5 if self.alike else _odd_share(self.triangles, point) > _MOST

    def goes_round(self, point: FloatArray) -> bool:
        """Return whether the mesh encloses a point and is closed.

        A mesh counts as closed if its winding number at the point is an integer or, without a consistent orientation,
        if all rays agree.
        """
        if self._is_beyond(point):
            return False
        if not self.alike:
            return _odd_share(self.triangles, point) == 1.0
        turns = abs(self.turns(point))
        return turns > 0.5 and abs(turns - round(turns)) < _WHOLE

    def _is_beyond(self, point: FloatArray) -> bool:
        return bool(np.any(point < self.triangles.min(axis=(0, 1))) or np.any(point > self.triangles.max(axis=(0, 1))))

    def contains(self, other: "_Piece") -> bool:
        """Return whether another mesh lies inside this one, tested at a sample of its corners and centroids."""
        places = np.concatenate((other.triangles[:, 0], other.triangles.mean(axis=1)))
        return all(self.encloses(place) for place in places[:: max(len(places) // _PROBES, 1)])

    def turns(self, point: FloatArray) -> float:
        """Return the winding number of the mesh around a point.

        The winding number is the sum of the triangles' signed solid angles over 4 π: ±1 inside a closed surface and 0
        outside (A. Van Oosterom and J. Strackee, The solid angle of a plane triangle, 1983).
        """
        a, b, c = (self.triangles[:, k] - point for k in range(3))
        lengths = [np.linalg.norm(side, axis=1) for side in (a, b, c)]
        volume = np.einsum("md,md->m", a, cross(b, c))
        level = lengths[0] * lengths[1] * lengths[2]
        for first, second, third in ((a, b, lengths[2]), (b, c, lengths[0]), (c, a, lengths[1])):
            level += np.einsum("md,md->m", first, second) * third
        return float(np.sum(2.0 * np.arctan2(volume, level)) / (4.0 * np.pi))


def _heights(triangles: FloatArray) -> FloatArray:
    """Return the least height of each of m triangles, shape (m,) [m]; near zero for a degenerate triangle."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    area = np.linalg.norm(cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.max(np.linalg.norm(sides, axis=2), axis=1)
    return np.asarray(area / np.maximum(longest, np.finfo(float).tiny))


def _corner_numbers(triangles: FloatArray) -> IntArray:
    """Return an index per corner of m triangles, shape (m, 3); corners in the same or adjacent grid cells share one."""
    corners = triangles.reshape(-1, 3)
    low = corners.min(axis=0)
    width = _GRID * float(np.max(corners.max(axis=0) - low))
    cell = np.floor((corners - low) / max(width, np.finfo(float).tiny)).astype(np.int64)
    # Three cell indices of up to a million fit into one key of 60 bits.
    key = (cell[:, 0] << 40) + (cell[:, 1] << 20) + cell[:, 2]
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    near = cKDTree(cell[first]).query_pairs(1.8, output_type="ndarray")
    return _components(near[:, 0], near[:, 1], len(first))[number].reshape(-1, 3)


def _piece_numbers(corner: IntArray) -> IntArray:
    """Return the index of the connected surface to which each of m triangles belongs, shape (m,).

    Triangles with a common corner belong to one surface. Such a surface is cut at all edges that more than two
    triangles share, if in every part every edge then has exactly two triangles; the parts count as separate surfaces.
    """
    by_corner = _components(corner[:, [0, 1]].ravel(), corner[:, [1, 2]].ravel(), int(corner.max()) + 1)[corner[:, 0]]
    start = corner.ravel()
    end = np.roll(corner, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(corner.max()) + 1) + np.maximum(start, end)
    _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    triangle = np.argsort(edge, kind="stable")[np.repeat(count == 2, count)] // 3
    by_edge = _components(triangle[::2], triangle[1::2], len(corner))
    _, own, own_count = np.unique(edge * len(corner) + np.repeat(by_edge, 3), return_inverse=True, return_counts=True)
    unclear = np.zeros(int(by_corner.max()) + 1, dtype=np.bool_)
    unclear[np.repeat(by_corner, 3)[own_count[own.ravel()] != 2]] = True
    return np.unique(np.where(unclear[by_corner], by_corner, len(corner) + by_edge), return_inverse=True)[1]


def _components(first: IntArray, second: IntArray, count: int) -> IntArray:
    graph = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1], dtype=np.intp)


def _turn_alike(corner: IntArray) -> bool:
    """Return whether a mesh is oriented: every shared edge is traversed equally often in both directions."""
    start = corner.ravel()
    end = np.roll(corner, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(corner.max()) + 1) + np.maximum(start, end)
    _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
    return bool(np.all((np.bincount(edge.ravel(), np.sign(end - start)) == 0.0) | (count == 1)))


def _odd_share(triangles: FloatArray, point: FloatArray) -> float:
    """Return the fraction of rays from a point, evenly spread, that cross an odd number of triangles."""
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_RAYS) + 0.3
    height = 1.0 - (2.0 * np.arange(_RAYS) + 1.0) / _RAYS
    beside = np.sqrt(1.0 - height**2)
    rays = np.column_stack((beside * np.cos(turn), beside * np.sin(turn), height))
    corners = triangles - point
    return float(np.mean([np.count_nonzero(_meets(corners, ray)) % 2 for ray in rays]))


def _meets(corners: FloatArray, ray: FloatArray) -> BoolArray:
    """Return a mask of the triangles that a ray from the origin crosses, shape (m,).

    A ray crosses a triangle if it lies on the same side of the three planes through the origin and an edge each.
    """
    sides = [cross(corners[:, k], corners[:, (k + 1) % 3]) @ ray for k in range(3)]
    volume = np.einsum("md,md->m", corners[:, 0], cross(corners[:, 1], corners[:, 2]))
    positive = (sides[0] > 0.0) & (sides[1] > 0.0) & (sides[2] > 0.0) & (volume > 0.0)
    negative = (sides[0] < 0.0) & (sides[1] < 0.0) & (sides[2] < 0.0) & (volume < 0.0)
    return np.asarray(positive | negative)
