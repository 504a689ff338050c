"""Forward kinematics of a plane curve from its heading: x' = cos θ, y' = sin θ (section 2.1, Equation 1)."""

from collections.abc import Callable

import numpy as np

from ccm_opt.arrays import FloatArray

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
MAX_TURN_STEP = 0.4
"""Largest change of heading [rad] a quadrature interval may hold; 5 Gauss points then err by less than 1e-13 of its length."""


def integrate_positions(heading_at: Callable[[FloatArray], FloatArray], arc: FloatArray, knots: FloatArray) -> FloatArray:
    """Positions relative to the base at given arc lengths.

    Args:
        heading_at: exact heading over arc length [rad].
        arc: increasing arc lengths, shape (m,) [m].
        knots: arc lengths of the spline's knots, increasing; quadrature intervals never straddle one.

    Returns:
        Shape (m, 2) [m].
    """
    edges = np.unique(np.concatenate((knots, arc)))
    probes = heading_at(np.linspace(0.0, 1.0, 9)[:, None] * np.diff(edges) + edges[:-1])
    pieces = np.maximum(1, np.ceil(np.abs(np.diff(probes, axis=0)).sum(axis=0) / MAX_TURN_STEP)).astype(int)
    fine = np.concatenate([np.linspace(a, b, k, endpoint=False) for a, b, k in zip(edges[:-1], edges[1:], pieces, strict=True)] + [edges[-1:]])
    half = 0.5 * np.diff(fine)
    theta = heading_at(half[:, None] * (_NODES + 1.0) + fine[:-1, None])
    steps = np.stack(((np.cos(theta) * _WEIGHTS).sum(axis=1) * half, (np.sin(theta) * _WEIGHTS).sum(axis=1) * half), axis=1)
    positions = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return positions[np.searchsorted(fine, arc)]
