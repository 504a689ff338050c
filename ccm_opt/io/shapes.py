"""Shapes found in drawings, and flattening of curves into chords.

A curve p(t) replaced by chords over equal steps h of its parameter deviates from the chord at the same parameter by at
most h² max|p''| / 8 (the error of linear interpolation). The number of steps follows from a bound on p''.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import LeftOut


@dataclass(frozen=True)
class ImportBounds:
    """Bounds of the import, the same for all formats.

    Attributes:
        most_bytes: largest size of a file. Taste.
        most_vertices: largest number of vertices of all obstacles. Taste: a planner would take hours with more.
        most_points: largest number of points of all shapes, counted while they are read, before repairs join some.
            Derived: with more points, more than ``most_vertices`` would remain, unless outlines are drawn repeatedly.
        most_elements: largest number of elements, counted each time they are used or inserted. Derived: an element
            gives at least one vertex.
        most_nodes: largest number of elements of any kind, or of points in lists, in a file. Taste.
        deepest: deepest nesting of elements, which bounds recursion. Taste: people nest a dozen deep, and converters of
            drawings a few dozen deep.
        reported_defects: number of defects of a drawing listed in an error. Taste.
        largest_coordinate: largest coordinate, in the unit of the result. Derived: beyond it double precision no longer
            resolves a millionth.
        most_nested: largest number of pairs of rings of one shape whose boxes meet. Measured: this number takes
            0.5 s when each ring lies inside the next.
    """

    most_bytes: int = 32 * 2**20
    most_vertices: int = 50_000
    most_points: int = 100_000
    most_elements: int = 50_000
    most_nodes: int = 300_000
    deepest: int = 200
    reported_defects: int = 10
    largest_coordinate: float = 1e9
    most_nested: int = 500_000

    def listed(self, defects: Sequence[str]) -> str:
        """Return the first defects of a drawing in one sentence, and the number of the remaining ones."""
        shown = list(defects[: self.reported_defects])
        if len(defects) > len(shown):
            shown.append(f"and {len(defects) - len(shown)} more")
        return "; ".join(shown)


IMPORT = ImportBounds()
"""Bounds applied to every drawing."""


FillRule = Literal["polygon", "evenodd", "nonzero"]
"""Fill rule of nested rings, see ``Shape``."""

Drawn = Literal["line", "outline", "painted", "area"]
"""How a shape is drawn: as an open line; as a closed line without fill, so that outlines within it are holes; filled;
or as an area, for example a hatch, which is solid whatever closed outlines mean."""


@dataclass(frozen=True)
class Shape:
    """One shape of a drawing: the area enclosed by closed rings, an open line, or a true circle.

    Attributes:
        name: name of the shape in the drawing.
        rings: closed rings, each of shape (k, 2), without repeating the first point; the points of an open line; the
            centre of a circle, shape (1, 2).
        drawn: how the shape is drawn, see ``Drawn``.
        rule: ``polygon``: the first ring is the outline, the others are holes; ``evenodd`` and ``nonzero``: nested
            rings are holes by the fill rules of SVG.
        curved: whether a ring is a flattened curve.
        half_width: distance by which the shape extends beyond its rings, half the line width; the radius of a circle.
        layer: layer on which the shape is drawn; empty where the drawing has none.
    """

    name: str
    rings: tuple[FloatArray, ...]
    drawn: Drawn = "painted"
    rule: FillRule = "polygon"
    curved: bool = False
    half_width: float = 0.0
    layer: str = ""

    @property
    def is_circle(self) -> bool:
        """Whether the shape is a true circle."""
        return self.size == 1

    @property
    def size(self) -> int:
        """Number of points of all rings."""
        return sum(len(ring) for ring in self.rings)


@dataclass(frozen=True)
class DrawingContent:
    """The shapes that a reader found in a drawing.

    Attributes:
        shapes: shapes in the order of the drawing.
        left_out: elements that are no shapes, with the reasons.
        unit: unit of length stated in the file, for example ``mm``; empty where it states none.
        metres: length of one unit by the physical size that the file states [m]; None where it states none.
    """

    shapes: tuple[Shape, ...]
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""
    metres: float | None = None


Reader: TypeAlias = Callable[[bytes, float], DrawingContent]
"""Function that returns the shapes in a file's bytes, curves flattened to within a distance in the drawing's unit."""


MAX_STEPS = 20_000
"""Largest number of chords of one curve; more suggest an error of scale."""


def flatten_bezier(control: FloatArray, distance: float) -> FloatArray:
    """Return a Bézier curve of any degree as a polyline.

    The second derivative of a curve of degree d is at most d (d - 1) max|P_i - 2 P_(i+1) + P_(i+2)| (Farin, Curves and
    Surfaces for CAGD, section 4.4).

    Args:
        control: control points, shape (d + 1, 2).
        distance: largest distance allowed between curve and polyline.

    Returns:
        Points on the curve, both ends included, shape (k, 2).

    Raises:
        ProblemError: the curve would need more than ``MAX_STEPS`` chords.
    """
    degree = len(control) - 1
    bend = np.linalg.norm(np.diff(control, n=2, axis=0), axis=1).max(initial=0.0)
    t = np.linspace(0.0, 1.0, _steps(degree * (degree - 1) * float(bend), distance) + 1)[:, None]
    points = np.repeat(control[None, :, :], len(t), axis=0)
    for _ in range(degree):  # de Casteljau
        points = (1.0 - t[..., None]) * points[:, :-1] + t[..., None] * points[:, 1:]
    return _pinned(points[:, 0], control[0], control[-1])


def flatten_ellipse(
    center: FloatArray, major: FloatArray, minor: FloatArray, start: float, sweep: float, distance: float
) -> FloatArray:
    """Return the arc center + major cos t + minor sin t of an ellipse as a polyline.

    Its second derivative is at most the longer of the two perpendicular semi-axes.

    Args:
        center: centre, shape (2,).
        major: a semi-axis, shape (2,).
        minor: the semi-axis perpendicular to ``major``, shape (2,).
        start: parameter of the first point [rad].
        sweep: change of the parameter, negative for clockwise [rad].
        distance: largest distance allowed between arc and polyline.

    Returns:
        Points on the arc, both ends included, shape (k, 2).

    Raises:
        ProblemError: the arc would need more than ``MAX_STEPS`` chords.
    """
    longest = max(float(np.hypot(*major)), float(np.hypot(*minor)))
    steps = _steps(longest * sweep**2, distance)
    # At least one chord per quarter turn, so that an ellipse does not collapse when the distance is large.
    steps = max(steps, math.ceil(abs(sweep) / (0.5 * math.pi)))
    t = start + sweep * np.linspace(0.0, 1.0, steps + 1)
    points: FloatArray = center + np.outer(np.cos(t), major) + np.outer(np.sin(t), minor)
    return points


def flatten_arc(center: FloatArray, radius: float, start: float, sweep: float, distance: float) -> FloatArray:
    """Return a circular arc as a polyline; arguments and result as in ``flatten_ellipse``."""
    return flatten_ellipse(center, np.array([radius, 0.0]), np.array([0.0, radius]), start, sweep, distance)


def flatten_bulges(points: FloatArray, bulges: FloatArray, distance: float) -> FloatArray:
    """Return a polyline with arcs, given by bulges as in DXF, as a polyline of straight legs.

    A bulge b is tan(φ/4) with φ the angle of the arc, positive counter-clockwise; the radius over a chord of length c
    is c (1 + b²) / (4 |b|).

    Args:
        points: vertices, shape (k, 2).
        bulges: bulge of the leg after each point but the last, shape (k - 1,).
        distance: largest distance allowed between arc and polyline.

    Returns:
        Points, all of ``points`` included, shape (m, 2).
    """
    pieces = [points[:1]]
    for tail, head, bulge in zip(points[:-1], points[1:], bulges, strict=True):
        straight = bulge == 0.0 or bool(np.all(tail == head))
        pieces.append(head[None] if straight else _bulge(tail, head, float(bulge), distance)[1:])
    return np.concatenate(pieces)


def _bulge(tail: FloatArray, head: FloatArray, bulge: float, distance: float) -> FloatArray:
    chord = head - tail
    # The centre is offset from the middle of the chord, to its left, by c (1 − b²) / (4 b).
    center = 0.5 * (tail + head) + (1.0 - bulge**2) / (4.0 * bulge) * np.array([-chord[1], chord[0]])
    start = math.atan2(*(tail - center)[::-1])
    arc = flatten_arc(center, float(np.hypot(*(tail - center))), start, 4.0 * math.atan(bulge), distance)
    return _pinned(arc, tail, head)


def _pinned(points: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
    """Set the ends of a polyline, in place, to exact values free of rounding, and return it."""
    points[0] = first
    points[-1] = last
    return points


def _steps(second_derivative: float, distance: float) -> int:
    """Return the number of chords needed over a parameter interval of length 1.

    Args:
        second_derivative: bound on |p''|.
        distance: largest distance allowed between curve and chords.

    Raises:
        ProblemError: the bound is not finite, or more than ``MAX_STEPS`` chords would be needed.
    """
    if not math.isfinite(second_derivative):
        raise ProblemError("a curve has a coordinate that is not finite")
    # h² max|p''| / 8 ≤ distance with h = 1 / steps.
    needed = math.sqrt(second_derivative / (8.0 * distance))
    if needed > MAX_STEPS:  # possibly infinite
        raise ProblemError(
            f"a curve needs {needed:.0f} chords to stay within {distance:.3g} drawing units; check "
            "workspace.scale, or raise curve_tolerance"
        )
    return max(math.ceil(needed), 1)


def flatten_spline(
    knots: FloatArray, control: FloatArray, weights: FloatArray, degree: int, distance: float
) -> FloatArray:
    """Return a B-spline curve, which may be rational, as a polyline.

    Between two knots the curve is a quotient p = n / w of polynomials, and their coefficients bound the derivatives:
    p' = (n' − w' p) / w and p'' = (n'' − 2 w' p' − w'' p) / w (Piegl and Tiller, The NURBS Book, equation 4.8).

    Args:
        knots: knots, non-decreasing, shape (k + degree + 1,).
        control: control points, shape (k, 2).
        weights: weights of the control points, positive, shape (k,).
        degree: degree, at least 1.
        distance: largest distance allowed between curve and polyline.

    Returns:
        Points on the curve, both ends included, shape (m, 2).

    Raises:
        ProblemError: the curve would need more than ``MAX_STEPS`` chords, or a weight is not positive.
    """
    from scipy.interpolate import PPoly  # noqa: PLC0415 - slow to load and seldom needed

    if not np.all(weights > 0.0):
        raise ProblemError("a weight of the spline is not positive; explode it into a polyline or arcs")
    weights = weights / weights.max()
    # Columns: n and w.
    columns = np.column_stack((weights[:, None] * control, weights))
    coefficients = np.stack([PPoly.from_spline((knots, column, degree)).c for column in columns.T], axis=-1)
    powers = np.arange(degree, -1, -1)  # highest first
    pieces: list[FloatArray] = []
    for k in range(degree, len(knots) - degree - 1):
        width = float(knots[k + 1] - knots[k])
        if width <= 0.0:
            continue
        # Rescale the span to width 1; for the bounds, measure positions from its start.
        terms = coefficients[:, k] * width ** powers[:, None]
        whole = terms.copy()
        terms[:, :2] -= terms[:, 2:] * (terms[-1, :2] / terms[-1, 2])
        terms = np.abs(terms)
        slopes = powers @ terms
        bends = (powers * (powers - 1)) @ terms
        least = float(weights[k - degree : k + 1].min())
        reach = float(np.hypot(*terms[:, :2].sum(axis=0))) / least
        slope = (np.hypot(slopes[0], slopes[1]) + slopes[2] * reach) / least
        bend = (np.hypot(bends[0], bends[1]) + 2.0 * slopes[2] * slope + bends[2] * reach) / least
        values = np.linspace(0.0, 1.0, _steps(float(bend), distance) + 1)[:, None] ** powers @ whole
        values = values[1:] if pieces else values
        pieces.append(values[:, :2] / values[:, 2:])
        if sum(map(len, pieces)) > MAX_STEPS:
            raise ProblemError("a spline needs too many chords; check workspace.scale, or raise curve_tolerance")
    return np.concatenate(pieces)
