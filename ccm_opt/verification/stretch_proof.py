"""Proofs by bisection that gaps hold at all times.

Over a stretch of time, the distance of a pair of bodies changes from its value at mid-stretch by at most the distance
that their points travel. A pair is therefore *proved* apart if its distance at mid-stretch, less that travel, is large
enough, and *refuted* if the distance at mid-stretch itself is too small. Otherwise the stretch is halved. Stretches
start with a length of many samples, and surfaces as boxes of many triangles; boxes larger than the travel are opened
before stretches are halved. Pairs that are still undecided when the travel is below ``settings.resolution``, or when
the allowed work is used up, are rejected, so the proof is sound.

The same bisection finds the least gap over all times to within ``settings.report_resolution`` for the report.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.chain_motion import ChainMotion, TimeStretches
from ccm_opt.verification.verification_settings import VerificationSettings

BLOCK = 32
"""Number of sample intervals in the initial stretches.

Measured on three problems in space: half as many compare links with many more boxes, twice as many with many more
triangles.
"""


@dataclass(frozen=True)
class Pairs:
    """Pairs of bodies in stretches of time: a link, and either another link or a box of surfaces.

    Attributes:
        stretch: indices of the stretches, shape (P,).
        link: indices of the links, from 0, shape (P,).
        other: indices of the other links or of the boxes, shape (P,).
    """

    stretch: IntArray
    link: IntArray
    other: IntArray

    def __len__(self) -> int:
        return len(self.stretch)

    @classmethod
    def in_all(cls, stretches: int, link: IntArray, other: IntArray) -> "Pairs":
        """Repeat pairs of links and others in each of a number of stretches."""
        stretch = np.repeat(np.arange(stretches), len(link))
        return cls(stretch, np.tile(link, stretches), np.tile(other, stretches))

    def where(self, chosen: BoolArray | IntArray) -> "Pairs":
        """Return the pairs selected by a mask of shape (P,) or by indices."""
        return Pairs(self.stretch[chosen], self.link[chosen], self.other[chosen])

    def and_also(self, others: "Pairs", shift: int = 0) -> "Pairs":
        """Return these pairs followed by others, whose stretch indices are shifted by `shift`."""
        return Pairs(
            np.concatenate((self.stretch, others.stretch + shift)),
            np.concatenate((self.link, others.link)),
            np.concatenate((self.other, others.other)),
        )


@dataclass(frozen=True)
class Nearest:
    """The least gap found, and where and when it occurs.

    Attributes:
        gap: gap between the two surfaces [m]; inf if no pair was near.
        link: index of the link, from 0.
        other: index of the other link, or of the box of a single surface.
        time: time at which the gap occurs [s].
    """

    gap: float = np.inf
    link: int = 0
    other: int = 0
    time: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """The result of a proof.

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
    """Bounds on the gaps of pairs, each array of shape (P,) [m].

    Attributes:
        least: lower bound on the gap throughout the stretch.
        most: upper bound on the gap at mid-stretch.
        travel: largest loss of gap between mid-stretch and any other time of the stretch.
        exact: mask of the pairs of two single bodies whose distance was computed.
    """

    least: FloatArray
    most: FloatArray
    travel: FloatArray
    exact: BoolArray


Measure = Callable[[TimeStretches, FloatArray, Pairs, float], Measured]
"""Function from stretches, their poses at mid-stretch (S, links + 1, d) [m], pairs and a cutoff [m] to gap bounds.

Gaps above the cutoff need not be bounded tightly.
"""
Opened = Callable[[Pairs, FloatArray], tuple[Pairs, BoolArray]]
"""Function from pairs and their travels to pairs with the contents of opened boxes, and a mask of the boxes opened."""


def open_none(pairs: Pairs, travel: FloatArray) -> tuple[Pairs, BoolArray]:
    """Open no boxes, for pairs without boxes."""
    none = np.zeros(len(travel), dtype=bool)
    return pairs.where(none), none


def least_allowed_gap(limit: float, thickness: float, settings: VerificationSettings) -> float:
    """Return the gap that a pair must keep: the limit less the contact tolerance, raised where axes could touch.

    Args:
        limit: required gap [m].
        thickness: distance of the axes at which the surfaces touch [m].
        settings: settings with the contact tolerance.
    """
    return max(limit - settings.contact_tolerance, settings.touch - thickness)


def prove_stretches(
    motion: ChainMotion,
    stretches: TimeStretches,
    pairs: Pairs,
    measure: Measure,
    least: float,
    settings: VerificationSettings,
    opened: Opened = open_none,
    nearest: Nearest | None = None,
) -> Verdict:
    """Prove that every pair keeps a gap of at least ``least`` during its stretch.

    Args:
        motion: motion of the arm.
        stretches: stretches of time.
        pairs: pairs in these stretches.
        measure: function that bounds the gaps of pairs.
        least: gap that every pair must keep [m].
        settings: resolutions and limits on the work.
        opened: function that opens boxes.
        nearest: the least gap already found; none by default.
    """
    nearest = Nearest() if nearest is None else nearest
    ceiling = nearest.gap
    kept = np.inf
    # Breadth first: all pairs of one depth are measured at once, where numpy is fast.
    while len(pairs):
        cutoff = max(least, _told(ceiling, settings))
        known = measure(stretches, motion.poses(stretches.middle), pairs, cutoff)
        nearest = _nearer(motion, stretches, pairs, known, nearest)
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
        vague = known.least < _told(ceiling, settings)
        vague &= ~known.exact | (known.travel > 0.0)
        if np.count_nonzero(vague) < settings.most_report_pairs:
            undecided |= vague
        kept = min(kept, float(np.min(known.least[~undecided], initial=np.inf)))
        stretches, pairs = _divided(stretches, pairs.where(undecided), known.travel[undecided], opened)
    return Verdict(proved=nearest.gap >= least, nearest=nearest, kept=kept)


def _told(ceiling: float, settings: VerificationSettings) -> float:
    """Return the gap above which pairs need no refinement for the report, given an upper bound on the least gap [m]."""
    return min(ceiling - settings.report_resolution, (1.0 - settings.report_share) * ceiling)


def _nearer(motion: ChainMotion, stretches: TimeStretches, pairs: Pairs, known: Measured, nearest: Nearest) -> Nearest:
    exact = np.where(known.exact, known.most, np.inf)
    best = int(np.argmin(exact))
    if exact[best] >= nearest.gap:
        return nearest
    when = motion.when(float(stretches.middle[pairs.stretch[best]]))
    return Nearest(float(exact[best]), int(pairs.link[best]), int(pairs.other[best]), when)


def _divided(stretches: TimeStretches, pairs: Pairs, travel: FloatArray, opened: Opened) -> tuple[TimeStretches, Pairs]:
    """Refine pairs: open boxes larger than the travel, and halve the stretches of all other pairs."""
    parts, boxes = opened(pairs, travel)
    whole = pairs.where(~boxes)
    # Stretches without pairs are dropped, so the remaining stretches are renumbered.
    kept, renumbered = np.unique(parts.stretch, return_inverse=True)
    cut, numbers = np.unique(whole.stretch, return_inverse=True)
    first = replace(whole, stretch=numbers)
    both = first.and_also(first, shift=len(cut))
    same = stretches.take(kept)
    halves = stretches.take(cut).halves()
    together = TimeStretches(np.concatenate((same.low, halves.low)), np.concatenate((same.high, halves.high)))
    return together, replace(parts, stretch=renumbered).and_also(both, shift=len(kept))
