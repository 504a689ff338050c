"""A curve of segments from a base: its places and headings, and where it ends."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.segment import EVEN_KNOTS, CurvatureSegment, Knots

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


@dataclass(frozen=True)
class Curve:
    """Segments end to end, in the plane or in space.

    Attributes:
        base: position of the base, shape (d,) [m].
        segments: at least one, with their lengths, knots and curvatures.
    """

    base: FloatArray
    segments: tuple[Any, ...]

    @cached_property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries, 0 first and L last, shape (segments + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum([segment.length for segment in self.segments])))

    @cached_property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of all spline knots and boundaries, increasing, 0 first and L last [m]."""
        knots = [start + s.breakpoints[:-1] for start, s in zip(self.boundaries[:-1], self.segments, strict=True)]
        return np.append(np.concatenate(knots), self.boundaries[-1])

    @property
    def length(self) -> float:
        """Total length L [m]."""
        return float(self.boundaries[-1])

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Positions at increasing arc lengths in [0, L], shape (m,) to (m, d) [m]."""
        raise NotImplementedError

    def mean_directions(self, links: int) -> FloatArray:
        """Mean direction over each of ``links`` equal lengths, shape (links, d)."""
        raise NotImplementedError


@dataclass(frozen=True)
class Configuration(Curve):
    """Curvature segments end to end; position and heading are continuous across them.

    Attributes:
        base: position of the base, shape (2,) [m].
        segments: at least one; each starts at the heading where the one before ends.
    """

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

    def mean_headings(self, links: int) -> FloatArray:
        """Mean heading over each of ``links`` equal lengths, shape (links,) [rad]; exact."""
        edges = np.linspace(0.0, self.length, links + 1)
        means: FloatArray = np.diff(self.heading_integral_at(edges)) * (links / self.length)
        return means

    def mean_directions(self, links: int) -> FloatArray:
        """Directions of the mean headings, shape (links, 2)."""
        return unit_vector(self.mean_headings(links))

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
