"""Which samples of curves are kept so that straight lines between them stay near all others, extremes among them."""

import ctypes
import heapq
from itertools import pairwise
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.compiled_source import compiled_source

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_GAP = np.dtype([("away", np.float64), ("farthest", np.int64), ("begin", np.int64), ("end", np.int64)])
"""``Gap`` of thinning.c."""


class _ThinningStruct(ctypes.Structure):
    """``Thinning`` of thinning.c."""

    _fields_ = (
        *((name, _POINTER) for name in ("time", "columns")),
        *((name, _LONG) for name in ("samples", "width")),
        ("tolerance", ctypes.c_double),
        ("most", _LONG),
        *((name, _POINTER) for name in ("kept", "queue", "rise")),
    )


def kept_samples(time: FloatArray, columns: FloatArray, tolerance: float, most: int, always: IntArray) -> IntArray:
    """Numbers of the samples that are kept, increasing.

    Sample by sample, the one that is farthest from the lines between those kept so far is added (Ramer 1972, Douglas
    and Peucker 1973, here for all columns at once and the worst first).

    Args:
        time: shape (T,), increasing.
        columns: one curve each, shape (T, C).
        tolerance: largest distance of a sample from the lines that is left, unless ``most`` comes first.
        most: samples that are kept besides those that are always kept.
        always: samples that are kept in any case: first and last, least and greatest of every column are kept too.
    """
    kept = np.zeros(len(time), dtype=np.bool_)
    kept[[0, len(time) - 1, *np.argmin(columns, axis=0), *np.argmax(columns, axis=0), *always]] = True
    most += int(np.count_nonzero(kept))
    by_c = np.all(np.isfinite(columns)) and keep_by_c(kept, time, columns, tolerance, most)
    if not by_c:
        keep_by_python(kept, time, columns, tolerance, most)
    return np.flatnonzero(kept)


def keep_by_c(kept: BoolArray, time: FloatArray, columns: FloatArray, tolerance: float, most: int) -> bool:
    """As ``keep_by_python``, by compiled code; whether there is any."""
    library = compiled_source(Path(__file__).with_name("thinning.c"), ("thin_samples",))
    if library is None:
        return False
    times = np.ascontiguousarray(time, dtype=np.float64)
    values = np.ascontiguousarray(columns, dtype=np.float64)
    queue = np.empty(len(times), dtype=_GAP)
    rise = np.empty(values.shape[1])
    # C is given bare addresses: all of these live until it is done.
    job = _ThinningStruct(
        times.ctypes.data, values.ctypes.data, *values.shape, tolerance, most,
        *(array.ctypes.data for array in (kept, queue, rise)),
    )  # fmt: skip
    library.thin_samples(ctypes.byref(job))
    return True


def keep_by_python(kept: BoolArray, time: FloatArray, columns: FloatArray, tolerance: float, most: int) -> None:
    """Mark the samples that are kept beside those that are marked, the first and the last among them.

    Args:
        kept: shape (T,), changed.
        time: shape (T,), increasing.
        columns: shape (T, C).
        tolerance: largest distance of a sample from the lines that is left, unless ``most`` comes first.
        most: samples that are kept in all.
    """
    marked = np.flatnonzero(kept).tolist()
    queue = [worst for pair in pairwise(marked) if (worst := _farthest(time, columns, *pair))]
    heapq.heapify(queue)
    found = len(marked)
    while queue and found < most:
        error, middle, begin, end = heapq.heappop(queue)
        if -error <= tolerance:
            break
        kept[middle] = True
        found += 1
        for pair in ((begin, middle), (middle, end)):
            if worst := _farthest(time, columns, *pair):
                heapq.heappush(queue, worst)


def _farthest(time: FloatArray, columns: FloatArray, begin: int, end: int) -> tuple[float, int, int, int] | None:
    """The sample between two that is farthest from their line, with the negative distance first; None without any."""
    if end - begin < 2:
        return None
    share = ((time[begin + 1 : end] - time[begin]) / (time[end] - time[begin]))[:, None]
    line = columns[begin] + share * (columns[end] - columns[begin])
    away = np.max(np.abs(columns[begin + 1 : end] - line), axis=1)
    worst = int(np.argmax(away))
    return -float(away[worst]), begin + 1 + worst, begin, end
