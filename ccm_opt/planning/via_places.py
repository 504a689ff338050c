"""Via places, which a goal lists and the path of the tip passes in order, and where a path passes them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import KeyframeRows, LimitOf
from ccm_opt.planning.pose import CurveUnknowns


@dataclass(frozen=True, eq=False)
class Passings:
    """Positions where a path of straight legs comes nearest to places, in their order.

    Attributes:
        leg: leg on which each place is passed, shape (m,).
        share: share of the leg, from 0 to 1, shape (m,).
    """

    leg: IntArray
    share: FloatArray

    @property
    def along(self) -> FloatArray:
        """Positions as leg number plus share, so that corners of the path have integers, shape (m,)."""
        return np.asarray(self.leg + self.share, dtype=np.float64)


def passings(tips: FloatArray, places: FloatArray) -> Passings:
    """Return where a path passes places in order, so that the sum of the squared distances from these is least.

    Args:
        tips: corners of the path, at least two, shape (K, 3) [m].
        places: the places, shape (m, 3) [m].
    """
    leg = np.diff(tips, axis=0)
    size = np.einsum("kd,kd->k", leg, leg)
    off = places[:, None] - tips[None, :-1]
    along = np.einsum("mkd,kd->mk", off, leg) / np.where(size > 0.0, size, 1.0)
    share = np.clip(along, 0.0, 1.0)
    away = np.sum((off - share[..., None] * leg) ** 2, axis=2)
    chosen = _in_order(away)
    return Passings(chosen, share[np.arange(len(places)), chosen])


def _in_order(away: FloatArray) -> IntArray:
    """Return a column for each row of a table (m, k), non-decreasing and with the least sum of entries, shape (m,)."""
    # Dynamic programme: the least sum of rows so far with the last at a column or before it; then back from the end.
    sums = np.zeros_like(away)
    best = np.zeros(away.shape[1])
    for m in range(len(away)):
        sums[m] = best + away[m]
        best = np.minimum.accumulate(sums[m])
    chosen = np.zeros(len(away), dtype=np.intp)
    last = away.shape[1] - 1
    for m in reversed(range(len(away))):
        last = int(np.argmin(sums[m, : last + 1]))
        chosen[m] = last
    return chosen


def first_violation(tips: FloatArray, places: FloatArray, reach: float) -> tuple[int, float] | None:
    """Return the number of the first place that a path does not pass, and the path's distance from it [m], or None.

    Args:
        tips: samples of the path, shape (N, 3) [m].
        places: places in the order in which they are to be passed, shape (m, 3) [m].
        reach: distance that counts as passing [m].
    """
    first = 0
    for number, place in enumerate(places):
        away = np.linalg.norm(tips[first:] - place, axis=1)
        near = np.flatnonzero(away <= reach)
        if len(near) == 0:
            return number, float(np.min(away))
        first += int(near[0])
    return None


@dataclass(frozen=True, eq=False)
class PassedPlaces(LimitOf[CurveUnknowns]):
    """Limit of motions whose tip passes places at keyframes, in their order.

    Attributes:
        places: the places, shape (m, d) [m].
        reach: largest distance of the tip from a place, unless it was larger before [m].
    """

    places: FloatArray
    reach: float

    def _passed(self, sweep: Any) -> tuple[IntArray, FloatArray]:
        """Return the keyframes that pass the places, (m,), and the tip's offsets from the places, shape (m, d) [m]."""
        off = sweep.points[:, sweep.space.arm.links] - self.places[:, None]
        keyframe = _in_order(np.sum(off**2, axis=2))
        return keyframe, off[np.arange(len(keyframe)), keyframe]

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return bounds per axis that keep the tip in the cube inscribed in the ball, or no farther out than before."""
        del u
        keyframe, off = self._passed(sweep)
        moved = np.flatnonzero(keyframe > 0)
        keyframe, off = keyframe[moved], off[moved] / sweep.space.nominal_length
        d = off.shape[1]
        most = np.maximum(self.reach / (np.sqrt(d) * sweep.space.nominal_length), np.abs(off))
        slopes = sweep.moving[keyframe, sweep.space.arm.links] / sweep.space.nominal_length
        return (
            KeyframeRows(
                np.repeat(keyframe, d), slopes.reshape(len(off) * d, -1), (-most - off).ravel(), (most - off).ravel()
            ),
        )

    def holds(self, sweep: Any, before: Any, u: FloatArray) -> bool:
        """Return whether the tip passes every place within ``reach``, or at least as near as before."""
        del u
        away, was = (np.linalg.norm(self._passed(each)[1], axis=1) for each in (sweep, before))
        return bool(np.all(away <= np.maximum(self.reach, was) * (1.0 + 1e-9)))
