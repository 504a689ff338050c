"""Proofs over stretches of a motion in space.

As in ``verification.bisection`` a pair is *proved* apart in a stretch of time when its gap at the middle, less what it
can lose in the stretch, is enough, *refuted* when a pose of the motion itself is too near, and else halved.
Stretches begin as many samples long. What is still undecided when no more can be lost than the resolution, or when the
work is used up, is refused, so the proof is sound.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.bisection import Nearest, Verdict
from ccm_opt.verification.space_chain_motion import SpaceChainMotion, TimeStretches
from ccm_opt.verification.verification_settings import VerificationSettings


@dataclass(frozen=True)
class StretchPairs:
    """Pairs of bodies in stretches of time.

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

    def where(self, mask: BoolArray) -> "StretchPairs":
        """The pairs that a mask of shape (P,) keeps."""
        return StretchPairs(self.stretch[mask], self.link[mask], self.other[mask])

    def and_also(self, others: "StretchPairs", shift: int = 0) -> "StretchPairs":
        """These, and others whose stretches are numbered from a shift."""
        return StretchPairs(
            np.concatenate((self.stretch, others.stretch + shift)),
            np.concatenate((self.link, others.link)),
            np.concatenate((self.other, others.other)),
        )


@dataclass(frozen=True)
class Measured:
    """What is known of pairs, each array of shape (P,) [m].

    Attributes:
        least: gap at the middle of the stretch, or less.
        most: gap at the middle, or more.
        travel: how much of the gap may be lost in the stretch.
        exact: whether the pair is one of two bodies, and not of a box of them.
    """

    least: FloatArray
    most: FloatArray
    travel: FloatArray
    exact: BoolArray


Measure = Callable[[TimeStretches, FloatArray, StretchPairs, float], Measured]
"""Stretches, the poses at their middles, shape (S, links + 1, 3) [m], pairs, and the gap [m] beyond which it is enough
to know that they keep it, to what is known of the pairs."""
Opened = Callable[[StretchPairs, FloatArray], tuple[StretchPairs, BoolArray]]
"""Pairs and their travels, to those that take the place of boxes, and which were boxes to be opened."""


def open_none(pairs: StretchPairs, travel: FloatArray) -> tuple[StretchPairs, BoolArray]:
    """For pairs that are none of boxes."""
    none = np.zeros(len(travel), dtype=bool)
    return pairs.where(none), none


def prove_stretches(
    motion: SpaceChainMotion,
    stretches: TimeStretches,
    pairs: StretchPairs,
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
    while len(pairs):
        cutoff = max(least, ceiling - settings.report_resolution)
        known = measure(stretches, motion.poses(stretches.middle), pairs, cutoff)
        nearest = _nearer(motion, stretches, pairs, known, nearest)
        # A pose of the motion itself is too near: a counterexample, so that no halving can help.
        if nearest.gap < least:
            return Verdict(proved=False, nearest=nearest)
        after = known.least - known.travel
        undecided = after < least
        if np.any(undecided & known.exact & (known.travel < settings.resolution)):
            return Verdict(proved=False, nearest=nearest, remark="touches within the resolution of the proof")
        if 2 * np.count_nonzero(undecided) > settings.most_pairs:
            return Verdict(proved=False, nearest=nearest, remark="so close for so long that the proof was given up")

        # What is proved may still hold the least gap, which the report wants more exactly.
        ceiling = min(ceiling, nearest.gap, float(np.min(known.most)))
        vague = after < ceiling - settings.report_resolution
        vague &= ~known.exact | (known.travel > 0.0)
        if np.count_nonzero(vague) < settings.most_report_pairs:
            undecided |= vague
        stretches, pairs = _divided(stretches, pairs.where(undecided), known.travel[undecided], opened)
    return Verdict(proved=nearest.gap >= least, nearest=nearest)


def _nearer(
    motion: SpaceChainMotion, stretches: TimeStretches, pairs: StretchPairs, known: Measured, nearest: Nearest
) -> Nearest:
    exact = np.where(known.exact, known.most, np.inf)
    best = int(np.argmin(exact))
    if exact[best] >= nearest.gap:
        return nearest
    when = motion.when(float(stretches.middle[pairs.stretch[best]]))
    return Nearest(float(exact[best]), int(pairs.link[best]), int(pairs.other[best]), when)


def _divided(
    stretches: TimeStretches, pairs: StretchPairs, travel: FloatArray, opened: Opened
) -> tuple[TimeStretches, StretchPairs]:
    """Boxes that are larger than what moves are opened, and the stretches of the other pairs halved."""
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


@dataclass(frozen=True)
class SpaceProofSettings:
    """Numbers of the proofs in space, beside those that both kinds of arm share.

    Attributes:
        block: intervals between samples that make the first stretches. Measured on the three jobs: with half as many
            pairs must be told apart from many more boxes, with twice as many from many more triangles.
        probes: moments at which the nearest surface is looked for first. Taste.
    """

    block: int = 32
    probes: int = 8


DEFAULT_SPACE_PROOF = SpaceProofSettings()
"""The numbers that are used unless others are given."""
