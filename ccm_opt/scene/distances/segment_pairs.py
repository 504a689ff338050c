"""Where two segments in space are nearest to each other."""

import numpy as np

from ccm_opt.core.arrays import FloatArray


def segment_distances(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Nearest points of segments ab and cd, each end of shape (k, 3) [m].

    The nearest pair is where both lines are nearest if that is inside both segments, and else has an end of one.

    Returns:
        Shares along the first and the second, distances [m], and unit vectors from the second to the first.
    """
    tiny = 1e-300
    u = b - a
    w = d - c
    start = a - c
    uu = np.einsum("kd,kd->k", u, u)
    uw = np.einsum("kd,kd->k", u, w)
    ww = np.einsum("kd,kd->k", w, w)
    pu = np.einsum("kd,kd->k", start, u)
    pw = np.einsum("kd,kd->k", start, w)
    det = uu * ww - uw * uw
    skew = det > 1e-14 * uu * ww
    safe = np.where(skew, det, 1.0)
    inner_s = np.where(skew, (uw * pw - ww * pu) / safe, -1.0)
    inner_t = np.where(skew, (uu * pw - uw * pu) / safe, -1.0)
    inside = (inner_s > 0.0) & (inner_s < 1.0) & (inner_t > 0.0) & (inner_t < 1.0)
    zero = np.zeros_like(uu)
    one = np.ones_like(uu)
    candidates = (
        (zero, np.clip(pw / np.maximum(ww, tiny), 0.0, 1.0)),
        (one, np.clip((pw + uw) / np.maximum(ww, tiny), 0.0, 1.0)),
        (np.clip(-pu / np.maximum(uu, tiny), 0.0, 1.0), zero),
        (np.clip((uw - pu) / np.maximum(uu, tiny), 0.0, 1.0), one),
        (np.where(inside, inner_s, 0.0), np.where(inside, inner_t, np.clip(pw / np.maximum(ww, tiny), 0.0, 1.0))),
    )
    s = np.stack([share for share, _ in candidates])
    t = np.stack([share for _, share in candidates])
    lines = a + s[..., None] * u - c - t[..., None] * w
    squares = np.einsum("ckd,ckd->ck", lines, lines)
    best = np.argmin(squares, axis=0)
    columns = np.arange(len(uu))
    line = lines[best, columns]
    distance = np.sqrt(squares[best, columns])
    return s[best, columns], t[best, columns], distance, line / np.maximum(distance, 1e-12)[:, None]
