"""Proofs at all times by bisection, over intervals of a motion in the plane.

In a stretch of time around its middle pose the distance of a pair changes by at most the distance its points can
travel, so a pair is *proved* apart when its distance at the middle, less that travel, is still enough; it is
*refuted* when the distance at the middle itself is too small. Neither: halve the stretch. What is still
undecided when the travel is below ``settings.resolution`` or the work is used up is refused, so the proof is sound.

The same halving finds the least gap over all times to within ``settings.report_resolution``, for the report (more
coarsely when the arm never comes within a link's length of anything).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.verification.verification_settings import VerificationSettings

from .link_motion import ChainMotion, Nodes


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
            return Verdict(proved=False, nearest=nearest, remark="too close for too long for the proof to finish")

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
