"""Via points, which the tip has to pass in order on its way to the goal, and the positions where a path passes them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit import KeyframeRows, LimitOf
from ccm_opt.planning.pose import CurveUnknowns


@dataclass(frozen=True, eq=False)
class Passings:
    """Positions on a polyline of the tip at which m via points are passed, in their order.

    Attributes:
        leg: index of the leg on which each via point is passed, shape (m,).
        share: fraction of the leg before that position, from 0 to 1, shape (m,).
    """

    leg: IntArray
    share: FloatArray

    @property
    def along(self) -> FloatArray:
        """Positions as the index of the leg plus the fraction of the leg, so that vertices are integers, shape (m,)."""
        return np.asarray(self.leg + self.share, dtype=np.float64)


def passings(tips: FloatArray, places: FloatArray) -> Passings:
    """Return the positions on a tip path that count as those at which the via points are passed, in order.

    Among all positions on non-decreasing legs, these minimise the sum of the squared distances from the via points.

    Args:
        tips: vertices of the path, at least two, shape (K, 3) [m].
        places: via points, shape (m, 3) [m].
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
    """Return a column index for each row of a table (m, k), non-decreasing and with the least sum of entries, (m,)."""
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
    """Return the index of the first via point that a tip path does not pass in order, and its distance [m].

    The distance is the least from this via point to the samples after the previous one was passed. The result is None
    if all are passed.

    Args:
        tips: samples of the tip path, shape (N, 3) [m].
        places: via points in the order in which they have to be passed, shape (m, 3) [m].
        reach: distance within which a via point counts as passed [m].
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
    """Limit on a motion that makes the tip pass via points at keyframes, in their order.

    Attributes:
        places: via points, shape (m, d) [m].
        reach: largest distance of the tip from a via point, unless the distance was larger before a step [m].
    """

    places: FloatArray
    reach: float

    def _passed(self, sweep: Any) -> tuple[IntArray, FloatArray]:
        """Return the keyframes at which m via points are passed, (m,), and the tip's offsets from them, (m, d) [m]."""
        off = sweep.points[:, sweep.space.arm.links] - self.places[:, None]
        keyframe = _in_order(np.sum(off**2, axis=2))
        return keyframe, off[np.arange(len(keyframe)), keyframe]

    def keyframe_rows(self, sweep: Any, u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return linear bounds that keep the tip near the via points at the keyframes that pass them.

        The tip stays in a cube around the via point, inscribed in the ball of radius ``reach``; coordinates of the
        offset that are larger already must not grow.
        """
        del u
        keyframe, off = self._passed(sweep)
        moved = np.flatnonzero(keyframe > 0)
        keyframe, off = keyframe[moved], off[moved] / sweep.space.nominal_length
        d = off.shape[1]
        most = np.maximum(self.reach / (np.sqrt(d) * sweep.space.nominal_length), np.abs(off))
        slopes = sweep.moving[keyframe, sweep.space.arm.links] / sweep.space.nominal_length
        return (
            KeyframeRows(
                np.repeat(keyframe, d),
                slopes.reshape(len(off) * d, -1),
                (-most - off).ravel(),
                (most - off).ravel(),
                "via places",
            ),
        )

    def holds(self, sweep: Any, before: Any, u: FloatArray) -> bool:
        """Return whether the tip passes every via point within ``reach``, or no farther away than in ``before``."""
        del u
        away, was = (np.linalg.norm(self._passed(each)[1], axis=1) for each in (sweep, before))
        return bool(np.all(away <= np.maximum(self.reach, was) * (1.0 + 1e-9)))
