"""Convex polygons in the plane: orientation, half-planes, clipping and chords."""

import numpy as np

from ccm_opt.arrays import FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The scalar cross product a × b of plane vectors, shapes (..., 2) broadcast to (...)."""
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def signed_area(vertices: FloatArray) -> float:
    """The area of a simple polygon [m²], positive when ``vertices`` (m, 2) run counter-clockwise."""
    return float(0.5 * np.sum(cross(vertices, np.roll(vertices, -1, axis=0))))


def counter_clockwise(vertices: FloatArray) -> FloatArray:
    """The same polygon with its vertices (m, 2) running counter-clockwise."""
    return vertices if signed_area(vertices) >= 0.0 else vertices[::-1]


def is_convex(vertices: FloatArray, tolerance: float = 1e-12) -> bool:
    """Whether a counter-clockwise polygon turns left, or goes straight on, at each vertex.

    Args:
        vertices: shape (m, 2) [m].
        tolerance: the depth of dents that count as straight [m].
    """
    edges = np.roll(vertices, -1, axis=0) - vertices
    following = np.roll(edges, -1, axis=0)
    longer = np.maximum(np.linalg.norm(edges, axis=1), np.linalg.norm(following, axis=1))
    return bool(np.all(cross(edges, following) >= -tolerance * longer))


def without_short_edges(vertices: FloatArray, shortest: float = 1e-12) -> FloatArray:
    """Vertices (m, 2) of a closed ring without those nearer than ``shortest`` [m] to the one before."""
    lengths = np.linalg.norm(vertices - np.roll(vertices, 1, axis=0), axis=1)
    kept: FloatArray = vertices[lengths > shortest]
    return kept


def half_planes(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The half-planes ``normals @ x <= offsets`` whose intersection is a convex polygon.

    Args:
        vertices: counter-clockwise, no two alike in succession, shape (m, 2) [m].

    Returns:
        Unit outward normals, shape (m, 2), and offsets, shape (m,) [m]; row i belongs to the edge from vertex i to
        i + 1.
    """
    edges = np.roll(vertices, -1, axis=0) - vertices
    normals = np.column_stack((edges[:, 1], -edges[:, 0])) / np.linalg.norm(edges, axis=1)[:, None]
    return normals, np.einsum("ij,ij->i", normals, vertices)


def clip(vertices: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """The part of a convex polygon with ``normal @ x <= offset`` (one step of Sutherland & Hodgman, 1974).

    Args:
        vertices: counter-clockwise, shape (m, 2) [m].
        normal: shape (2,).
        offset: [m].

    Returns:
        Counter-clockwise vertices, shape (k, 2); k = 0 when nothing is left.
    """
    excess = vertices @ normal - offset
    if np.all(excess <= 0.0):
        return vertices
    kept: list[FloatArray] = []
    for i, here in enumerate(excess):
        after = (i + 1) % len(vertices)
        there = excess[after]
        if here <= 0.0:
            kept.append(vertices[i])
        if (here < 0.0 < there) or (there < 0.0 < here):
            kept.append(vertices[i] + here / (here - there) * (vertices[after] - vertices[i]))
    return np.array(kept).reshape(-1, 2)


def intersection(vertices: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """The part of a convex polygon (m, 2) within the half-planes ``normals @ x <= offsets``; shape (k, 2)."""
    for normal, offset in zip(normals, offsets, strict=True):
        if len(vertices) == 0:
            break
        vertices = clip(vertices, normal, float(offset))
    return vertices


def chord(normals: FloatArray, offsets: FloatArray, through: FloatArray, direction: FloatArray) -> FloatArray:
    """The part of a line inside a convex polygon that holds the point ``through``.

    Args:
        normals: of the polygon's half-planes, shape (m, 2).
        offsets: shape (m,) [m].
        through: a point inside, shape (2,) [m].
        direction: of the line, unit, shape (2,).

    Returns:
        The two ends, the one behind first, shape (2, 2) [m]; both are ``through`` when the line only touches the
        polygon.
    """
    rate = normals @ direction
    slack = np.maximum(offsets - normals @ through, 0.0)
    ahead = float(np.min(slack[rate > 1e-12] / rate[rate > 1e-12], initial=np.inf))
    behind = float(np.min(slack[rate < -1e-12] / -rate[rate < -1e-12], initial=np.inf))
    return np.array([through - behind * direction, through + ahead * direction])


def path_length(points: FloatArray) -> float:
    """The length [m] of a polyline, points of shape (k, 2)."""
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def nearest_on_segments(points: FloatArray, segments: FloatArray) -> FloatArray:
    """The nearest points of segments (..., 2, 2) to points (..., 2), broadcast; shape (..., 2) [m]."""
    tail, along = segments[..., 0, :], segments[..., 1, :] - segments[..., 0, :]
    fraction = np.sum((points - tail) * along, axis=-1) / np.maximum(np.sum(along * along, axis=-1), 1e-300)
    return np.asarray(tail + np.clip(fraction, 0.0, 1.0)[..., None] * along, dtype=np.float64)
