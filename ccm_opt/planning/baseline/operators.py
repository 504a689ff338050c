"""The curvature operators of the 1990 paper (section 2.1), and batches of candidate moves for hill climbing."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES, POWERS, CurvatureSegment

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Nodes and weights of Gauss quadrature on a piece of a curvature spline."""


@dataclass(frozen=True)
class Shapes:
    """Batch of m backbone curves with one common base position and equal numbers of curvature segments.

    Attributes:
        base: position of the base, shape (2,) [m].
        heading: headings at the base, shape (m,) [rad].
        lengths: lengths of the segments, shape (m, segments) [m].
        curvature: curvatures C_a..C_e of the segments, shape (m, segments, 5) [1/m].
        knots: relative arc lengths S_b..S_d of the inner interpolation points, shape (m, segments, 3).
        moments: second derivatives of the curvature C at the ends of the segments, shape (m, segments, 2) [1/m³].
    """

    base: FloatArray
    heading: FloatArray
    lengths: FloatArray
    curvature: FloatArray
    knots: FloatArray
    moments: FloatArray

    @classmethod
    def from_configurations(cls, configurations: Sequence[Configuration]) -> "Shapes":
        """Return configurations with equal numbers of segments and a common base position as one batch."""
        chains = [c.segments for c in configurations]
        return cls(
            configurations[0].base,
            np.array([c.base_heading for c in configurations]),
            np.array([[s.length for s in chain] for chain in chains]),
            np.array([[s.curvature for s in chain] for chain in chains], dtype=np.float64),
            np.array([[s.knots for s in chain] for chain in chains]),
            np.array([[s.moments for s in chain] for chain in chains]),
        )

    def __len__(self) -> int:
        return len(self.heading)

    def configuration(self, k: int) -> Configuration:
        """Return configuration k of the batch."""
        segments: list[CurvatureSegment] = []
        heading = float(self.heading[k])
        for j in range(self.lengths.shape[1]):
            b, c, d = (float(knot) for knot in self.knots[k, j])
            first, last = (float(moment) for moment in self.moments[k, j])
            segment = CurvatureSegment(
                float(self.lengths[k, j]), heading, self.curvature[k, j].copy(), (b, c, d), (first, last)
            )
            segments.append(segment)
            heading = segment.end_heading
        return Configuration(self.base, tuple(segments))

    def take(self, which: IntArray) -> "Shapes":
        """Return a batch of the configurations with given indices, in the order of the indices."""
        return Shapes(
            self.base,
            self.heading[which],
            self.lengths[which],
            self.curvature[which],
            self.knots[which],
            self.moments[which],
        )

    def first_segments(self, count: int) -> "Shapes":
        """Return the first ``count`` segments of every configuration, as a batch."""
        return Shapes(
            self.base,
            self.heading,
            self.lengths[:, :count],
            self.curvature[:, :count],
            self.knots[:, :count],
            self.moments[:, :count],
        )

    @cached_property
    def length(self) -> FloatArray:
        """Total lengths of the m curves, shape (m,) [m]."""
        total: FloatArray = self.lengths.sum(axis=1)
        return total

    @cached_property
    def tips(self) -> tuple[FloatArray, FloatArray]:
        """Positions, shape (m, 2) [m], and headings, shape (m,) [rad], of the tips of the m curves."""
        t = self._widths[..., None] * (0.5 * (_NODES + 1.0))
        c = self._coefficients[:, :, None] / POWERS
        inside = t * (c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3])))
        headings = inside + (self.heading[:, None] + self._turned[:, :-1])[..., None]
        # Headings have closed forms; only the positions need quadrature.
        weights = 0.5 * self._widths[..., None] * _WEIGHTS
        steps = np.stack(((np.cos(headings) * weights).sum((1, 2)), (np.sin(headings) * weights).sum((1, 2))), axis=1)
        return self.base + steps, self.heading + self._turned[:, -1]

    def points(self, count: int) -> FloatArray:
        """Return points at equal arc lengths on the m curves, from base to tip, shape (m, count + 1, 2) [m].

        The points are approximate: sums of chords in the direction of mean headings.
        """
        step = (self.length / count)[:, None, None]
        chords = step * unit_vector(self.mean_headings(count))
        start = np.zeros((len(self), 1, 2))
        points: FloatArray = self.base + np.concatenate((start, np.cumsum(chords, axis=1)), axis=1)
        return points

    def mean_headings(self, links: int) -> FloatArray:
        """Return the exact mean headings on ``links`` equal pieces of each of the m curves, shape (m, links) [rad]."""
        arc = np.linspace(0.0, 1.0, links + 1) * self.length[:, None]
        integral = self._heading_integral(arc)
        means: FloatArray = np.diff(integral, axis=1) * (links / self.length[:, None])
        return means

    @cached_property
    def _widths(self) -> FloatArray:
        """Lengths of the pieces of the curvature splines, shape (m, 4 segments) [m]."""
        edge = np.zeros((*self.lengths.shape, 1))
        shares = np.diff(np.concatenate((edge, self.knots, edge + 1.0), axis=2), axis=2)
        return (shares * self.lengths[..., None]).reshape(len(self), -1)

    @cached_property
    def _breaks(self) -> FloatArray:
        """Arc lengths at which the pieces of the curvature splines begin, shape (m, 4 segments) [m]."""
        return np.cumsum(self._widths, axis=1) - self._widths

    @cached_property
    def _coefficients(self) -> FloatArray:
        """Coefficients of the cubic polynomials of curvature on the pieces of the splines, shape (m, 4 segments, 4)."""
        a = self._widths.reshape(*self.lengths.shape, PIECES)
        moments = self._second_derivatives(a)
        left = moments[..., :-1]
        right = moments[..., 1:]
        values = self.curvature
        linear = np.diff(values, axis=2) / a - a * (2.0 * left + right) / 6.0
        pieces = np.stack((values[..., :-1], linear, 0.5 * left, (right - left) / (6.0 * a)), axis=-1)
        return pieces.reshape(len(self), -1, 4)

    def _second_derivatives(self, a: FloatArray) -> FloatArray:
        """Return the second derivatives M_0..M_4 of cubic splines at all knots, shape (m, segments, 5) [1/m³].

        A 3 × 3 system is solved for each segment; M_0 and M_4 are given.

        Args:
            a: lengths of the pieces, shape (m, segments, 4) [m].
        """
        slopes = np.diff(self.curvature, axis=2) / a
        rows = 6.0 * np.diff(slopes, axis=2)
        ends = self.moments
        middle = 2.0 * (a[..., :-1] + a[..., 1:])
        r0 = rows[..., 0] - a[..., 0] * ends[..., 0]
        r1 = rows[..., 1]
        r2 = rows[..., 2] - a[..., 3] * ends[..., 1]
        # Eliminate the outer unknowns from the middle row, then substitute back.
        f0 = a[..., 1] / middle[..., 0]
        f2 = a[..., 2] / middle[..., 2]
        m1 = (r1 - f0 * r0 - f2 * r2) / (middle[..., 1] - f0 * a[..., 1] - f2 * a[..., 2])
        m0 = (r0 - a[..., 1] * m1) / middle[..., 0]
        m2 = (r2 - a[..., 2] * m1) / middle[..., 2]
        return np.stack((ends[..., 0], m0, m1, m2, ends[..., 1]), axis=-1)

    @cached_property
    def _turned(self) -> FloatArray:
        """Changes of heading from base to the start of each piece and to the tip, shape (m, 4 segments + 1) [rad]."""
        turns = (self._coefficients * self._widths[..., None] ** POWERS / POWERS).sum(axis=2)
        return np.concatenate((np.zeros((len(self), 1)), np.cumsum(turns, axis=1)), axis=1)

    def _heading_integral(self, arc: FloatArray) -> FloatArray:
        """Return the integrals of the heading from the base to given arc lengths, shape (m, k) [rad m].

        Args:
            arc: arc lengths on the m curves, shape (m, k) [m].
        """
        piece = np.zeros(arc.shape, dtype=np.intp)
        for k in range(1, self._breaks.shape[1]):
            # The number of breaks below an arc length is the index of its piece; counted in all rows at once.
            piece += arc > self._breaks[:, k, None]
        row = np.arange(len(self))[:, None]
        t = arc - self._breaks[row, piece]
        c0, c1, c2, c3 = (c[row, piece] for c in np.moveaxis(self._coefficients / (POWERS * (POWERS + 1)), 2, 0))
        start = self._turned[row, piece] + self.heading[:, None]
        bends = t * (c0 + t * (c1 + t * (c2 + t * c3)))
        integral: FloatArray = self._integrals[row, piece] + t * (start + bends)
        return integral

    @cached_property
    def _integrals(self) -> FloatArray:
        """Integrals of the heading from the base to the start of each piece, shape (m, 4 segments) [rad m]."""
        a = self._widths
        bends = (self._coefficients * a[..., None] ** (POWERS + 1) / (POWERS * (POWERS + 1))).sum(axis=2)
        pieces = (self._turned[:, :-1] + self.heading[:, None]) * a + bends
        integrals: FloatArray = np.cumsum(pieces, axis=1) - pieces
        return integrals


class Operator(StrEnum):
    """Operators of a hill climb, each named after the coordinate of a backbone curve that it raises or lowers."""

    C_A = "C_a"
    C_B = "C_b"
    C_C = "C_c"
    C_D = "C_d"
    C_E = "C_e"
    S_B = "S_b"
    S_C = "S_c"
    S_D = "S_d"
    ROTATE = "rotate"
    LENGTH = "length"


UP_AND_DOWN = (Operator.C_A, Operator.C_B, Operator.C_C, Operator.C_D, Operator.C_E)
LEFT_AND_RIGHT = (Operator.S_B, Operator.S_C, Operator.S_D)
ALL = (*UP_AND_DOWN, *LEFT_AND_RIGHT, Operator.ROTATE)
"""The nine operators of the paper. ``LENGTH`` is not among them, since the length of the arm is fixed; only SCM-4 uses
it to choose the length of a segment."""


@dataclass(frozen=True)
class StepSizes:
    """Maximum step sizes of the operators of a hill climb, and the scales of smaller steps tried in addition.

    The step size adapts in every move, since all scales are evaluated in one batch and the best is taken. The step
    sizes are a choice of this package; the paper does not specify any.

    Attributes:
        least_spacing: minimum distance of interpolation points from each other and from the ends, as a fraction of the
            segment's length. Points that are already closer, as in a part of a divided segment, need not move apart.
        turn: change of a curvature C times the length of the segment [rad].
        slide: change of a relative arc length S.
        rotation: rotation of the base [rad].
        stretch: relative change of a segment's length.
        scales: decreasing factors on all step sizes.
    """

    least_spacing: float = 0.08
    turn: float = 0.6
    slide: float = 0.04
    rotation: float = 0.15
    stretch: float = 0.05
    scales: tuple[float, ...] = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)


@dataclass(frozen=True)
class Moves:
    """Operators that generate the candidate moves of a hill climb, and the curvature segments that may change.

    Attributes:
        segments: indices of the segments; base rotation does not depend on them.
        operators: operators in the order of the candidates, which breaks ties.
        sizes: step sizes.
    """

    segments: tuple[int, ...] = (0,)
    operators: tuple[Operator, ...] = ALL
    sizes: StepSizes = StepSizes()

    def candidates(self, here: Shapes) -> Shapes:
        """Return a batch of all valid configurations that differ from a given one by one operator step.

        Each operator is applied in both directions and at every scale; configurations with interpolation points too
        close together are left out.

        Args:
            here: the given configuration, a batch of one.
        """
        scales = np.asarray(self.sizes.scales)
        signed = np.stack((scales, -scales), axis=1).ravel()
        pairs: list[tuple[Operator, int]] = [
            (o, k) for k in self.segments for o in self.operators if o is not Operator.ROTATE
        ]
        if Operator.ROTATE in self.operators:
            pairs.append((Operator.ROTATE, 0))  # the base has no segment
        many = here.take(np.zeros(len(pairs) * len(signed), dtype=np.intp))
        least = min(self.sizes.least_spacing, float(_spacing(many.knots[-1:, self.segments])[0])) * (1.0 - 1e-9)
        # Block k of the batch is for pair k: all its scales, both ways.
        for k, (operator, segment) in enumerate(pairs):
            _apply(many, slice(k * len(signed), (k + 1) * len(signed)), operator, segment, signed, self.sizes)
        return many.take(np.flatnonzero(_spacing(many.knots[:, self.segments]) >= least))


def _apply(many: Shapes, rows: slice, operator: Operator, segment: int, signed: FloatArray, sizes: StepSizes) -> None:
    """Apply one operator to a range of configurations of a batch, in place.

    Args:
        many: the batch.
        rows: the range, a slice of the indices of its configurations.
        operator: the operator.
        segment: index of the segment that changes; ignored for base rotation.
        signed: signed scales of the steps, one for each configuration of the range.
        sizes: step sizes at scale 1.
    """
    if operator in UP_AND_DOWN:
        lengths = many.lengths[rows, segment]
        many.curvature[rows, segment, UP_AND_DOWN.index(operator)] += signed * sizes.turn / lengths
    elif operator in LEFT_AND_RIGHT:
        many.knots[rows, segment, LEFT_AND_RIGHT.index(operator)] += signed * sizes.slide
    elif operator is Operator.ROTATE:
        many.heading[rows] += signed * sizes.rotation
    else:
        many.lengths[rows, segment] *= 1.0 + signed * sizes.stretch


def _spacing(knots: FloatArray) -> FloatArray:
    """Return the minimum distances of S_b, S_c and S_d from each other and from 0 and 1, over all segments, shape (m,).

    Args:
        knots: relative arc lengths S_b..S_d of m configurations, shape (m, segments, 3).
    """
    edge = np.zeros((*knots.shape[:2], 1))
    gaps = np.diff(np.concatenate((edge, knots, edge + 1.0), axis=2), axis=2)
    least: FloatArray = gaps.min(axis=(1, 2))
    return least
