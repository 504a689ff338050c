"""Terms of the objective, each a function that returns an expression; ``configuration_cost`` sums them.

Weights are for lengths in units of the arm's length. The knot and bound terms are what makes the NLP converge: they
leave no direction of the variables without curvature.
"""

import casadi as ca

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.nlp.configuration_settings import DEFAULT_CONFIGURATION, ConfigurationSettings


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


def nearness(
    points: ca.SX, normals: FloatArray, offsets: FloatArray, settings: ConfigurationSettings = DEFAULT_CONFIGURATION
) -> ca.SX:
    """Σ max(0, 1 - slack/D)² of points behind sides of their region: what they lack to the distance D of each.

    Args:
        points: shape (2, m).
        normals: of the sides, shape (k, 2).
        offsets: shape (k,).
        settings: the distance D, and the weight of the sum.
    """
    slack = ca.repmat(ca.DM(offsets), 1, points.shape[1]) - ca.DM(normals) @ points
    lacking = ca.fmax(1.0 - slack / settings.nearness_distance, 0.0)
    return settings.nearness_weight * ca.sumsqr(lacking) / points.shape[1]


def configuration_cost(
    state: ca.SX,
    control: ca.SX,
    squared_curvature: ca.SX,
    weight: ca.SX,
    settings: ConfigurationSettings = DEFAULT_CONFIGURATION,
) -> ca.SX:
    """Objective of one segment: w ∫κ² + 4 Σ(a_i/L_k - 1/4)² + 0.1 ΣB² + a small slope term, with the weights usual."""
    return (
        weight * bending(squared_curvature)
        + settings.knot_weight * uneven_knots(control)
        + settings.bound_weight * curvature_bounds(control)
        + settings.slope_weight * curvature_steps(state, control)
    )
