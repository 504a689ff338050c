"""Fractions of straight motions before a sampled collision check fails, by NumPy."""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.sampled_check import SampledCheck

CHUNK = 2048
"""Number of poses checked in one batch."""
STRIDE = 8
"""Interval of the poses that are checked first, with the last one; the result does not depend on this number."""


def free_shares_by_numpy(check: SampledCheck, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the collision-free fractions of straight motions, as ``SampledCheck.free_shares``."""
    travel = check.arm.link_length * np.abs(end - start).sum(axis=1)
    count = np.maximum(1, np.ceil(travel / check.spacing)).astype(np.intp)
    # One more than the last index means that no pose is refuted.
    first = count + 1
    motion, k = _steps(count)
    early = (k % STRIDE == 0) | (k == count[motion])
    _look(check, start, end, count, motion[early], k[early], first)
    # Then check only poses before the first one that was refuted.
    late = ~early & (k < first[motion])
    _look(check, start, end, count, motion[late], k[late], first)
    shares: FloatArray = (first - 1) / count
    return shares


def _look(
    check: SampledCheck,
    start: FloatArray,
    end: FloatArray,
    count: IntArray,
    motion: IntArray,
    k: IntArray,
    first: IntArray,
) -> None:
    """Check poses of motions, and lower ``first`` of each motion in place to the first pose that is refuted."""
    for begin in range(0, len(motion), CHUNK):
        part = motion[begin : begin + CHUNK]
        step = k[begin : begin + CHUNK]
        share = (step / count[part])[:, None]
        bad = check.refuted(start[part] + share * (end[part] - start[part]))
        np.minimum.at(first, part[bad], step[bad])


def _steps(count: IntArray) -> tuple[IntArray, IntArray]:
    """Return indices of items, each repeated as often as its count, and the numbers from 1 to the count."""
    thing = np.repeat(np.arange(len(count)), count)
    number = np.arange(1, len(thing) + 1) - np.repeat(np.cumsum(count) - count, count)
    return thing, number
