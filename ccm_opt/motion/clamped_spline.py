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
    return np.asarray(clamped_spline(np.eye(keyframes))(_beside(keyframes)), dtype=np.float64)


def places_along(keyframes: int, samples: int) -> FloatArray:
    """Parameters of the spline, so many for each leg of its control polygon, shape (samples (keyframes − 1) + 1,).

    Even steps of the parameter would be long ones near the ends, where the legs are followed faster.
    """
    legs = keyframes - 1
    return np.interp(np.arange(samples * legs + 1) / samples, np.arange(keyframes), _beside(keyframes))


@lru_cache(maxsize=64)
def _beside(keyframes: int) -> FloatArray:
    """The spline's parameter beside each of at least four control points, shape (keyframes,)."""
    knots = clamped_spline(np.eye(keyframes)).t
    return np.array([knots[k + 1 : k + DEGREE + 1].mean() for k in range(keyframes)])
