"""Proofs at all times by bisection.

In a stretch of time around its middle pose the distance of a pair changes by at most the distance its points can
travel, so a pair is *proved* apart when its distance at the middle, less that travel, is still enough; it is
*refuted* when the distance at the middle itself is too small. Neither: halve the stretch. Stretches begin as many
samples long, and surfaces as boxes of many; what is larger than what moves is opened before stretches are halved. What
is still undecided when the travel is below ``settings.resolution`` or the work is used up is refused, so the proof is
sound.

The same halving finds the least gap over all times to within ``settings.report_resolution``, for the report.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.chain_motion import ChainMotion, TimeStretches
from ccm_opt.verification.verification_settings import VerificationSettings

BLOCK = 32
"""Intervals between samples that make the first stretches. Measured on three jobs in space: with half as many pairs
must be told apart from many more boxes, with twice as many from many more triangles."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of bodies in stretches of time: a link, and another link or a box of surfaces.

    Attributes:
        stretch: number of the stretch, shape (P,).
        link: number of the link from 0, shape (P,).
        other: number of the other link, or of a box of surfaces, shape (P,).
    """

    stretch: IntArray
    link: IntArray
    other: IntArray

    def __len__(self) -> int:
        return len(self.stretch)

    @classmethod
    def in_all(cls, stretches: int, link: IntArray, other: IntArray) -> "Pairs":
        """Return the same pairs in each of some stretches."""
        stretch = np.repeat(np.arange(stretches), len(link))
        return cls(stretch, np.tile(link, stretches), np.tile(other, stretches))

    def where(self, chosen: BoolArray | IntArray) -> "Pairs":
        """Return the pairs that a mask of shape (P,), or numbers, keep."""
        return Pairs(self.stretch[chosen], self.link[chosen], self.other[chosen])

    def and_also(self, others: "Pairs", shift: int = 0) -> "Pairs":
        """Return the these, and others whose stretches are numbered from a shift."""
        return Pairs(
            np.concatenate((self.stretch, others.stretch + shift)),
            np.concatenate((self.link, others.link)),
            np.concatenate((self.other, others.other)),
        )


@dataclass(frozen=True)
class Nearest:
    """The least gap met.

    Attributes:
        gap: between the two surfaces [m]; inf when no pair was near.
        link: number of the link from 0.
        other: number of the other link, or of the box of one surface.
        time: when [s].
    """

    gap: float = np.inf
    link: int = 0
    other: int = 0
    time: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """What a proof has come to.

    Attributes:
        proved: whether every pair is proved apart.
        nearest: the least gap met.
        remark: why not, where that needs words.
        kept: gap that every pair is proved to keep [m], not less than was to be proved; -inf where that is not.
    """

    proved: bool
    nearest: Nearest
    remark: str = ""
    kept: float = -np.inf


@dataclass(frozen=True)
class Measured:
    """What is known of pairs, each array of shape (P,) [m].

    Attributes:
        least: gap that is kept throughout the stretch.
        most: gap at the middle of the stretch, or more.
        travel: how much of a gap may be lost from the middle on.
        exact: whether the pair is one of two bodies, and was measured as such.
    """

    least: FloatArray
    most: FloatArray
    travel: FloatArray
    exact: BoolArray


Measure = Callable[[TimeStretches, FloatArray, Pairs, float], Measured]
"""Stretches, the poses at their middles, shape (S, links + 1, d) [m], pairs, and the gap [m] beyond which it is enough
to know that they keep it, to what is known of the pairs."""
Opened = Callable[[Pairs, FloatArray], tuple[Pairs, BoolArray]]
"""Pairs and their travels, to those that take the place of boxes, and which were boxes to be opened."""


def open_none(pairs: Pairs, travel: FloatArray) -> tuple[Pairs, BoolArray]:
    """For pairs that are none of boxes."""
    none = np.zeros(len(travel), dtype=bool)
    return pairs.where(none), none


def least_allowed_gap(limit: float, thickness: float, settings: VerificationSettings) -> float:
    """Return the gap a pair must have: the limit less the contact tolerance, but never axes that touch.

    Args:
        limit: gap asked for [m].
        thickness: distance of the axes at which the surfaces touch [m].
        settings: the contact tolerance.
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
        motion: of the arm.
        stretches: of time.
        pairs: in them.
        measure: what is known of pairs.
        least: gap that every pair must keep [m].
        settings: resolutions, and how much work may be done.
        opened: parts of boxes.
        nearest: the least gap that is known to be met; none by default.
    """
    nearest = Nearest() if nearest is None else nearest
    ceiling = nearest.gap
    kept = np.inf
    # Breadth first: all pairs of one depth are measured at once, where numpy is fast.
    while len(pairs):
        cutoff = max(least, _told(ceiling, settings))
        known = measure(stretches, motion.poses(stretches.middle), pairs, cutoff)
        nearest = _nearer(motion, stretches, pairs, known, nearest)
        # A pose of the motion itself is too near: a counterexample, so that no halving can help.
        if nearest.gap < least:
            return Verdict(proved=False, nearest=nearest)
        undecided = known.least < least
        if np.any(undecided & known.exact & (known.travel < settings.resolution)):
            return Verdict(proved=False, nearest=nearest, remark="touches within the resolution of the proof")
        # Halving doubles the pairs; a motion that would need more memory than that is refused, never waved through.
        if 2 * np.count_nonzero(undecided) > settings.most_pairs:
            return Verdict(proved=False, nearest=nearest, remark="so close for so long that the proof was given up")

        # What is proved may still hold the least gap, which the report wants more exactly.
        ceiling = min(ceiling, nearest.gap, float(np.min(known.most)))
        vague = known.least < _told(ceiling, settings)
        vague &= ~known.exact | (known.travel > 0.0)
        if np.count_nonzero(vague) < settings.most_report_pairs:
            undecided |= vague
        kept = min(kept, float(np.min(known.least[~undecided], initial=np.inf)))
        stretches, pairs = _divided(stretches, pairs.where(undecided), known.travel[undecided], opened)
    return Verdict(proved=nearest.gap >= least, nearest=nearest, kept=kept)


def _told(ceiling: float, settings: VerificationSettings) -> float:
    """Return the gaps from which on nothing is told more exactly, where a known one is met [m]."""
    return min(ceiling - settings.report_resolution, (1.0 - settings.report_share) * ceiling)


def _nearer(motion: ChainMotion, stretches: TimeStretches, pairs: Pairs, known: Measured, nearest: Nearest) -> Nearest:
    exact = np.where(known.exact, known.most, np.inf)
    best = int(np.argmin(exact))
    if exact[best] >= nearest.gap:
        return nearest
    when = motion.when(float(stretches.middle[pairs.stretch[best]]))
    return Nearest(float(exact[best]), int(pairs.link[best]), int(pairs.other[best]), when)


def _divided(stretches: TimeStretches, pairs: Pairs, travel: FloatArray, opened: Opened) -> tuple[TimeStretches, Pairs]:
    """Return the boxes that are larger than what moves are opened, and the stretches of the other pairs halved."""
    parts, boxes = opened(pairs, travel)
    whole = pairs.where(~boxes)
    # Stretches without a pair are dropped, so pairs are numbered anew among those that are left.
    kept, renumbered = np.unique(parts.stretch, return_inverse=True)
    cut, numbers = np.unique(whole.stretch, return_inverse=True)
    first = replace(whole, stretch=numbers)
    both = first.and_also(first, shift=len(cut))
    same = stretches.take(kept)
    halves = stretches.take(cut).halves()
    together = TimeStretches(np.concatenate((same.low, halves.low)), np.concatenate((same.high, halves.high)))
    return together, replace(parts, stretch=renumbered).and_also(both, shift=len(kept))
