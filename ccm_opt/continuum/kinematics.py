"""Forward kinematics of a plane curve from its heading: x' = cos θ, y' = sin θ (section 2.1, Equation 1)."""

from collections.abc import Callable

import numpy as np

from ccm_opt.ground.arrays import FloatArray

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss points of positions."""
_CUBIC_NODES, _CUBIC_WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Gauss points of headings: three integrate a quintic exactly."""
MAX_TURN_STEP = 0.4
"""Largest total turn [rad] in a quadrature interval; 8 Gauss points then err by less than 1e-12 of its length."""


def integrate_positions(
    heading_at: Callable[[FloatArray], FloatArray], arc: FloatArray, knots: FloatArray
) -> FloatArray:
    """Positions relative to the base at given arc lengths.

    Args:
        heading_at: exact heading over arc length [rad].
        arc: increasing arc lengths, shape (m,) [m].
        knots: arc lengths of the spline's knots, increasing; quadrature intervals never straddle one.

    Returns:
        Shape (m, 2) [m].
    """
    fine = _refine(heading_at, np.unique(np.concatenate((knots, arc))))
    half = 0.5 * np.diff(fine)
    theta = heading_at(half[:, None] * (_NODES + 1.0) + fine[:-1, None])
    steps = half[:, None] * np.stack((np.cos(theta) @ _WEIGHTS, np.sin(theta) @ _WEIGHTS), axis=1)
    positions = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return positions[np.searchsorted(fine, arc)]


def integrate_headings(
    heading_at: Callable[[FloatArray], FloatArray], arc: FloatArray, knots: FloatArray
) -> FloatArray:
    """Integral of the heading from 0 to given arc lengths, shape (m,) [rad m].

    Exact: θ is a quartic between knots, and three Gauss points integrate a quintic.

    Args:
        heading_at: exact heading over arc length [rad].
        arc: increasing arc lengths, shape (m,) [m].
        knots: arc lengths of the spline's knots, increasing, 0 first.
    """
    edges = np.unique(np.concatenate((knots, arc)))
    half = 0.5 * np.diff(edges)
    steps = half * (heading_at(half[:, None] * (_CUBIC_NODES + 1.0) + edges[:-1, None]) @ _CUBIC_WEIGHTS)
    integral: FloatArray = np.concatenate(([0.0], np.cumsum(steps)))[np.searchsorted(edges, arc)]
    return integral


def _refine(heading_at: Callable[[FloatArray], FloatArray], edges: FloatArray) -> FloatArray:
    """Split the intervals between edges until none turns by more than ``MAX_TURN_STEP``."""
    probes = heading_at(np.linspace(0.0, 1.0, 9)[:, None] * np.diff(edges) + edges[:-1])
    # The heading is a quartic between knots: nine probes miss little of its total turn.
    turns = np.abs(np.diff(probes, axis=0)).sum(axis=0)
    pieces = np.maximum(1, np.ceil(turns / MAX_TURN_STEP)).astype(np.intp)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    fraction = (np.arange(pieces.sum()) - first) / np.repeat(pieces, pieces)
    return np.append(np.repeat(edges[:-1], pieces) + fraction * np.repeat(np.diff(edges), pieces), edges[-1])
