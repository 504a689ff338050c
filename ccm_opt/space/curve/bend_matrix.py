"""Which bends of the joints come nearest to a curve whose curvature is a spline: the averages of its turns."""

from functools import lru_cache

import numpy as np

from ccm_opt.ground.arrays import FloatArray

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Gauss points: three integrate a quintic exactly, and a cubic times a line is a quartic."""


def bend_matrix(links: int, length: float, knots: int) -> FloatArray:
    """Bends about one axis by the turn at the base and the curvature at evenly spread knots, shape (links, knots + 1).

    Between the knots the curvature is the natural cubic spline. The bend of a joint is ∫ κ(s) w(s) ds with the
    triangle w that is 1 at the joint and 0 at its neighbours: in the plane that is the difference of the curve's mean
    headings on both links. Headings do not add in space; bends do.

    Args:
        links: number of links.
        length: of the arm [m].
        knots: number of curvature values, at least 2.

    Returns:
        Columns: the turn at the base, then the curvature at each knot [rad/(1/m)].
    """
    matrix = _unit_bend_matrix(links, knots).copy()
    matrix[:, 1:] *= length  # curvature counts per metre: a curve of length L turns L times as far as one of length 1
    return matrix


@lru_cache(maxsize=32)
def _unit_bend_matrix(links: int, knots: int) -> FloatArray:
    """The same for a curve of length 1."""
    joints = np.arange(links + 1) / links
    # Between joints and knots the integrand is one polynomial; rounding merges a joint with a knot at the same place.
    edges = np.unique(np.round(np.concatenate((joints, np.linspace(0.0, 1.0, knots))), 14))
    half = 0.5 * np.diff(edges)
    s = (edges[:-1, None] + half[:, None] * (_NODES + 1.0)).ravel()
    turned = (half[:, None] * _WEIGHTS).ravel()[:, None] * natural_spline_basis(s, knots)
    link = np.minimum((s * links).astype(np.intp), links - 1)
    share = (s * links - link)[:, None]

    # A turn at a share t of a link counts (1 − t) at the joint before it and t at the joint behind; behind the last
    # link there is no joint.
    bends = np.zeros((links + 1, knots))
    np.add.at(bends, link, (1.0 - share) * turned)
    np.add.at(bends, link + 1, share * turned)
    matrix = np.zeros((links, knots + 1))
    matrix[0, 0] = 1.0
    matrix[:, 1:] = bends[:links]
    return matrix


def natural_spline_basis(s: FloatArray, knots: int) -> FloatArray:
    """Values at s of the natural cubic splines that are 1 at one of evenly spread knots and 0 at the others.

    Args:
        s: shape (m,), in [0, 1].
        knots: how many, the first at 0 and the last at 1.

    Returns:
        Shape (m, knots).
    """
    width = 1.0 / (knots - 1)
    values = np.eye(knots)
    moments = natural_spline_moments(knots)
    piece = np.clip((s / width).astype(np.intp), 0, knots - 2)
    right = (s / width - piece)[:, None]
    left = 1.0 - right
    straight = left * values[piece] + right * values[piece + 1]
    bent = (left**3 - left) * moments[piece] + (right**3 - right) * moments[piece + 1]
    return np.asarray(straight + width**2 / 6.0 * bent)


@lru_cache(maxsize=32)
def natural_spline_moments(knots: int) -> FloatArray:
    """Second derivatives at evenly spread knots in [0, 1] by the values there, shape (knots, knots)."""
    width = 1.0 / (knots - 1)
    moments = np.zeros((knots, knots))
    if knots == 2:
        return moments
    inner = knots - 2
    system = 4.0 * np.eye(inner) + np.eye(inner, k=1) + np.eye(inner, k=-1)
    differences = np.eye(inner, knots) - 2.0 * np.eye(inner, knots, k=1) + np.eye(inner, knots, k=2)
    moments[1:-1] = np.linalg.solve(system, 6.0 / width**2 * differences)
    return moments
