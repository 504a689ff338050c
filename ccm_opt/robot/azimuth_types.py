"""The paper's types and operators of curves in space (section 2.1, Figure 2).

In the plane a segment with at most one inflection is straight, bends to the left or to the right, or to one side and
then to the other. In space it bends towards an azimuth: straight is none, left and right are the arcs towards ψ = 0 and
ψ = π, left-right and right-left two arcs towards 0 → π and π → 0. The azimuth counts from n1 towards n2, in the frame
that is carried along without turning about the curve; so one family of arcs and one of pairs of arcs hold them all.
They are chosen from end poses alone.

The curvature operators move an interpolation point, slide a knot, or rotate the base.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polyline import wrap
from ccm_opt.robot.biarc import Biarc
from ccm_opt.robot.bishop_curve import Moments, SpaceConfiguration, SpaceSegment
from ccm_opt.robot.rigid_motions import across, polar, transported, turned_towards
from ccm_opt.robot.segment import SegmentType, end_angle

_MOST_AMPLITUDE = 2.4
"""Amplitude of two bows at which they are bent as far as a modal curve whose chord vanishes [rad]."""


@dataclass(frozen=True)
class AzimuthType:
    """Where a segment bends to, base first.

    Attributes:
        azimuths: none where it is straight, one of an arc, two of an arc that follows another [rad].
    """

    azimuths: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """In words."""
        return ("straight", "arc", "two arcs")[len(self.azimuths)]

    def planar(self, tolerance: float = 1e-6) -> SegmentType | None:
        """The type of the plane that it is, or None where it leaves the plane of t and n1.

        Args:
            tolerance: of its azimuths [rad].
        """
        words = []
        for azimuth in self.azimuths:
            if abs(wrap(azimuth)) <= tolerance:
                words.append("left")
            elif abs(wrap(azimuth - np.pi)) <= tolerance:
                words.append("right")
            else:
                return None
        if len(words) == 2 and words[0] == words[1]:
            return None
        return SegmentType("-".join(words) or "straight")


def select_azimuth_type(
    base: FloatArray,
    frame: FloatArray,
    tip: FloatArray,
    direction: FloatArray | None,
    *,
    base_turns: bool = False,
    tolerance: float = 1e-6,
) -> AzimuthType:
    """The simplest type that joins two poses, without simulating any curve (section 2.1).

    Let α be the turn from the base's direction to the chord, and β that from the chord to the tip's direction, both
    with the azimuths to which they go in a carried frame. Where both go to one azimuth an arc does, as in the plane;
    where they do not, or one of them vanishes alone, two arcs do, and their azimuths are those of the biarc.

    Args:
        base: shape (3,) [m].
        frame: (t, n1, n2) at the base as columns, from which azimuths count, shape (3, 3).
        tip: shape (3,) [m]; different from the base.
        direction: of the tip, a unit vector, shape (3,), or None when any will do.
        base_turns: whether the base may turn; then it starts with the direction that an arc asks for.
        tolerance: angles below it count as zero [rad].
    """
    chord = np.asarray(tip, dtype=np.float64) - np.asarray(base, dtype=np.float64)
    alpha, first = polar(frame, chord)
    if direction is None:
        # A free end takes the turn of the other one, as on a circular arc; with both ends free the line is straight.
        return AzimuthType(() if base_turns or alpha <= tolerance else (first,))
    beta, last = polar(transported(frame, chord), direction)
    if base_turns:
        return AzimuthType(() if beta <= tolerance else (last,))
    if alpha <= tolerance and beta <= tolerance:
        return AzimuthType()
    both = alpha > tolerance and beta > tolerance
    if both and abs(wrap(last - first)) <= tolerance:
        return AzimuthType((first,))
    return AzimuthType(_of_biarc(base, frame, tip, direction, first if alpha > tolerance else last + np.pi))


def natural_space_segment(
    kind: AzimuthType, base: FloatArray, frame: FloatArray, tip: FloatArray, length: float
) -> SpaceSegment:
    """A first curve of a given type and length from base towards tip; the base turns to aim it.

    In the plane of its azimuth an arc is a circular arc, and two arcs to opposite sides are the modal curve of the
    plane's types. Of other pairs each half of that curve bends to its own azimuth, with the amplitude that gives the
    chord.

    Args:
        kind: the type.
        base: shape (3,) [m].
        frame: (t, n1, n2) as columns, from which azimuths count; it is turned so that the segment aims at the tip.
        tip: shape (3,) [m]; no farther than ``length``.
        length: L [m].

    Raises:
        ProblemError: the tip is farther than the length, or too near for two bows.
    """
    chord = np.asarray(tip, dtype=np.float64) - np.asarray(base, dtype=np.float64)
    ratio = float(np.linalg.norm(chord)) / length
    if ratio > 1.0 + 1e-9:
        raise ProblemError(f"a segment of {length:g} m cannot span {ratio * length:g} m; give it more length")
    aimed = transported(frame, chord)
    if len(kind.azimuths) == 0:
        return SpaceSegment(length, aimed, np.zeros((5, 2)))
    first = kind.azimuths[0]
    if len(kind.azimuths) == 1:
        amplitude = end_angle(SegmentType.LEFT, min(ratio, 1.0))
        bent = np.tile(2.0 * amplitude / length * across(first), (5, 1))
        return SpaceSegment(length, turned_towards(aimed, first, -amplitude), bent)
    return _two_bows(kind, aimed, chord, length, min(ratio, 1.0))


def _of_biarc(
    base: FloatArray, frame: FloatArray, tip: FloatArray, direction: FloatArray, first: float
) -> tuple[float, float]:
    """Azimuths of both arcs; where there is no biarc, to a side and back."""
    try:
        arcs = Biarc.between(base, frame, tip, direction)
    except ProblemError:
        return first, first + np.pi
    return arcs.first.azimuth, arcs.second.azimuth


def _two_bows(kind: AzimuthType, aimed: FloatArray, chord: FloatArray, length: float, ratio: float) -> SpaceSegment:
    """Half a wave of curvature to each of two azimuths, as high as the chord asks for."""
    shape = np.zeros((5, 2))
    shape[1] = 2.0 * np.pi / length * across(kind.azimuths[0])
    shape[3] = 2.0 * np.pi / length * across(kind.azimuths[1])

    def excess(amplitude: float) -> float:
        return float(np.linalg.norm(SpaceSegment(length, aimed, amplitude * shape).end[1])) / length - ratio

    # Bows to nearly one side close later than those to opposite sides.
    most = next((m for m in (_MOST_AMPLITUDE, 2.0 * _MOST_AMPLITUDE) if excess(m) < 0.0), None)
    if most is None:
        raise ProblemError(
            f"two bows of {length:g} m do not span so little as {ratio * length:g} m; give it less length"
        )
    amplitude = 0.0 if ratio >= 1.0 else float(brentq(excess, 0.0, most))
    bent = SpaceSegment(length, aimed, amplitude * shape)
    # Turned as a whole, so that where it ends comes to lie on the chord.
    reached = bent.end[1]
    axes = transported(np.eye(3), reached), transported(np.eye(3), chord)
    return SpaceSegment(length, axes[1] @ axes[0].T @ bent.frame, amplitude * shape)


@dataclass(frozen=True)
class PointOperator:
    """Moves an interpolation point of both curvatures towards an azimuth: ±C_a .. ±C_e of the plane at 0 and π.

    Attributes:
        segment: which.
        point: 0 to 4 for C_a to C_e.
        azimuth: in the segment's carried frame [rad].
        turn: change of the curvature times the segment's length [rad].
    """

    segment: int
    point: int
    azimuth: float
    turn: float

    def applied(self, curve: SpaceConfiguration) -> SpaceConfiguration:
        """The curve with the point moved."""
        parts = _Parts.of(curve)
        change = self.turn / parts.lengths[self.segment] * across(self.azimuth)
        parts.curvatures[self.segment][self.point] += change
        return parts.chained()


@dataclass(frozen=True)
class KnotOperator:
    """Moves an interpolation point along the curve: ±S_b, ±S_c, ±S_d, of both curvatures at once.

    Attributes:
        segment: which.
        knot: 0 to 2 for S_b to S_d.
        slide: change of S.
    """

    segment: int
    knot: int
    slide: float

    def applied(self, curve: SpaceConfiguration) -> SpaceConfiguration:
        """The curve with the knot moved.

        Raises:
            ValueError: the knots would lie out of their order.
        """
        parts = _Parts.of(curve)
        parts.knots[self.segment][self.knot] += self.slide
        return parts.chained()


@dataclass(frozen=True)
class BaseOperator:
    """Rotates the base towards an azimuth.

    Attributes:
        azimuth: in the base's frame [rad].
        turn: [rad].
    """

    azimuth: float
    turn: float

    def applied(self, curve: SpaceConfiguration) -> SpaceConfiguration:
        """The curve with its base rotated."""
        parts = _Parts.of(curve)
        parts.frame = turned_towards(parts.frame, self.azimuth, self.turn)
        return parts.chained()


SpaceOperator = PointOperator | KnotOperator | BaseOperator


def space_operators(segments: int, turn: float, slide: float, rotation: float) -> Iterator[SpaceOperator]:
    """All operators both ways: towards left, up, right and down, along the curve and back.

    Args:
        segments: number of segments.
        turn: change of a curvature times its segment's length [rad].
        slide: change of a knot's place.
        rotation: of the base [rad].
    """
    azimuths = [0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi]
    for segment in range(segments):
        for azimuth in azimuths:
            yield from (PointOperator(segment, point, azimuth, turn) for point in range(5))
        for sign in (1.0, -1.0):
            yield from (KnotOperator(segment, knot, sign * slide) for knot in range(3))
    yield from (BaseOperator(azimuth, rotation) for azimuth in azimuths)


@dataclass
class _Parts:
    """A curve as what may be changed of it."""

    base: FloatArray
    frame: FloatArray
    lengths: list[float]
    curvatures: list[FloatArray]
    knots: list[list[float]]
    moments: list[Moments]

    @classmethod
    def of(cls, curve: SpaceConfiguration) -> "_Parts":
        segments = curve.segments
        return cls(
            curve.base,
            curve.base_frame,
            [segment.length for segment in segments],
            [segment.curvature.copy() for segment in segments],
            [list(segment.knots) for segment in segments],
            [segment.moments for segment in segments],
        )

    def chained(self) -> SpaceConfiguration:
        knots = [(inner[0], inner[1], inner[2]) for inner in self.knots]
        return SpaceConfiguration.chain(self.base, self.frame, self.lengths, self.curvatures, knots, self.moments)
