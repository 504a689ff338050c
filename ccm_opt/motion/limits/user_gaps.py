"""The user's gaps between keyframes: sampled within every interval, with a reserve for what lies between samples.

Equations are not looked at here: between keyframes a motion leaves them by the square of the step, and the path that
is laid through the keyframes in the end is brought back onto them.
"""

from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.motion.limits.user_slopes import slope_norms
from ccm_opt.motion.settings.user_limit_settings import UserLimitSettings

if TYPE_CHECKING:
    from ccm_opt.user_terms.row_set import RowSet


def intervals_with_broken_gaps(rows: "RowSet", headings: FloatArray, settings: UserLimitSettings) -> IntArray:
    """Intervals of a piecewise-linear motion in which a gap is less than its reserve, sorted.

    Args:
        rows: of the constraints that hold between keyframes.
        headings: link headings at the keyframes, shape (K, links) [rad].
        settings: samples and reserve.
    """
    lasting = _lasting(rows)
    if not lasting.any():
        return np.zeros(0, dtype=np.intp)
    intervals = len(headings) - 1

    # Places in units of intervals: place 2.25 is a quarter of the way through interval 2.
    place = np.arange(settings.samples * intervals + 1) / settings.samples
    k = np.minimum(place.astype(np.intp), intervals - 1)
    between = headings[k] + (place - k)[:, None] * (headings[k + 1] - headings[k])
    gaps = rows.table(between)[:, lasting]
    # Negated, so that NaN counts as short.
    short = ~(gaps >= _reserve(rows, lasting, gaps, headings[[0, -1]], settings)).all(axis=1)

    # A sample on a keyframe belongs to the intervals on both sides of it.
    before = np.maximum(np.ceil(place[short]).astype(np.intp) - 1, 0)
    return np.unique(np.concatenate((k[short], before)))


def _lasting(rows: "RowSet") -> BoolArray:
    """Which rows are gaps that hold over the whole motion, wherever keyframes are on it."""
    lasting: BoolArray = ~rows.equal & (rows.first <= 0.0) & (rows.last >= 1.0) & ~rows.parametric
    return lasting


def _reserve(
    rows: "RowSet", lasting: BoolArray, gaps: FloatArray, ends: FloatArray, settings: UserLimitSettings
) -> FloatArray:
    """Least gap at every sample, shape (N, rows): the reserve, but near an end no more than that end has."""
    # The reserve is an angle of the whole arm; a slope turns it into the unit of its gap.
    slopes = np.stack([slope_norms(np.asarray(rows.slopes(end, 0.0)[1])) for end in ends])[:, lasting]
    least = settings.reserve * settings.keep_share * settings.margin * slopes.max(axis=0)
    reserve = np.broadcast_to(least, gaps.shape).copy()

    # The start and the goal are given: a motion cannot have more room near them than they have.
    near = max(1, round(settings.near_end * len(gaps)))
    reserve[:near] = np.minimum(reserve[:near], np.maximum(gaps[0], -settings.allowed))
    reserve[-near:] = np.minimum(reserve[-near:], np.maximum(gaps[-1], -settings.allowed))
    return reserve
