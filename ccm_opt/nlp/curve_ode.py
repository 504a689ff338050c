"""The curve's differential equation in CasADi: κ from a natural spline, θ in closed form, x and y by Gauss-Legendre.

Lengths are in units of the arm's length. A segment starts in the state X = (x, y, θ, κ, s) and is shaped by the
control U = (C_1..C_4, a_0..a_3, B_0..B_3): curvature at the knots after the first (C_0 = κ keeps the curvature
continuous), arc lengths between knots, and a bound on |κ| for each piece.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ccm_opt.continuum.segment import PIECES

STATES = 5
"""Size of X."""
CONTROLS = 12
"""Size of U."""
SUBSTEPS = 2
"""Chords a piece is cut into, for quadrature and for containment."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss points of one chord."""


@dataclass(frozen=True)
class SegmentFlow:
    """Expressions of one curvature segment.

    Attributes:
        end: state at its end, (5, 1).
        points: positions at the sub-step ends, base first, (2, PIECES * SUBSTEPS + 1).
        bernstein: Bernstein coefficients of κ, a row a piece, (PIECES, 4).
        bending: ∫κ² ds.
    """

    end: ca.SX
    points: ca.SX
    bernstein: ca.SX
    bending: ca.SX


def natural_spline_moments(widths: ca.SX, values: ca.SX) -> ca.SX:
    """Second derivatives M_0..M_4 of the natural cubic spline by the Thomas algorithm, (5, 1).

    a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}],
    M_0 = M_4 = 0; the matrix is diagonally dominant, so elimination needs no pivots (Golub and Van Loan, 4.3).
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


def piece_polynomials(widths: ca.SX, values: ca.SX) -> ca.SX:
    """Power coefficients of κ on each piece over arc length from the piece's start, (PIECES, 4)."""
    moments = natural_spline_moments(widths, values)
    rows = []
    for i in range(PIECES):
        a = widths[i]
        left = moments[i]
        right = moments[i + 1]
        slope = (values[i + 1] - values[i]) / a - a * (2 * left + right) / 6
        rows.append(ca.horzcat(values[i], slope, left / 2, (right - left) / (6 * a)))
    return ca.vertcat(*rows)


def turn(polynomial: ca.SX, arc: ca.SX) -> ca.SX:
    """Heading gained from a piece's start to ``arc``: the integral of its cubic, a quartic."""
    c = polynomial
    return arc * (c[0] + arc * (c[1] / 2 + arc * (c[2] / 3 + arc * c[3] / 4)))


def squared_curvature(polynomial: ca.SX, width: ca.SX) -> ca.SX:
    """∫κ² ds over one piece; four Gauss points are exact for a sextic."""
    total = ca.SX(0)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        t = width * (node + 1) / 2
        kappa = polynomial[0] + t * (polynomial[1] + t * (polynomial[2] + t * polynomial[3]))
        total += weight / 2 * kappa**2
    return width * total


def bernstein_coefficients(polynomial: ca.SX, width: ca.SX) -> ca.SX:
    """Bernstein coefficients of a cubic on [0, width]; the cubic stays within their hull (Farouki 2012), (1, 4)."""
    c0, c1, c2, c3 = (polynomial[i] * width**i for i in range(4))
    return ca.horzcat(c0, c0 + c1 / 3, c0 + 2 * c1 / 3 + c2 / 3, c0 + c1 + c2 + c3)


def chord_vector(polynomial: ca.SX, heading: ca.SX, start: ca.SX, width: ca.SX) -> ca.SX:
    """∫ (cos θ, sin θ) ds over one sub-step by four Gauss points, (2, 1)."""
    x = ca.SX(0)
    y = ca.SX(0)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        theta = heading + turn(polynomial, start + width * (node + 1) / 2)
        x += weight / 2 * ca.cos(theta)
        y += weight / 2 * ca.sin(theta)
    return width * ca.vertcat(x, y)


def segment_flow(state: ca.SX, control: ca.SX) -> SegmentFlow:
    """Integrate one segment: X_{k+1} = F(X_k, U_k) and what costs and constraints need on the way."""
    position = state[:2]
    heading = state[2]
    values = ca.vertcat(state[3], control[:4])
    widths = control[4:8]
    polynomials = piece_polynomials(widths, values)

    points = [position]
    bernstein = []
    bending = ca.SX(0)
    for i in range(PIECES):
        polynomial = polynomials[i, :]
        step = widths[i] / SUBSTEPS
        for j in range(SUBSTEPS):
            position += chord_vector(polynomial, heading, j * step, step)
            points.append(position)
        heading += turn(polynomial, widths[i])
        bernstein.append(bernstein_coefficients(polynomial, widths[i]))
        bending += squared_curvature(polynomial, widths[i])

    end = ca.vertcat(position, heading, values[4], state[4] + ca.sum1(widths))
    return SegmentFlow(end, ca.horzcat(*points), ca.vertcat(*bernstein), bending)


@cache
def segment_function() -> ca.Function:
    """(X, U) -> (X_{k+1}, points, Bernstein coefficients, ∫κ²) as one CasADi function."""
    state = ca.SX.sym("X", STATES)
    control = ca.SX.sym("U", CONTROLS)
    flow = segment_flow(state, control)
    return ca.Function("segment", [state, control], [flow.end, flow.points, flow.bernstein, flow.bending])
