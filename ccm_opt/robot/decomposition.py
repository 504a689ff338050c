"""Operations on the segments of a planar curve: add, delete, divide, merge, move a boundary (paper, section 2.2).

Dividing, merging and moving a boundary leave the shape of the curve as it is. The curvature of a curve is a piecewise
cubic over arc length; a segment holds up to four pieces exactly if they join with continuous second derivatives. So a
part of a divided segment keeps the knots inside it, gets further knots without effect up to three inner knots, and
keeps the second derivatives at its ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import ROUNDING, SHORTEST, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES, POWERS, CurvatureSegment, Knots

_FIT_SAMPLES = 65
"""Number of headings used in the least-squares fit of one segment. Heuristic: thirteen per value to be found."""


def add_segment(configuration: Configuration, segment: CurvatureSegment) -> Configuration:
    """Return a planar curve extended by a segment at its tip; the segment is turned to start at the tip's heading."""
    heading = configuration.segments[-1].end_heading
    return Configuration(configuration.base, (*configuration.segments, replace(segment, heading=heading)))


def delete_segment(configuration: Configuration) -> Configuration:
    """Return a planar curve without its last segment.

    Raises:
        ProblemError: the curve has only one segment.
    """
    if len(configuration.segments) == 1:
        raise ProblemError("a configuration has at least one segment; got one, expected two or more to delete from")
    return Configuration(configuration.base, configuration.segments[:-1])


def divide_segment(configuration: Configuration, index: int, fraction: float) -> Configuration:
    """Return a planar curve of unchanged shape with one segment divided in two.

    Args:
        configuration: the curve.
        index: index of the segment to divide.
        fraction: arc length of the division from the segment's start, as a fraction of the segment's length in (0, 1).

    Raises:
        ProblemError: ``fraction`` does not lie inside the segment.
    """
    if not SHORTEST <= fraction <= 1.0 - SHORTEST:
        raise ProblemError(f"a segment is divided between its ends, at a share in (0, 1) of its length; got {fraction}")
    stretch = _Stretch.from_segments((configuration.segments[index],))
    cut = fraction * stretch.length
    parts = stretch.part(0.0, cut).segment(), stretch.part(cut, stretch.length).segment()
    return _replaced(configuration, index, index + 1, parts)


def merge_segments(configuration: Configuration, index: int, tolerance: float = 1e-9) -> Configuration:
    """Return a planar curve with two neighbouring segments merged into one, its shape kept within a tolerance.

    Two segments have up to seven inner knots between them, one has three. If a derivative of the curvature jumps at no
    more than three of the seven, as after a division, the shape is kept exactly; else the headings are fitted by least
    squares with the headings at both ends exact.

    Args:
        configuration: the curve.
        index: index of the first of the two segments.
        tolerance: allowed change of the heading anywhere on them [rad].

    Raises:
        ProblemError: no single segment keeps the shape of the two within the tolerance.
    """
    merged = _joined(configuration, index).fitted(tolerance)
    return _replaced(configuration, index, index + 2, (merged,))


def move_boundary(
    configuration: Configuration,
    index: int,
    length: float,
    tolerance: float = 1e-9,
) -> Configuration:
    """Return a planar curve with the boundary between two neighbouring segments moved along the curve.

    One segment becomes longer, the other shorter; the shape of the curve is kept within a tolerance.

    Args:
        configuration: the curve.
        index: index of the first of the two segments.
        length: new length of the first segment [m].
        tolerance: allowed change of the heading [rad].

    Raises:
        ProblemError: one of the two segments would vanish, or no segment keeps the shape of its part of the curve
            within the tolerance.
    """
    stretch = _joined(configuration, index)
    if not SHORTEST * stretch.length <= length <= (1.0 - SHORTEST) * stretch.length:
        raise ProblemError(f"the two segments share {stretch.length:g} m; got {length:g} m for the first of them")
    first = stretch.part(0.0, length).fitted(tolerance)
    second = replace(stretch.part(length, stretch.length).fitted(tolerance), heading=first.end_heading)
    return _replaced(configuration, index, index + 2, (first, second))


def segment_head(segment: CurvatureSegment, length: float) -> CurvatureSegment:
    """Return the first ``length`` metres of a segment as a new segment of the same shape; at most all of it."""
    if length >= segment.length:
        return segment
    return _Stretch.from_segments((segment,)).part(0.0, length).segment()


def segment_tail(segment: CurvatureSegment, length: float) -> CurvatureSegment:
    """Return the rest of a segment after its first ``length`` metres as a new segment of the same shape."""
    return _Stretch.from_segments((segment,)).part(length, segment.length).segment()


def interpolate(first: Configuration, last: Configuration, share: float) -> Configuration:
    """Return a planar curve whose base heading and curvature are interpolated linearly between those of two curves.

    Args:
        first: first curve.
        last: last curve, with the base and the length of the first.
        share: interpolation parameter; 0 gives the first curve, 1 the last.

    Returns:
        A curve with the segment boundaries of both curves; ``last`` itself if ``share`` is at least 1.
    """
    if share >= 1.0:
        return last
    one = _Stretch.from_segments(first.segments)
    other = _Stretch.from_segments(last.segments)
    breaks = _merged(np.concatenate((one.breaks, other.breaks)), one.length)
    mixed = (1.0 - share) * one.on(breaks) + share * other.on(breaks)
    heading = first.base_heading + share * (last.base_heading - first.base_heading)
    inner = np.concatenate((first.boundaries[1:-1], last.boundaries[1:-1]))
    stretch = _Stretch(heading, breaks, mixed)
    return Configuration(first.base, stretch.segments(inner))


def _joined(configuration: Configuration, index: int) -> "_Stretch":
    if not 0 <= index < len(configuration.segments) - 1:
        raise ProblemError(
            f"segment {index} has no neighbour after it; expected 0 to {len(configuration.segments) - 2}"
        )
    return _Stretch.from_segments(configuration.segments[index : index + 2])


def _replaced(
    configuration: Configuration, first: int, end: int, segments: Sequence[CurvatureSegment]
) -> Configuration:
    """Return a planar curve whose segments ``first`` to ``end - 1`` are replaced by others.

    The new segments must start and end at the headings of the old ones.
    """
    return replace(configuration, segments=(*configuration.segments[:first], *segments, *configuration.segments[end:]))


def _merged(values: FloatArray, length: float) -> FloatArray:
    """Return arc lengths in increasing order without duplicates [m].

    Values count as duplicates if they differ only by rounding, relative to the length ``length`` of the curve [m].
    """
    values = np.sort(values)
    distinct: FloatArray = values[np.append(True, np.diff(values) > ROUNDING * length)]
    return distinct


@dataclass(frozen=True)
class _Stretch:
    """A part of a curve whose curvature is a piecewise cubic.

    Attributes:
        heading: heading at the start [rad].
        breaks: increasing arc lengths of the ends of the m pieces, starting at 0, shape (m + 1,) [m].
        coefficients: curvature coefficients in powers of the offset from each break, shape (m, 4).
    """

    heading: float
    breaks: FloatArray
    coefficients: FloatArray

    @classmethod
    def from_segments(cls, segments: Sequence[CurvatureSegment]) -> "_Stretch":
        """Return the stretch that consists of segments joined end to end."""
        ends = np.concatenate(([0.0], np.cumsum([s.length for s in segments])))
        breaks = [start + s.breakpoints[:-1] for start, s in zip(ends[:-1], segments, strict=True)]
        coefficients = np.concatenate([s.coefficients for s in segments])
        return cls(segments[0].heading, np.append(np.concatenate(breaks), ends[-1]), coefficients)

    @property
    def length(self) -> float:
        return float(self.breaks[-1])

    def on(self, breaks: FloatArray) -> FloatArray:
        """Return the curvature coefficients of the stretch on a finer division, shape (len(breaks) - 1, 4).

        ``breaks`` are increasing arc lengths that include the stretch's own breaks within their range [m].
        """
        piece = np.searchsorted(self.breaks[1:-1], 0.5 * (breaks[:-1] + breaks[1:]))
        t = breaks[:-1] - self.breaks[piece]
        return _about(self.coefficients[piece], t)

    def part(self, first: float, last: float) -> "_Stretch":
        """Return the part of the stretch between two arc lengths [m]."""
        inside = self.breaks[(self.breaks > first) & (self.breaks < last)]
        # Breaks right at the ends would make pieces of zero length.
        margin = 1e-12 * self.length
        inside = inside[(inside > first + margin) & (inside < last - margin)]
        breaks = np.concatenate(([first], inside, [last]))
        return _Stretch(self._heading_at(first), breaks - first, self.on(breaks))

    def _heading_at(self, arc: float) -> float:
        widths = np.clip(arc - self.breaks[:-1], 0.0, np.diff(self.breaks))
        turns = (self.coefficients * widths[:, None] ** POWERS / POWERS).sum(axis=1)
        return float(self.heading + turns.sum())

    def _jumps(self) -> FloatArray:
        """Return the sizes of the jumps of the curvature C and of C', C'' and C''' at every inner break.

        Returns:
            Absolute jumps, shape (m - 1, 4) [1/m]; the k-th derivative is multiplied by the k-th power of the length,
            so that all are comparable.
        """
        widths = np.diff(self.breaks)
        powers = np.arange(PIECES)
        ends = self.on(self.breaks)
        left = _about(self.coefficients[:-1], widths[:-1])
        # Powers of the length make derivatives comparable with the curvature itself.
        jumps: FloatArray = np.abs(ends[1:] - left) * self.length**powers
        return jumps

    def segment(self) -> CurvatureSegment:
        """Return one segment equal to the stretch, which must have at most four pieces that join smoothly.

        Raises:
            ProblemError: the stretch does not fit into one segment.
        """
        found = self._exact()
        if found is None:
            raise ProblemError(f"{len(self.breaks) - 1} pieces do not make one segment; expected at most {PIECES}")
        return found

    def _exact(self) -> CurvatureSegment | None:
        """Return one segment equal to the stretch, or None if no segment is."""
        jumps = self._jumps()
        scale = ROUNDING * max(1.0 / self.length, float(np.abs(self.coefficients[:, 0]).max()))
        too_many = len(self.breaks) > PIECES + 1
        if too_many:
            scale *= 1.0 + 1e3  # differences between merged parts carry more rounding error
        if np.any(jumps[:, :3] > 1e3 * scale):
            return None
        knots = self.breaks[1:-1]
        if too_many:
            knots = knots[jumps[:, 3] > scale]  # a break at which no derivative jumps is not a knot
        if len(knots) > PIECES - 1:
            return None
        breaks = _with_idle(np.concatenate(([0.0], knots, [self.length])))
        return self._on_knots(breaks)

    def _on_knots(self, breaks: FloatArray) -> CurvatureSegment:
        c = self.on(breaks)
        # The last knot is the end of the last piece; no break starts there.
        end = _about(self.coefficients[-1:], np.diff(self.breaks[-2:]))[0]
        moments = (2.0 * float(c[0, 2]), 2.0 * float(end[2]))
        values = np.append(c[:, 0], end[0])
        return CurvatureSegment(self.length, self.heading, values, _knots(breaks / self.length), moments)

    def segments(self, inner: FloatArray) -> tuple[CurvatureSegment, ...]:
        """Return segments that together equal the stretch, with boundaries at given arc lengths [m].

        Parts of more than four cubic pieces get further boundaries, as a segment holds four pieces.
        """
        bounds = _merged(np.concatenate(([0.0], inner, [self.length])), self.length)
        pieces: list[CurvatureSegment] = []
        for first, last in pairwise(bounds):
            part = self.part(float(first), float(last))
            # A segment holds four pieces: a part with more is cut after every fourth.
            cuts = np.append(part.breaks[:-1:PIECES], part.length)
            pieces.extend(part.part(float(a), float(b)).segment() for a, b in pairwise(cuts))
        return tuple(pieces)

    def fitted(self, tolerance: float) -> CurvatureSegment:
        """Return one segment equal to the stretch if there is one, else its least-squares fit.

        Raises:
            ProblemError: a heading of the fit differs from that of the stretch by more than the tolerance [rad].
        """
        exact = self._exact()
        if exact is not None:
            return exact
        fit, error = self._fit(_FIT_SAMPLES)
        if error > tolerance:
            raise ProblemError(
                f"one segment cannot follow the two: its heading would be {error:.3g} rad off, {tolerance:.3g} rad are "
                "allowed; straighten one of them first, or allow more"
            )
        return fit

    def _fit(self, samples: int) -> tuple[CurvatureSegment, float]:
        """Return the least-squares fit of a segment with even knots to the headings, and its greatest error [rad].

        The curvature of the fit is a natural cubic spline. The heading at the end is exact.
        """
        arc = np.linspace(0.0, self.length, samples)
        wanted = np.array([self._heading_at(float(s)) for s in arc]) - self.heading
        basis = np.stack(
            [CurvatureSegment(self.length, 0.0, unit).heading_at(arc) for unit in np.eye(PIECES + 1)], axis=1
        )
        # The last row makes the end heading exact; its multiplier is dropped with [:-1].
        normal = np.block([[basis.T @ basis, basis[-1:].T], [basis[-1:], np.zeros((1, 1))]])
        values = np.linalg.solve(normal, np.append(basis.T @ wanted, wanted[-1]))[:-1]
        error = float(np.abs(basis @ values - wanted).max())
        return CurvatureSegment(self.length, self.heading, values), error


def _about(c: FloatArray, t: FloatArray) -> FloatArray:
    """Return the power coefficients of m cubics c(x) expressed in x − t instead of x, shape (m, 4).

    Args:
        c: coefficients of the powers 0 to 3 of x, shape (m, 4).
        t: new origin of each cubic, shape (m,).
    """
    value = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3]))
    slope = c[:, 1] + t * (2.0 * c[:, 2] + 3.0 * t * c[:, 3])
    return np.stack((value, slope, c[:, 2] + 3.0 * t * c[:, 3], c[:, 3]), axis=1)


def _with_idle(breaks: FloatArray) -> FloatArray:
    """Return five breaks: the given ones, and breaks without effect, each in the middle of the widest interval left."""
    while len(breaks) < PIECES + 1:
        k = int(np.argmax(np.diff(breaks)))
        breaks = np.insert(breaks, k + 1, 0.5 * (breaks[k] + breaks[k + 1]))
    return breaks


def _knots(shares: FloatArray) -> Knots:
    return float(shares[1]), float(shares[2]), float(shares[3])
