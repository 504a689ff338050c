"""The clamped cubic B-spline over keyframes, and where it runs beside them."""

from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.ground.arrays import FloatArray

DEGREE = 3
"""Of the spline: the least with a continuous second derivative."""


def clamped_spline(control: FloatArray) -> BSpline:
    """Clamped uniform cubic B-spline over [0, 1] with given control points, shape (m ≥ 4, links)."""
    spans = len(control) - DEGREE
    # End knots of multiplicity four: the curve begins and ends on its first and last control point.
    knots = np.concatenate((np.zeros(DEGREE), np.linspace(0.0, 1.0, spans + 1), np.ones(DEGREE)))
    return BSpline(knots, control, DEGREE)


@lru_cache(maxsize=64)
def smoothing_matrix(keyframes: int) -> FloatArray:
    """Where the spline is beside each of its control points, as a matrix on them, shape (keyframes, keyframes).

    Row k is the spline's value at the Greville abscissa of control point k, the mean of the three knots inside its
    support, where the spline is near it (de Boor, *A Practical Guide to Splines*, chapter IX). Fewer than four
    keyframes make straight legs, which the spline follows.
    """
    if keyframes < DEGREE + 1:
        return np.eye(keyframes)
    spline = clamped_spline(np.eye(keyframes))
    beside = np.array([spline.t[k + 1 : k + DEGREE + 1].mean() for k in range(keyframes)])
    return np.asarray(spline(beside), dtype=np.float64)
