"""The five-point cubic spline that carries the curvature of a segment (section 2.1, Figure 1); natural by default."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray


def second_derivatives(widths: FloatArray, values: FloatArray, ends: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Second derivatives M of the cubic spline at its knots; the natural one unless its ends are given.

    Solves a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}]
    with M_0, M_4 given (de Boor, A Practical Guide to Splines, chapter IV).

    Args:
        widths: knot spacings a_0..a_3, shape (4,).
        values: knot values C_a..C_e, shape (5, ...).
        ends: M_0 and M_4, zero for the natural spline.

    Returns:
        M_0..M_4, shape (5, ...); linear in ``values`` and ``ends``.
    """
    slopes = np.diff(values, axis=0) / widths.reshape(-1, *([1] * (values.ndim - 1)))
    matrix = np.diag(2.0 * (widths[:-1] + widths[1:])) + np.diag(widths[1:-1], 1) + np.diag(widths[1:-1], -1)
    rows = (6.0 * np.diff(slopes, axis=0)).reshape(3, -1)
    rows[[0, -1]] -= (widths[[0, -1]] * ends)[:, None]
    inner = np.linalg.solve(matrix, rows)
    moments = np.zeros_like(values, dtype=np.float64)
    moments[0], moments[-1] = ends
    moments[1:-1] = inner.reshape(3, *values.shape[1:])
    return moments


def piece_coefficients(widths: FloatArray, values: FloatArray, ends: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Power coefficients of each cubic piece in its own offset t in [0, a_i], shape (4 pieces, 4 powers, ...)."""
    moments = second_derivatives(widths, values, ends)
    a = widths.reshape(-1, *([1] * (values.ndim - 1)))
    left = moments[:-1]
    right = moments[1:]
    linear = np.diff(values, axis=0) / a - a * (2.0 * left + right) / 6.0
    return np.stack((values[:-1], linear, 0.5 * left, (right - left) / (6.0 * a)), axis=1)
