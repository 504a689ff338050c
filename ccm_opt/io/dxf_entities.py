"""Shapes of DXF entities, and curves as chords.

A curve p(t), replaced by chords over equal steps h of its parameter, is nowhere farther from the chord at the same
parameter than h² max|p''| / 8 (the error of linear interpolation). The number of steps follows from a bound on p''.
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.rings import Piece, joined_pieces

if TYPE_CHECKING:
    from ezdxf.math import BSpline

MAX_STEPS = 20_000
"""A single curve of more chords than this is taken for a mistake in scale."""


def flatten_bezier(control: FloatArray, distance: float) -> FloatArray:
    """A Bézier curve of any degree as a polyline.

    Of degree d its second derivative is at most d (d - 1) max|P_i - 2 P_(i+1) + P_(i+2)| (Farin, Curves and Surfaces
    for CAGD, section 4.4).

    Args:
        control: control points, shape (d + 1, 2).
        distance: greatest distance between curve and polyline.

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
    """The arc center + major cos t + minor sin t of an ellipse as a polyline.

    Its second derivative is at most the longer of the two perpendicular half axes.

    Args:
        center: shape (2,).
        major: a half axis, shape (2,).
        minor: the half axis perpendicular to it, shape (2,).
        start: first parameter [rad].
        sweep: parameter passed, negative for clockwise [rad].
        distance: greatest distance between arc and polyline.

    Returns:
        Points on the arc, both ends included, shape (k, 2).

    Raises:
        ProblemError: the arc would need more than ``MAX_STEPS`` chords.
    """
    longest = max(float(np.hypot(*major)), float(np.hypot(*minor)))
    steps = _steps(longest * sweep**2, distance)
    # A chord a quarter at least keeps the outline of an ellipse from collapsing where the distance is large.
    steps = max(steps, math.ceil(abs(sweep) / (0.5 * math.pi)))
    t = start + sweep * np.linspace(0.0, 1.0, steps + 1)
    points: FloatArray = center + np.outer(np.cos(t), major) + np.outer(np.sin(t), minor)
    return points


def flatten_arc(center: FloatArray, radius: float, start: float, sweep: float, distance: float) -> FloatArray:
    """A circular arc as a polyline; arguments and result as in ``flatten_ellipse``."""
    return flatten_ellipse(center, np.array([radius, 0.0]), np.array([0.0, radius]), start, sweep, distance)


def flatten_bulges(points: FloatArray, bulges: FloatArray, distance: float) -> FloatArray:
    """A polyline whose legs may be arcs, given by bulges as in DXF.

    A bulge is tan(φ/4), φ the angle of the arc, positive counter-clockwise; the radius is c (1 + b²) / (4 |b|) over
    a chord of length c.

    Args:
        points: shape (k, 2).
        bulges: of the leg after each point but the last, shape (k - 1,).
        distance: greatest distance between arc and polyline.

    Returns:
        Shape (m, 2), all of ``points`` included.
    """
    pieces = [points[:1]]
    for tail, head, bulge in zip(points[:-1], points[1:], bulges, strict=True):
        straight = bulge == 0.0 or bool(np.all(tail == head))
        pieces.append(head[None] if straight else _bulge(tail, head, float(bulge), distance)[1:])
    return np.concatenate(pieces)


def _bulge(tail: FloatArray, head: FloatArray, bulge: float, distance: float) -> FloatArray:
    chord = head - tail
    # The centre stands off the middle of the chord, to its left, by c (1 − b²) / (4 b).
    center = 0.5 * (tail + head) + (1.0 - bulge**2) / (4.0 * bulge) * np.array([-chord[1], chord[0]])
    start = math.atan2(*(tail - center)[::-1])
    arc = flatten_arc(center, float(np.hypot(*(tail - center))), start, 4.0 * math.atan(bulge), distance)
    return _pinned(arc, tail, head)


def _pinned(points: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
    """The same points with their ends free of rounding."""
    points[0] = first
    points[-1] = last
    return points


def _steps(second_derivative: float, distance: float) -> int:
    """Chords needed over a parameter interval of length 1."""
    if not math.isfinite(second_derivative):
        raise ProblemError("a curve has a point that is not finite; expected finite coordinates")
    # h² max|p''| / 8 ≤ distance with h = 1 / steps.
    needed = math.sqrt(second_derivative / (8.0 * distance))
    if needed > MAX_STEPS:  # maybe infinite
        raise ProblemError(
            f"a curve needs {needed:.0f} chords to stay within {distance:.3g} drawing units; check the scale, or allow "
            "a larger curve_tolerance"
        )
    return max(math.ceil(needed), 1)


def flatten_spline(
    knots: FloatArray, control: FloatArray, weights: FloatArray, degree: int, distance: float
) -> FloatArray:
    """A B-spline curve, which may be rational, as a polyline.

    Between two knots the curve is a quotient p = n / w of polynomials, whose coefficients bound their derivatives:
    p' = (n' − w' p) / w and p'' = (n'' − 2 w' p' − w'' p) / w (Piegl and Tiller, The NURBS Book, equation 4.8).

    Args:
        knots: shape (k + degree + 1,), not decreasing.
        control: control points, shape (k, 2).
        weights: of the control points, positive, shape (k,).
        degree: at least 1.
        distance: greatest distance between curve and polyline.

    Returns:
        Points on the curve, both ends included, shape (m, 2).

    Raises:
        ProblemError: the curve would need more than ``MAX_STEPS`` chords, or a weight is not positive.
    """
    from scipy.interpolate import PPoly  # noqa: PLC0415 - slow to load and seldom needed

    if not np.all(weights > 0.0):
        raise ProblemError("it is a spline with a weight that is not positive; explode it into a polyline or arcs")
    weights = weights / weights.max()
    # Columns: n and w.
    columns = np.column_stack((weights[:, None] * control, weights))
    coefficients = np.stack([PPoly.from_spline((knots, column, degree)).c for column in columns.T], axis=-1)
    powers = np.arange(degree, -1, -1)  # from the highest on
    pieces: list[FloatArray] = []
    for k in range(degree, len(knots) - degree - 1):
        width = float(knots[k + 1] - knots[k])
        if width <= 0.0:
            continue
        # Over a span of width 1, places seen from where it begins.
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
            raise ProblemError("a spline needs too many chords; check the scale, or allow a larger curve_tolerance")
    return np.concatenate(pieces)


Entity: TypeAlias = Any
"""An entity of ezdxf, of the type that its ``dxftype()`` says."""
_FRAME_VERTEX = 16
"""Flag of a POLYLINE vertex that steers a fitted curve and is not on it (DXF reference, VERTEX, code 70)."""
_CLOSED = 1e-9
"""A spline whose ends are nearer than this, relative to its extent, is closed."""
_FULL_TURN = 1e-9
"""Arcs that miss a full turn by less than this are full [rad]."""


def hatch_rings(entity: Entity, distance: float) -> tuple[tuple[FloatArray, ...], bool]:
    """The closed boundaries of a HATCH or MPOLYGON, and whether they have curves."""
    pieces = [_boundary(path, distance) for path in entity.paths]
    return tuple(piece.points for piece in pieces), any(piece.curved for piece in pieces)


def corner_points(entity: Entity) -> FloatArray:
    """Corners of a SOLID or TRACE in order round it, shape (3 or 4, 2)."""
    # A triangle repeats its last corner.
    points = np.array([(p.x, p.y) for p in entity.wcs_vertices()], dtype=np.float64)
    repeated = np.all(points == np.roll(points, 1, axis=0), axis=1)
    corners: FloatArray = points[~repeated]
    return corners


def _line(entity: Entity, _distance: float) -> Piece:
    start = entity.dxf.start
    end = entity.dxf.end
    return Piece(np.array([(start.x, start.y), (end.x, end.y)], dtype=np.float64))


def _arc(entity: Entity, distance: float) -> Piece:
    # DXF gives arcs in degrees but ellipses in radians, both counter-clockwise.
    start, sweep = _sweep(math.radians(entity.dxf.start_angle), math.radians(entity.dxf.end_angle))
    center = np.array((entity.dxf.center.x, entity.dxf.center.y))
    return _turned(flatten_arc(center, float(entity.dxf.radius), start, sweep, distance), sweep)


def _ellipse(entity: Entity, distance: float) -> Piece:
    start, sweep = _sweep(entity.dxf.start_param, entity.dxf.end_param)
    return _elliptic(entity.dxf.center, entity.dxf.major_axis, entity.dxf.ratio, start, sweep, distance)


def _elliptic(center: Entity, axis: Entity, ratio: float, start: float, sweep: float, distance: float) -> Piece:
    major = np.array((axis.x, axis.y))
    # The minor half axis is the major one, turned left by 90° and shortened.
    minor = ratio * np.array((-major[1], major[0]))
    return _turned(flatten_ellipse(np.array((center.x, center.y)), major, minor, start, sweep, distance), sweep)


def _turned(points: FloatArray, sweep: float) -> Piece:
    full = sweep > 2.0 * math.pi - _FULL_TURN
    return Piece(points[:-1] if full else points, full, curved=True)


def _sweep(start: float, end: float) -> tuple[float, float]:
    """Start and counter-clockwise turn of an arc; equal ends are a full turn [rad]."""
    sweep = math.fmod(end - start, 2.0 * math.pi)
    return start, sweep if sweep > _FULL_TURN else sweep + 2.0 * math.pi


def _lwpolyline(entity: Entity, distance: float) -> Piece:
    # Columns: x, y, width at the start and at the end of the leg, bulge.
    table = np.array(entity.get_points("xyseb"), dtype=np.float64).reshape(-1, 5)
    width = max(float(table[:, 2:4].max(initial=0.0)), float(entity.dxf.get("const_width", 0.0)))
    return _polygonal(table[:, :2], table[:, 4], bool(entity.closed), distance, 0.5 * width)


def _polyline(entity: Entity, distance: float) -> Piece:
    drawn = [vertex.dxf for vertex in entity.vertices if not vertex.dxf.flags & _FRAME_VERTEX]
    points = np.array([(v.location.x, v.location.y) for v in drawn], dtype=np.float64).reshape(-1, 2)
    bulges = np.array([v.get("bulge", 0.0) for v in drawn], dtype=np.float64)
    width = max((_vertex_width(vertex, entity) for vertex in drawn), default=0.0)
    return _polygonal(points, bulges, bool(entity.is_closed), distance, 0.5 * width)


def _vertex_width(vertex: Entity, polyline: Entity) -> float:
    """Width of the leg after a vertex where it is greatest; the polyline's where the vertex gives none."""
    start = vertex.get("start_width", polyline.dxf.get("default_start_width", 0.0))
    end = vertex.get("end_width", polyline.dxf.get("default_end_width", 0.0))
    return float(max(start, end))


def _polygonal(points: FloatArray, bulges: FloatArray, closed: bool, distance: float, half_width: float = 0.0) -> Piece:
    """A polyline with bulges; an open one that ends where it began is closed too."""
    if len(points) < 2:
        raise ProblemError(f"it has {len(points)} vertices; expected at least two")
    # Many programs repeat the first vertex rather than set the flag.
    if not closed and len(points) > 2 and np.all(points[0] == points[-1]):
        points = points[:-1]
        bulges = bulges[:-1]
        closed = True
    path = np.vstack((points, points[:1])) if closed else points
    flat = flatten_bulges(path, bulges[: len(path) - 1], distance)
    curved = bool(np.any(bulges[: len(path) - 1] != 0.0))
    return Piece(flat[:-1] if closed else flat, closed, curved, half_width)


def _spline(entity: Entity, distance: float) -> Piece:
    return _flat_spline(entity.construction_tool(), distance)


def _flat_spline(tool: "BSpline", distance: float) -> Piece:
    control = np.array([(p.x, p.y) for p in tool.control_points], dtype=np.float64)
    weights = np.array(tool.weights() or np.ones(len(control)), dtype=np.float64)
    points = flatten_spline(np.array(tool.knots(), dtype=np.float64), control, weights, tool.degree, distance)
    extent = np.ptp(points, axis=0).max()
    closed = len(points) > 3 and bool(np.hypot(*(points[0] - points[-1])) <= _CLOSED * extent)
    return Piece(points[:-1] if closed else points, closed, curved=True)


def _boundary(path: Entity, distance: float) -> Piece:
    """One closed boundary of a hatch: a polyline with bulges, or edges that may be out of order."""
    if hasattr(path, "vertices"):
        table = np.array(path.vertices, dtype=np.float64).reshape(-1, 3)
        return _polygonal(table[:, :2], table[:, 2], closed=True, distance=distance)
    pieces = [_edge(edge, distance) for edge in path.edges]
    # An edge that closes by itself, a full circle, needs no other.
    loops = [piece for piece in pieces if piece.closed]
    if pieces and not loops:
        extent = float(np.ptp(np.concatenate([piece.points for piece in pieces]), axis=0).max())
        # Ends meet exactly, or as nearly as six digits tell, or within what a drawing may be off.
        for gap in (1e-12 * extent, 1e-6 * extent, max(distance, 1e-6 * extent)):
            loops = joined_pieces(pieces, gap)
            if len(loops) == 1 and loops[0].closed:
                break
    if len(loops) != 1 or not loops[0].closed:
        raise ProblemError("a boundary of the hatch is not closed; close it, or draw a closed polyline")
    return loops[0]


def _edge(edge: Entity, distance: float) -> Piece:
    """One edge of a hatch's boundary; its orientation does not matter."""
    kind = edge.EDGE_TYPE
    if kind == "LineEdge":
        return Piece(np.array([(edge.start.x, edge.start.y), (edge.end.x, edge.end.y)], dtype=np.float64))
    if kind == "ArcEdge":
        start, sweep = _sweep(math.radians(edge.start_angle), math.radians(edge.end_angle))
        center = np.array((edge.center.x, edge.center.y))
        return _turned(flatten_arc(center, float(edge.radius), start, sweep, distance), sweep)
    if kind == "EllipseEdge":
        start, sweep = _sweep(edge.start_param, edge.end_param)
        return _elliptic(edge.center, edge.major_axis, edge.ratio, start, sweep, distance)
    return _flat_spline(edge.construction_tool(), distance)


PIECES: Mapping[str, Callable[[Entity, float], Piece]] = {
    "LINE": _line,
    "ARC": _arc,
    "ELLIPSE": _ellipse,
    "HELIX": _spline,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "SPLINE": _spline,
}
"""How each type of entity becomes a piece."""
