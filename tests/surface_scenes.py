"""Random triangles for tests of distances in space, and a slow computation of distances independent of the package."""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.surfaces import TriangleSoup


def triangle_soup(triangles: FloatArray, rounding: FloatArray, owner: IntArray) -> TriangleSoup:
    """Return triangles of several bodies, from vertices (m, 3, 3) [m], rounding (m,) [m] and indices of bodies (m,)."""
    return TriangleSoup(triangles, rounding, owner, tuple(f"body {k}" for k in range(int(owner.max(initial=-1)) + 1)))


def random_triangles(rng: np.random.Generator, count: int) -> TriangleSoup:
    """Return random triangles of different sizes, some degenerate to segments, points or slivers, some rounded."""
    size = rng.exponential(0.2, (count, 1, 1))
    corners = rng.uniform(-1.0, 1.0, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    kind = rng.integers(0, 10, count)
    corners[kind == 0] = corners[kind == 0, :1]
    corners[kind == 1, 2] = corners[kind == 1, 1]
    corners[kind == 2, 2] = corners[kind == 2].mean(axis=1)  # about a third of the way along, and then off it a little
    corners[kind == 3, 2] = corners[kind == 3, :2].mean(axis=1) + 1e-9 * rng.normal(size=(np.sum(kind == 3), 3))
    rounding = np.where(rng.random(count) < 0.3, rng.exponential(0.05, count), 0.0)
    return triangle_soup(corners, rounding, rng.integers(0, 4, count))


def random_segments(rng: np.random.Generator, count: int) -> FloatArray:
    """Return random segments of different lengths, some degenerate to points, shape (count, 2, 3) [m]."""
    start = rng.uniform(-1.3, 1.3, (count, 3))
    length = rng.choice([0.0, 0.05, 0.5], (count, 1))
    return np.stack((start, start + length * rng.normal(size=(count, 3))), axis=1)


def slow_distances(segments: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the distances of segments (k, 2, 3) from triangles (m, 3, 3), shape (k, m) [m].

    Ternary search: the distance from a convex set is a convex function along a segment.
    """
    start = segments[:, None, 0]
    line = (segments[:, 1] - segments[:, 0])[:, None]
    low = np.zeros((len(segments), len(triangles)))
    high = np.ones_like(low)
    for _ in range(60):
        one = low + (high - low) / 3.0
        other = high - (high - low) / 3.0
        left = _from_triangles(start + one[:, :, None] * line, triangles)
        falls = _from_triangles(start + other[:, :, None] * line, triangles) < left
        low = np.where(falls, one, low)
        high = np.where(falls, high, other)
    return _from_triangles(start + low[:, :, None] * line, triangles)


def _from_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the distances of points (k, m, 3) from m triangles, shape (k, m) [m].

    Each is the minimum distance from vertices and from those projections onto edges and plane that are in the triangle.
    """
    best = np.min(np.linalg.norm(triangles - points[:, :, None], axis=3), axis=2)
    for chosen in ((0, 1), (1, 2), (2, 0), (0, 1, 2)):
        corners = triangles[:, list(chosen)]
        sides = corners[:, 1:] - corners[:, :1]
        weights = np.einsum("kmd,mdc->kmc", points - corners[:, 0], np.linalg.pinv(sides, rcond=1e-13))
        foot = corners[:, 0] + np.einsum("kmc,mcd->kmd", weights, sides)
        inside = np.all(weights >= 0.0, axis=2) & (np.sum(weights, axis=2) <= 1.0)
        best = np.minimum(best, np.where(inside, np.linalg.norm(foot - points, axis=2), np.inf))
    return best


def slow_gaps(segments: FloatArray, scene: TriangleSoup, reach: float) -> FloatArray:
    """Return the distances of k segments from a set of rounded triangles, at most ``reach``, shape (k,) [m]."""
    gaps = slow_distances(segments, scene.triangles) - scene.rounding
    return np.minimum(np.min(gaps, axis=1), reach)
