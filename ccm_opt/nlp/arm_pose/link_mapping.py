"""The mapping as constraints: every link's heading is the mean heading of the curve over the link's length.

φ_j = (1/l) ∫ θ ds over link j = (Θ(s_{j+1}) - Θ(s_j))/l. It is the mapping in which motions are planned, φ = A v. Knots
may pass joints while the NLP is solved: Θ(s) is summed over the pieces about the joint, each with its share of s,
which is smooth as often as the curve itself is.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.nlp.arm_pose.lifted_curve import LiftedCurve, SplinePieces
from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative


def mapping_rows(curve: LiftedCurve, link_headings: ca.SX, window: int) -> tuple[RowBlock, RowBlock]:
    """φ_j l = Θ(s_{j+1}) - Θ(s_j) for every link, and that every joint stays among the pieces looked at for it.

    Args:
        curve: the curve.
        link_headings: φ, shape (links, 1) [rad].
        window: pieces looked at on either side of the one in which a joint lies while knots are even.
    """
    links = link_headings.numel()
    joints = JointsAmongPieces.of(curve, links, window)
    integrals = joints.integrals()
    mapped = links * (integrals[1:] - integrals[:-1])
    ties = equal_to_zero(tuple(f"mapping of link {j + 1}" for j in range(links)), mapped - link_headings)
    return ties, joints.kept_among()


@dataclass(frozen=True, eq=False)
class JointsAmongPieces:
    """Sums over a curve up to every joint and the tip, whatever piece the joint lies on.

    Attributes:
        curve: the curve.
        arcs: of the joints and the tip, shape (links + 1,).
        first: of every joint the first piece that is looked at, shape (links + 1,).
        last: the last, likewise.
    """

    curve: LiftedCurve
    arcs: FloatArray
    first: IntArray
    last: IntArray

    @classmethod
    def of(cls, curve: LiftedCurve, links: int, window: int) -> "JointsAmongPieces":
        """All joints of an arm; arguments as of ``mapping_rows``."""
        arcs = np.arange(links + 1) / links
        middle = np.minimum((arcs * curve.count).astype(int), curve.count - 1)
        return cls(curve, arcs, np.maximum(middle - window, 0), np.minimum(middle + window, curve.count - 1))

    def integrals(self) -> ca.SX:
        """Θ at every joint, shape (links + 1, 1)."""
        looked_at, inside = self._inside
        return self.curve.integrals[self.first.tolist()] + self._shares @ looked_at.integral_after(inside)

    def turns(self) -> ca.SX:
        """θ at every joint, shape (links + 1, 1)."""
        looked_at, inside = self._inside
        return self.curve.headings[self.first.tolist()] + self._shares @ looked_at.turn_after(inside)

    def kept_among(self) -> RowBlock:
        """Every joint lies behind the start of its first piece and before the end of its last."""
        behind = np.flatnonzero(self.first > 0)
        before = np.flatnonzero(self.last < self.curve.count - 1)
        rows = ca.vertcat(
            ca.DM(self.arcs[behind]) - self.curve.arcs[self.first[behind].tolist()],
            self.curve.arcs[(self.last[before] + 1).tolist()] - ca.DM(self.arcs[before]),
        )
        names = [f"joint {j}: knot {self.first[j]} stays before it" for j in behind]
        names += [f"joint {j}: knot {self.last[j] + 1} stays behind it" for j in before]
        return not_negative(tuple(names), rows)

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray]:
        """Every joint with every piece from its first to its last, as two arrays."""
        counts = self.last - self.first + 1
        joint = np.repeat(np.arange(len(self.first)), counts)
        piece = np.arange(len(joint)) - np.repeat(np.cumsum(counts) - counts, counts) + self.first[joint]
        return joint, piece

    @cached_property
    def _inside(self) -> tuple[SplinePieces, ca.SX]:
        """The pieces of these pairs, and how much of each lies before its joint: nothing or all, except in one."""
        joint, piece = self._pairs
        looked_at = self.curve.pieces.take(piece.tolist())
        return looked_at, ca.fmin(ca.fmax(ca.DM(self.arcs[joint]) - looked_at.start, 0), looked_at.width)

    @cached_property
    def _shares(self) -> ca.DM:
        """Sums what belongs to the same joint."""
        joint, _ = self._pairs
        return ca.DM.triplet(
            joint.tolist(), list(range(len(joint))), ca.DM.ones(len(joint)), len(self.arcs), len(joint)
        )
