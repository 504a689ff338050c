"""Which samples of curves are kept so that straight lines between them stay near all others, extremes among them."""

import heapq
from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray


def kept_samples(time: FloatArray, columns: FloatArray, tolerance: float, most: int, always: IntArray) -> IntArray:
    """Choose the samples that are kept, by their numbers, increasing.

    Sample by sample, the one that is farthest from the lines between those kept so far is added (Ramer 1972, Douglas
    and Peucker 1973, here for all columns at once and the worst first). Unlike the least and greatest of even stretches
    of time this bounds the error, by which the page draws the arm, and keeps a tenth of the samples.

    Args:
        time: shape (T,), increasing.
        columns: one curve each, shape (T, C).
        tolerance: largest distance of a sample from the lines that is left, unless ``most`` comes first.
        most: samples that are kept besides those that are always kept.
        always: samples that are kept in any case: first and last, least and greatest of every column are kept too.
    """
    kept = {0, len(time) - 1, *np.argmin(columns, axis=0).tolist(), *np.argmax(columns, axis=0).tolist()}
    kept |= set(always.tolist())
    most += len(kept)
    queue = [worst for pair in pairwise(sorted(kept)) if (worst := _farthest(time, columns, *pair))]
    heapq.heapify(queue)
    while queue and len(kept) < most:
        error, middle, begin, end = heapq.heappop(queue)
        if -error <= tolerance:
            break
        kept.add(middle)
        for pair in ((begin, middle), (middle, end)):
            if worst := _farthest(time, columns, *pair):
                heapq.heappush(queue, worst)
    return np.array(sorted(kept), dtype=np.intp)


def _farthest(time: FloatArray, columns: FloatArray, begin: int, end: int) -> tuple[float, int, int, int] | None:
    """The sample between two that is farthest from their line, with the negative distance first; None without any."""
    if end - begin < 2:
        return None
    share = ((time[begin + 1 : end] - time[begin]) / (time[end] - time[begin]))[:, None]
    line = columns[begin] + share * (columns[end] - columns[begin])
    away = np.max(np.abs(columns[begin + 1 : end] - line), axis=1)
    worst = int(np.argmax(away))
    return -float(away[worst]), begin + 1 + worst, begin, end
