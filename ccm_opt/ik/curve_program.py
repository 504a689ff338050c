"""Symbolic curve ODE, constraints and costs of the NLP for a planar curve through a corridor, in CasADi.

Lengths are in units of the arm's length. A segment starts in the state X = (x, y, θ, κ, s) and is shaped by the control
U = (C_1..C_4, a_0..a_3, B_0..B_3): curvature at the knots after the first (C_0 = κ keeps the curvature continuous), arc
lengths between knots, and a bound on |κ| for each piece.

The costs of knots and bounds make the NLP converge: with them, the objective has curvature in every direction of the
variables.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.lifted_curve import SplinePieces
from ccm_opt.ik.row_program import RowBlock, equal_to_zero, not_negative
from ccm_opt.robot.segment import PIECES

_KNOT_WEIGHT = 4.0
"""Weight of uneven knots. Heuristic; leaves no direction of the variables without curvature of the objective."""
_BOUND_WEIGHT = 0.1
"""Weight of the squared bounds on ``|κ|``. Heuristic; gives the objective curvature and keeps the bounds tight."""
_SLOPE_WEIGHT = 1e-3
"""Weight of the differences of curvature between knots. Heuristic."""
_NEARNESS_WEIGHT = 10.0
"""Weight of closeness to walls, before the user's weight. Heuristic."""
_NEARNESS_DISTANCE = 0.03
"""Distance from walls beyond which points of the curve cost nothing [arm lengths]. Heuristic."""

STATES = 5
"""Size of the state X."""
CONTROLS = 12
"""Size of the control U."""
SUBSTEPS = 2
"""Number of chords per piece, for quadrature and for containment."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss-Legendre nodes and weights of one chord."""


@dataclass(frozen=True)
class SegmentFlow:
    """Symbolic results of integrating one curvature segment.

    Attributes:
        end: state X at the end of the segment, shape (5, 1).
        points: positions at the ends of the sub-steps, from the start of the segment, (2, PIECES * SUBSTEPS + 1).
        bernstein: Bernstein coefficients of the curvature, one row per piece, shape (PIECES, 4).
        bending: integral ∫κ² ds over the segment.
    """

    end: ca.SX
    points: ca.SX
    bernstein: ca.SX
    bending: ca.SX


def natural_spline_moments(widths: ca.SX, values: ca.SX) -> ca.SX:
    """Return the second derivatives M_0..M_4 of a natural cubic spline at its five knots, shape (5, 1).

    Solves a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}]
    with M_0 = M_4 = 0 by the Thomas algorithm; the matrix is diagonally dominant, so elimination needs no pivoting
    (Golub and Van Loan, 4.3).

    Args:
        widths: distances a_0..a_3 of the knots, shape (4, 1).
        values: values C_0..C_4 at the knots, shape (5, 1).
    """
    slopes = [(values[i + 1] - values[i]) / widths[i] for i in range(PIECES)]
    diagonal = [2 * (widths[i] + widths[i + 1]) for i in range(3)]
    right = [6 * (slopes[i + 1] - slopes[i]) for i in range(3)]
    for i in (1, 2):
        factor = widths[i] / diagonal[i - 1]
        diagonal[i] -= factor * widths[i]
        right[i] -= factor * right[i - 1]
    last = right[2] / diagonal[2]
    middle = (right[1] - widths[2] * last) / diagonal[1]
    return ca.vertcat(0, (right[0] - widths[1] * middle) / diagonal[0], middle, last, 0)


def segment_flow(state: ca.SX, control: ca.SX) -> SegmentFlow:
    """Return the integral X_{k+1} = F(X_k, U_k) of one segment, with further expressions for costs and constraints.

    Args:
        state: state X_k at the start, shape (5, 1).
        control: control U_k, shape (12, 1).
    """
    values = ca.vertcat(state[3], control[:4])
    widths = control[4:8]
    ends = ca.cumsum(ca.vertcat(state[4], widths))
    moments = natural_spline_moments(widths, values)
    shape = (widths, state[2], values[:-1], values[1:], moments[:-1], moments[1:])
    headings = ca.cumsum(ca.vertcat(state[2], SplinePieces(ends[:-1], *shape).turn()))
    pieces = SplinePieces(ends[:-1], widths, headings[:-1], *shape[2:])

    # ∫ (cos θ, sin θ) ds over every chord by four Gauss points.
    chords = []
    for j in range(SUBSTEPS):
        chord = ca.SX(PIECES, 2)
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            theta = pieces.heading + pieces.turn_after(widths * (j + (node + 1) / 2) / SUBSTEPS)
            chord += weight / 2 * ca.horzcat(ca.cos(theta), ca.sin(theta))
        chords.append(chord * ca.repmat(widths / SUBSTEPS, 1, 2))
    steps = ca.horzcat(*(chord[i, :].T for i in range(PIECES) for chord in chords))
    points = ca.cumsum(ca.horzcat(state[:2], steps), 1)

    # A cubic stays within the hull of its Bernstein coefficients (Farouki 2012). With the second derivatives M these
    # are its end values, and the thirds of its chord less (2 M_0 + M_1) a²/18 and (M_0 + 2 M_1) a²/18.
    first, last = pieces.first, pieces.last
    left, right = pieces.first_moment * widths**2 / 18, pieces.last_moment * widths**2 / 18
    second, third = (2 * first + last) / 3 - 2 * left - right, (first + 2 * last) / 3 - left - 2 * right
    end = ca.vertcat(points[:, -1], headings[-1], values[-1], ends[-1])
    bending = ca.sum1(pieces.squared_curvature())
    return SegmentFlow(end, points, ca.horzcat(first, second, third, last), bending)


@cache
def segment_function() -> ca.Function:
    """Return the CasADi function from state X and control U of a segment to the four expressions of ``SegmentFlow``."""
    state = ca.SX.sym("X", STATES)
    control = ca.SX.sym("U", CONTROLS)
    flow = segment_flow(state, control)
    return ca.Function("segment", [state, control], [flow.end, flow.points, flow.bernstein, flow.bending])


def gap_closing(k: int, flow: SegmentFlow, following: ca.SX) -> RowBlock:
    """Return the NLP constraints X_{k+1} = F(X_k, U_k): segment k ends in the state in which the next one begins.

    Args:
        k: index of the segment.
        flow: expressions of the segment.
        following: state X_{k+1}, shape (5, 1).
    """
    what = ("x", "y", "heading", "curvature", "arc length")
    return equal_to_zero(tuple(f"segment {k}: gap in {name} at its end" for name in what), following - flow.end)


def base_at_stub_end(state: ca.SX, stub: ca.SX) -> RowBlock:
    """Return the NLP constraints that start the first segment at the end of a straight stub from the base, the origin.

    Args:
        state: state at the start of the first segment, shape (5, 1).
        stub: length of the stub.
    """
    names = ("base: x", "base: y")
    return equal_to_zero(names, state[:2] - stub * ca.vertcat(ca.cos(state[2]), ca.sin(state[2])))


def knot_spacing(k: int, control: ca.SX, fraction: float) -> RowBlock:
    """Return the NLP constraints a_i ≥ fraction · L_k, which keep the knots of segment k with the length L_k apart."""
    widths = control[4:8]
    names = tuple(f"segment {k}: spacing of knots {i} and {i + 1}" for i in range(PIECES))
    return not_negative(names, widths - fraction * ca.sum1(widths))


def certified_curvature(k: int, control: ca.SX, flow: SegmentFlow) -> RowBlock:
    """Return the NLP constraints that make B_i an upper bound on |κ| on the whole piece i of segment k.

    B_i is at least the magnitude of every Bernstein coefficient of the curvature on the piece.
    """
    names = []
    rows = []
    for i in range(PIECES):
        for j in range(4):
            rows += [control[8 + i] - flow.bernstein[i, j], control[8 + i] + flow.bernstein[i, j]]
            names += [f"segment {k}: curvature of piece {i} {side} its bound" for side in ("above", "below minus")]
    return not_negative(tuple(names), ca.vertcat(*rows))


def certified_containment(
    k: int, control: ca.SX, flow: SegmentFlow, normals: ca.SX, offsets: ca.SX, ends: tuple[bool, bool] = (False, False)
) -> RowBlock:
    """Return the NLP constraints that keep the whole curve of a segment in a convex region.

    The rows are A_k P + B_i (a_i/m)²/8 ≤ b_k at both ends of every sub-step, m of them per piece.

    Between two points h apart along the curve, the curve leaves their chord by at most B t(1-t) h²/2, t in [0, 1] (the
    error of linear interpolation, de Boor, chapter II), and the region is convex. Margins α² B h²/2 and (1-α)² B h²/2
    at the two points cover this deviation for every α. Here α = 1/2; where the arm itself begins or ends, α = 0
    leaves that point without margin, since a base or a goal may touch the wall.

    Args:
        k: index of the segment.
        control: control U_k of the segment, shape (12, 1).
        flow: expressions of the segment.
        normals: normals of the region's half-planes, shape (half-planes, 2).
        offsets: offsets of the half-planes, shape (half-planes, 1).
        ends: whether the segment's start is the arm's base, and its end the arm's tip.
    """
    names = []
    rows = []
    shares = _margin_shares(ends)
    for i in range(PIECES):
        sagitta = control[8 + i] * (control[4 + i] / SUBSTEPS) ** 2 / 2
        for j in range(SUBSTEPS + 1):
            point = SUBSTEPS * i + j
            rows.append(offsets - normals @ flow.points[:, point] - shares[i, j] * sagitta)
            names += [
                f"segment {k}: piece {i} at point {point}, side {row} of its region" for row in range(normals.shape[0])
            ]
    return not_negative(tuple(names), ca.vertcat(*rows))


def _margin_shares(ends: tuple[bool, bool]) -> FloatArray:
    """Return the fraction of B h²/2 that each piece of a segment keeps as margin to its region at the sub-step ends.

    Args:
        ends: whether the segment starts at the arm's base, and whether it ends at the tip.

    Returns:
        Shape (PIECES, SUBSTEPS + 1).
    """
    shares = np.full((PIECES, SUBSTEPS + 1), 0.25)
    if ends[0]:
        shares[0, :2] = [0.0, 1.0]
    if ends[1]:
        shares[-1, -2:] = [1.0, 0.0]
    return shares


def nearness(points: ca.SX, normals: FloatArray, offsets: FloatArray) -> ca.SX:
    """Return the weighted mean over m points of Σ max(0, 1 - slack/D)², the cost of points closer to walls than D.

    The sum is over k half-planes n · p ≤ b, with slack = b - n · p.

    Args:
        points: points p of the curve, shape (2, m).
        normals: outward unit normals n, shape (k, 2).
        offsets: offsets b, shape (k,).
    """
    slack = ca.repmat(ca.DM(offsets), 1, points.shape[1]) - ca.DM(normals) @ points
    lacking = ca.fmax(1.0 - slack / _NEARNESS_DISTANCE, 0.0)
    return _NEARNESS_WEIGHT * ca.sumsqr(lacking) / points.shape[1]


def configuration_cost(state: ca.SX, control: ca.SX, bending: ca.SX, weight: ca.SX) -> ca.SX:
    """Return the cost of one segment, w ∫κ² ds + 4 Σ(a_i/L_k - 1/4)² + 0.1 ΣB² + 0.001 Σ(C_{i+1} - C_i)².

    The second term pulls the knots towards even spacing, the third keeps the certified bounds B tight, and the last
    mildly favours a gently changing curvature.

    Args:
        state: state X_k at the start of the segment, shape (5, 1).
        control: control U_k, shape (12, 1).
        bending: integral ∫κ² ds over the segment, twice the elastic energy of a unit rod.
        weight: weight w of the bending.
    """
    widths = control[4:8]
    values = ca.vertcat(state[3], control[:4])
    return (
        weight * bending
        + _KNOT_WEIGHT * ca.sumsqr(widths / ca.sum1(widths) - 1 / PIECES)
        + _BOUND_WEIGHT * ca.sumsqr(control[8:12])
        + _SLOPE_WEIGHT * ca.sumsqr(values[1:] - values[:-1])
    )
