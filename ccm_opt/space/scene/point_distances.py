"""Distances of places from triangles, by the plain formula, for the few places that are asked of once."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING

TINIEST = np.finfo(np.float64).tiny
"""Squares below this have lost all their digits."""


def distance_from_triangles(point: FloatArray, triangles: FloatArray) -> float:
    """Least distance of a place from triangles, which may have no area [m]; ∞ where there are none.

    Args:
        point: shape (3,) [m].
        triangles: shape (m, 3, 3) [m].
    """
    if len(triangles) == 0:
        return float(np.inf)
    # Only triangles whose box is no farther than the nearest corner of all can be nearest.
    low = triangles.min(axis=1) - point
    high = point - triangles.max(axis=1)
    beyond = np.maximum(np.maximum(low, high), 0.0)
    to_boxes = np.einsum("ij,ij->i", beyond, beyond)
    to_corners = np.sum((triangles[:, 0] - point) ** 2, axis=1).min()
    maybe = triangles[to_boxes <= to_corners * (1.0 + ROUNDING) + TINIEST]
    return float(np.linalg.norm(nearest_on_triangles(point, maybe) - point, axis=1).min())


def nearest_on_triangles(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """The nearest place of each triangle to a place, shape (m, 3) [m].

    The foot of the perpendicular where it lies on the triangle, else the nearest place of the sides.

    Args:
        point: shape (3,) [m].
        triangles: shape (m, 3, 3) [m].
    """
    sides = np.roll(triangles, -1, axis=1) - triangles
    to_point = point - triangles
    along = np.einsum("mij,mij->mi", to_point, sides)
    squares = np.einsum("mij,mij->mi", sides, sides)
    share = np.clip(along / np.where(squares > 0.0, squares, 1.0), 0.0, 1.0)
    on_sides = triangles + share[:, :, None] * sides
    apart = np.sum((on_sides - point) ** 2, axis=2)
    nearest: FloatArray = on_sides[np.arange(len(triangles)), np.argmin(apart, axis=1)]

    normal = np.cross(sides[:, 0], sides[:, 1])
    square = np.einsum("mi,mi->m", normal, normal)
    # Of all sides the place lies on the inner side: its foot is on the triangle.
    inner = np.einsum("mij,mij->mi", np.cross(normal[:, None, :], sides), to_point)
    above = (square > 0.0) & np.all(inner >= 0.0, axis=1)
    height = np.einsum("mi,mi->m", to_point[:, 0], normal) / np.where(square > 0.0, square, 1.0)
    nearest[above] = point - height[above, None] * normal[above]
    return nearest
