"""Whether triangles that share vertices enclose something."""

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import IntArray


def is_closed(faces: IntArray) -> bool:
    """Whether every edge is one of an even number of triangles, so that there is an inside.

    Args:
        faces: vertices of each triangle, shape (m, 3).
    """
    keys = np.sort(edge_keys(faces))
    starts = np.flatnonzero(np.append(True, keys[1:] != keys[:-1]))
    counts = np.diff(np.append(starts, len(keys)))
    return bool(len(faces) and np.all(counts % 2 == 0))


def edge_keys(faces: IntArray, base: int | None = None) -> npt.NDArray[np.uint64]:
    """Every edge of every triangle as one number, whichever way it runs, shape (3 m,).

    Args:
        faces: vertices of each triangle, shape (m, 3).
        base: more than any vertex; absent: one more than the greatest.
    """
    if len(faces) == 0:
        return np.zeros(0, dtype=np.uint64)
    step = np.uint64(faces.max() + 1 if base is None else base)
    starts = faces.ravel().astype(np.uint64)
    ends = np.roll(faces, -1, axis=1).ravel().astype(np.uint64)
    return np.minimum(starts, ends) * step + np.maximum(starts, ends)
