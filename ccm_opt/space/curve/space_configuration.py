"""A configuration of the continuous manipulator in space: a base and a chain of curvature segments."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import EVEN_KNOTS, Knots
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.curve.space_segment import NO_MOMENTS, Moments, SpaceSegment


@dataclass(frozen=True)
class SpaceConfiguration:
    """Curvature segments end to end; place and frame are continuous across them.

    Attributes:
        base: position of the base, shape (3,) [m].
        segments: at least one; each starts with the frame with which the one before ends.
    """

    base: FloatArray
    segments: tuple[SpaceSegment, ...]

    @classmethod
    def chain(
        cls,
        base: FloatArray,
        frame: FloatArray,
        lengths: Sequence[float],
        curvatures: Sequence[FloatArray],
        knots: Sequence[Knots] | None = None,
        moments: Sequence[Moments] | None = None,
    ) -> "SpaceConfiguration":
        """Join segments end to end from a base frame; the frames of the others follow.

        Args:
            base: shape (3,) [m].
            frame: (t, n1, n2) at the base as columns, shape (3, 3).
            lengths: of the segments [m].
            curvatures: five pairs a segment, each of shape (5, 2) [1/m].
            knots: three a segment; even knots when None.
            moments: at the ends of each segment; none, those of natural splines, when None.
        """
        segments: list[SpaceSegment] = []
        for k, (length, curvature) in enumerate(zip(lengths, curvatures, strict=True)):
            inner = knots[k] if knots else EVEN_KNOTS
            ends = moments[k] if moments else NO_MOMENTS
            segment = SpaceSegment(float(length), frame, np.asarray(curvature, dtype=np.float64), inner, ends)
            segments.append(segment)
            frame = segment.end[0]
        return cls(np.asarray(base, dtype=np.float64), tuple(segments))

    @classmethod
    def from_plane(cls, curve: Configuration, base: FloatArray, rotation: FloatArray) -> "SpaceConfiguration":
        """A curve of the plane, laid into space: its x along the first column of a rotation, its y along the second.

        Args:
            curve: with natural segments or parts of divided ones.
            base: where the plane's base comes to lie, shape (3,) [m].
            rotation: shape (3, 3).
        """
        segments = []
        for segment in curve.segments:
            c = np.cos(segment.heading)
            s = np.sin(segment.heading)
            frame = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            values = np.column_stack((segment.curvature, np.zeros(5)))
            moments = (segment.moments, (0.0, 0.0))
            segments.append(SpaceSegment(segment.length, frame, values, segment.knots, moments))
        return cls(np.asarray(base, dtype=np.float64), tuple(segments))

    @cached_property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries, 0 first and L last, shape (segments + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum([segment.length for segment in self.segments])))

    @cached_property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of all knots and boundaries, increasing, 0 first and L last [m]."""
        pairs = zip(self.boundaries[:-1], self.segments, strict=True)
        inner = np.concatenate([start + segment.breakpoints[:-1] for start, segment in pairs])
        return np.append(inner, self.boundaries[-1])

    @property
    def length(self) -> float:
        """Total length L [m]."""
        return float(self.boundaries[-1])

    @property
    def base_frame(self) -> FloatArray:
        """(t, n1, n2) at the base as columns, shape (3, 3)."""
        return self.segments[0].frame

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """κ1 and κ2 at increasing arc lengths in [0, L], shape (m,) to (m, 2) [1/m]."""
        return np.concatenate([part.curvature_at(inside) for part, inside in self._parts(arc)])

    def frames_at(self, arc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames and positions at increasing arc lengths in [0, L], of shape (m,) [m].

        Returns:
            Rotations with columns t, n1, n2, shape (m, 3, 3), and positions, shape (m, 3) [m].
        """
        found = [part.frames_at(inside) for part, inside in self._parts(arc)]
        places = [start + place for start, (_, place) in zip(self._starts, found, strict=True)]
        return np.concatenate([frames for frames, _ in found]), np.concatenate(places)

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Positions at increasing arc lengths in [0, L], shape (m, 3) [m]."""
        return self.frames_at(arc)[1]

    @cached_property
    def tip(self) -> tuple[FloatArray, FloatArray]:
        """Position (3,) [m] and direction (3,) of the tip."""
        last = self.segments[-1]
        return self._starts[-1] + last.end[1], last.end[0][:, 0]

    @cached_property
    def _starts(self) -> FloatArray:
        """Where every segment begins, shape (segments, 3) [m]."""
        moved = np.array([segment.end[1] for segment in self.segments[:-1]]).reshape(-1, 3)
        return np.asarray(self.base + np.concatenate((np.zeros((1, 3)), np.cumsum(moved, axis=0))))

    def _parts(self, arc: FloatArray) -> list[tuple[SpaceSegment, FloatArray]]:
        """Every segment with the arc lengths that lie on it, from its own beginning."""
        arc = np.asarray(arc, dtype=np.float64)
        cuts = np.searchsorted(arc, self.boundaries[1:-1])
        inside = np.split(arc, cuts)
        return [
            (segment, np.clip(part - start, 0.0, segment.length))
            for segment, part, start in zip(self.segments, inside, self.boundaries[:-1], strict=True)
        ]
