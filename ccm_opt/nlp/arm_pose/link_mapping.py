"""The mapping as constraints: every link's heading is the mean heading of the curve over the link's length.

φ_j = (1/l) ∫ θ ds over link j = (Θ(s_{j+1}) - Θ(s_j))/l. It is the mapping in which motions are planned, φ = A v. Knots
may pass joints while the NLP is solved: Θ(s) is summed over the pieces about the joint, each with its share of s,
which is smooth as often as the curve itself is.
"""

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.nlp.arm_pose.lifted_curve import LiftedCurve
from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative


def mapping_rows(curve: LiftedCurve, link_headings: ca.SX, window: int) -> tuple[RowBlock, RowBlock]:
    """φ_j l = Θ(s_{j+1}) - Θ(s_j) for every link, and that every joint stays among the pieces looked at for it.

    Args:
        curve: the curve.
        link_headings: φ, shape (links, 1) [rad].
        window: pieces looked at on either side of the one in which a joint lies while knots are even.
    """
    links = link_headings.numel()
    arcs = np.arange(links + 1) / links
    middle = np.minimum((arcs * curve.count).astype(int), curve.count - 1)
    first = np.maximum(middle - window, 0)
    last = np.minimum(middle + window, curve.count - 1)
    joint, piece = _pairs(first, last)
    looked_at = curve.pieces.take(piece.tolist())
    # What a piece adds to Θ(s): nothing before it, all of it behind it.
    inside = ca.fmin(ca.fmax(ca.DM(arcs[joint]) - looked_at.start, 0), looked_at.width)
    shares = ca.DM.triplet(joint.tolist(), list(range(len(joint))), ca.DM.ones(len(joint)), links + 1, len(joint))
    integrals = curve.integrals[first.tolist()] + shares @ looked_at.integral_after(inside)
    mapped = links * (integrals[1:] - integrals[:-1])
    ties = equal_to_zero(tuple(f"mapping of link {j + 1}" for j in range(links)), mapped - link_headings)
    return ties, _kept_among(curve, arcs, first, last)


def _pairs(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """Every joint with every piece from its first to its last, as two arrays."""
    counts = last - first + 1
    joint = np.repeat(np.arange(len(first)), counts)
    piece = np.arange(len(joint)) - np.repeat(np.cumsum(counts) - counts, counts) + first[joint]
    return joint, piece


def _kept_among(curve: LiftedCurve, arcs: FloatArray, first: IntArray, last: IntArray) -> RowBlock:
    """Every joint lies behind the start of its first piece and before the end of its last."""
    behind = np.flatnonzero(first > 0)
    before = np.flatnonzero(last < curve.count - 1)
    rows = ca.vertcat(
        ca.DM(arcs[behind]) - curve.arcs[first[behind].tolist()],
        curve.arcs[(last[before] + 1).tolist()] - ca.DM(arcs[before]),
    )
    names = [f"joint {j}: knot {first[j]} stays before it" for j in behind]
    names += [f"joint {j}: knot {last[j] + 1} stays behind it" for j in before]
    return not_negative(tuple(names), rows)
