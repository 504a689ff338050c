"""Conversion of DXF entities to polylines, and joining of polylines end to end into chains."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.shapes import flatten_arc, flatten_bulges, flatten_ellipse, flatten_spline

if TYPE_CHECKING:
    from ezdxf.math import BSpline

_MOST_MEETING = 100
"""Maximum mean number of line ends within joining distance of a line end, which counts too. Heuristic: usually two."""


@dataclass(frozen=True)
class Piece:
    """A polyline from a DXF drawing, in drawing units.

    Attributes:
        points: vertices, shape (k, 2); a closed piece does not repeat its first point.
        closed: whether the last point is joined to the first.
        curved: whether the polyline is a flattened curve.
        half_width: half the line width.
        name: name of the shape; a chain takes the name of its first piece.
    """

    points: FloatArray
    closed: bool = False
    curved: bool = False
    half_width: float = 0.0
    name: str = ""


def joined_pieces(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """Join open polylines into chains wherever exactly two ends meet; a chain ends where more than two ends meet.

    Args:
        pieces: open polylines of non-zero length; one that lies entirely on another is dropped.
        gap: maximum distance between ends that meet; a short segment then bridges them.

    Returns:
        Chains, in the order of the first polyline of each; a loop is a closed piece.

    Raises:
        ProblemError: so many ends lie close together that it is ambiguous which of them meet.
    """
    pieces = _without_duplicates(pieces, gap)
    if not pieces:
        return []
    # Ends that meet are led to one of them, so that GEOS sees them meet.
    ends = _meeting(np.array([piece.points[[0, -1]] for piece in pieces]).reshape(-1, 2), gap).reshape(-1, 2, 2)
    led = [np.vstack((a, piece.points, b)) for piece, (a, b) in zip(pieces, ends, strict=True)]
    chains = shapely.get_parts(shapely.line_merge(shapely.multilinestrings([shapely.LineString(one) for one in led])))
    middles = shapely.points([0.5 * (piece.points[0] + piece.points[1]) for piece in pieces])
    ours, of_chain = shapely.STRtree(chains).query(middles, predicate="dwithin", distance=gap)
    members = [ours[of_chain == k] for k in range(len(chains))]
    order = sorted(range(len(chains)), key=lambda k: int(members[k].min()))
    return [_chain(chains[k], [pieces[number] for number in np.sort(members[k])]) for k in order]


def _chain(line: shapely.LineString, members: Sequence[Piece]) -> Piece:
    points = shapely.get_coordinates(shapely.remove_repeated_points(line))
    closed = bool(shapely.is_closed(line))
    curved = any(piece.curved for piece in members)
    half_width = max(piece.half_width for piece in members)
    return Piece(points[:-1] if closed else points, closed, curved, half_width, members[0].name)


def _without_duplicates(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """Return the polylines without those that lie, within ``gap``, on a longer one or repeat an earlier one."""
    lines = np.array([shapely.LineString(piece.points) for piece in pieces])
    tree = shapely.STRtree(lines)
    middles = shapely.line_interpolate_point(lines, 0.5, normalized=True)
    ours, others = tree.query(middles, predicate="dwithin", distance=gap)
    lengths = shapely.length(lines)
    # A piece may lie on one that is longer by rounding alone, but of two that lie on each other one stays.
    before = (lengths[others] > lengths[ours] + gap) | ((abs(lengths[others] - lengths[ours]) <= gap) & (others < ours))
    ours, others = ours[before], others[before]
    on = shapely.covers(shapely.buffer(lines[others], gap), lines[ours])
    lost = set(ours[on].tolist())
    return [piece for k, piece in enumerate(pieces) if k not in lost]


def _meeting(points: FloatArray, gap: float) -> FloatArray:
    """Return n points, each replaced by the first point of its cluster, shape (n, 2).

    Args:
        points: points, shape (n, 2).
        gap: maximum distance between neighbours within a cluster (single linkage).

    Raises:
        ProblemError: clusters are so dense that it is ambiguous which ends meet.
    """
    # Equal points are one place, however many there are; pairs are sought among different ones only.
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    tree = cKDTree(places)
    if tree.count_neighbors(tree, gap) > _MOST_MEETING * len(places):
        raise ProblemError(
            "too many open lines end close together to tell which of them meet; join them, or simplify the drawing"
        )
    pairs = tree.query_pairs(gap, output_type="ndarray")
    # Pairs of near points are the edges of a graph; its connected components are the places that meet.
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    group = connected_components(graph, directed=False)[1]
    first = np.unique(group, return_index=True)[1]
    return np.asarray(places[first[group]][place_of.reshape(-1)])


Entity: TypeAlias = Any
"""An entity of the ezdxf library, of the DXF type that ``dxftype()`` returns."""
_FRAME_VERTEX = 16
"""Flag of POLYLINE vertices that are control points of a fitted curve, not on it (DXF reference, VERTEX, code 70)."""
_CLOSED = 1e-9
"""Distance between the two ends of a spline, relative to its extent, up to which the spline counts as closed."""
_FULL_TURN = 1e-9
"""Difference from a full turn up to which an arc counts as a full circle [rad]."""


def hatch_rings(entity: Entity, distance: float) -> tuple[tuple[FloatArray, ...], bool]:
    """Return the boundaries of a HATCH or MPOLYGON entity as closed rings, and whether any has curves.

    Args:
        entity: the entity.
        distance: maximum distance between a curve and its polyline, in drawing units.

    Returns:
        Points of each ring, shape (k, 2), the first not repeated; and whether a ring is a flattened curve.

    Raises:
        ProblemError: a boundary is open.
    """
    pieces = [_boundary(path, distance) for path in entity.paths]
    return tuple(piece.points for piece in pieces), any(piece.curved for piece in pieces)


def corner_points(entity: Entity) -> FloatArray:
    """Return the corners of a SOLID or TRACE entity in order around the outline, shape (3 or 4, 2)."""
    # A triangle repeats its last corner.
    points = np.array([(p.x, p.y) for p in entity.wcs_vertices()], dtype=np.float64)
    repeated = np.all(points == np.roll(points, 1, axis=0), axis=1)
    corners: FloatArray = points[~repeated]
    return corners


def _line(entity: Entity, _distance: float) -> Piece:
    return _straight(entity.dxf)


def _straight(leg: Entity) -> Piece:
    return Piece(np.array([(leg.start.x, leg.start.y), (leg.end.x, leg.end.y)], dtype=np.float64))


def _arc(entity: Entity, distance: float) -> Piece:
    return _circular(entity.dxf, distance)


def _circular(arc: Entity, distance: float) -> Piece:
    # DXF gives arcs in degrees but ellipses in radians, both counter-clockwise.
    start, sweep = _sweep(math.radians(arc.start_angle), math.radians(arc.end_angle))
    center = np.array((arc.center.x, arc.center.y))
    return _turned(flatten_arc(center, float(arc.radius), start, sweep, distance), sweep)


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
    """Return the start angle of an arc and its counter-clockwise extent [rad]; equal end angles mean a full turn."""
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
    """Return the larger of the two line widths of the segment that begins at a POLYLINE vertex.

    The polyline's default width applies if the vertex gives none.
    """
    start = vertex.get("start_width", polyline.dxf.get("default_start_width", 0.0))
    end = vertex.get("end_width", polyline.dxf.get("default_end_width", 0.0))
    return float(max(start, end))


def _polygonal(points: FloatArray, bulges: FloatArray, closed: bool, distance: float, half_width: float = 0.0) -> Piece:
    """Return a polyline with circular arcs as a ``Piece``; a polyline that ends at its first point counts as closed.

    Args:
        points: vertices, shape (k, 2).
        bulges: tangent of a quarter of the arc angle of the segment after each vertex, 0 if straight, shape (k,).
        closed: whether the last vertex is joined to the first.
        distance: maximum distance between an arc and its chords.
        half_width: half the line width.
    """
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
    """Return one closed boundary of a hatch, given as a polyline with arcs or as edges in any order.

    Raises:
        ProblemError: the edges do not form a single closed loop.
    """
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
        raise ProblemError("a boundary of the hatch is open; close it, or draw a closed polyline")
    return loops[0]


def _edge(edge: Entity, distance: float) -> Piece:
    """Return one edge of a hatch boundary as a polyline; the direction of the edge has no meaning."""
    kind = edge.EDGE_TYPE
    if kind == "LineEdge":
        return _straight(edge)
    if kind == "ArcEdge":
        return _circular(edge, distance)
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
"""Converters of entities to polylines, by DXF type; each takes the entity and the chord tolerance."""
