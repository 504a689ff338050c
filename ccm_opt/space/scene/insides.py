"""How deep places lie inside of bodies."""

from functools import lru_cache

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.scene.bodies import Body, CylinderBody, MeshBody
from ccm_opt.space.scene.point_distances import distance_from_triangles
from ccm_opt.space.scene.surfaces import box_about

_RAYS = np.array([[0.83, 0.41, 0.37], [-0.29, 0.77, -0.57], [0.13, -0.61, 0.78]])
"""Directions without a pattern, so that no ray runs along the faces and edges that people draw."""


def depth_inside(body: Body, point: FloatArray) -> float:
    """How far a place is inside a body [m]; negative outside, minus the distance to it.

    A mesh that is not closed has no inside.

    Args:
        body: the body.
        point: shape (3,) [m].
    """
    if isinstance(body, CylinderBody):
        return _depth_in_cylinder(body, point)
    distance = distance_from_triangles(point, body.triangles)
    return body.rounding + (distance if body.closed and encloses(body, point) else -distance)


def encloses(body: Body, point: FloatArray) -> bool:
    """Whether the triangles of a closed body go round a place.

    Args:
        body: a closed body; of one whose triangles have no area nothing lies inside.
        point: shape (3,) [m].
    """
    triangles = body.triangles
    low, high = box_about(triangles)
    if np.any((point < low) | (point > high)):
        return False
    if isinstance(body, MeshBody) and not _is_oriented(body):
        votes = [_crossings(point, way, triangles) % 2 for way in _RAYS]
        return sum(votes) > 1
    return abs(_winding_number(point, triangles)) > 0.5


def _depth_in_cylinder(body: CylinderBody, point: FloatArray) -> float:
    """The same of a cylinder itself, not of the prism about it [m]."""
    way = body.end - body.start
    length = float(np.linalg.norm(way))
    along = float((point - body.start) @ way) / length
    beside = float(np.linalg.norm(point - body.start - along / length * way))
    over_end = max(-along, along - length)
    over_side = beside - body.radius
    if over_end <= 0.0 or over_side <= 0.0:
        return -max(over_end, over_side)
    return -float(np.hypot(over_end, over_side))


def _winding_number(point: FloatArray, triangles: FloatArray) -> float:
    """How often triangles go round a place: the solid angles that it sees of them, over 4π.

    Source: A. van Oosterom and J. Strackee, The solid angle of a plane triangle, IEEE Trans. Biomed. Eng. 30 (1983).
    """
    corners = triangles - point
    lengths = np.linalg.norm(corners, axis=2)
    first, second, third = (corners[:, k] for k in range(3))
    volume = np.einsum("mi,mi->m", first, np.cross(second, third))
    below = (
        np.prod(lengths, axis=1)
        + np.einsum("mi,mi->m", first, second) * lengths[:, 2]
        + np.einsum("mi,mi->m", second, third) * lengths[:, 0]
        + np.einsum("mi,mi->m", third, first) * lengths[:, 1]
    )
    return float(np.sum(np.arctan2(volume, below)) / (2.0 * np.pi))


def _crossings(point: FloatArray, way: FloatArray, triangles: FloatArray) -> int:
    """How many triangles a ray crosses (Möller and Trumbore, Fast, minimum storage ray/triangle intersection, 1997)."""
    first_side = triangles[:, 1] - triangles[:, 0]
    second_side = triangles[:, 2] - triangles[:, 0]
    across = np.cross(way, second_side)
    determinant = np.einsum("mi,mi->m", first_side, across)
    usable = determinant != 0.0
    inverse = 1.0 / np.where(usable, determinant, 1.0)
    from_corner = point - triangles[:, 0]
    u = inverse * np.einsum("mi,mi->m", from_corner, across)
    other = np.cross(from_corner, first_side)
    v = inverse * (other @ way)
    along = inverse * np.einsum("mi,mi->m", second_side, other)
    return int(np.count_nonzero(usable & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along > 0.0)))


@lru_cache(maxsize=64)
def _is_oriented(body: MeshBody) -> bool:
    """Whether at every edge as many triangles run one way as the other."""
    faces: IntArray = body.faces
    starts = faces.ravel().astype(np.int64)
    ends = np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    count = np.int64(len(body.vertices))
    there = np.sort(starts * count + ends)
    back = np.sort(ends * count + starts)
    return bool(np.array_equal(there, back))
