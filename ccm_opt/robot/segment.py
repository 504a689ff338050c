"""Curvature segments, and the five types with at most one inflection (section 2.1, Figure 2)."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.interpolate import PPoly
from scipy.optimize import brentq
from scipy.special import j0

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polyline import vector_heading, wrap


def second_derivatives(widths: FloatArray, values: FloatArray, ends: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """Return the second derivatives M of a cubic spline at its knots; the natural spline unless ends are given.

    Solves a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}]
    with M_0, M_4 given (de Boor, A Practical Guide to Splines, chapter IV).

    Args:
        widths: spacings of the knots a_0..a_3, shape (4,).
        values: values at the knots C_a..C_e, shape (5, ...).
        ends: M_0 and M_4; zero for the natural spline.

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
    """Return the power coefficients of each cubic piece, shape (4 pieces, 4 powers, ...).

    The powers are those of the offset t in [0, a_i] from the start of the piece.
    """
    moments = second_derivatives(widths, values, ends)
    a = widths.reshape(-1, *([1] * (values.ndim - 1)))
    left = moments[:-1]
    right = moments[1:]
    linear = np.diff(values, axis=0) / a - a * (2.0 * left + right) / 6.0
    return np.stack((values[:-1], linear, 0.5 * left, (right - left) / (6.0 * a)), axis=1)


def curvature_spline(coefficients: FloatArray, breaks: FloatArray) -> PPoly:
    """Return a piecewise cubic from coefficients of shape (pieces, 4 powers, ...) and its breaks.

    The coefficients multiply powers of the arc length from the start of each piece.
    """
    return PPoly.construct_fast(np.ascontiguousarray(np.swapaxes(coefficients, 0, 1)[::-1]), breaks)


PIECES = 4
"""Number of cubic pieces of a segment's curvature, which has five knots."""
POWERS = np.arange(1, PIECES + 1)
"""Powers of arc length in the integral of a cubic."""
EVEN_KNOTS = (0.25, 0.5, 0.75)
Knots: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class CurvatureSegment:
    """A curve segment, the triple (L, start heading, C) of the paper.

    Attributes:
        length: L, positive [m].
        heading: heading at s = 0 [rad].
        curvature: C_a..C_e, the curvature at the five knots, shape (5,) [1/m].
        knots: S_b, S_c, S_d with 0 < S_b < S_c < S_d < 1.
        moments: second derivatives of C over arc length at both ends [1/m³]. Zero for the paper's segments, whose
            spline is natural. The parts of a divided segment need them to leave the curve unchanged.
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
        """Power coefficients of the curvature over arc length from the start of each piece, (4, 4)."""
        return piece_coefficients(np.diff(self.breakpoints), np.asarray(self.curvature, dtype=np.float64), self.moments)

    @cached_property
    def spline(self) -> PPoly:
        """Curvature over arc length [1/m]."""
        return curvature_spline(self.coefficients, self.breakpoints)

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """Return the heading θ at arc lengths in [0, L], any shape [rad]; exact, a quartic per piece."""
        return np.asarray(self.heading + self.spline.antiderivative()(arc))

    @cached_property
    def end_heading(self) -> float:
        """Heading θ at the segment's end [rad]."""
        return float(self.heading_at(np.array(self.length)))


_SIGN_SAMPLES = 32
"""Number of intervals per cubic piece of the sampled headings that show the signs of the curvature. Taste."""

_FIRST_ZERO_OF_J0 = 2.404825557695773
"""End angle at which the chord of a modal curve vanishes [rad]."""
SINE = np.array([0.0, 1.0, 0.0, -1.0, 0.0])
"""One full period of the sine at a segment's five knots."""


class SegmentType(StrEnum):
    """The signs of a segment's curvature from the base on; left is counter-clockwise and positive."""

    STRAIGHT = "straight"
    LEFT = "left"
    RIGHT = "right"
    LEFT_RIGHT = "left-right"
    RIGHT_LEFT = "right-left"

    @property
    def mirrored(self) -> "SegmentType":
        """The type of the mirror image, with left and right exchanged."""
        return SegmentType("-".join(_OTHER_SIDE[word] for word in self.value.split("-")))


_OTHER_SIDE = {"straight": "straight", "left": "right", "right": "left"}


def classify(segment: CurvatureSegment, least_turn: float = 1e-3) -> SegmentType:
    """Return the type of a segment from the signs of its curvature.

    Args:
        segment: the segment.
        least_turn: a stretch of one sign counts if it turns the heading by more than this [rad].

    Raises:
        ProblemError: the curvature changes sign more than once; the segment must be divided first.
    """
    arc = np.unique(np.linspace(segment.breakpoints[:-1], segment.breakpoints[1:], _SIGN_SAMPLES + 1))
    heading = segment.heading_at(arc)
    turning = heading[np.concatenate(([0], _extrema(heading), [len(arc) - 1]))]
    turns = np.diff(turning)
    signs = np.sign(turns[np.abs(turns) > least_turn]).astype(int)
    stretches = [int(sign) for k, sign in enumerate(signs) if k == 0 or sign != signs[k - 1]]
    name = "-".join("left" if sign > 0 else "right" for sign in stretches) or "straight"
    if len(stretches) > 2:
        raise ProblemError(
            f"a segment type has at most one inflection, this curvature has {len(stretches) - 1} ({name}); "
            "divide the segment at an inflection first"
        )
    return SegmentType(name)


def segment_words(segment: CurvatureSegment) -> str:
    """Return the type of a segment in words, or "several inflections", for which the paper has no type."""
    try:
        return str(classify(segment))
    except ProblemError:
        return "several inflections"


def select_segment_type(
    base: FloatArray,
    base_heading: float | None,
    tip: FloatArray,
    tip_heading: float | None,
    tolerance: float = 1e-6,
) -> SegmentType:
    """Return the simplest type that joins two poses, without simulating any curve (section 2.1).

    With the chord from base to tip let α be the turn from the base's tangent to the chord and β the turn from the
    chord to the tip's tangent, both in [-π, π). By the mean value theorem the chord's direction is a weighted mean of
    the curve's headings, so while the headings span less than π a curve of one sign has α and β of that sign, and
    opposite signs of α and β prove an inflection: α > 0 > β is left-right. Where one of the two vanishes but not the
    other the curve must leave the chord and come back, so it too has an inflection. A free end heading takes the
    value of a circular arc, α = β.

    A pose with α and β of one sign can also be reached with an inflection; the simpler type is returned.

    Args:
        base: position of the base, shape (2,) [m].
        base_heading: heading at the base [rad], or None if the base may turn.
        tip: position of the tip, shape (2,) [m]; different from the base.
        tip_heading: heading at the tip [rad], or None if any heading will do.
        tolerance: angles below it count as zero [rad].
    """
    chord = np.asarray(tip, dtype=np.float64) - np.asarray(base, dtype=np.float64)
    direction = vector_heading(chord)
    alpha = None if base_heading is None else wrap(direction - base_heading)
    beta = None if tip_heading is None else wrap(tip_heading - direction)
    # A free end takes the turn of the other end, as on a circular arc; with both ends free the line is straight.
    if alpha is None:
        alpha = beta or 0.0
    if beta is None:
        beta = alpha
    first = _sign(alpha, tolerance)
    last = _sign(beta, tolerance)
    if first == last:
        return {0: SegmentType.STRAIGHT, 1: SegmentType.LEFT, -1: SegmentType.RIGHT}[first]
    return SegmentType.LEFT_RIGHT if first > last else SegmentType.RIGHT_LEFT


def natural_segment(kind: SegmentType, base: FloatArray, tip: FloatArray, length: float) -> CurvatureSegment:
    """Return an initial curve of a given type and length from base towards tip; the base turns to aim it.

    One-signed types are the circular arc: end angles a with sin(a)/a = chord/L and curvature ±2a/L. Types with an
    inflection are the modal curve θ = a (1 - cos 2πs), whose chord is L·J₀(a) long and makes the angle a with its ends
    (Chirikjian and Burdick): curvature ±(2πa/L) sin 2πs. Neither takes the end headings into account; hill climbing or
    the NLP does. The straight type has zero curvature, whatever the length.

    Args:
        kind: the type.
        base: position of the base, shape (2,) [m].
        tip: position of the tip, shape (2,) [m]; no farther away than ``length``.
        length: L [m].

    Returns:
        A segment whose chord points at the tip, exactly for straight and arc, to spline accuracy otherwise.

    Raises:
        ProblemError: the tip is farther than the length.
    """
    chord = np.asarray(tip, dtype=np.float64) - np.asarray(base, dtype=np.float64)
    direction = vector_heading(chord)
    ratio = float(np.hypot(*chord)) / length
    if ratio > 1.0 + 1e-9:
        raise ProblemError(f"a segment of {length:g} m cannot span {ratio * length:g} m; give it more length")
    # A chord that exceeds the length by rounding counts as straight.
    amplitude = end_angle(kind, min(ratio, 1.0))
    sign = 1.0 if kind in {SegmentType.LEFT, SegmentType.LEFT_RIGHT} else -1.0
    shape = np.full(5, 2.0) if kind in {SegmentType.LEFT, SegmentType.RIGHT} else 2.0 * np.pi * SINE
    return CurvatureSegment(length, direction - sign * amplitude, sign * amplitude / length * shape)


def end_angle(kind: SegmentType, ratio: float) -> float:
    """Return the angle between the ends and the chord of a natural segment [rad], from chord / length in [0, 1]."""
    if kind is SegmentType.STRAIGHT or ratio >= 1.0:
        return 0.0
    if kind in {SegmentType.LEFT, SegmentType.RIGHT}:
        return float(brentq(lambda a: np.sinc(a / np.pi) - ratio, 0.0, np.pi))
    return float(brentq(lambda a: j0(a) - ratio, 0.0, _FIRST_ZERO_OF_J0))


def _sign(angle: float, tolerance: float) -> int:
    return 0 if abs(angle) <= tolerance else (1 if angle > 0 else -1)


def _extrema(heading: FloatArray) -> IntArray:
    """Return the indices of the local extrema of a sampled heading, where the curvature changes sign."""
    slope = np.sign(np.diff(heading))
    return np.flatnonzero(slope[1:] * slope[:-1] < 0) + 1
