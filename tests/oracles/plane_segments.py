"""Closest points of segments in the plane, and test for crossings."""

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray


def closest_on_segments(
    p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the closest points of m pairs of segments pq and rs that do not cross, from four end-to-segment distances.

    Returns:
        Place on pq, place on rs, and the vector from the point on rs to the point on pq; shapes (m,), (m,), (m, 2).
    """
    d = q - p
    e = s - r
    dd = np.maximum(np.einsum("ij,ij->i", d, d), 1e-30)
    ee = np.maximum(np.einsum("ij,ij->i", e, e), 1e-30)

    w = p - r
    dw = np.einsum("ij,ij->i", d, w)
    ew = np.einsum("ij,ij->i", e, w)
    de = np.einsum("ij,ij->i", d, e)
    zero = np.zeros_like(dw)
    one = np.ones_like(dw)
    # An end of one segment is nearest to the other at its projection, clipped; all four ends are tried.
    on_first = np.stack((np.clip(-dw / dd, 0, 1), np.clip((de - dw) / dd, 0, 1), zero, one))
    on_second = np.stack((zero, one, np.clip(ew / ee, 0, 1), np.clip((ew + de) / ee, 0, 1)))

    apart = w + on_first[..., None] * d - on_second[..., None] * e
    best = np.argmin(np.einsum("kij,kij->ki", apart, apart), axis=0)
    columns = np.arange(len(p))
    return on_first[best, columns], on_second[best, columns], apart[best, columns]


def segments_cross(p: FloatArray, q: FloatArray, r: FloatArray, s: FloatArray) -> BoolArray:
    """Return whether m pairs of segments pq and rs cross properly, in a point inside both, shape (m,).

    Overlap of bounding boxes is checked too, since orientations of collinear segments are only rounding errors.
    """
    # Each segment's ends lie on opposite sides of the other's line; an end that touches counts as no crossing.
    opposite = (_side(p, q, r) * _side(p, q, s) < 0.0) & (_side(r, s, p) * _side(r, s, q) < 0.0)
    low = np.maximum(np.minimum(p, q), np.minimum(r, s))
    high = np.minimum(np.maximum(p, q), np.maximum(r, s))
    return np.asarray(opposite & np.all(low <= high, axis=1))


def _side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    # Twice the signed area of the triangle: positive where r lies to the left of pq.
    return (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])
