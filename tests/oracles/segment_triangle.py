"""Distances of segments from triangles in space by numpy, pair by pair; a triangle may be a segment or a point.

The algorithm is that of triangles.h, which explains it.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray

_FLAT = 1e-26
"""``FLAT`` of triangles.h."""
_Edge: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _TrianglePlanes:
    """Frames of the planes of triangles: an edge, the height on it, and the normal; as ``Plane`` of triangles.h."""

    corner: FloatArray
    edge: FloatArray
    height: FloatArray
    normal: FloatArray
    edge_square: FloatArray
    height_square: FloatArray
    foot: FloatArray
    exists: BoolArray

    @classmethod
    def of(cls, triangles: FloatArray) -> "_TrianglePlanes":
        """Return the frames of triangles, shape (n, 3, 3) [m]."""
        corner = triangles[:, 0]
        edge = triangles[:, 1] - corner
        side = triangles[:, 2] - corner
        edge_square = _dot(edge, edge)
        foot = _divided(_dot(side, edge), edge_square)
        height = side - foot[:, None] * edge
        height_square = _dot(height, height)
        normal = np.cross(edge, height)
        normal = _divided(normal, np.linalg.norm(normal, axis=1)[:, None])
        exists = (edge_square > 0.0) & (height_square > _FLAT * edge_square)
        return cls(corner, edge, height, normal, edge_square, height_square, foot, exists)

    def over(self, offset: FloatArray) -> BoolArray:
        """Return whether the projections of points onto the planes are in the triangles.

        Args:
            offset: vectors from the first vertices of the triangles to the points, shape (n, 3) [m].
        """
        up = _divided(_dot(offset, self.height), self.height_square)
        at = _divided(_dot(offset, self.edge), self.edge_square)
        return self.exists & (up >= 0.0) & (at >= self.foot * up) & (1.0 - at >= (1.0 - self.foot) * up)


def nearest_pairs(segments: FloatArray, triangles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the closest points of n pairs of a segment and a triangle.

    Args:
        segments: ends of the segments, shape (n, 2, 3) [m].
        triangles: vertices of the triangles, the longest edge first, shape (n, 3, 3) [m].

    Returns:
        Distances (n,) [m], parameters in [0, 1] of the points on the segments (n,), and points of the triangles (n, 3)
        [m].
    """
    start = segments[:, 0]
    line = segments[:, 1] - start
    planes = _TrianglePlanes.of(triangles)
    candidates = [_to_edge(start, line, triangles[:, k], triangles[:, (k + 1) % 3]) for k in range(3)]
    shares = [share for share, _ in candidates]
    points = [point for _, point in candidates]
    valid = [np.ones(len(start), dtype=bool)] * 3

    offset = start - planes.corner
    begins = _dot(offset, planes.normal)
    ends = begins + _dot(line, planes.normal)
    for end, height in ((0.0, begins), (1.0, ends)):
        at = offset + end * line
        shares.append(np.full(len(start), end))
        points.append(planes.corner + at - height[:, None] * planes.normal)
        valid.append(planes.over(at))
    crossing = _divided(begins, begins - ends)
    shares.append(crossing)
    points.append(start + crossing[:, None] * line)
    valid.append(
        (begins * ends <= 0.0) & (begins != ends) & planes.over(offset + crossing[:, None] * line),
    )

    share = np.stack(shares)
    point = np.stack(points)
    distance = np.linalg.norm(start + share[:, :, None] * line - point, axis=2)
    distance[~np.stack(valid)] = np.inf
    best = np.argmin(distance, axis=0)
    rows = np.arange(len(start))
    return distance[best, rows], share[best, rows], point[best, rows]


def outward_normals(segments: FloatArray, triangles: FloatArray, share: FloatArray, point: FloatArray) -> FloatArray:
    """Return unit vectors from points of triangles to points of segments, shape (n, 3).

    If both points coincide, the vector is the triangle's normal on the side of the segment's midpoint; for a degenerate
    triangle, any unit vector perpendicular to the segment.
    """
    line = segments[:, 1] - segments[:, 0]
    apart = segments[:, 0] + share[:, None] * line - point
    length = np.linalg.norm(apart, axis=1)
    planes = _TrianglePlanes.of(triangles)
    size = np.sqrt(np.maximum(_dot(line, line), planes.edge_square))
    side = np.where(_dot(segments.mean(axis=1) - planes.corner, planes.normal) < 0.0, -1.0, 1.0)
    meeting = np.where(planes.exists[:, None], side[:, None] * planes.normal, _across(line))
    return np.where((length > 1e-12 * size)[:, None], _divided(apart, length[:, None]), meeting)


def _across(line: FloatArray) -> FloatArray:
    """Return unit vectors perpendicular to lines, shape (n, 3)."""
    axis = np.eye(3)[np.argmin(np.abs(line), axis=1)]
    direction = np.cross(line, axis)
    length = np.linalg.norm(direction, axis=1)[:, None]
    return np.where(length > 0.0, _divided(direction, length), axis)


def _to_edge(start: FloatArray, line: FloatArray, begin: FloatArray, end: FloatArray) -> _Edge:
    """Return the closest points of n pairs of a segment and an edge, as parameters on segments and points on edges."""
    edge = end - begin
    apart = start - begin
    a = _dot(line, line)
    e = _dot(edge, edge)
    b = _dot(line, edge)
    c = _dot(line, apart)
    f = _dot(edge, apart)
    determinant = a * e - b * b
    share = np.where(determinant > 0.0, np.clip(_divided(b * f - c * e, determinant), 0.0, 1.0), 0.0)
    at = _divided(b * share + f, e)
    share = np.where(at < 0.0, np.clip(_divided(-c, a), 0.0, 1.0), share)
    share = np.where(at > 1.0, np.clip(_divided(b - c, a), 0.0, 1.0), share)
    share = np.where(e > 0.0, share, np.clip(_divided(-c, a), 0.0, 1.0))
    at = np.clip(at, 0.0, 1.0)
    return share, begin + at[:, None] * edge


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("nd,nd->n", a, b)
    return product


def _divided(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Return the quotient, and 0 where the denominator is 0."""
    zero = denominator == 0.0
    return np.where(zero, 0.0, numerator / np.where(zero, 1.0, denominator))
