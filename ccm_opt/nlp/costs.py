"""Terms of the objective, each a function that returns an expression; ``configuration_cost`` sums them.

Weights are for lengths in units of the arm's length. The knot and bound terms are what makes the NLP converge: they
leave no direction of the variables without curvature.
"""

import casadi as ca

from ccm_opt.arrays import FloatArray

KNOT_WEIGHT = 4.0
BOUND_WEIGHT = 0.1
SLOPE_WEIGHT = 1e-3
NEARNESS_WEIGHT = 10.0
NEARNESS_DISTANCE = 0.03
"""Sides of regions farther away than this, in units of the arm's length, cost nothing."""


def bending(squared_curvature: ca.SX) -> ca.SX:
    """∫κ² ds of one segment, twice the elastic energy of a unit rod."""
    return squared_curvature


def uneven_knots(control: ca.SX) -> ca.SX:
    """Σ (a_i / L_k - 1/4)²: pulls the knots towards even spacing."""
    widths = control[4:8]
    return ca.sumsqr(widths / ca.sum1(widths) - 0.25)


def curvature_bounds(control: ca.SX) -> ca.SX:
    """Σ B_i²: keeps the certified bounds tight."""
    return ca.sumsqr(control[8:12])


def curvature_steps(state: ca.SX, control: ca.SX) -> ca.SX:
    """Σ (C_{i+1} - C_i)²: a small preference for gently changing curvature."""
    values = ca.vertcat(state[3], control[:4])
    return ca.sumsqr(values[1:] - values[:-1])


def nearness(points: ca.SX, normals: FloatArray, offsets: FloatArray) -> ca.SX:
    """Σ max(0, 1 - slack/D)² of points behind sides of their region: what they lack to the distance D of each.

    Args:
        points: shape (2, m).
        normals: of the sides, shape (k, 2).
        offsets: shape (k,).
    """
    slack = ca.repmat(ca.DM(offsets), 1, points.shape[1]) - ca.DM(normals) @ points
    return NEARNESS_WEIGHT * ca.sumsqr(ca.fmax(1.0 - slack / NEARNESS_DISTANCE, 0.0)) / points.shape[1]


def configuration_cost(state: ca.SX, control: ca.SX, squared_curvature: ca.SX, weight: ca.SX) -> ca.SX:
    """Objective of one segment: w ∫κ² + 4 Σ(a_i/L_k - 1/4)² + 0.1 ΣB² + a small slope term."""
    return (
        weight * bending(squared_curvature)
        + KNOT_WEIGHT * uneven_knots(control)
        + BOUND_WEIGHT * curvature_bounds(control)
        + SLOPE_WEIGHT * curvature_steps(state, control)
    )
