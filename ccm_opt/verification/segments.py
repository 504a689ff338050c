"""Exact distances between many pairs of line segments at once."""

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray

CHUNK = 65_536
"""Pairs handled at a time, so that the intermediate arrays stay in the processor's cache."""


def segment_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Distances between segments ab and cd; a segment may be a single point.

    Two segments of the plane either cross or are nearest at an end of one of them (Ericson, Real-Time
    Collision Detection, section 5.1.9).

    Args:
        a: shape (N, 2) [m]; likewise b, c, d.
        b: other end of the first segments.
        c: one end of the second segments.
        d: other end of the second segments.

    Returns:
        Shape (N,) [m]; 0 where they cross.
    """
    parts = [
        _chunk_distances(a[k : k + CHUNK], b[k : k + CHUNK], c[k : k + CHUNK], d[k : k + CHUNK])
        for k in range(0, len(a), CHUNK)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _chunk_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    least = _end_to_segment(a, c, d)
    np.minimum(least, _end_to_segment(b, c, d), out=least)
    np.minimum(least, _end_to_segment(c, a, b), out=least)
    np.minimum(least, _end_to_segment(d, a, b), out=least)
    # Segments that cross have ends that may all be far away, so crossing is asked for apart.
    return np.where(_cross(a, b, c, d), 0.0, np.sqrt(least))


def _end_to_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Squared distance from points to segments."""
    ux = b[:, 0] - a[:, 0]
    uy = b[:, 1] - a[:, 1]
    wx = p[:, 0] - a[:, 0]
    wy = p[:, 1] - a[:, 1]
    # The least positive number stands in for the squared length of a segment that is a point.
    t = np.clip((wx * ux + wy * uy) / np.maximum(ux * ux + uy * uy, np.finfo(np.float64).tiny), 0.0, 1.0)
    # From the foot of the perpendicular, or the nearer end, to the point.
    wx -= t * ux
    wy -= t * uy
    return np.asarray(wx * wx + wy * wy)


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the segments cross in their interiors; a mere touch shows in the end distances."""
    # The ends of each segment lie on opposite sides of the other one.
    opposite = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.asarray(opposite & _boxes_meet(a, b, c, d))


def _boxes_meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the boxes around the segments meet; those of collinear ones, whose sides are but rounding, do not."""
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.asarray(np.all(low <= high, axis=1))


def _side(a: FloatArray, b: FloatArray, p: FloatArray) -> FloatArray:
    return np.asarray(
        (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0]),
    )
