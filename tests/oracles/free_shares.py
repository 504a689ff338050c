"""How far straight motions come before a pose that a sampled check refutes, by numpy."""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.sampled_check import SampledCheck

CHUNK = 2048
"""Poses that are looked at together."""
STRIDE = 8
"""Of these poses, and the last, all are looked at before those between; the answer does not depend on it."""


def free_shares_by_numpy(check: SampledCheck, start: FloatArray, end: FloatArray) -> FloatArray:
    """As ``SampledCheck.free_shares``."""
    travel = check.arm.link_length * np.abs(end - start).sum(axis=1)
    count = np.maximum(1, np.ceil(travel / check.spacing)).astype(np.intp)
    # One beyond the last pose stands for none that is refuted.
    first = count + 1
    motion, k = _steps(count)
    early = (k % STRIDE == 0) | (k == count[motion])
    _look(check, start, end, count, motion[early], k[early], first)
    # Then only what lies before the first pose that was refuted.
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
    """Lower ``first`` of every motion to the first of some of its poses that is refuted."""
    for begin in range(0, len(motion), CHUNK):
        part = motion[begin : begin + CHUNK]
        step = k[begin : begin + CHUNK]
        share = (step / count[part])[:, None]
        bad = check.refuted(start[part] + share * (end[part] - start[part]))
        np.minimum.at(first, part[bad], step[bad])


def _steps(count: IntArray) -> tuple[IntArray, IntArray]:
    """Numbers 1 to count of several things, one after the other: which thing, and the number."""
    thing = np.repeat(np.arange(len(count)), count)
    number = np.arange(1, len(thing) + 1) - np.repeat(np.cumsum(count) - count, count)
    return thing, number
