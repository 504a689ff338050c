"""Tracks of curves between two configurations, by cubic spirals.

Kanayama and Hartman, "Smooth local path planning for autonomous vehicles", 1989. With turn α and length ℓ

    κ(s) = (6 α / ℓ³) s (ℓ - s),    θ(s) = θ₀ + α (3 u² - 2 u³),  u = s / ℓ,

so the peak curvature is 1.5 α / ℓ, and ∫ κ'² ds = 12 α² / ℓ³ is the least of all curves of that turn, length and
end curvature. The chord is ℓ D(α) long and bisects the headings at its ends, which are -α/2 and α/2 to it. Two poses
that are symmetric to each other, that is, whose headings are bisected by the chord, therefore have exactly one such
turn between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.length_words import curvature, long_length, place
from ccm_opt.core.polyline import heading_of, unit_vector, vector_headings, wrap
from ccm_opt.errors import ProblemError
from ccm_opt.robot.configuration import Configuration, integrate_positions
from ccm_opt.robot.decomposition import rest_of, start_of
from ccm_opt.robot.segment import EVEN_KNOTS, CurvatureSegment

_MEAN_PLACES = 41
"""Places of mean poses that are compared before the best is refined. Taste; they stand denser at the ends, near which
the least of several minima lies."""

LARGEST_TURN = 4.0
"""Turns beyond this are refused [rad]: the chord of a cubic spiral shrinks to nothing a little later."""
_LARGEST_SUM = 6.28
"""A whole turn in all leaves no place for a mean pose: it would be infinitely far [rad]."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)
"""Gauss points of the chord's integral."""


def chord_ratio(turn: float) -> float:
    """D(α) = 2 ∫₀^½ cos(α (3/2 - 2x²) x) dx: chord over length of a cubic spiral (Kanayama and Hartman, table 1).

    Args:
        turn: α, at most 20 either way [rad]; the quadrature then errs by less than 1e-14.
    """
    x = 0.25 * (_NODES + 1.0)
    return float(0.5 * _WEIGHTS @ np.cos(turn * (1.5 - 2.0 * x * x) * x))


@dataclass(frozen=True)
class CubicSpiral:
    """One turn.

    Attributes:
        start: shape (2,) [m].
        heading: at the start [rad].
        turn: α, positive to the left [rad].
        length: ℓ, positive [m].
    """

    start: FloatArray
    heading: float
    turn: float
    length: float

    @classmethod
    def to_point(cls, start: FloatArray, heading: float, end: FloatArray) -> "CubicSpiral":
        """The turn from a pose to a point; it ends in the pose there that is symmetric to the first.

        Args:
            start: shape (2,) [m].
            heading: at the start [rad].
            end: another point, shape (2,) [m].

        Raises:
            ProblemError: start and end are one, or the turn would be more than ``LARGEST_TURN``.
        """
        chord = np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64)
        distance = float(np.hypot(*chord))
        turn = 2.0 * wrap(heading_of(chord) - heading)
        if distance == 0.0 or abs(turn) > LARGEST_TURN:
            raise ProblemError(
                f"no cubic spiral turns by {turn:.4g} rad over a chord of {distance:.4g} m; expected a chord, and at "
                f"most {LARGEST_TURN} rad; divide the turn"
            )
        return cls(np.asarray(start, dtype=np.float64), heading, turn, distance / chord_ratio(turn))

    @property
    def peak_curvature(self) -> float:
        """The curvature in the middle, with its sign [1/m]."""
        return 1.5 * self.turn / self.length

    @property
    def end_heading(self) -> float:
        """Heading at the end [rad]."""
        return self.heading + self.turn

    @cached_property
    def end(self) -> FloatArray:
        """The end point, shape (2,) [m]: a chord of ℓ D(α) at half the turn."""
        middle = self.heading + 0.5 * self.turn
        chord = self.length * chord_ratio(self.turn)
        return self.start + chord * unit_vector(middle)

    @property
    def jerk(self) -> float:
        """∫ κ'² ds = 12 α² / ℓ³ [1/m³]: what Kanayama and Hartman minimise."""
        return 12.0 * self.turn**2 / self.length**3

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """κ at arc lengths in [0, ℓ], any shape [1/m]."""
        s = np.asarray(arc, dtype=np.float64)
        curvature: FloatArray = 6.0 * self.turn / self.length**3 * s * (self.length - s)
        return curvature

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """θ at arc lengths in [0, ℓ], any shape [rad]."""
        u = np.asarray(arc, dtype=np.float64) / self.length
        heading: FloatArray = self.heading + self.turn * u * u * (3.0 - 2.0 * u)
        return heading

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Positions at increasing arc lengths in [0, ℓ], shape (len(arc), 2) [m]."""
        arc = np.asarray(arc, dtype=np.float64)
        return self.start + integrate_positions(self.heading_at, arc, np.array([0.0, self.length]))


def join_poses(
    start: FloatArray,
    heading: float,
    end: FloatArray,
    end_heading: float,
) -> tuple[CubicSpiral, ...]:
    """One cubic spiral between symmetric poses, two between others.

    A mean pose that is symmetric to both ends lies on an arc through them (on their chord when the headings are
    parallel). With A the turn from the first heading to the chord, B that from the chord to the last heading and
    h = (A + B)/2, its places are p₁ + d sin((1 - t) h)/sin h · e(δ - t h), 0 < t < 1, for a chord of length d and
    heading δ. The one with the least ∫ κ'² ds is taken, as Kanayama and Hartman do: the middle of the chord for
    parallel headings.

    Args:
        start: shape (2,) [m].
        heading: at the start [rad].
        end: another point, shape (2,) [m].
        end_heading: at the end, up to whole turns [rad].

    Returns:
        One or two turns, end to end.

    Raises:
        ProblemError: the points are one, or no mean pose keeps both turns within ``LARGEST_TURN``.
    """
    start = np.asarray(start, dtype=np.float64)
    end = np.asarray(end, dtype=np.float64)
    chord = end - start
    direction = heading_of(chord)
    before = wrap(direction - heading)
    after = wrap(end_heading - direction)
    # Symmetric poses are joined by one spiral.
    if abs(before - after) <= ROUNDING and 2.0 * abs(before) <= LARGEST_TURN:
        return (CubicSpiral.to_point(start, heading, end),)
    low, high = _mean_range(before, after)

    def cost(t: float) -> float:
        return sum(half.jerk for half in _halves(start, heading, chord, (before, after), t))

    if not (low < high and np.any(chord) and abs(before + after) < _LARGEST_SUM):
        raise ProblemError(
            f"no two cubic spirals of at most {LARGEST_TURN} rad join the poses ({start[0]:.4g}, {start[1]:.4g}), "
            f"{heading:.4g} rad and ({end[0]:.4g}, {end[1]:.4g}), {end_heading:.4g} rad; go through a pose between them"
        )
    # The cost may have several minima, the least of them close to an end, where one turn does nearly all.
    denser_at_ends = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _MEAN_PLACES)))
    places = low + (high - low) * denser_at_ends
    least = int(np.argmin([cost(place) for place in places]))
    bounds = (places[max(least - 1, 0)], places[min(least + 1, len(places) - 1)])
    best = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return _halves(start, heading, chord, (before, after), float(best.x))


def _mean_range(before: float, after: float) -> tuple[float, float]:
    """Places t of the mean pose at which both turns, 2A - t (A + B) and 2B - (1 - t)(A + B), are small enough."""
    total = before + after
    low = 0.0
    high = 1.0
    for constant, slope in ((2.0 * before, -total), (2.0 * after - total, total)):
        if abs(slope) >= 1e-12:
            ends = sorted(((-LARGEST_TURN - constant) / slope, (LARGEST_TURN - constant) / slope))
            low = max(low, ends[0])
            high = min(high, ends[1])
        elif abs(constant) > LARGEST_TURN:
            return 1.0, 0.0  # the turn is the same everywhere, and too large
    apart = 1e-6  # at the very ends one of the two turns has no length
    return low + apart, high - apart


def _halves(
    start: FloatArray, heading: float, chord: FloatArray, bends: tuple[float, float], t: float
) -> tuple[CubicSpiral, CubicSpiral]:
    """The two turns through the mean pose at place t."""
    half = 0.5 * (bends[0] + bends[1])
    distance = float(np.hypot(*chord))
    direction = heading_of(chord) - t * half
    share = (1.0 - t) * np.sinc((1.0 - t) * half / np.pi) / np.sinc(half / np.pi)
    middle = start + distance * share * unit_vector(direction)
    first = _between(start, heading, middle, 2.0 * (bends[0] - t * half))
    return first, _between(middle, first.end_heading, start + chord, 2.0 * (bends[1] - (1.0 - t) * half))


def _between(start: FloatArray, heading: float, end: FloatArray, turn: float) -> CubicSpiral:
    return CubicSpiral(start, heading, turn, float(np.hypot(*(end - start))) / chord_ratio(turn))


_EVEN = np.array([0.0, *EVEN_KNOTS, 1.0])
"""Even knots, the ends included."""


@dataclass(frozen=True)
class SegmentTrack:
    """Curvature segments end to end.

    Attributes:
        segments: each begins at the heading at which the one before ends.
    """

    segments: tuple[CurvatureSegment, ...]

    @property
    def length(self) -> float:
        """Total length [m]."""
        return float(sum(segment.length for segment in self.segments))

    def first(self, length: float) -> tuple[CurvatureSegment, ...]:
        """The segments of the first ``length`` metres, the last one cut, exactly."""
        return self._divided(length)[0]

    def after(self, length: float) -> "SegmentTrack":
        """What follows the first ``length`` metres."""
        return SegmentTrack(self._divided(length)[1])

    def from_pose(self, position: FloatArray) -> Configuration:
        """The track as a curve that begins at a point (2,) [m]."""
        return Configuration(position, self.segments)

    def _divided(self, length: float) -> tuple[tuple[CurvatureSegment, ...], tuple[CurvatureSegment, ...]]:
        """The segments of the first ``length`` metres, and the others; the one between is cut in two."""
        before: list[CurvatureSegment] = []
        least = SHORTEST * self.length
        for k, segment in enumerate(self.segments):
            left = length - sum(s.length for s in before)
            if left <= least:
                return tuple(before), self.segments[k:]
            if left < segment.length - least:
                return (*before, start_of(segment, left)), (rest_of(segment, left), *self.segments[k + 1 :])
            before.append(segment)
        return tuple(before), ()


def track_through(corners: FloatArray, sharpest: float) -> SegmentTrack:
    """Straight lines between corners and a cubic spiral round each (section 4.1).

    A turn by α that begins and ends at the distance c from its corner has the length 2 c cos(α/2) / D(α) and the peak
    curvature 1.5 α / length (Kanayama and Hartman). Legs between two corners are shared by halves.

    Args:
        corners: shape (k ≥ 2, 2) [m].
        sharpest: curvature that no turn may exceed [1/m].

    Raises:
        ProblemError: a turn is too sharp for the room along its legs.
    """
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    headings = vector_headings(legs)
    turns = [wrap(float(after - before)) for before, after in pairwise(headings)]
    share = np.full(len(lengths), 0.5)
    share[[0, -1]] = 1.0
    # A little short of all the room, so that the straights between two turns never vanish by rounding.
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
    """A cubic spiral as a curvature segment, exactly: κ = (6 α / ℓ³) s (ℓ - s) has the second derivative -12 α / ℓ³."""
    length = 2.0 * reach * np.cos(0.5 * turn) / chord_ratio(turn)
    if length <= 0.0 or 1.5 * abs(turn) > sharpest * length:
        raise ProblemError(
            f"the turn by {np.rad2deg(turn):.0f}° at {place(corner)} has {long_length(reach)} of room on "
            f"either side; that is too sharp for a curvature of {curvature(sharpest)}"
        )
    bend = -12.0 * turn / length**3
    return CurvatureSegment(
        float(length), heading, 6.0 * turn / length * _EVEN * (1.0 - _EVEN), EVEN_KNOTS, (bend, bend)
    )


def without_near(points: Sequence[FloatArray], least: float) -> FloatArray:
    """Points with those left out that are nearer than ``least`` [m] to the one before; the last always stays."""
    kept = [points[0]]
    for point in points[1:-1]:
        if np.hypot(*(point - kept[-1])) >= least and np.hypot(*(points[-1] - point)) >= least:
            kept.append(point)
    return np.array([*kept, points[-1]])
