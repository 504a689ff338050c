"""Symbolic curve of the goal-pose NLP, with states at its knots (lifted), evaluated at the joints of the arm.

Lengths are in units of the arm's length. The curve is a chain of K curvature segments of four spline pieces each. Its
knots lie at arc lengths σ_0 = 0 < σ_1 < ... < σ_4K = 1; at knot i the curvature is C_i, the heading θ_i, and Θ_i =
∫_0^{σ_i} θ ds; M_i are the second derivatives of the curvature, zero where segments meet because the paper's splines
are natural (section 2.1). On the piece from σ_i, with t = s - σ_i and a = σ_{i+1} - σ_i,

    κ(t) = C_i + (ΔC/a - a (2 M_i + M_{i+1})/6) t + M_i t²/2 + (M_{i+1} - M_i) t³/(6 a).

The states (θ, Θ) of neighbouring knots are tied by the ODE θ' = κ, Θ' = θ, whose solution over a piece is known in
closed form: this is multiple shooting with an exact integrator. Every row then depends on one piece only, which keeps
the derivatives small and the building of the solver fast.

The mean of θ over link j is (Θ(s_{j+1}) - Θ(s_j))/l. Knots may pass joints while the NLP is solved: Θ(s) is summed over
the pieces near the joint, each over its part up to s, and this sum is as smooth as the curve itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.ik.row_program import RowBlock, equal_to_zero, not_negative
from ccm_opt.robot.segment import PIECES

_WINDOW = 1
"""Number of spline pieces on either side of a joint's initial piece in which the joint may lie as knots move. A wider
window takes longer to build, a narrower one restricts the knots (measured: with 1 building takes three quarters of the
time that 2 takes, and the poses of clutter are the same)."""
_LEAST_PIECE = 0.08
"""Least length of a spline piece, as a fraction of the length of its segment (as in the configuration NLP)."""


@dataclass(frozen=True, eq=False)
class SplinePieces:
    """The m symbolic cubic pieces of a curvature spline; every method evaluates all of them at once.

    Attributes:
        start: arc length at the start of each piece, shape (m, 1).
        width: arc length a of each piece, shape (m, 1).
        heading: heading θ at the start of each piece, shape (m, 1) [rad].
        first: curvature at the start of each piece, shape (m, 1).
        last: curvature at the end of each piece, shape (m, 1).
        first_moment: second derivative of the curvature at the start of each piece, shape (m, 1).
        last_moment: second derivative of the curvature at the end of each piece, shape (m, 1).
    """

    start: ca.SX
    width: ca.SX
    heading: ca.SX
    first: ca.SX
    last: ca.SX
    first_moment: ca.SX
    last_moment: ca.SX

    def take(self, indices: Sequence[int]) -> "SplinePieces":
        """Return the spline pieces with given indices, which may repeat, in that order."""
        return SplinePieces(*(column[list(indices)] for column in vars(self).values()))

    def integral_after(self, t: ca.SX) -> ca.SX:
        """Return the integral of the heading over the first arc length t of each piece, shape (m, 1), quintic in t."""
        slope = (self.last - self.first) / self.width - self.width * (2 * self.first_moment + self.last_moment) / 6
        jerk = (self.last_moment - self.first_moment) / (120 * self.width)
        inner = self.first / 2 + t * (slope / 6 + t * (self.first_moment / 24 + t * jerk))
        return t * (self.heading + t * inner)

    def turn_after(self, t: ca.SX) -> ca.SX:
        """Return the turn ∫ κ ds over the first arc length t of each piece, shape (m, 1) [rad]: a quartic in t."""
        slope = (self.last - self.first) / self.width - self.width * (2 * self.first_moment + self.last_moment) / 6
        jerk = (self.last_moment - self.first_moment) / (24 * self.width)
        return t * (self.first + t * (slope / 2 + t * (self.first_moment / 6 + t * jerk)))

    def turn(self) -> ca.SX:
        """Return the turn ∫ κ ds over each whole piece, shape (m, 1) [rad]."""
        moments = self.first_moment + self.last_moment
        return self.width * (self.first + self.last) / 2 - self.width**3 * moments / 24

    def integral(self) -> ca.SX:
        """Return the integral of the heading over each whole piece, shape (m, 1)."""
        chord = self.first / 3 + self.last / 6
        moments = (8 * self.first_moment + 7 * self.last_moment) / 360
        return self.width * (self.heading + self.width * (chord - self.width**2 * moments))

    def squared_curvature(self) -> ca.SX:
        """Return the integral of the squared curvature over each piece, shape (m, 1).

        With τ = t/a and b_i = M_i a²/6 the curvature is its chord minus τ(1 - τ)[(2 - τ) b_i + (1 + τ) b_{i+1}]; the
        numbers are the integrals of the products of these polynomials.
        """
        bow = self.first_moment * self.width**2 / 6
        last_bow = self.last_moment * self.width**2 / 6
        chords = (self.first**2 + self.first * self.last + self.last**2) / 3
        mixed = self.first * (8 * bow + 7 * last_bow) / 60 + self.last * (7 * bow + 8 * last_bow) / 60
        bows = 8 * (bow**2 + last_bow**2) / 105 + 31 * bow * last_bow / 210
        return self.width * (chords - 2 * mixed + bows)


@dataclass(frozen=True, eq=False)
class LiftedCurve:
    """Symbols of a curve of K curvature segments, and the NLP constraints that tie them together.

    Attributes:
        segments: number of curvature segments K.
        shared_arcs: arc lengths of the knots if they are those of another curve, shape (4 K + 1, 1); None for new
            symbols.
    """

    segments: int
    shared_arcs: ca.SX | None = None

    @property
    def count(self) -> int:
        """Number of spline pieces, 4 K."""
        return PIECES * self.segments

    @cached_property
    def arcs(self) -> ca.SX:
        """Arc lengths σ of the knots, shape (4 K + 1, 1)."""
        return self.shared_arcs if self.shared_arcs is not None else ca.SX.sym("arc", self.count + 1)

    @cached_property
    def curvatures(self) -> ca.SX:
        """Curvatures C at the knots, shape (4 K + 1, 1)."""
        return ca.SX.sym("curvature", self.count + 1)

    @cached_property
    def headings(self) -> ca.SX:
        """Headings θ at the knots, shape (4 K + 1, 1) [rad]."""
        return ca.SX.sym("theta", self.count + 1)

    @cached_property
    def integrals(self) -> ca.SX:
        """Heading integrals Θ at the knots, shape (4 K + 1, 1) [rad]."""
        return ca.SX.sym("integral", self.count + 1)

    @cached_property
    def bows(self) -> ca.SX:
        """Scaled second derivatives M a²/6 at the inner knots of every segment, shape (3 K, 1).

        Here a is the width of even pieces, so a bow has the size of a curvature: the deviation of the spline from the
        chord between knots. M itself is a thousand times larger than the other variables, which would spoil the scaling
        of the NLP.
        """
        return ca.SX.sym("bow", (PIECES - 1) * self.segments)

    @property
    def moment_scale(self) -> float:
        """Ratio of a second derivative M of the curvature to the scaled variable ("bow") that represents it."""
        return 6.0 * self.count**2

    @property
    def variables(self) -> ca.SX:
        """All symbols of the curve in one column."""
        return ca.vertcat(self.arcs, self.curvatures, self.headings, self.integrals, self.bows)

    @cached_property
    def pieces(self) -> SplinePieces:
        """All 4 K spline pieces of the curve, from base to tip."""
        inner = self.moment_scale * ca.reshape(self.bows, PIECES - 1, self.segments)
        zero = ca.SX.zeros(1, self.segments)  # the paper's splines are natural
        return SplinePieces(
            start=self.arcs[:-1],
            width=self.arcs[1:] - self.arcs[:-1],
            heading=self.headings[:-1],
            first=self.curvatures[:-1],
            last=self.curvatures[1:],
            first_moment=ca.vec(ca.vertcat(zero, inner)),
            last_moment=ca.vec(ca.vertcat(inner, zero)),
        )

    @cached_property
    def segment_lengths(self) -> ca.SX:
        """Lengths L_k of the curvature segments, shape (1, K)."""
        return ca.sum1(ca.reshape(self.pieces.width, PIECES, self.segments))

    def rows(self) -> tuple[RowBlock, RowBlock, RowBlock]:
        """Return the NLP constraints that define a curve: spline equations, integration, minimum knot spacing."""
        return self._spline_equations(), self._gap_closing(), self._knot_spacing()

    def _spline_equations(self) -> RowBlock:
        """Return the NLP constraints for the natural cubic spline at the inner knots of every segment.

        The equations are a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [ΔC_i/a_i - ΔC_{i-1}/a_{i-1}] (de
        Boor, A Practical Guide to Splines, chapter IV).
        """
        knots = [PIECES * segment + inside for segment in range(self.segments) for inside in range(1, PIECES)]
        before = self.pieces.take([knot - 1 for knot in knots])
        after = self.pieces.take(knots)
        moments = before.width * before.first_moment + after.width * after.last_moment
        moments += 2 * (before.width + after.width) * after.first_moment
        bend = (after.last - after.first) / after.width - (before.last - before.first) / before.width
        names = tuple(f"segment {knot // PIECES}: spline at knot {knot % PIECES}" for knot in knots)
        return equal_to_zero(names, (moments - 6 * bend) / (6 * self.count))

    def _gap_closing(self) -> RowBlock:
        """Return the NLP constraints that integrate θ and Θ, the integral of θ, over each piece, from knot to knot."""
        turns = self.headings[1:] - self.headings[:-1] - self.pieces.turn()
        integrals = self.integrals[1:] - self.integrals[:-1] - self.pieces.integral()
        what = ("heading", "the integral of the heading")
        return equal_to_zero(self._piece_names("gap in {}", what), ca.vertcat(turns, integrals))

    def _knot_spacing(self) -> RowBlock:
        lengths = ca.vec(ca.repmat(self.segment_lengths, PIECES, 1))
        return not_negative(self._piece_names("{} of knots", ("spacing",)), self.pieces.width - _LEAST_PIECE * lengths)

    def _piece_names(self, text: str, kinds: Sequence[str]) -> tuple[str, ...]:
        places = [(index // PIECES, index % PIECES) for index in range(self.count)]
        return tuple(
            f"segment {segment}, piece {piece}: {text.format(kind)}" for kind in kinds for segment, piece in places
        )


@dataclass(frozen=True, eq=False)
class JointsAmongPieces:
    """Evaluation of a curve's heading and heading integral at all joints and the tip, although knots may move.

    Each joint may lie on any of several consecutive spline pieces.

    Attributes:
        curve: the curve.
        arcs: arc lengths of the joints and the tip, shape (links + 1,).
        first: index of the first piece on which each joint may lie, shape (links + 1,).
        last: index of the last piece on which each joint may lie, shape (links + 1,).
    """

    curve: LiftedCurve
    arcs: FloatArray
    first: IntArray
    last: IntArray

    @classmethod
    def from_curve(cls, curve: LiftedCurve, arcs: FloatArray) -> "JointsAmongPieces":
        """Return the evaluation of a curve at an arm's joints and tip; ``arcs`` are their arc lengths, (links + 1,)."""
        middle = np.minimum((arcs * curve.count).astype(int), curve.count - 1)
        return cls(curve, arcs, np.maximum(middle - _WINDOW, 0), np.minimum(middle + _WINDOW, curve.count - 1))

    def joint_order_rows(self) -> RowBlock:
        """Return the NLP constraints that keep every joint between its first piece's start and its last piece's end."""
        behind = np.flatnonzero(self.first > 0)
        before = np.flatnonzero(self.last < self.curve.count - 1)
        rows = ca.vertcat(
            ca.DM(self.arcs[behind]) - self.curve.arcs[self.first[behind].tolist()],
            self.curve.arcs[(self.last[before] + 1).tolist()] - ca.DM(self.arcs[before]),
        )
        names = [f"joint {j}: knot {self.first[j]} stays before it" for j in behind]
        names += [f"joint {j}: knot {self.last[j] + 1} stays behind it" for j in before]
        return not_negative(tuple(names), rows)

    def at_joints(self, curve: LiftedCurve) -> tuple[ca.SX, ca.SX]:
        """Return the heading θ and its integral Θ at every joint and the tip, each of shape (links + 1, 1).

        Args:
            curve: the curve to evaluate, whose knots are those of ``self.curve``.
        """
        joint, piece = self._pairs
        pieces = curve.pieces.take(piece.tolist())
        inside = ca.fmin(ca.fmax(ca.DM(self.arcs[joint]) - pieces.start, 0), pieces.width)
        places = np.arange(len(joint)).tolist()
        sums = ca.DM.triplet(joint.tolist(), places, ca.DM.ones(len(joint)), len(self.arcs), len(joint))
        first = self.first.tolist()
        turned = curve.headings[first] + ca.mtimes(sums, pieces.turn_after(inside))
        return turned, curve.integrals[first] + ca.mtimes(sums, pieces.integral_after(inside))

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray]:
        """All pairs of a joint and a piece on which the joint may lie, as two arrays of indices, shape (pairs,)."""
        counts = self.last - self.first + 1
        joint = np.repeat(np.arange(len(self.first)), counts)
        piece = np.arange(len(joint)) - np.repeat(np.cumsum(counts) - counts, counts) + self.first[joint]
        return joint, piece
