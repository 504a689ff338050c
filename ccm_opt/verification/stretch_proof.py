"""Proofs at all times by bisection, over intervals of a motion and over stretches of one in space.

In a stretch of time around its middle pose the distance of a pair changes by at most the distance its points can
travel, so a pair is *proved* apart when its distance at the middle, less that travel, is still enough; it is
*refuted* when the distance at the middle itself is too small. Neither: halve the stretch. What is still
undecided when the travel is below ``settings.resolution`` or the work is used up is refused, so the proof is sound.

The same halving finds the least gap over all times to within ``settings.report_resolution``, for the report (more
coarsely when the arm never comes within a link's length of anything).

As over intervals, a pair is *proved* apart in a stretch of time when its gap at the middle, less what it
can lose in the stretch, is enough, *refuted* when a pose of the motion itself is too near, and else halved.
Stretches begin as many samples long. What is still undecided when no more can be lost than the resolution, or when the
work is used up, is refused, so the proof is sound.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.link_motion import ChainMotion, Nodes
from ccm_opt.verification.space_chain_motion import SpaceChainMotion, TimeStretches
from ccm_opt.verification.verification_settings import VerificationSettings


@dataclass(frozen=True)
class Pairs:
    """Pairs of bodies in stretches of time: a link, and another link or an edge of a wall.

    Attributes:
        node: number of the stretch, shape (P,).
        link: number of the link from 0, shape (P,).
        other: number of the other link or of the edge, shape (P,).
    """

    node: IntArray
    link: IntArray
    other: IntArray

    def __len__(self) -> int:
        return len(self.node)

    def where(self, mask: BoolArray) -> "Pairs":
        """The pairs that a mask of shape (P,) keeps."""
        return Pairs(self.node[mask], self.link[mask], self.other[mask])


@dataclass(frozen=True)
class Nearest:
    """The least gap met.

    Attributes:
        gap: between the two surfaces [m]; inf when no pair was near.
        link: number of the link from 0.
        other: number of the other link or of the edge.
        time: when [s].
    """

    gap: float = np.inf
    link: int = 0
    other: int = 0
    time: float = 0.0


@dataclass(frozen=True)
class Verdict:
    """Whether every pair is proved apart, the least gap met, and why not when it is not proved."""

    proved: bool
    nearest: Nearest
    remark: str = ""


Evaluate = Callable[[Nodes, Pairs, FloatArray], tuple[FloatArray, FloatArray]]
"""(stretches, pairs, poses) to the gap between the surfaces at the middle and the travel in the stretch, (P,) [m]."""


def least_allowed_gap(limit: float, thickness: float, settings: VerificationSettings) -> float:
    """The gap a pair must have: the limit less the contact tolerance, but never axes that touch.

    Args:
        limit: gap asked for [m].
        thickness: distance of the axes at which the surfaces touch [m].
        settings: the contact tolerance.
    """
    return max(limit - settings.contact_tolerance, settings.touch - thickness)


def prove_apart(
    motion: ChainMotion,
    pairs: Pairs,
    evaluate: Evaluate,
    least: float,
    nearest: Nearest,
    settings: VerificationSettings,
) -> Verdict:
    """Prove that every pair keeps a gap of at least ``least`` during every stretch, by halving.

    Args:
        motion: of the arm.
        pairs: candidates in the whole intervals, ``node`` being the interval's number.
        evaluate: the pair's gap and travel.
        least: gap that every pair must keep [m].
        nearest: the least gap known so far.
        settings: resolutions, and how much work may be done.
    """
    # Breadth first: all pairs of one depth are evaluated at once, where numpy is fast.
    nodes = motion.whole
    while len(pairs):
        gap, travel = evaluate(nodes, pairs, motion.poses(nodes))
        nearest = _nearer(motion, nodes, pairs, gap, nearest)
        # A pose of the motion itself is too near: a counterexample, so that no halving can help.
        if nearest.gap < least:
            return Verdict(proved=False, nearest=nearest)
        # A pair that does not come near enough within its travel is done with, for this stretch and all parts of it.

        undecided = gap - travel < least
        if np.any(undecided & (travel < settings.resolution)):
            return Verdict(proved=False, nearest=nearest, remark="touches within the resolution of the proof")
        # Halving doubles the pairs; a motion that would need more memory than that is refused, never waved through.
        if 2 * np.count_nonzero(undecided) > settings.most_pairs:
            return Verdict(proved=False, nearest=nearest, remark="so close for so long that the proof was given up")

        # What is proved may still hold the least gap, which the report wants more exactly.
        vague = gap - travel < nearest.gap - settings.report_resolution
        if np.count_nonzero(vague) < settings.most_report_pairs:
            undecided |= vague
        nodes, pairs = _halve(nodes, pairs.where(undecided))
    return Verdict(proved=nearest.gap >= least, nearest=nearest)


def _nearer(motion: ChainMotion, nodes: Nodes, pairs: Pairs, gap: FloatArray, known: Nearest) -> Nearest:
    best = int(np.argmin(gap))
    if gap[best] >= known.gap:
        return known
    return Nearest(
        float(gap[best]), int(pairs.link[best]), int(pairs.other[best]), motion.when(nodes, int(pairs.node[best]))
    )


def _halve(nodes: Nodes, pairs: Pairs) -> tuple[Nodes, Pairs]:
    # Stretches without an undecided pair are dropped, so pairs are numbered anew among those that are left.
    kept, renumbered = np.unique(pairs.node, return_inverse=True)
    first = 2 * renumbered
    children = Pairs(np.concatenate((first, first + 1)), np.tile(pairs.link, 2), np.tile(pairs.other, 2))
    return nodes.take(kept).halves(), children


@dataclass(frozen=True)
class HatMeans:
    """What values at samples say of the means around the inner ones, T − 2 of them; values have any further shape.

    Attributes:
        time: of the samples, shape (T,) [s].
    """

    time: FloatArray

    @property
    def steps(self) -> tuple[FloatArray, FloatArray]:
        """Steps before and after the inner samples, each of shape (T − 2,) [s]."""
        step = np.diff(self.time)
        return step[:-1], step[1:]

    def mean(self, values: FloatArray) -> FloatArray:
        """Means of what is linear between samples, shape (T − 2, …)."""
        before, after = self._beside(values)
        change = after * (values[2:] - values[1:-1]) + before * (values[:-2] - values[1:-1])
        return np.asarray(values[1:-1] + change / (3.0 * (before + after)))

    def first(self, values: FloatArray) -> FloatArray:
        """Mean rates over both steps, shape (T − 2, …)."""
        before, after = self._beside(values)
        return np.asarray((values[2:] - values[:-2]) / (before + after))

    def second(self, values: FloatArray) -> FloatArray:
        """Second difference quotients: exactly the means of second derivatives, shape (T − 2, …)."""
        before, after = self._beside(values)
        rates = np.diff(values, axis=0)
        return np.asarray(2.0 * (rates[1:] / after - rates[:-1] / before) / (before + after))

    def at(self, sample: int) -> "HatMeans":
        """Of one inner sample, counted from 0, alone."""
        return HatMeans(self.time[sample : sample + 3])

    def variance(self, values: FloatArray) -> FloatArray:
        """Bound on the mean square of how far vectors (3, …, d) at the samples of one are from their mean, (…)."""
        before, after = (float(step[0]) for step in self.steps)
        # A square is convex, so that between samples it is below what is linear.
        weights = np.array([before, 2.0 * (before + after), after]) / (3.0 * (before + after))
        away = np.sum((values - self.mean(values)) ** 2, axis=-1)
        return np.asarray(np.tensordot(weights, away, axes=1))

    def _beside(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        before, after = (step.reshape(-1, *[1] * (values.ndim - 1)) for step in self.steps)
        return before, after


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
        nearest = _nearer_in_space(motion, stretches, pairs, known, nearest)
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


def _nearer_in_space(
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
    """

    block: int = 32


DEFAULT_SPACE_PROOF = SpaceProofSettings()
"""The numbers that are used unless others are given."""
