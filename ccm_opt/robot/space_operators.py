"""The curvature operators in space (section 2.1): move an interpolation point, slide a knot, rotate the base."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.rigid_motions import across, turned_towards
from ccm_opt.robot.space_configuration import Moments, SpaceConfiguration


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
