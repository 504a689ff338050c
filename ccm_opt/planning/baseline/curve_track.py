"""Tracks of straight lines and cubic spirals.

Kanayama and Hartman, "Smooth local path planning for autonomous vehicles", 1989. With turn α and length ℓ

    κ(s) = (6 α / ℓ³) s (ℓ - s),    θ(s) = θ₀ + α (3 u² - 2 u³),  u = s / ℓ,

so the peak curvature is 1.5 α / ℓ, and ∫ κ'² ds = 12 α² / ℓ³ is the least of all curves of that turn, length and
end curvature. The chord is ℓ D(α) long and bisects the headings at its ends, which are -α/2 and α/2 to it.
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
"""Gauss points of the chord's integral."""


def chord_ratio(turn: float) -> float:
    """Return the chord-to-length ratio D(α) of a cubic spiral (Kanayama and Hartman, table 1).

    D(α) = 2 ∫₀^½ cos(α (3/2 - 2x²) x) dx.

    Args:
        turn: α, at most 20 either way [rad]; the quadrature then errs by less than 1e-14.
    """
    x = 0.25 * (_NODES + 1.0)
    return float(0.5 * _WEIGHTS @ np.cos(turn * (1.5 - 2.0 * x * x) * x))


_EVEN = np.array([0.0, *EVEN_KNOTS, 1.0])
"""Even knots, including the ends."""


@dataclass(frozen=True)
class SegmentTrack:
    """Curvature segments joined end to end.

    Attributes:
        segments: the segments; each begins at the heading at which the previous one ends.
    """

    segments: tuple[CurvatureSegment, ...]

    @property
    def length(self) -> float:
        """Total length [m]."""
        return float(sum(segment.length for segment in self.segments))

    def first(self, length: float) -> tuple[CurvatureSegment, ...]:
        """Return the segments of the first ``length`` metres, with the last segment cut exactly."""
        return self._divided(length)[0]

    def after(self, length: float) -> "SegmentTrack":
        """Return the track that follows the first ``length`` metres."""
        return SegmentTrack(self._divided(length)[1])

    def from_pose(self, position: FloatArray) -> Configuration:
        """Return the track as a curve that begins at a point (2,) [m]."""
        return Configuration(position, self.segments)

    def _divided(self, length: float) -> tuple[tuple[CurvatureSegment, ...], tuple[CurvatureSegment, ...]]:
        """Return the segments of the first ``length`` metres and the remaining ones; splits the one at the boundary."""
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
    """Return straight lines between corners, with a cubic spiral around each inner corner (section 4.1).

    A turn by α that begins and ends at the distance c from its corner has the length 2 c cos(α/2) / D(α) and the peak
    curvature 1.5 α / length (Kanayama and Hartman). Two neighbouring corners may each use half of their leg.

    Args:
        corners: the corners in order, shape (k ≥ 2, 2) [m].
        sharpest: maximum curvature of a turn [1/m].

    Raises:
        ProblemError: a turn is too sharp for the length of its legs.
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
    """Return a cubic spiral, exactly represented as a curvature segment.

    κ = (6 α / ℓ³) s (ℓ - s) has the second derivative -12 α / ℓ³.

    Raises:
        ProblemError: the turn is too sharp.
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
    """Return points without those closer than ``least`` [m] to the previous or the last point; keeps the last one."""
    kept = [points[0]]
    for point in points[1:-1]:
        if np.hypot(*(point - kept[-1])) >= least and np.hypot(*(points[-1] - point)) >= least:
            kept.append(point)
    return np.array([*kept, points[-1]])
