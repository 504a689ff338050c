"""Curves made of curvature segments, in the plane and in space: their positions, directions and tips.

In space the curve is t' = κ1 n1 + κ2 n2, n_i' = −κ_i t, where the frame (t, n1, n2) does not turn about the curve
(Bishop, "There is more than one way to frame a curve", 1975). Unlike the Frenet frame, it has no singularity where the
curve is straight. The curves in the plane of t and n1 have κ2 = 0, and there the curve is the paper's (section 2.1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.interpolate import PPoly

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.rigid_motions import carried, chained
from ccm_opt.robot.segment import EVEN_KNOTS, CurvatureSegment, Knots, curvature_spline

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Gauss-Legendre nodes and weights on [-1, 1] for positions, and for means over a link. Directions are smooth except at
spline knots, where their third derivative jumps."""
_MAGNUS_NODES = np.polynomial.legendre.leggauss(3)[0]
"""Gauss-Legendre nodes on [-1, 1] of one step of the Magnus integration of a curve in space."""
MAX_TURN_STEP = 0.4
"""Largest total turn in a quadrature interval [rad]; the error of 8 Gauss points is then below 1e-12 of its length."""
MOST_TURN = 0.05
"""Largest turn of a curve in space in one integration step [rad]; the error of the sixth-order step is then below
1e-12."""
LEAST_STEPS = 40
"""Minimum number of steps per segment in space, so that the curvature changes little within one step."""
_PROBES = 5
"""Number of arc lengths per interval at which the curvature is sampled to choose the step size."""


def integrate_positions(
    heading_at: Callable[[FloatArray], FloatArray], arc: FloatArray, knots: FloatArray
) -> FloatArray:
    """Return the positions on a planar curve relative to its base, ∫ (cos θ, sin θ) ds, by Gauss-Legendre quadrature.

    Args:
        heading_at: heading θ of the curve as a function of arc length [rad].
        arc: arc lengths of the positions, increasing, shape (m,) [m].
        knots: arc lengths of the knots of the curvature spline, increasing [m]; no quadrature interval contains one.

    Returns:
        Shape (m, 2) [m].
    """
    fine = _refine(heading_at, np.unique(np.concatenate((knots, arc))))
    half = 0.5 * np.diff(fine)
    theta = heading_at(half[:, None] * (_NODES + 1.0) + fine[:-1, None])
    steps = half[:, None] * np.stack((np.cos(theta) @ _WEIGHTS, np.sin(theta) @ _WEIGHTS), axis=1)
    positions = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return positions[np.searchsorted(fine, arc)]


def _refine(heading_at: Callable[[FloatArray], FloatArray], edges: FloatArray) -> FloatArray:
    """Return increasing arc lengths refined until a planar curve turns by at most ``MAX_TURN_STEP`` between two.

    Args:
        heading_at: heading of the curve as a function of arc length [rad].
        edges: arc lengths, increasing [m]; all are kept.
    """
    probes = heading_at(np.linspace(0.0, 1.0, 9)[:, None] * np.diff(edges) + edges[:-1])
    # The heading is a quartic between knots: nine probes capture almost all of its total turn.
    turns = np.abs(np.diff(probes, axis=0)).sum(axis=0)
    pieces = np.maximum(1, np.ceil(turns / MAX_TURN_STEP)).astype(np.intp)
    return _parted(edges, pieces)


def _parted(edges: FloatArray, counts: IntArray) -> FloatArray:
    """Return ``edges`` with each of their m intervals divided into ``counts`` equal parts, one count per interval."""
    first = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(counts.sum()) - first) / np.repeat(counts, counts)
    return np.append(np.repeat(edges[:-1], counts) + share * np.repeat(np.diff(edges), counts), edges[-1])


class Curve(Protocol):
    """Interface of curves: curvature segments joined end to end, in the plane or in space."""

    @property
    def base(self) -> FloatArray:
        """Position of the base, shape (d,) [m]."""

    @property
    def segments(self) -> Sequence[Any]:
        """The curvature segments, at least one, with their lengths, knots and curvatures."""

    @property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries from 0 to L, shape (segments + 1,) [m]."""

    @property
    def length(self) -> float:
        """Total length L of the curve [m]."""

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Return the positions, shape (m, d) [m], at increasing arc lengths in [0, L], shape (m,) [m]."""

    def mean_directions(self, links: int, lengths: FloatArray | None = None) -> FloatArray:
        """Divide the curve into ``links`` pieces and return the mean direction over each, shape (links, d).

        The pieces have equal lengths or, if ``lengths`` are given, lengths in their proportion.
        """


def link_edges(length: float, links: int, lengths: FloatArray | None) -> FloatArray:
    """Return the arc lengths of the ends of ``links`` pieces of a curve, from 0 to ``length``, shape (links + 1,).

    The pieces have equal lengths or, if ``lengths`` are given, lengths in their proportion.
    """
    if lengths is None:
        return np.linspace(0.0, length, links + 1)
    edges = np.concatenate(([0.0], np.cumsum(lengths)))
    return np.asarray(np.minimum(edges * (length / edges[-1]), length))


@dataclass(frozen=True)
class Configuration:
    """Curvature segments joined end to end in the plane, with continuous position and heading.

    Attributes:
        base: position of the base, shape (2,) [m].
        segments: at least one segment; each starts at the heading at which the previous one ends.
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
        """Return the planar curve of given segments joined end to end; headings are continuous at the joints.

        Args:
            base: position of the base, shape (2,) [m].
            heading: heading at the base [rad].
            lengths: length of each segment [m].
            curvatures: curvature at the five knots of each segment, arrays of shape (5,) [1/m].
            knots: three inner knots of each segment as fractions of its length; evenly spaced if None.
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

    @cached_property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries, 0 first and L last, shape (segments + 1,) [m]."""
        return np.concatenate(([0.0], np.cumsum([segment.length for segment in self.segments])))

    @cached_property
    def breakpoints(self) -> FloatArray:
        """Arc lengths of all spline knots and segment boundaries, increasing from 0 to L [m]."""
        knots = [start + s.breakpoints[:-1] for start, s in zip(self.boundaries[:-1], self.segments, strict=True)]
        return np.append(np.concatenate(knots), self.boundaries[-1])

    @property
    def length(self) -> float:
        """Total length L [m]."""
        return float(self.boundaries[-1])

    @cached_property
    def spline(self) -> PPoly:
        """Curvature of the curve as a function of arc length [1/m], a piecewise cubic."""
        return curvature_spline(np.concatenate([segment.coefficients for segment in self.segments]), self.breakpoints)

    @cached_property
    def _turns(self) -> PPoly:
        """Turn of the heading from the base, ∫ κ ds, as a function of arc length [rad]."""
        return self.spline.antiderivative()

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """Return the curvature at arc lengths in [0, L], in the shape of ``arc`` [1/m]."""
        return np.asarray(self.spline(arc))

    def heading_at(self, arc: FloatArray) -> FloatArray:
        """Return the exact heading at arc lengths in [0, L], in the shape of ``arc`` [rad]."""
        return np.asarray(self.base_heading + self._turns(arc))

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Return the positions at increasing arc lengths in [0, L], shape (len(arc), 2) [m].

        The positions are integrated by Gauss-Legendre quadrature.
        """
        return self.base + integrate_positions(self.heading_at, np.asarray(arc, dtype=np.float64), self.breakpoints)

    def heading_integral_at(self, arc: FloatArray) -> FloatArray:
        """Return the exact integral of the heading over arc length from 0 to ``arc``, in its shape [rad m]."""
        return np.asarray(self.base_heading * arc + self._turns.antiderivative()(arc))

    def mean_headings(self, links: int, lengths: FloatArray | None = None) -> FloatArray:
        """Divide the curve into ``links`` pieces and return the exact mean heading over each, shape (links,) [rad].

        The pieces have equal lengths or, if ``lengths`` are given, lengths in their proportion.
        """
        integrals = np.diff(self.heading_integral_at(link_edges(self.length, links, lengths)))
        if lengths is None:
            return np.asarray(integrals * (links / self.length))
        return np.asarray(integrals * (np.sum(lengths) / (lengths * self.length)))

    def mean_directions(self, links: int, lengths: FloatArray | None = None) -> FloatArray:
        """Return the unit vectors of the mean headings, shape (links, 2)."""
        return unit_vector(self.mean_headings(links, lengths))

    @cached_property
    def tip(self) -> tuple[FloatArray, float]:
        """Position of the tip, shape (2,) [m], and heading of the tip [rad]."""
        return self.positions_at(np.array([self.length]))[0], self.segments[-1].end_heading


class SpaceSegment(NamedTuple):
    """A segment of a curve in space.

    Attributes:
        length: L, positive [m].
        curvature: curvatures κ1 and κ2 at the five knots, shape (5, 2) [1/m].
        knots: the three inner knots as fractions of the length, increasing between 0 and 1.
    """

    length: float
    curvature: FloatArray
    knots: Knots


@dataclass(frozen=True)
class SpaceConfiguration:
    """Curvature segments joined end to end in space, with continuous position and frame.

    Attributes:
        base: position of the base, shape (3,) [m].
        base_frame: (t, n1, n2) at the base as columns, a rotation, shape (3, 3).
        turns: two planar curves whose curvatures are κ1 and κ2, so that their headings are ∫ κ1 ds and ∫ κ2 ds.
    """

    base: FloatArray
    base_frame: FloatArray
    turns: tuple[Configuration, Configuration]

    def __post_init__(self) -> None:
        if np.shape(self.base_frame) != (3, 3):
            raise ValueError(f"a curve in space starts with a frame of shape (3, 3), got {np.shape(self.base_frame)}")

    @classmethod
    def chain(
        cls,
        base: FloatArray,
        frame: FloatArray,
        lengths: Sequence[float],
        curvatures: Sequence[FloatArray],
        knots: Sequence[Knots] | None = None,
    ) -> "SpaceConfiguration":
        """Return the curve in space of given segments joined end to end, starting with a given frame.

        Args:
            base: position of the base, shape (3,) [m].
            frame: (t, n1, n2) at the base as columns, shape (3, 3).
            lengths: length of each segment [m].
            curvatures: κ1 and κ2 at the five knots of each segment, arrays of shape (5, 2) [1/m].
            knots: three inner knots of each segment as fractions of its length; evenly spaced if None.

        Raises:
            ValueError: the arguments do not make valid segments.
        """
        for curvature in curvatures:
            if np.shape(curvature) != (5, 2):
                raise ValueError(f"a segment in space has five pairs of curvatures, got shape {np.shape(curvature)}")
        first, second = (
            Configuration.chain(np.zeros(2), 0.0, lengths, [np.asarray(each)[:, side] for each in curvatures], knots)
            for side in (0, 1)
        )
        return cls(np.asarray(base, dtype=np.float64), frame, (first, second))

    @cached_property
    def segments(self) -> tuple[SpaceSegment, ...]:
        """Segments of the curve, from the base to the tip."""
        pairs = zip(*(turn.segments for turn in self.turns), strict=True)
        return tuple(
            SpaceSegment(one.length, np.column_stack((one.curvature, other.curvature)), one.knots)
            for one, other in pairs
        )

    @property
    def boundaries(self) -> FloatArray:
        """Arc lengths of the segment boundaries, 0 first and L last, shape (segments + 1,) [m]."""
        return self.turns[0].boundaries

    @property
    def length(self) -> float:
        """Total length L [m]."""
        return self.turns[0].length

    def curvature_at(self, arc: FloatArray) -> FloatArray:
        """Return the curvatures κ1 and κ2, shape (..., 2) [1/m], at arc lengths in [0, L], shape (...) [m]."""
        return np.stack([turn.curvature_at(arc) for turn in self.turns], axis=-1)

    def sample_frames(self, arc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the frames and positions at increasing arc lengths in [0, L], shape (m,) [m].

        Returns:
            Rotations with columns t, n1, n2, shape (m, 3, 3), and positions, shape (m, 3) [m].
        """
        edges = self._steps(np.unique(np.concatenate((self.turns[0].breakpoints, arc))))
        half = 0.5 * np.diff(edges)
        curvature = self.curvature_at(edges[:-1, None] + half[:, None] * (_MAGNUS_NODES + 1.0))
        twists = np.zeros((*curvature.shape[:-1], 6))
        # κ1 turns t towards n1, that is about n2; κ2 turns t towards n2, that is about −n1. The frame advances along t.
        twists[..., 1] = -curvature[..., 1]
        twists[..., 2] = curvature[..., 0]
        twists[..., 3] = 1.0
        frames, places = chained(self.base_frame, *carried(twists, 2.0 * half))
        at = np.searchsorted(edges, arc)
        return frames[at], self.base + places[at]

    def _steps(self, edges: FloatArray) -> FloatArray:
        """Return increasing arc lengths refined until the curve turns by at most ``MOST_TURN`` between two.

        Every segment has at least ``LEAST_STEPS`` of the intervals. ``edges`` are arc lengths, all of which are kept.
        """
        probes = np.linspace(edges[:-1], edges[1:], _PROBES)
        sharpest = np.linalg.norm(self.curvature_at(probes), axis=-1).max(axis=0)
        # A nearly straight curve may still change its curvature a lot over a long step.
        shortest = min(segment.length for segment in self.turns[0].segments)
        per_step = np.maximum(sharpest / MOST_TURN, LEAST_STEPS / shortest)
        return _parted(edges, np.maximum(1, np.ceil(np.diff(edges) * per_step)).astype(np.intp))

    def positions_at(self, arc: FloatArray) -> FloatArray:
        """Return the positions at increasing arc lengths in [0, L], shape (m, 3) [m]."""
        return self.sample_frames(arc)[1]

    def mean_directions(self, links: int, lengths: FloatArray | None = None) -> FloatArray:
        """Divide the curve into ``links`` pieces and return the mean direction over each, shape (links, 3).

        Within a piece, the rotation vectors from the direction at its midpoint to its other directions are averaged;
        for a curve in a plane the result is the direction of the mean heading.
        """
        edges = link_edges(self.length, links, lengths)
        middles = 0.5 * (edges[:-1] + edges[1:])
        arcs = middles[:, None] + 0.5 * np.diff(edges)[:, None] * np.append(_NODES, 0.0)
        order = np.argsort(arcs.ravel())
        frames = np.empty((links * arcs.shape[1], 3, 3))
        frames[order] = self.sample_frames(arcs.ravel()[order])[0]
        frames = frames.reshape(links, -1, 3, 3)
        middle = frames[:, -1]
        local = np.einsum("nij,nki->nkj", middle, frames[:, :-1, :, 0])
        sideways = np.linalg.norm(local[..., 1:], axis=-1)
        angle = np.arctan2(sideways, local[..., 0])
        turns = local[..., 1:] * (angle / np.maximum(sideways, np.finfo(np.float64).tiny))[..., None]
        mean = 0.5 * np.einsum("k,nkd->nd", _WEIGHTS, turns)
        size = np.linalg.norm(mean, axis=1)
        ahead = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * mean), axis=1)
        return np.asarray(np.einsum("nij,nj->ni", middle, ahead))

    @cached_property
    def tip(self) -> tuple[FloatArray, FloatArray]:
        """Position of the tip, shape (3,) [m], and direction of the tip, a unit vector of shape (3,)."""
        frames, places = self.sample_frames(np.array([self.length]))
        return places[0], frames[0, :, 0]
