"""Closed rings out of loose pieces."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely import STRtree

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.found_shapes import IMPORT, FillRule

_MOST_MEETING = 100
"""Neighbours that an open end has within the joining distance, on average. Taste: two as a rule."""
_MOST_CROSSINGS = 1000
"""Pairs of edges of one outline that meet besides neighbours, and are repaired. Measured: 0.5 s for as many, and ten
seconds for four times as many."""
_REPAIR_SHARE = 1e-3
"""A repair that changes the enclosed area by more than this share is refused, since something else was meant. Taste."""


def filled(rings: Sequence[FloatArray], rule: FillRule) -> list[shapely.Polygon]:
    """The polygons that rings enclose.

    Args:
        rings: each of shape (k, 2), k >= 3.
        rule: how rings within rings count.

    Returns:
        Valid polygons with area, at least one; holes are kept.

    Raises:
        ProblemError: a ring encloses no area, or crosses itself so that its repair would change the area.
    """
    if rule == "polygon":
        return repaired(shapely.Polygon(rings[0], rings[1:]))
    solids = [shapely.MultiPolygon(repaired(shapely.Polygon(ring))) for ring in rings]
    turns = np.array([_turn(ring) for ring in rings])
    boxed = STRtree(solids).query(solids)
    if boxed.shape[1] > IMPORT.most_nested:
        raise ProblemError(f"it has {len(rings)} rings within rings, too many to fill; draw them as several shapes")
    # Rings that are far apart have nothing to do with each other, and are filled by themselves.
    linked = coo_array((np.ones(boxed.shape[1]), boxed), shape=(len(rings), len(rings)))
    _, groups = connected_components(linked, directed=False)
    inner, outer = boxed[:, shapely.covers(np.array(solids)[boxed[1]], np.array(solids)[boxed[0]])]
    around = np.bincount(inner, minlength=len(rings))
    # Inside is an odd number of rings, or a sum of windings other than 0 (SVG 1.1, section 11.3).
    winding = np.bincount(inner, turns[outer], minlength=len(rings))
    inside = around % 2 == 1 if rule == "evenodd" else winding != 0.0
    order = np.lexsort((inside, around, groups))
    found: list[shapely.Polygon] = []
    for _, group in groupby(order, key=lambda k: groups[k]):
        found += polygons_of(_filled_inwards(solids, around, inside, list(group)))
    return found


def _filled_inwards(
    solids: Sequence[shapely.MultiPolygon], around: IntArray, inside: BoolArray, order: Sequence[int]
) -> shapely.Geometry:
    """What rings fill and clear by turns, from those with no other around them inwards."""
    parts: list[shapely.Geometry] = []
    for (_, fills), members in groupby(order, key=lambda k: (around[k], bool(inside[k]))):
        level = shapely.union_all([solids[k] for k in members])
        if fills:
            parts.append(level)
        elif parts:
            # What fills again farther in lies within what is cleared here, so that only the last part changes.
            parts[-1] = shapely.difference(parts[-1], level)
    return shapely.union_all(parts)


def repaired(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """A polygon as valid polygons.

    Args:
        polygon: any; its outline may cross itself.

    Returns:
        Valid polygons with area, at least one, that differ from the given one by at most ``repair_share`` of its area;
        holes smaller than that, which a repair may leave at a crossing, are filled.

    Raises:
        ProblemError: there is no area, or the repair would change it too much.
    """
    if polygon.is_valid and polygon.area > 0.0:
        return [polygon]
    why = shapely.is_valid_reason(polygon)
    if _is_tangled(polygon):
        raise ProblemError(
            f"the outline crosses or touches itself more than {_MOST_CROSSINGS} times, too often to be "
            "repaired; list the corners in order round the shape"
        )
    # Of a bow tie GEOS keeps both halves, so that a change of area shows that more than a slip was repaired.
    mended = polygons_of(shapely.make_valid(polygon))
    area = sum(part.area for part in mended)
    if area == 0.0:
        raise ProblemError("the outline encloses no area; expected at least three corners that are not in one line")
    allowed = _REPAIR_SHARE
    if abs(area - polygon.area) > allowed * area:
        raise ProblemError(
            f"the outline {_sentence(why)}; a repair would change its area by {abs(area - polygon.area) / area:.1%}, "
            f"allowed {allowed:.1%}; list the corners in order round the shape"
        )
    return [_without_specks(part, allowed * area) for part in mended]


def polygons_of(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons with area among the parts of a geometry."""
    parts = [geometry]
    # Collections may hold collections; they are taken apart until only single geometries are left.
    while any(hasattr(part, "geoms") for part in parts):
        parts = [inner for part in parts for inner in getattr(part, "geoms", [part])]
    return [part for part in parts if isinstance(part, shapely.Polygon) and part.area > 0.0]


def _is_tangled(polygon: shapely.Polygon) -> bool:
    """Whether so many pairs of edges meet besides neighbours that a repair, which takes their square, would not end."""
    outlines = [_without_repeats(shapely.get_coordinates(ring)) for ring in (polygon.exterior, *polygon.interiors)]
    edges = np.asarray(
        shapely.linestrings(np.concatenate([np.stack((ring[:-1], ring[1:]), axis=1) for ring in outlines]))
    )
    tree = STRtree(edges)
    at_once = max(1, IMPORT.most_nested // len(edges))
    # Each edge meets itself and its two neighbours, and every other pair is met from both sides.
    left = 3 * len(edges) + 2 * _MOST_CROSSINGS
    boxed = left + IMPORT.most_nested
    for k in range(0, len(edges), at_once):
        ours, theirs = tree.query(edges[k : k + at_once])
        boxed -= len(ours)
        left -= int(np.count_nonzero(shapely.intersects(edges[k + ours], edges[theirs])))
        if left < 0 or boxed < 0:
            return True
    return False


def _without_repeats(ring: FloatArray) -> FloatArray:
    """A closed ring without corners that are where the one before is; at least the first and the last are left."""
    moves = np.any(ring[1:] != ring[:-1], axis=1)
    moves[-1] = True
    return ring[np.concatenate(([True], moves))]


def _without_specks(polygon: shapely.Polygon, area: float) -> shapely.Polygon:
    return shapely.Polygon(polygon.exterior, [ring for ring in polygon.interiors if shapely.Polygon(ring).area > area])


def _turn(ring: FloatArray) -> int:
    """1 for a counter-clockwise ring, -1 for a clockwise one: the winding that the rule ``nonzero`` counts."""
    return 1 if shapely.LinearRing(ring).is_ccw else -1


def _sentence(why: str) -> str:
    """GEOS's reason, for example ``Self-intersection[1 2]``, in plain words."""
    place = re.search(r"\[(\S+) (\S+)\]", why)
    where = f" at ({float(place[1]):.6g}, {float(place[2]):.6g})" if place else ""
    reason = why.split("[", maxsplit=1)[0].strip().lower()
    words = {"self-intersection": "crosses itself", "ring self-intersection": "touches itself"}
    return f"{words.get(reason, f'is not a polygon ({reason})')}{where}"


@dataclass(frozen=True)
class Piece:
    """A polyline of a drawing.

    Attributes:
        points: shape (k, 2); a closed piece does not repeat its first point.
        closed: whether the last point is joined to the first.
        curved: whether it is a flattened curve.
        half_width: half the width with which it is drawn.
        name: of the shape that it becomes; a chain has that of its first piece.
    """

    points: FloatArray
    closed: bool = False
    curved: bool = False
    half_width: float = 0.0
    name: str = ""


def joined_pieces(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """Join open pieces where exactly two ends meet; where more meet, chains end.

    Args:
        pieces: open pieces, each of some length; what is drawn twice, whole or in parts, counts once.
        gap: ends no farther apart than this meet; a short leg then bridges them.

    Returns:
        Chains in the order of their first pieces; a loop is a closed piece.

    Raises:
        ProblemError: ends lie so densely that it cannot be told which of them meet.
    """
    pieces = _drawn_once(pieces, gap)
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


def _drawn_once(pieces: Sequence[Piece], gap: float) -> list[Piece]:
    """The pieces that lie on no longer ones, and of equal ones the first."""
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
    """The points, but those joined by steps of at most ``gap`` all at the first of them; shape as given."""
    # Equal points are one place, however many there are; pairs are sought among different ones only.
    places, place_of = np.unique(points, axis=0, return_inverse=True)
    tree = cKDTree(places)
    if tree.count_neighbors(tree, gap) > _MOST_MEETING * len(places):
        raise ProblemError("open lines end in crowds too dense to tell which of them meet; join them, or simplify")
    pairs = tree.query_pairs(gap, output_type="ndarray")
    # Pairs of near points are the edges of a graph; its connected components are the places that meet.
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    group = connected_components(graph, directed=False)[1]
    first = np.unique(group, return_index=True)[1]
    return np.asarray(places[first[group]][place_of.reshape(-1)])
