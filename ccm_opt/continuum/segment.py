"""The curvature segment: a length, a start heading and a five-point cubic spline of curvature (section 2.1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ccm_opt.continuum.spline import piece_coefficients
from ccm_opt.ground.arrays import FloatArray

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
