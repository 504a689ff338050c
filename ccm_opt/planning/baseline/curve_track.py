"""Reference paths of straight lines and cubic spirals along which a planar arm is fed.

Source: Kanayama and Hartman, "Smooth local path planning for autonomous vehicles", 1989. A cubic spiral with the
change of heading α and the length ℓ has the curvature and heading

    κ(s) = (6 α / ℓ³) s (ℓ - s),    θ(s) = θ₀ + α (3 u² - 2 u³),  u = s / ℓ,

so the peak curvature is 1.5 α / ℓ, and ∫ κ'² ds = 12 α² / ℓ³ is the minimum over all curves with equal change of
heading, length and end curvature 0. The chord has the length ℓ D(α) and makes the angles -α/2 and α/2 with the ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import SHORTEST, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import curvature, long_length, place
from ccm_opt.core.polyline import vector_headings, wrap
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import segment_head, segment_tail
from ccm_opt.robot.segment import EVEN_KNOTS, CurvatureSegment

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)
"""Nodes and weights of Gauss quadrature for the chord of a cubic spiral."""


def chord_ratio(turn: float) -> float:
    """Return the ratio D(α) of chord to length of a cubic spiral (Kanayama and Hartman, table 1).

    D(α) = 2 ∫₀^½ cos(α (3/2 - 2x²) x) dx.

    Args:
        turn: change of heading α in [-20, 20] [rad]; the error of the quadrature is then below 1e-14.
    """
    x = 0.25 * (_NODES + 1.0)
    return float(0.5 * _WEIGHTS @ np.cos(turn * (1.5 - 2.0 * x * x) * x))


_EVEN = np.array([0.0, *EVEN_KNOTS, 1.0])
"""Relative arc lengths of evenly spaced knots, ends included."""


@dataclass(frozen=True)
class SegmentTrack:
    """Reference path of curvature segments joined end to end, along which an arm is fed.

    Attributes:
        segments: the segments; each begins with the heading with which the previous one ends.
    """

    segments: tuple[CurvatureSegment, ...]

    @property
    def length(self) -> float:
        """Total length of the path [m]."""
        return float(sum(segment.length for segment in self.segments))

    def first(self, length: float) -> tuple[CurvatureSegment, ...]:
        """Return the segments of the first ``length`` [m] of the path; the last segment is cut exactly."""
        return self._divided(length)[0]

    def after(self, length: float) -> "SegmentTrack":
        """Return the rest of the path after the first ``length`` [m]."""
        return SegmentTrack(self._divided(length)[1])

    def from_pose(self, position: FloatArray) -> Configuration:
        """Return the whole path as a backbone curve that begins at a given point, shape (2,) [m]."""
        return Configuration(position, self.segments)

    def _divided(self, length: float) -> tuple[tuple[CurvatureSegment, ...], tuple[CurvatureSegment, ...]]:
        """Return the segments of the first ``length`` [m], and the others; a segment across the boundary is cut."""
        before: list[CurvatureSegment] = []
        least = SHORTEST * self.length
        for k, segment in enumerate(self.segments):
            left = length - sum(s.length for s in before)
            if left <= least:
                return tuple(before), self.segments[k:]
            if left < segment.length - least:
                return (*before, segment_head(segment, left)), (segment_tail(segment, left), *self.segments[k + 1 :])
            before.append(segment)
        return tuple(before), ()


def track_through(corners: FloatArray, sharpest: float) -> SegmentTrack:
    """Return a path of straight lines between corners, with a cubic spiral at every inner corner (section 4.1).

    A spiral with the change of heading α whose ends have the distance c from the corner has the length
    2 c cos(α/2) / D(α) and the peak curvature 1.5 α / length (Kanayama and Hartman). The spirals at two neighbouring
    corners may each use half of the line between them.

    Args:
        corners: the corners in order, shape (K ≥ 2, 2) [m].
        sharpest: maximum curvature of a spiral [1/m].

    Raises:
        ProblemError: a spiral exceeds the maximum curvature because the lines at its corner are too short.
    """
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    headings = vector_headings(legs)
    turns = [wrap(float(after - before)) for before, after in pairwise(headings)]
    share = np.full(len(lengths), 0.5)
    share[[0, -1]] = 1.0
    # Slightly less than the whole length, so that the straights between two turns never vanish by rounding.
    reaches = [0.999 * min(share[k] * lengths[k], share[k + 1] * lengths[k + 1]) for k in range(len(turns))]

    heading = float(headings[0])
    segments: list[CurvatureSegment] = []
    for k, length in enumerate(lengths):
        straight = float(length)
        if k > 0:
            straight -= reaches[k - 1]
        if k < len(turns):
            straight -= reaches[k]
        if straight > SHORTEST * lengths.sum():
            segments.append(CurvatureSegment(straight, heading, np.zeros(5)))
        if k < len(turns):
            segments.append(_spiral(heading, turns[k], float(reaches[k]), sharpest, corners[k + 1]))
            heading = segments[-1].end_heading
    return SegmentTrack(tuple(segments))


def _spiral(heading: float, turn: float, reach: float, sharpest: float, corner: FloatArray) -> CurvatureSegment:
    """Return a cubic spiral around a corner, exactly represented as a curvature segment.

    The curvature κ = (6 α / ℓ³) s (ℓ - s) has the second derivative -12 α / ℓ³.

    Args:
        heading: heading at the start [rad].
        turn: change of heading α [rad].
        reach: distance of both ends from the corner [m].
        sharpest: maximum curvature [1/m].
        corner: position of the corner, for messages, shape (2,) [m].

    Raises:
        ProblemError: the maximum curvature is exceeded.
    """
    length = 2.0 * reach * np.cos(0.5 * turn) / chord_ratio(turn)
    if length <= 0.0 or 1.5 * abs(turn) > sharpest * length:
        raise ProblemError(
            f"the turn by {np.rad2deg(turn):.0f}° at {place(corner)} has {long_length(reach)} of track on either side; "
            f"that takes a curvature above the limit of {curvature(sharpest)}"
        )
    bend = -12.0 * turn / length**3
    return CurvatureSegment(
        float(length), heading, 6.0 * turn / length * _EVEN * (1.0 - _EVEN), EVEN_KNOTS, (bend, bend)
    )


def without_near(points: Sequence[FloatArray], least: float) -> FloatArray:
    """Return a polyline's points thinned to a minimum distance ``least`` [m], shape (k, 2) [m].

    The first and the last point are always kept. A point between them is dropped if it is closer than ``least`` to the
    last point or to the previous point that was kept.
    """
    kept = [points[0]]
    for point in points[1:-1]:
        if np.hypot(*(point - kept[-1])) >= least and np.hypot(*(points[-1] - point)) >= least:
            kept.append(point)
    return np.array([*kept, points[-1]])
