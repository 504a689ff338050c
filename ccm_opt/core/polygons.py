"""Geometry of polygons in the plane."""

import numpy as np
import shapely

from ccm_opt.core.arrays import TINY, FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar cross products a × b of plane vectors (..., 2), shape (...)."""
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def after_each(vertices: FloatArray) -> FloatArray:
    """Return the successor of each vertex (m, 2) of a closed ring, shape (m, 2)."""
    return np.concatenate((vertices[1:], vertices[:1]))


def signed_area(vertices: FloatArray) -> float:
    """Return the area of a simple polygon with vertices (m, 2), positive if they are counter-clockwise [m²]."""
    x, y = vertices.T
    return 0.5 * float(x[:-1] @ y[1:] - x[1:] @ y[:-1] + x[-1] * y[0] - x[0] * y[-1])


def counter_clockwise(vertices: FloatArray) -> FloatArray:
    """Return the vertices of a polygon (m, 2) in counter-clockwise order."""
    return vertices if signed_area(vertices) >= 0.0 else vertices[::-1]


def is_convex(vertices: FloatArray, tolerance: float = 1e-12) -> bool:
    """Return whether a counter-clockwise polygon is convex: it turns left, or does not turn, at every vertex.

    Args:
        vertices: vertices of the polygon, shape (m, 2) [m].
        tolerance: depth of dents that still count as straight [m].
    """
    edges = after_each(vertices) - vertices
    following = after_each(edges)
    longer = np.maximum(np.linalg.norm(edges, axis=1), np.linalg.norm(following, axis=1))
    return bool(np.all(cross(edges, following) >= -tolerance * longer))


def without_short_edges(vertices: FloatArray, shortest: float = 1e-12) -> FloatArray:
    """Return the vertices (m, 2) of a closed ring without those closer than ``shortest`` [m] to their predecessor."""
    before = np.concatenate((vertices[-1:], vertices[:-1]))
    kept: FloatArray = vertices[np.linalg.norm(vertices - before, axis=1) > shortest]
    return kept


def half_planes(vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the half-planes ``normals @ x <= offsets`` whose intersection is a convex polygon.

    Args:
        vertices: counter-clockwise vertices without repetitions, shape (m, 2) [m].

    Returns:
        Unit outward normals, shape (m, 2), and offsets, shape (m,) [m]; index i belongs to the edge from vertex i
        to vertex i + 1.
    """
    edges = after_each(vertices) - vertices
    normals = (edges / np.hypot(edges[:, 0], edges[:, 1])[:, None])[:, ::-1] * (1.0, -1.0)
    return normals, np.einsum("ij,ij->i", normals, vertices)


def clip(vertices: FloatArray, normal: FloatArray, offset: float) -> FloatArray:
    """Return the part of a convex polygon with ``normal @ x <= offset`` (one step of Sutherland & Hodgman, 1974).

    Args:
        vertices: counter-clockwise vertices, shape (m, 2) [m].
        normal: normal of the half-plane, shape (2,).
        offset: offset of the half-plane [m].

    Returns:
        Counter-clockwise vertices, shape (k, 2); k = 0 if nothing is left.
    """
    excess: list[float] = (vertices @ normal - offset).tolist()
    if max(excess) <= 0.0:
        return vertices
    points: list[list[float]] = vertices.tolist()
    kept: list[list[float]] = []
    for i, here in enumerate(excess):
        there = excess[i - 1]
        if (here < 0.0 < there) or (there < 0.0 < here):
            # The edge from the previous vertex crosses the line: keep the intersection.
            x, y = points[i]
            u, v = points[i - 1]
            fraction = here / (here - there)
            kept.append([x + fraction * (u - x), y + fraction * (v - y)])
        if here <= 0.0:
            kept.append(points[i])
    return np.array(kept, dtype=np.float64).reshape(-1, 2)


def intersection(vertices: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the part of a convex polygon (m, 2) in half-planes ``normals @ x <= offsets``, as vertices (k, 2)."""
    for normal, offset in zip(normals, offsets, strict=True):
        if len(vertices) == 0:
            break
        vertices = clip(vertices, normal, float(offset))
    return vertices


def chords(normals: FloatArray, offsets: FloatArray, through: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the chords that a convex polygon cuts from lines through given points.

    Args:
        normals: normals of the polygon's half-planes, shape (m, 2).
        offsets: offsets of the half-planes, shape (m,) [m].
        through: points inside the polygon, one on each line, shape (n, 2) [m].
        directions: unit directions of the lines, shape (n, 2).

    Returns:
        The two ends of each chord in the order of its direction, shape (n, 2, 2) [m]; both equal the point if a line
        only touches the polygon.
    """
    rate = directions @ normals.T
    slack = np.maximum(offsets - through @ normals.T, 0.0)
    # Lines parallel to an edge, up to rounding of the cosine, never intersect it.
    reach = slack / np.where(np.abs(rate) > TINY, rate, 1.0)
    ahead = np.min(np.where(rate > TINY, reach, np.inf), axis=1)[:, None]
    behind = np.max(np.where(rate < -TINY, reach, -np.inf), axis=1)[:, None]
    return np.stack((through + behind * directions, through + ahead * directions), axis=1)


def nearest_on_segments(points: FloatArray, segments: FloatArray) -> FloatArray:
    """Return, per pair, the point on a segment (..., 2, 2) nearest to a point (..., 2), broadcast to (..., 2) [m]."""
    tail = segments[..., 0, :]
    along = segments[..., 1, :] - tail
    fraction = np.sum((points - tail) * along, axis=-1) / np.maximum(np.sum(along * along, axis=-1), 1e-300)
    return np.asarray(tail + np.clip(fraction, 0.0, 1.0)[..., None] * along, dtype=np.float64)


_NEEDLE = 1e-6
"""Angle between edges that turn back at a corner below which the corner counts as a needle [rad]."""
_ARC = 8
"""Number of polygon sides per quarter of the circle around the tip of a needle."""


def mitred(shape: shapely.Geometry, distance: float, limit: float = 5.0) -> shapely.Geometry:
    """Return planar polygons offset by a distance with mitred corners.

    For a positive distance, the result contains every point within this distance of the polygons, but for what GEOS
    loses where it leaves out shallow dents: rarely some 1e-5, and never more than 0.01, of the distance.

    Args:
        shape: polygons in the plane [m].
        distance: offset, negative to shrink [m].
        limit: mitre limit; corners that would extend farther than this many times the distance are cut off.
    """
    # At the tip of a needle of zero width GEOS divides by zero, shapely warns, and the tip is not offset.
    with np.errstate(divide="ignore", invalid="ignore"):
        grown: shapely.Geometry = shapely.buffer(shape, distance, join_style="mitre", mitre_limit=limit)
        tips = _needle_tips(shape)
        if len(tips) == 0:
            return grown
        around = shapely.buffer(shapely.MultiPoint(tips), abs(distance) / np.cos(np.pi / (4 * _ARC)), quad_segs=_ARC)
        tipped: shapely.Geometry = shapely.union(grown, around) if distance > 0.0 else shapely.difference(grown, around)
    return tipped


def _needle_tips(shape: shapely.Geometry) -> FloatArray:
    """Return the corners at which the outlines of a shape turn back on themselves, shape (k, 2) [m]."""
    tips = [np.zeros((0, 2))]
    for ring in shapely.get_rings(shape):
        corners = shapely.get_coordinates(ring)[:-1]
        after = after_each(corners) - corners
        before = np.roll(after, 1, axis=0)
        along = np.sum(before * after, axis=1)
        tips.append(corners[(along < 0.0) & (np.abs(cross(before, after)) <= _NEEDLE * np.abs(along))])
    return np.concatenate(tips)
