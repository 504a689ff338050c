"""Bend angles of joints per unit of curvature of a curve in space, by NumPy."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import CurveMap


def shapes_by_numpy(curve: CurveMap, places: FloatArray) -> FloatArray:
    """Return the bend angles of joints per unit of curvature at each knot, outside a guide tube, shape (m, knots).

    Args:
        curve: map from curvature to bend angles.
        places: arc lengths of the joints, shape (m,) [m].
    """
    l = curve.arm.link_length
    ahead, here, behind = (_twice_integrated(curve, places + shift) for shift in (l, 0.0, -l))
    return np.asarray((ahead - 2.0 * here + behind) / l)


def _twice_integrated(curve: CurveMap, s: FloatArray) -> FloatArray:
    """Return the double integrals of the hat function of every knot up to m arc lengths, shape (m, knots) [m²]."""
    h = curve.spacing
    x = s[:, None] / h - np.arange(curve.knots)
    # A hat is the second difference of the ramps (x)₊; twice integrated those are (x)₊³ / 6. At both ends of the
    # curve hats are halves, and beyond them there is no curvature.
    last = float(curve.knots - 1)
    whole = _cube(x + 1.0) - 2.0 * _cube(x) + _cube(x - 1.0)
    top = s / h
    whole[:, 0] = 3.0 * _square(top) - _cube(top) + _cube(top - 1.0)
    end = top - last
    whole[:, -1] = _cube(end + 1.0) - _cube(end) - 3.0 * _square(end)
    return h * h * whole / 6.0


def _cube(x: FloatArray) -> FloatArray:
    return np.maximum(x, 0.0) ** 3


def _square(x: FloatArray) -> FloatArray:
    return np.maximum(x, 0.0) ** 2
