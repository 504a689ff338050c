"""Symbolic curve ODE, constraints and costs of the configuration NLP, in CasADi.

Lengths are in units of the arm's length. A segment starts in the state X = (x, y, θ, κ, s) and is shaped by the control
U = (C_1..C_4, a_0..a_3, B_0..B_3): curvature at the knots after the first (C_0 = κ keeps the curvature continuous), arc
lengths between knots, and a bound on |κ| for each piece.

Weights are for lengths in units of the arm's length. The terms for knots and bounds make the NLP converge: with them,
the objective has curvature in every direction of the variables.
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
"""Weight of uneven knots. Taste; leaves no direction of the variables without curvature of the objective."""
_BOUND_WEIGHT = 0.1
"""Weight of the bounds on ``|κ|``. Taste; as for the knots, and it keeps the certificates tight."""
_SLOPE_WEIGHT = 1e-3
"""Weight of the differences of curvature between knots. Taste."""
_NEARNESS_WEIGHT = 10.0
"""Weight of closeness to walls, before the user's weight. Taste."""
_NEARNESS_DISTANCE = 0.03
"""Distance beyond which sides of regions cost nothing [L]. Taste."""

STATES = 5
"""Size of the state X."""
CONTROLS = 12
"""Size of the control U."""
SUBSTEPS = 2
"""Number of chords per piece, for quadrature and for containment."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss points of one chord."""


@dataclass(frozen=True)
class SegmentFlow:
    """Expressions of one curvature segment.

    Attributes:
        end: state at the segment's end, (5, 1).
        points: positions at the ends of the sub-steps, base first, (2, PIECES * SUBSTEPS + 1).
        bernstein: Bernstein coefficients of κ, one row per piece, (PIECES, 4).
        bending: ∫κ² ds.
    """

    end: ca.SX
    points: ca.SX
    bernstein: ca.SX
    bending: ca.SX


def natural_spline_moments(widths: ca.SX, values: ca.SX) -> ca.SX:
    """Return the second derivatives M_0..M_4 of the natural cubic spline by the Thomas algorithm, (5, 1).

    Solves a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}]
    with M_0 = M_4 = 0; the matrix is diagonally dominant, so elimination needs no pivoting (Golub and Van Loan, 4.3).
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
    """Integrate one segment, X_{k+1} = F(X_k, U_k), with all expressions that costs and constraints need."""
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
    """Return (X, U) -> (X_{k+1}, points, Bernstein coefficients, ∫κ²) as one CasADi function."""
    state = ca.SX.sym("X", STATES)
    control = ca.SX.sym("U", CONTROLS)
    flow = segment_flow(state, control)
    return ca.Function("segment", [state, control], [flow.end, flow.points, flow.bernstein, flow.bending])


def gap_closing(k: int, flow: SegmentFlow, following: ca.SX) -> RowBlock:
    """Return the rows X_{k+1} = F(X_k, U_k): a segment ends where the next one begins."""
    what = ("x", "y", "heading", "curvature", "arc length")
    return equal_to_zero(tuple(f"segment {k}: gap in {name} at its end" for name in what), following - flow.end)


def base_at_stub_end(state: ca.SX, stub: ca.SX) -> RowBlock:
    """Return the rows that start the first segment at the end of the straight stub; the base is the origin."""
    names = ("base: x", "base: y")
    return equal_to_zero(names, state[:2] - stub * ca.vertcat(ca.cos(state[2]), ca.sin(state[2])))


def knot_spacing(k: int, control: ca.SX, fraction: float) -> RowBlock:
    """Return the rows a_i ≥ fraction · L_k, which keep the spline knots apart."""
    widths = control[4:8]
    names = tuple(f"segment {k}: spacing of knots {i} and {i + 1}" for i in range(PIECES))
    return not_negative(names, widths - fraction * ca.sum1(widths))


def certified_curvature(k: int, control: ca.SX, flow: SegmentFlow) -> RowBlock:
    """Return the rows B_i ≥ |Bernstein coefficients of κ on piece i|, so B_i bounds |κ| on the whole piece."""
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
    """Return the rows that keep the whole curve of a segment in its region.

    The rows are A_k P + B_i (a_i/m)²/8 ≤ b_k at both ends of every sub-step, m of them per piece.

    Between two points h apart along the curve, the curve leaves their chord by at most B t(1-t) h²/2, t in [0, 1] (the
    error of linear interpolation, de Boor, chapter II), and the region is convex. Margins α² B h²/2 and (1-α)² B h²/2
    at the two points cover this deviation for every α. Here α = 1/2; where the arm itself begins or ends, α = 0
    leaves that point without margin, since a base or a goal may touch the wall.

    Args:
        k: index of the segment.
        control: U_k.
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
    """Return the fraction of B h²/2 that each piece keeps as margin at its points, shape (PIECES, SUBSTEPS + 1)."""
    shares = np.full((PIECES, SUBSTEPS + 1), 0.25)
    if ends[0]:
        shares[0, :2] = [0.0, 1.0]
    if ends[1]:
        shares[-1, -2:] = [1.0, 0.0]
    return shares


def nearness(points: ca.SX, normals: FloatArray, offsets: FloatArray) -> ca.SX:
    """Return the weighted cost per point of closeness to the sides of its region, Σ max(0, 1 - slack/D)².

    Args:
        points: points of the curve, shape (2, m).
        normals: normals of the sides, shape (k, 2).
        offsets: offsets of the sides, shape (k,).
    """
    slack = ca.repmat(ca.DM(offsets), 1, points.shape[1]) - ca.DM(normals) @ points
    lacking = ca.fmax(1.0 - slack / _NEARNESS_DISTANCE, 0.0)
    return _NEARNESS_WEIGHT * ca.sumsqr(lacking) / points.shape[1]


def configuration_cost(state: ca.SX, control: ca.SX, bending: ca.SX, weight: ca.SX) -> ca.SX:
    """Return the objective of one segment: w ∫κ² + 4 Σ(a_i/L_k - 1/4)² + 0.1 ΣB² + 0.001 Σ(C_{i+1} - C_i)².

    The second term pulls the knots towards even spacing, the third keeps the certified bounds tight, and the last
    mildly favours a gently changing curvature.

    Args:
        state: X_k.
        control: U_k.
        bending: ∫κ² over the segment, twice the elastic energy of a unit rod.
        weight: w, the weight of the bending.
    """
    widths = control[4:8]
    values = ca.vertcat(state[3], control[:4])
    return (
        weight * bending
        + _KNOT_WEIGHT * ca.sumsqr(widths / ca.sum1(widths) - 1 / PIECES)
        + _BOUND_WEIGHT * ca.sumsqr(control[8:12])
        + _SLOPE_WEIGHT * ca.sumsqr(values[1:] - values[:-1])
    )
