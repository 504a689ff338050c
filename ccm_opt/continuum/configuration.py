"""A configuration of the continuous curvature manipulator: a base position and a chain of curvature segments."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.continuum.kinematics import integrate_headings, integrate_positions
from ccm_opt.continuum.segment import EVEN_KNOTS, CurvatureSegment, Knots
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class Configuration:
    """Curvature segments end to end; position and heading are continuous across them.

    Attributes:
        base: position of the base, shape (2,) [m].
        segments: at least one; each starts at the heading where the one before ends.
    """

    base: FloatArray
    segments: tuple[CurvatureSegment, ...]

    @classmethod
    def chain(
        cls,
        base: FloatArray,
        heading: float,
        lengths: Sequence[float],
        curvatures: Sequence[FloatArray],
        knots: Sequence[Knots] | None = None,
    ) -> "Configuration":
        """Join segments end to end from a base pose; the headings follow.

        Args:
            base: shape (2,) [m].
            heading: at the base [rad].
            lengths: of the segments [m].
            curvatures: five values a segment [1/m].
            knots: three a segment; even knots when None.
        """
        segments: list[CurvatureSegment] = []
        for k, (length, curvature) in enumerate(zip(lengths, curvatures, strict=True)):
            segment = CurvatureSegment(
                float(length), heading, np.asarray(curvature, dtype=np.float64), knots[k] if knots else EVEN_KNOTS
            )
            segments.append(segment)
            heading = segment.end_heading
        return cls(np.asarray(base, dtype=np.float64), tuple(segments))

    @cached_property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries, 0 first and L last, shape (segments + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum([segment.length for segment in self.segments])))

    @cached_property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of all spline knots and boundaries, increasing, 0 first and L last [m]."""
        knots = [start + s.breakpoints for start, s in zip(self.boundaries[:-1], self.segments, strict=True)]
        inner = np.concatenate([k[:-1] for k in knots])
        return np.append(inner, self.boundaries[-1])

    @property
    def length(self) -> float:
        """Total length L [m]."""
        return float(self.boundaries[-1])

    @property
    def base_heading(self) -> float:
        """Heading at the base [rad]."""
        return self.segments[0].heading

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """Curvature at arc lengths in [0, L], shape of ``arc`` [1/m]."""
        return self._evaluate("curvature_at", arc)

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """Heading at arc lengths in [0, L], shape of ``arc`` [rad]; exact."""
        return self._evaluate("heading_at", arc)

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Positions at increasing arc lengths in [0, L], shape (len(arc), 2) [m]; Gauss-Legendre quadrature."""
        return self.base + integrate_positions(self.heading_at, np.asarray(arc, dtype=np.float64), self.breakpoints)

    def heading_integral_at(self, arc: FloatArray) -> FloatArray:
        """Integral of the heading from the base to increasing arc lengths, shape of ``arc`` [rad m]; exact."""
        return integrate_headings(self.heading_at, np.asarray(arc, dtype=np.float64), self.breakpoints)

    @cached_property
    def tip(self) -> tuple[FloatArray, float]:
        """Position (2,) [m] and heading [rad] of the tip."""
        return self.positions_at(np.array([self.length]))[0], self.segments[-1].end_heading

    def _evaluate(self, method: str, arc: FloatArray) -> FloatArray:
        arc = np.asarray(arc, dtype=np.float64)
        index = np.clip(np.searchsorted(self.boundaries, arc, side="right") - 1, 0, len(self.segments) - 1)
        result = np.empty_like(arc)
        for k, segment in enumerate(self.segments):
            mask = index == k
            result[mask] = getattr(segment, method)(arc[mask] - self.boundaries[k])
        return result
