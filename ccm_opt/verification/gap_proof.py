"""Proofs by bisection of time that gaps between moving bodies hold at all times.

Over a time interval, the distance of a pair of bodies changes from its value at mid-interval by at most the distance
that their points travel. A pair is therefore *proved* apart if its distance at mid-interval, less that travel, is large
enough, and *refuted* if the distance at mid-interval itself is too small. Otherwise the interval is halved. Intervals
start with a length of many samples, and surfaces as bounding boxes of many triangles; boxes larger than the travel are
replaced by their children before intervals are halved. Pairs that are still undecided when the travel is below
``settings.resolution``, or when the allowed work is used up, are rejected, so the proof is sound.

The same bisection finds the least gap over all times to within ``settings.report_resolution`` for the report.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.chain_motion import ChainMotion, TimeIntervals
from ccm_opt.verification.verification_settings import VerificationSettings

BLOCK = 32
"""Number of steps between samples in each initial time interval.

Measured on three problems in space: half as many compare links with many more boxes, twice as many with many more
triangles.
"""


@dataclass(frozen=True)
class Pairs:
    """P pairs of bodies in time intervals: a link, and either another link or a bounding box of surfaces.

    Attributes:
        interval: indices of the time intervals, shape (P,).
        link: indices of the links, from 0, shape (P,).
        other: indices of the other links or of the boxes, shape (P,).
    """

    interval: IntArray
    link: IntArray
    other: IntArray

    def __len__(self) -> int:
        return len(self.interval)

    @classmethod
    def in_all(cls, intervals: int, link: IntArray, other: IntArray) -> "Pairs":
        """Repeat given pairs of links and other bodies in each of a number of time intervals."""
        interval = np.repeat(np.arange(intervals), len(link))
        return cls(interval, np.tile(link, intervals), np.tile(other, intervals))

    def where(self, chosen: BoolArray | IntArray) -> "Pairs":
        """Return the pairs of bodies selected by a mask of shape (P,) or by indices."""
        return Pairs(self.interval[chosen], self.link[chosen], self.other[chosen])

    def and_also(self, others: "Pairs", shift: int = 0) -> "Pairs":
        """Return these pairs followed by other pairs, whose interval indices are shifted by `shift`."""
        return Pairs(
            np.concatenate((self.interval, others.interval + shift)),
            np.concatenate((self.link, others.link)),
            np.concatenate((self.other, others.other)),
        )


@dataclass(frozen=True)
class Nearest:
    """Least gap between two bodies, and where and when this gap occurs.

    Attributes:
        gap: gap between the two surfaces [m]; inf if no distance between two single bodies was computed.
        link: index of the link, from 0.
        other: index of the other link, or of the box of a single edge or triangle.
        time: time at which the gap occurs [s].
    """

    gap: float = np.inf
    link: int = 0
    other: int = 0
    time: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """Result of a proof that bodies stay apart.

    Attributes:
        proved: whether every pair is proved apart.
        nearest: the least gap found.
        remark: reason why the proof failed, if it needs explaining.
        kept: gap that every pair is proved to keep [m], at least the required one; -inf if the proof failed.
    """

    proved: bool
    nearest: Nearest
    remark: str = ""
    kept: float = -np.inf


@dataclass(frozen=True)
class Measured:
    """Bounds on the gaps of P pairs of bodies in their time intervals, each array of shape (P,).

    Attributes:
        least: lower bounds on the gaps throughout the intervals [m].
        most: upper bounds on the gaps at mid-interval [m].
        travel: bounds on the loss of gap between mid-interval and any other time of the interval [m].
        exact: mask of the pairs of two single bodies whose distance was computed.
    """

    least: FloatArray
    most: FloatArray
    travel: FloatArray
    exact: BoolArray


Measure = Callable[[TimeIntervals, FloatArray, Pairs, float], Measured]
"""Function from time intervals, poses at mid-interval (S, links + 1, d) [m], pairs and a cutoff [m] to bounds on gaps.

Gaps above the cutoff need not be bounded tightly.
"""
Opened = Callable[[Pairs, FloatArray], tuple[Pairs, BoolArray]]
"""Function that replaces boxes larger than the travel [m], shape (P,), of the link that they are paired with.

It returns pairs of these links and the children of the boxes, and a mask, shape (P,), of the pairs so replaced.
"""


def open_none(pairs: Pairs, travel: FloatArray) -> tuple[Pairs, BoolArray]:
    """Return no pairs and an all-false mask, for pairs without bounding boxes."""
    none = np.zeros(len(travel), dtype=bool)
    return pairs.where(none), none


def least_allowed_gap(limit: float, thickness: float, settings: VerificationSettings) -> float:
    """Return the required gap less the contact tolerance, raised so that axes never touch [m].

    Args:
        limit: required gap [m].
        thickness: distance of the axes at which the surfaces touch [m].
        settings: settings with the contact tolerance.
    """
    return max(limit - settings.contact_tolerance, settings.touch - thickness)


def prove_gaps(
    motion: ChainMotion,
    intervals: TimeIntervals,
    pairs: Pairs,
    measure: Measure,
    least: float,
    settings: VerificationSettings,
    opened: Opened = open_none,
    nearest: Nearest | None = None,
) -> Verdict:
    """Prove, or refute, that every pair of bodies keeps a required gap during its time interval.

    Args:
        motion: motion of the arm.
        intervals: time intervals.
        pairs: pairs of bodies in these intervals.
        measure: function that bounds the gaps of pairs.
        least: gap that every pair must keep [m].
        settings: resolutions and limits on the work.
        opened: function that replaces large boxes by their children.
        nearest: the least gap already found; none by default.
    """
    nearest = Nearest() if nearest is None else nearest
    ceiling = nearest.gap
    kept = np.inf
    # Breadth first: all pairs of one depth are measured at once, where numpy is fast.
    while len(pairs):
        cutoff = max(least, _reporting_cutoff(ceiling, settings))
        known = measure(intervals, motion.poses(intervals.middle), pairs, cutoff)
        nearest = _nearer(motion, intervals, pairs, known, nearest)
        # A pose of the motion itself is a counterexample, so no halving can help.
        if nearest.gap < least:
            return Verdict(proved=False, nearest=nearest)
        undecided = known.least < least
        if np.any(undecided & known.exact & (known.travel < settings.resolution)):
            return Verdict(proved=False, nearest=nearest, remark="touches within the resolution of the proof")
        # Halving doubles the pairs; a motion that would exceed the allowed memory is rejected, never accepted unproved.
        if 2 * np.count_nonzero(undecided) > settings.most_pairs:
            return Verdict(proved=False, nearest=nearest, remark="too close for too long for the proof to finish")

        # Pairs that are proved may still contain the least gap, which the report needs more precisely.
        ceiling = min(ceiling, nearest.gap, float(np.min(known.most)))
        vague = known.least < _reporting_cutoff(ceiling, settings)
        vague &= ~known.exact | (known.travel > 0.0)
        if np.count_nonzero(vague) < settings.most_report_pairs:
            undecided |= vague
        kept = min(kept, float(np.min(known.least[~undecided], initial=np.inf)))
        intervals, pairs = _divided(intervals, pairs.where(undecided), known.travel[undecided], opened)
    return Verdict(proved=nearest.gap >= least, nearest=nearest, kept=kept)


def _reporting_cutoff(ceiling: float, settings: VerificationSettings) -> float:
    """Return the gap above which a pair cannot change the reported least gap noticeably [m].

    Args:
        ceiling: upper bound on the least gap [m].
        settings: accuracy of the reported gap.
    """
    return min(ceiling - settings.report_resolution, (1.0 - settings.report_share) * ceiling)


def _nearer(motion: ChainMotion, intervals: TimeIntervals, pairs: Pairs, known: Measured, nearest: Nearest) -> Nearest:
    exact = np.where(known.exact, known.most, np.inf)
    best = int(np.argmin(exact))
    if exact[best] >= nearest.gap:
        return nearest
    when = motion.when(float(intervals.middle[pairs.interval[best]]))
    return Nearest(float(exact[best]), int(pairs.link[best]), int(pairs.other[best]), when)


def _divided(intervals: TimeIntervals, pairs: Pairs, travel: FloatArray, opened: Opened) -> tuple[TimeIntervals, Pairs]:
    """Return refined intervals and pairs: large boxes replaced by their children, intervals of other pairs halved."""
    parts, boxes = opened(pairs, travel)
    whole = pairs.where(~boxes)
    # Time intervals without pairs are dropped, so the remaining ones are renumbered.
    kept, renumbered = _numbered(parts.interval, len(intervals))
    cut, numbers = _numbered(whole.interval, len(intervals))
    first = replace(whole, interval=numbers)
    both = first.and_also(first, shift=len(cut))
    same = intervals.take(kept)
    halves = intervals.take(cut).halves()
    together = TimeIntervals(np.concatenate((same.low, halves.low)), np.concatenate((same.high, halves.high)))
    return together, replace(parts, interval=renumbered).and_also(both, shift=len(kept))


def _numbered(index: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return which of the numbers below ``count`` are among indices (P,), sorted, and the place of each index there."""
    present = np.zeros(count, dtype=bool)
    present[index] = True
    return np.flatnonzero(present), (np.cumsum(present) - 1)[index]
