"""Curvature segments of planar curves, and their five types with at most one inflection (section 2.1, Figure 2)."""

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
    """Return the second derivatives M of an interpolating cubic spline of four pieces at its five knots.

    Solves a_{i-1} M_{i-1} + 2 (a_{i-1} + a_i) M_i + a_i M_{i+1} = 6 [(C_{i+1} - C_i)/a_i - (C_i - C_{i-1})/a_{i-1}]
    with M_0, M_4 given (de Boor, A Practical Guide to Splines, chapter IV).

    Args:
        widths: distances a_0..a_3 of neighbouring knots, shape (4,).
        values: values C_0..C_4 at the knots, shape (5, ...).
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
    """Return the power coefficients of the four pieces of an interpolating cubic spline with five knots.

    Args:
        widths: distances of neighbouring knots, shape (4,).
        values: values at the knots, shape (5, ...).
        ends: second derivatives at the first and last knot; zero for the natural spline.

    Returns:
        Coefficients of the powers 0 to 3 of the offset from the start of each piece, shape (4 pieces, 4 powers, ...).
    """
    moments = second_derivatives(widths, values, ends)
    a = widths.reshape(-1, *([1] * (values.ndim - 1)))
    left = moments[:-1]
    right = moments[1:]
    linear = np.diff(values, axis=0) / a - a * (2.0 * left + right) / 6.0
    return np.stack((values[:-1], linear, 0.5 * left, (right - left) / (6.0 * a)), axis=1)


def curvature_spline(coefficients: FloatArray, breaks: FloatArray) -> PPoly:
    """Return a piecewise cubic function of arc length.

    Args:
        coefficients: coefficients of the powers 0 to 3 of the arc length from the start of each piece, shape
            (pieces, 4 powers, ...).
        breaks: arc lengths of the ends of the pieces, shape (pieces + 1,) [m].
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
    """A planar curve segment whose curvature is a cubic spline through five knots (paper, section 2.1).

    Attributes:
        length: length L, positive [m].
        heading: heading at the start of the segment [rad].
        curvature: curvature C_a..C_e at the five knots, shape (5,) [1/m].
        knots: the three inner knots as fractions of the length, 0 < S_b < S_c < S_d < 1.
        moments: second derivatives of the curvature with respect to arc length at both ends [1/m³]. Zero for the
            paper's segments, whose spline is natural; the parts of a divided segment need others to keep their shape.
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
        """Arc lengths of the five knots from the start of the segment, shape (5,) [m]."""
        return self.length * np.array([0.0, *self.knots, 1.0])

    @cached_property
    def coefficients(self) -> FloatArray:
        """Coefficients of the four cubic pieces of the curvature, shape (4 pieces, 4 powers).

        The powers 0 to 3 are those of the arc length from the start of the piece.
        """
        return piece_coefficients(np.diff(self.breakpoints), np.asarray(self.curvature, dtype=np.float64), self.moments)

    @cached_property
    def spline(self) -> PPoly:
        """Curvature of the segment as a function of arc length [1/m], a piecewise cubic."""
        return curvature_spline(self.coefficients, self.breakpoints)

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """Return the exact heading at arc lengths in [0, L], in the shape of ``arc`` [rad].

        The heading is a quartic on each piece of the curvature.
        """
        return np.asarray(self.heading + self.spline.antiderivative()(arc))

    @cached_property
    def end_heading(self) -> float:
        """Heading at the end of the segment [rad]."""
        return float(self.heading_at(np.array(self.length)))


_LEAST_TURN = 1e-3
"""Turn of the heading above which a stretch of one sign of the curvature counts [rad]."""
_ROUNDED_TURN = 1e-6
"""Magnitude up to which an angle between two poses counts as zero [rad]."""
_SIGN_SAMPLES = 32
"""Number of intervals per cubic piece between the headings sampled to find the signs of the curvature. Heuristic."""

_FIRST_ZERO_OF_J0 = 2.404825557695773
"""Angle between the ends and the chord of a modal curve at which the length of the chord vanishes [rad]."""
SINE = np.array([0.0, 1.0, 0.0, -1.0, 0.0])
"""Values of one full period of the sine at the five evenly spaced knots of a segment."""


class SegmentType(StrEnum):
    """Signs of the curvature along a segment, from its start to its end; left is counter-clockwise and positive."""

    STRAIGHT = "straight"
    LEFT = "left"
    RIGHT = "right"
    LEFT_RIGHT = "left-right"
    RIGHT_LEFT = "right-left"


def classify(segment: CurvatureSegment) -> SegmentType:
    """Return the type of a curve segment, given by the signs of its curvature.

    Raises:
        ProblemError: the curvature changes sign more than once; the segment must be divided first.
    """
    arc = np.unique(np.linspace(segment.breakpoints[:-1], segment.breakpoints[1:], _SIGN_SAMPLES + 1))
    heading = segment.heading_at(arc)
    turning = heading[np.concatenate(([0], _extrema(heading), [len(arc) - 1]))]
    turns = np.diff(turning)
    signs = np.sign(turns[np.abs(turns) > _LEAST_TURN]).astype(int)
    stretches = [int(sign) for k, sign in enumerate(signs) if k == 0 or sign != signs[k - 1]]
    name = "-".join("left" if sign > 0 else "right" for sign in stretches) or "straight"
    if len(stretches) > 2:
        raise ProblemError(
            f"a segment type has at most one inflection, this curvature has {len(stretches) - 1} ({name}); "
            "divide the segment at an inflection first"
        )
    return SegmentType(name)


def segment_words(segment: CurvatureSegment) -> str:
    """Return the type of a curve segment in words, or "several inflections", for which the paper has no type."""
    try:
        return str(classify(segment))
    except ProblemError:
        return "several inflections"


def select_segment_type(
    base: FloatArray,
    base_heading: float | None,
    tip: FloatArray,
    tip_heading: float | None,
) -> SegmentType:
    """Return the simplest type of curve segment that joins two poses, without computing a curve (section 2.1).

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
        tip_heading: heading at the tip [rad], or None if the tip may have any heading.
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
    first = _sign(alpha)
    last = _sign(beta)
    if first == last:
        return {0: SegmentType.STRAIGHT, 1: SegmentType.LEFT, -1: SegmentType.RIGHT}[first]
    return SegmentType.LEFT_RIGHT if first > last else SegmentType.RIGHT_LEFT


def natural_segment(kind: SegmentType, base: FloatArray, tip: FloatArray, length: float) -> CurvatureSegment:
    """Return a curve segment of a given type and length from a base to a tip, as a start for further optimisation.

    Types of one sign are circular arcs: the angle a between chord and ends solves sin(a)/a = chord/L, and the curvature
    is ±2a/L. Types with an inflection are the modal curve θ = a (1 - cos 2πs), whose chord is L·J₀(a) long and makes
    the angle a with its ends (Chirikjian and Burdick): curvature ±(2πa/L) sin 2πs. The straight type has zero
    curvature for any length. Prescribed end headings are left to the optimisation (hill climbing or NLP).

    Args:
        kind: the type.
        base: position of the base, shape (2,) [m]; the heading there is chosen so that the chord points at the tip.
        tip: position of the tip, shape (2,) [m]; no farther away than ``length``.
        length: length L of the segment [m].

    Returns:
        A segment whose chord points at the tip, exactly for straight and arc, to spline accuracy otherwise.

    Raises:
        ProblemError: the tip is farther away than the length.
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
    """Return the angle between the chord and the ends of an arc or modal curve of a given type [rad].

    Args:
        kind: the type; a straight segment has the angle 0.
        ratio: length of the chord divided by that of the curve, in [0, 1].
    """
    if kind is SegmentType.STRAIGHT or ratio >= 1.0:
        return 0.0
    if kind in {SegmentType.LEFT, SegmentType.RIGHT}:
        return float(brentq(lambda a: np.sinc(a / np.pi) - ratio, 0.0, np.pi))
    return float(brentq(lambda a: j0(a) - ratio, 0.0, _FIRST_ZERO_OF_J0))


def _sign(angle: float) -> int:
    return 0 if abs(angle) <= _ROUNDED_TURN else (1 if angle > 0 else -1)


def _extrema(heading: FloatArray) -> IntArray:
    """Return the indices of the local extrema of a sampled heading, shape (N,), where the curvature changes sign."""
    slope = np.sign(np.diff(heading))
    return np.flatnonzero(slope[1:] * slope[:-1] < 0) + 1
