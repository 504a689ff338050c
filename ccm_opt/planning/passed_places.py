"""Where a path of the tip passes the places that a goal names on the way, one after the other."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Passings:
    """Where a path of straight legs comes nearest to places, in their order.

    Attributes:
        leg: on which each place is passed, shape (m,).
        share: of the leg, from 0 to 1, shape (m,).
    """

    leg: IntArray
    share: FloatArray

    @property
    def along(self) -> FloatArray:
        """The same as one number, corners being whole ones, shape (m,)."""
        return np.asarray(self.leg + self.share, dtype=np.float64)


def passings(tips: FloatArray, places: FloatArray) -> Passings:
    """Where a path passes places in their order so that the squares of its distances from them are least in all.

    Args:
        tips: corners of the path, at least two, shape (K, 3) [m].
        places: shape (m, 3) [m].
    """
    leg = np.diff(tips, axis=0)
    size = np.einsum("kd,kd->k", leg, leg)
    off = places[:, None] - tips[None, :-1]
    along = np.einsum("mkd,kd->mk", off, leg) / np.where(size > 0.0, size, 1.0)
    share = np.clip(along, 0.0, 1.0)
    away = np.sum((off - share[..., None] * leg) ** 2, axis=2)
    # The least sum of places so far with the last of them passed on a leg or before it; then back from the end.
    sums = np.zeros_like(away)
    best = np.zeros(len(leg))
    for m in range(len(places)):
        sums[m] = best + away[m]
        best = np.minimum.accumulate(sums[m])
    chosen = np.zeros(len(places), dtype=np.intp)
    last = len(leg) - 1
    for m in reversed(range(len(places))):
        chosen[m] = int(np.argmin(sums[m, : last + 1]))
        last = int(chosen[m])
    return Passings(chosen, share[np.arange(len(places)), chosen])


def first_missed(tips: FloatArray, places: FloatArray, reach: float) -> tuple[int, float] | None:
    """Number of the first place that a path does not pass within reach, and how near it comes [m]; None of none.

    Args:
        tips: the path at samples, shape (N, 3) [m].
        places: in the order in which they are to be passed, shape (m, 3) [m].
        reach: how near counts [m].
    """
    first = 0
    for number, place in enumerate(places):
        away = np.linalg.norm(tips[first:] - place, axis=1)
        near = np.flatnonzero(away <= reach)
        if len(near) == 0:
            return number, float(np.min(away))
        first += int(near[0])
    return None
