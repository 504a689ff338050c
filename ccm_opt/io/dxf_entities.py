"""Single entities of a DXF drawing as pieces; what is drawn on the back of the plane was turned upright before."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.curves import flatten_arc, flatten_bulges, flatten_ellipse, flatten_spline
from ccm_opt.io.rings import Piece, joined_pieces

if TYPE_CHECKING:
    from ezdxf.math import BSpline

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
