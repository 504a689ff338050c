"""The mapping as constraints: every link's heading is the mean heading of the curve over the link's length.

φ_j = (1/l) ∫ θ ds over link j = (Θ(s_{j+1}) - Θ(s_j))/l. It is the mapping in which motions are planned, φ = A v. Knots
may pass joints while the NLP is solved: Θ(s) is summed over the pieces about the joint, each with its share of s,
which is smooth as often as the curve itself is.
"""

from dataclasses import dataclass
from functools import cached_property, partial

import casadi as ca
import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.nlp.arm_pose.lifted_curve import LiftedCurve, SplinePieces
from ccm_opt.nlp.constraints import RowBlock, equal_to_zero, not_negative
from ccm_opt.nlp.repeated_rows import Repeated, selection


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

    def turns_and_integrals(self) -> Repeated:
        """∫ κ and ∫∫ κ over the part before the joint of every piece that is looked at for one, shape (2, pairs)."""
        joint, piece = self._pairs
        knots = np.stack((piece, piece + 1)).ravel("F").tolist()
        columns = (
            ca.reshape(self.curve.arcs[knots], 2, -1),
            ca.reshape(self.curve.curvatures[knots], 2, -1),
            self.curve.bows_at_ends[:, piece.tolist()],
            self.curve.headings[piece.tolist()].T,
        )
        form = partial(_before_joint, self.curve.moment_scale)
        return Repeated(form, columns, (ca.SX(ca.DM(self.arcs[joint])).T,))

    def sums_over_pieces(self) -> tuple[ca.DM, ca.DM]:
        """What θ and Θ at every joint have of ``turns_and_integrals`` beside what is before the first piece.

        Returns:
            Sparse matrices, shape (links + 1, 2 pairs).
        """
        joint, _ = self._pairs
        shape = (len(self.arcs), 2 * len(joint))
        places = 2 * np.arange(len(joint))
        return selection(*shape, joint, places), selection(*shape, joint, places + 1)

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


def _before_joint(scale: float, arcs: ca.SX, curvatures: ca.SX, bows: ca.SX, heading: ca.SX, joint: ca.SX) -> ca.SX:
    """Turn and integral of the heading over what of a piece lies before a joint, column by column, shape (2, e).

    Args:
        scale: of the bows.
        arcs: where the piece begins and ends, shape (2, e).
        curvatures: there, likewise.
        bows: likewise.
        heading: where it begins, shape (1, e) [rad].
        joint: arc length of the joint, shape (1, e).
    """
    start, end = ca.vertsplit(arcs)
    first, last = ca.vertsplit(curvatures)
    first_moment, last_moment = ca.vertsplit(scale * bows)
    piece = SplinePieces(start, end - start, heading, first, last, first_moment, last_moment)
    inside = ca.fmin(ca.fmax(joint - start, 0), piece.width)
    return ca.vertcat(piece.turn_after(inside), piece.integral_after(inside))
