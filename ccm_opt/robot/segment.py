"""Curvature segments: length, start heading and a five-point cubic spline of the curvature."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray


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


PIECES = 4
"""Cubic pieces of a segment's curvature: it has five knots."""
POWERS = np.arange(1, PIECES + 1)
"""Of arc length in the integral of a cubic."""
EVEN_KNOTS = (0.25, 0.5, 0.75)
Knots: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class CurvatureSegment:
    """The triple (L, start heading, C) of the paper.

    Attributes:
        length: L, positive [m].
        heading: heading at s = 0 [rad].
        curvature: C_a..C_e, shape (5,) [1/m].
        knots: S_b, S_c, S_d with 0 < S_b < S_c < S_d < 1.
        moments: second derivatives of C over arc length at both ends [1/m³]. The paper's segments have none: their
            spline is natural. The parts of a divided segment need them to keep the curve where it is.
    """

    length: float
    heading: float
    curvature: FloatArray
    knots: Knots = EVEN_KNOTS
    moments: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.length > 0.0:
            raise ValueError(f"a segment's length must be positive, got {self.length}")
        if np.shape(self.curvature) != (5,):
            raise ValueError(f"a segment has five curvature values, got shape {np.shape(self.curvature)}")
        if not (0.0 < self.knots[0] < self.knots[1] < self.knots[2] < 1.0):
            raise ValueError(f"knots must satisfy 0 < S_b < S_c < S_d < 1, got {self.knots}")

    @cached_property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of the five knots, shape (5,) [m]."""
        return self.length * np.array([0.0, *self.knots, 1.0])

    @cached_property
    def coefficients(self) -> FloatArray:
        """Curvature's power coefficients on each piece over arc length from the piece's start, shape (4, 4)."""
        return piece_coefficients(np.diff(self.breakpoints), np.asarray(self.curvature, dtype=np.float64), self.moments)

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """C at arc lengths in [0, L], any shape [1/m]."""
        piece, t = self._locate(arc)
        c = self.coefficients[piece]
        values: FloatArray = c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3]))
        return values

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """θ at arc lengths in [0, L], any shape [rad]; exact, a quartic on each piece."""
        piece, t = self._locate(arc)
        c = self.coefficients[piece]
        turned = t * (c[..., 0] + t * (c[..., 1] / 2 + t * (c[..., 2] / 3 + t * c[..., 3] / 4)))
        headings: FloatArray = self._piece_headings[piece] + turned
        return headings

    @cached_property
    def end_heading(self) -> float:
        """θ at the segment's end [rad]."""
        return float(self._piece_headings[-1])

    def _locate(self, arc: FloatArray) -> tuple[np.ndarray, FloatArray]:
        piece = np.clip(np.searchsorted(self.breakpoints, arc, side="right") - 1, 0, 3)
        return piece, np.asarray(arc, dtype=np.float64) - self.breakpoints[piece]

    @cached_property
    def _piece_headings(self) -> FloatArray:
        a = np.diff(self.breakpoints)
        c = self.coefficients
        turns = a * (c[:, 0] + a * (c[:, 1] / 2 + a * (c[:, 2] / 3 + a * c[:, 3] / 4)))
        return self.heading + np.concatenate(([0.0], np.cumsum(turns)))
