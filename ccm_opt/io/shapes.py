"""Shapes found in drawings, limits on drawings, and approximation of curves by chords.

A curve p(t) deviates from chords over equal parameter steps h by at most h² max|p''| / 8, the error of linear
interpolation. An upper bound on |p''| therefore gives the number of chords.
"""

import difflib
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import LeftOut


@dataclass(frozen=True)
class ImportBounds:
    """Limits on the size of drawings of every supported format.

    Attributes:
        most_bytes: maximum size of a file [bytes]. Heuristic.
        most_vertices: maximum number of vertices of all obstacles together. Heuristic: planning would take hours with
            more.
        most_points: maximum number of points of all shapes together, as read, before repairs merge some. Derived: with
            more points, more than ``most_vertices`` would remain, unless outlines are drawn repeatedly.
        most_elements: maximum number of drawn elements, counted at each use or insertion. Derived: an element gives at
            least one vertex.
        most_nodes: maximum number of XML elements of any kind, or of JSON lists, in a file. Heuristic.
        deepest: maximum nesting depth of elements, which bounds recursion. Heuristic: people nest a dozen deep, and
            file converters a few dozen deep.
        reported_defects: maximum number of defects of a drawing listed in an error message. Heuristic.
        largest_coordinate: maximum absolute coordinate, in the unit of the problem file. Derived: double precision no
            longer resolves a millionth of a unit beyond this value.
        most_nested: maximum number of pairs of rings of one shape whose bounding boxes intersect. Measured: checking
            this many pairs takes 0.5 s if each ring lies inside the next.
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
        """Return a text with the first ``reported_defects`` defects of a drawing and the number of further ones."""
        shown = list(defects[: self.reported_defects])
        if len(defects) > len(shown):
            shown.append(f"and {len(defects) - len(shown)} more")
        return "; ".join(shown)


IMPORT = ImportBounds()
"""Limits applied to every drawing."""


FillRule = Literal["polygon", "evenodd", "nonzero"]
"""Rule that decides which nested rings of a shape are holes, see ``Shape.rule``."""

Drawn = Literal["line", "outline", "painted", "area"]
"""Kind of a drawn shape: an open line; a closed outline without fill, within which other outlines are holes; a filled
outline; or an area such as a hatch, which is solid under every setting for closed outlines."""


@dataclass(frozen=True)
class Shape:
    """One shape of a drawing: the area enclosed by closed rings, an open line, or an exact circle.

    Attributes:
        name: name of the shape in the drawing.
        rings: closed rings, each of shape (k, 2), without repeating the first point; the points of an open line; the
            centre of a circle, shape (1, 2).
        drawn: how the shape is drawn, see ``Drawn``.
        rule: ``polygon``: the first ring is the outline, the others are holes; ``evenodd`` and ``nonzero``: nested
            rings are holes by the fill rules of SVG.
        curved: whether a ring is a flattened curve.
        half_width: distance by which the shape extends beyond its rings: half the line width, or the radius of a
            circle.
        layer: layer on which the shape is drawn; empty if the drawing has none.
        stroke_width: width of the stroke with which the drawing shows the shape, for information only, as the shape
            does not extend by it; 0 if it has no stroke.
    """

    name: str
    rings: tuple[FloatArray, ...]
    drawn: Drawn = "painted"
    rule: FillRule = "polygon"
    curved: bool = False
    half_width: float = 0.0
    layer: str = ""
    stroke_width: float = 0.0

    @property
    def is_circle(self) -> bool:
        """Whether the shape is an exact circle rather than a polygon or line."""
        return self.size == 1

    @property
    def size(self) -> int:
        """Number of points of all rings together."""
        return sum(len(ring) for ring in self.rings)


@dataclass(frozen=True)
class DrawingContent:
    """Shapes that a reader found in a drawing, with the drawing's unit and whatever was ignored.

    Attributes:
        shapes: shapes in the order of the drawing.
        left_out: elements that gave no shape, each with the reason.
        unit: unit of length stated in the file, for example ``mm``; empty if it states none.
        metres: length of one drawing unit according to the physical size or unit that the file states [m]; None if
            it states none.
    """

    shapes: tuple[Shape, ...]
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""
    metres: float | None = None


class LayerSelection:
    """Selection of the shapes of a drawing that are read, by the names of layers and shapes.

    Upper and lower case are not distinguished, as in CAD programs. Shapes that are skipped are counted by layer.

    Args:
        layers: names of the layers that are read; None for all.
        without: names of layers and shapes that are not read.
    """

    def __init__(self, layers: Sequence[str] | None = None, without: Sequence[str] = ()) -> None:
        self._layers = None if layers is None else {name.casefold() for name in layers}
        self._without = {name.casefold() for name in without}
        self._given = {"layers": layers or (), "without": without}
        self._met: dict[str, str] = {}
        self._skipped: Counter[tuple[str, str]] = Counter()

    def skips(self, layer: str, name: str) -> bool:
        """Return whether the shape with a name on a layer is not read, and count it; "" stands for no layer."""
        names = {layer.casefold(), name.casefold()}
        self.meet(layer, name)
        if names & self._without:
            self._skipped[layer if layer.casefold() in self._without else name, "workspace.without names it"] += 1
            return True
        if self._layers is not None and layer.casefold() not in self._layers:
            self._skipped[layer, "workspace.layers does not list it"] += 1
            return True
        return False

    def meet(self, *names: str) -> None:
        """Record names of layers and shapes that the drawing has; "" stands for none."""
        self._met.update((name.casefold(), name) for name in names)

    def left_out(self) -> tuple[LeftOut, ...]:
        """Return a report on the shapes that were skipped, an entry per layer or name."""
        return tuple(
            LeftOut(f"{repr(name) if name else 'no layer'} ({number} {'shape' if number == 1 else 'shapes'})", reason)
            for (name, reason), number in self._skipped.items()
        )

    def unknown_names(self) -> list[str]:
        """Return a message for every selected name that no shape of the drawing has."""
        known = sorted(name for name in self._met.values() if name)
        kinds = {"layers": "layer", "without": "layer or shape"}
        return [
            f"workspace.{key}: it has no {kinds[key]} '{name}'{_meant(name, known)}"
            for key, names in self._given.items()
            for name in names
            if name.casefold() not in self._met
        ]


def _meant(name: str, known: Sequence[str]) -> str:
    """Return the end of a message about an unknown name: the most similar known one, or some of those known."""
    by_word = {each.casefold(): each for each in known}
    near = difflib.get_close_matches(name.casefold(), by_word, n=1)
    if near:
        return f", did you mean '{by_word[near[0]]}'?"
    shown = known[: IMPORT.reported_defects]
    several = f" and {len(known) - len(shown)} more" if len(known) > len(shown) else ""
    return f", only {', '.join(repr(each) for each in shown)}{several}" if known else ""


Reader: TypeAlias = Callable[[bytes, float, LayerSelection], DrawingContent]
"""Reader of a drawing format: takes the bytes of a file, the chord tolerance for curves [drawing units], and the
selection of shapes."""


MAX_STEPS = 20_000
"""Maximum number of chords for one curve; a curve that needs more suggests a wrong scale."""


def flatten_bezier(control: FloatArray, distance: float) -> FloatArray:
    """Return a polyline within a given distance of a Bézier curve of any degree.

    The second derivative of a curve of degree d is bounded by d (d - 1) max|P_i - 2 P_(i+1) + P_(i+2)| (Farin, Curves
    and Surfaces for CAGD, section 4.4).

    Args:
        control: control points, shape (d + 1, 2).
        distance: maximum distance between curve and polyline.

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
    """Return a polyline within a given distance of the elliptic arc center + major cos t + minor sin t.

    The norm of the second derivative is bounded by the length of the longer semi-axis.

    Args:
        center: centre, shape (2,).
        major: a semi-axis, shape (2,).
        minor: the semi-axis perpendicular to ``major``, shape (2,).
        start: parameter of the first point [rad].
        sweep: change of the parameter, negative for clockwise [rad].
        distance: maximum distance between arc and polyline.

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
    """Return a polyline within a given distance of a circular arc.

    Args:
        center: centre of the circle, shape (2,).
        radius: radius of the circle.
        start: angle of the first point [rad].
        sweep: extent of the arc, negative for clockwise [rad].
        distance: maximum distance between arc and polyline.

    Returns:
        Points on the arc, both ends included, shape (k, 2).

    Raises:
        ProblemError: the arc would need more than ``MAX_STEPS`` chords.
    """
    return flatten_ellipse(center, np.array([radius, 0.0]), np.array([0.0, radius]), start, sweep, distance)


def flatten_bulges(points: FloatArray, bulges: FloatArray, distance: float) -> FloatArray:
    """Return a polyline of straight segments for one with circular arcs, which bulges define as in DXF.

    The bulge of an arc of angle φ, positive counter-clockwise, is b = tan(φ/4); over a chord of length c the radius is
    c (1 + b²) / (4 |b|).

    Args:
        points: vertices, shape (k, 2).
        bulges: bulge of the segment after each vertex but the last, 0 where straight, shape (k - 1,).
        distance: maximum distance between an arc and its chords.

    Returns:
        Vertices of the polyline, all of ``points`` included, shape (m, 2).
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
    """Return a polyline after setting its first and last point, in place, to the given exact points."""
    points[0] = first
    points[-1] = last
    return points


def _steps(second_derivative: float, distance: float) -> int:
    """Return the number of chords of equal parameter step that keep a curve p(t), 0 ≤ t ≤ 1, within a distance.

    Args:
        second_derivative: upper bound on |p''|.
        distance: maximum distance between curve and chords.

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
    """Return a polyline within a given distance of a B-spline curve, which may be rational (NURBS).

    Between two knots the curve is a quotient p = n / w of polynomials, whose coefficients bound the derivatives
    p' = (n' − w' p) / w and p'' = (n'' − 2 w' p' − w'' p) / w (Piegl and Tiller, The NURBS Book, equation 4.8).

    Args:
        knots: non-decreasing knot values, shape (k + degree + 1,).
        control: control points, shape (k, 2).
        weights: weights of the control points, positive, shape (k,).
        degree: degree of the spline, at least 1.
        distance: maximum distance between curve and polyline.

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
