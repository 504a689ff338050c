"""Decomposition of a configuration (section 2.2): add, delete, divide and merge segments, and move a boundary.

Dividing, merging and moving a boundary leave the curve as it is. Its curvature is a piecewise cubic over arc length; a
segment holds up to four of the pieces exactly if they join with continuous second derivatives. So a part of a divided
segment keeps the knots that lie in it, is given idle knots to make up three, and keeps the second derivatives at its
ends.
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
"""Number of headings used in the least-squares fit of one segment. Taste: thirteen per value to be found."""


def add_segment(configuration: Configuration, segment: CurvatureSegment) -> Configuration:
    """Return the configuration with one more segment at its tip, which continues from the tip's heading."""
    heading = configuration.segments[-1].end_heading
    return Configuration(configuration.base, (*configuration.segments, replace(segment, heading=heading)))


def delete_segment(configuration: Configuration) -> Configuration:
    """Return the configuration without its tip segment.

    Raises:
        ProblemError: the configuration has only one segment.
    """
    if len(configuration.segments) == 1:
        raise ProblemError("a configuration has at least one segment; got one, expected two or more to delete from")
    return Configuration(configuration.base, configuration.segments[:-1])


def divide_segment(configuration: Configuration, index: int, at: float) -> Configuration:
    """Return the same curve with one segment divided in two.

    Args:
        configuration: the curve.
        index: index of the segment to divide.
        at: where to divide the segment, as a fraction of its length in (0, 1).

    Raises:
        ProblemError: the place is not inside the segment.
    """
    if not SHORTEST <= at <= 1.0 - SHORTEST:
        raise ProblemError(f"a segment is divided between its ends, at a share in (0, 1) of its length; got {at}")
    stretch = _Stretch.from_segments((configuration.segments[index],))
    cut = at * stretch.length
    parts = stretch.part(0.0, cut).segment(), stretch.part(cut, stretch.length).segment()
    return _replaced(configuration, index, index + 1, parts)


def merge_segments(configuration: Configuration, index: int, tolerance: float = 1e-9) -> Configuration:
    """Return the same curve with two neighbouring segments merged.

    Two segments have up to seven inner knots between them, one has three. If at most three of these knots matter, as
    after a division, the curve does not move at all; else the headings are fitted by least squares with the headings at
    both ends exact.

    Args:
        configuration: the curve.
        index: index of the first of the two segments.
        tolerance: allowed change of the heading [rad].

    Raises:
        ProblemError: one segment cannot follow the two within the tolerance.
    """
    merged = _joined(configuration, index).fitted(tolerance)
    return _replaced(configuration, index, index + 2, (merged,))


def move_boundary(
    configuration: Configuration,
    index: int,
    length: float,
    tolerance: float = 1e-9,
) -> Configuration:
    """Return the same curve with the boundary between two neighbouring segments moved.

    One of the segments becomes longer, the other shorter.

    Args:
        configuration: the curve.
        index: index of the first of the two segments.
        length: new length of the first segment [m].
        tolerance: allowed change of the heading [rad].

    Raises:
        ProblemError: one of the two segments would vanish, or a segment cannot follow its part within the tolerance.
    """
    stretch = _joined(configuration, index)
    if not SHORTEST * stretch.length <= length <= (1.0 - SHORTEST) * stretch.length:
        raise ProblemError(f"the two segments share {stretch.length:g} m; got {length:g} m for the first of them")
    first = stretch.part(0.0, length).fitted(tolerance)
    second = replace(stretch.part(length, stretch.length).fitted(tolerance), heading=first.end_heading)
    return _replaced(configuration, index, index + 2, (first, second))


def segment_head(segment: CurvatureSegment, length: float) -> CurvatureSegment:
    """Return the first ``length`` metres of a segment, exactly."""
    if length >= segment.length:
        return segment
    return _Stretch.from_segments((segment,)).part(0.0, length).segment()


def segment_tail(segment: CurvatureSegment, length: float) -> CurvatureSegment:
    """Return the rest of a segment after its first ``length`` metres, exactly."""
    return _Stretch.from_segments((segment,)).part(length, segment.length).segment()


def interpolate(first: Configuration, last: Configuration, share: float) -> Configuration:
    """Return a configuration between two others, with linearly interpolated base heading and curvature.

    Args:
        first: the curve at ``share`` 0.
        last: the curve at ``share`` 1, with the same base and length.
        share: position between the curves; 0 gives the first curve, 1 the last.

    Returns:
        A curve with the segment boundaries of both; ``last`` itself at ``share`` 1.
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
    """Return the configuration with a few segments replaced by others that end at the same heading."""
    return replace(configuration, segments=(*configuration.segments[:first], *segments, *configuration.segments[end:]))


def _merged(values: FloatArray, length: float) -> FloatArray:
    """Return the values sorted, with duplicates (up to rounding) removed."""
    values = np.sort(values)
    distinct: FloatArray = values[np.append(True, np.diff(values) > ROUNDING * length)]
    return distinct


@dataclass(frozen=True)
class _Stretch:
    """A part of a curve whose curvature is a piecewise cubic.

    Attributes:
        heading: heading at the start [rad].
        breaks: increasing arc lengths between the pieces, the first is 0, shape (m + 1,) [m].
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
        """Return the curvature coefficients of the same stretch on finer breaks, shape (len(breaks) - 1, 4)."""
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
        """Return the jumps of the curvature C and of C', C'' and C''' at every inner break, shape (m - 1, 4) [1/m].

        Derivatives are scaled by powers of the length, so that all are comparable.
        """
        widths = np.diff(self.breaks)
        powers = np.arange(PIECES)
        ends = self.on(self.breaks)
        left = _about(self.coefficients[:-1], widths[:-1])
        # Powers of the length make derivatives comparable with the curvature itself.
        jumps: FloatArray = np.abs(ends[1:] - left) * self.length**powers
        return jumps

    def segment(self) -> CurvatureSegment:
        """Return the stretch as one segment, exactly; it must have at most four pieces that join smoothly.

        Raises:
            ProblemError: the stretch does not fit into one segment.
        """
        found = self._exact()
        if found is None:
            raise ProblemError(f"{len(self.breaks) - 1} pieces do not make one segment; expected at most {PIECES}")
        return found

    def _exact(self) -> CurvatureSegment | None:
        """Return the stretch as one segment if that leaves the curve unchanged, else None."""
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
        """Return the stretch as segments with boundaries at the given arc lengths.

        Parts of more than four pieces get further boundaries.
        """
        bounds = _merged(np.concatenate(([0.0], inner, [self.length])), self.length)
        made: list[CurvatureSegment] = []
        for first, last in pairwise(bounds):
            part = self.part(float(first), float(last))
            # A segment holds four pieces: a part with more is cut after every fourth.
            cuts = np.append(part.breaks[:-1:PIECES], part.length)
            made.extend(part.part(float(a), float(b)).segment() for a, b in pairwise(cuts))
        return tuple(made)

    def fitted(self, tolerance: float) -> CurvatureSegment:
        """Return one segment for the stretch: exact if possible, else the least-squares fit of its headings.

        Raises:
            ProblemError: the headings of the fit are off by more than the tolerance.
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
        """Return the natural spline with even knots that best fits the headings, and its greatest error [rad].

        The last heading is exact.
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
    """Return the coefficients of cubics, shape (m, 4), after their origins are shifted.

    The new origins lie at the old offsets ``t``, shape (m,).
    """
    value = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3]))
    slope = c[:, 1] + t * (2.0 * c[:, 2] + 3.0 * t * c[:, 3])
    return np.stack((value, slope, c[:, 2] + 3.0 * t * c[:, 3], c[:, 3]), axis=1)


def _with_idle(breaks: FloatArray) -> FloatArray:
    """Return five breaks: the given ones, and idle ones that repeatedly halve the widest interval."""
    while len(breaks) < PIECES + 1:
        k = int(np.argmax(np.diff(breaks)))
        breaks = np.insert(breaks, k + 1, 0.5 * (breaks[k] + breaks[k + 1]))
    return breaks


def _knots(shares: FloatArray) -> Knots:
    return float(shares[1]), float(shares[2]), float(shares[3])
