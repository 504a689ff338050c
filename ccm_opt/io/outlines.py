"""Interpretation of the closed outlines of a drawing, and repair of the polygons that they enclose.

Depending on the key ``workspace.closed`` of a problem file, closed outlines are solids with holes, or walls, or the
largest one bounds the workspace.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely import STRtree

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.polygons import mitred
from ccm_opt.io.shapes import IMPORT, FillRule, Shape, flatten_arc

_SAME = 1e-6
"""Distance between two outlines, relative to the drawing's extent, up to which they count as repetitions."""

_ROUND = 1e-7
"""Minimum chord deviation of the polygon of a circle, relative to its radius; the polygon then has 7000 corners."""


def as_walls(shapes: Sequence[Shape], distance: float) -> list[Shape]:
    """Return shapes with every closed outline turned into a line along it; lines and areas are unchanged.

    Args:
        shapes: shapes of a drawing.
        distance: maximum distance between a circle and its polygon.
    """
    found: list[Shape] = []
    for shape in shapes:
        if shape.drawn in {"line", "area"}:
            found.append(shape)
            continue
        found += [
            replace(part, rings=(np.vstack((part.rings[0], part.rings[0][:1])),), drawn="line")
            for part in _apart(shape, distance)
        ]
    return found


def with_holes(shapes: Sequence[Shape], distance: float) -> list[Shape]:
    """Return shapes in which unfilled outlines inside another outline of their layer are holes in that outline.

    An outline within a hole is solid again. Outlines that touch or cross each other are all solid.

    Args:
        shapes: shapes, in one unit of length.
        distance: maximum distance between a circle and its polygon.

    Raises:
        ProblemError: too many outlines lie within each other.
    """
    layers: dict[str, list[tuple[int, Shape]]] = {}
    for k, shape in enumerate(shapes):
        if shape.drawn == "outline":
            layers.setdefault(shape.layer, []).extend((k, part) for part in _apart(shape, distance))
    found: list[list[Shape]] = [[shape] for shape in shapes]
    for parts in layers.values():
        for k, _ in parts:
            found[k] = []
        for k, solid in _nested(parts):
            # A circle without holes stays a true one.
            untouched = len(solid.rings) == 1 and shapes[k].is_circle
            found[k].append(shapes[k] if untouched else solid)
    return [shape for group in found for shape in group]


def split_off_boundary(shapes: Sequence[Shape], growth: float, distance: float) -> tuple[shapely.Polygon, list[Shape]]:
    """Return the largest closed outline of a drawing as the boundary of the workspace, and the other shapes.

    Args:
        shapes: shapes of a drawing.
        growth: chord deviation of curves; a curved outline is offset inward by this and by half its line width.
        distance: maximum distance between a circle and its polygon.

    Raises:
        ProblemError: there is no closed outline, or the largest one is not a simple polygon.
    """
    parts = [part for shape in shapes if shape.drawn not in {"line", "area"} for part in _apart(shape, distance)]
    parts = [parts[k] for k in _without_duplicates(np.array([_simple(part.rings[0]) for part in parts]))]
    areas = [abs(shapely.Polygon(part.rings[0]).area) if len(part.rings[0]) > 2 else 0.0 for part in parts]
    if not areas or max(areas) == 0.0:
        raise ProblemError('it has no closed outline that can bound the workspace; give bounds, and closed = "solid"')
    taken = int(np.argmax(areas))
    outline = parts[taken]
    polygons = repaired(shapely.Polygon(outline.rings[0]))
    shrunk = mitred(polygons[0], -(outline.half_width + (growth if outline.curved else 0.0)))
    if len(polygons) > 1 or not isinstance(shrunk, shapely.Polygon) or shrunk.is_empty or shrunk.interiors:
        raise ProblemError(
            f"its largest outline '{outline.name}' is not a simple polygon and cannot bound the workspace"
        )
    kept = [shape for shape in shapes if shape.drawn in {"line", "area"}]
    others = [replace(part, drawn="outline") for k, part in enumerate(parts) if k != taken]
    return shrunk, [*others, *kept]


def _apart(shape: Shape, distance: float) -> list[Shape]:
    """Return each ring of a shape as a separate shape, a circle as a polygon.

    The polygon of a very large circle deviates from it by more than ``distance``; the excess deviation is added to the
    shape's line width.
    """
    if shape.is_circle:
        coarse = max(distance, _ROUND * shape.half_width)
        ring = flatten_arc(shape.rings[0][0], shape.half_width, 0.0, 2.0 * np.pi, coarse)[:-1]
        return [replace(shape, rings=(ring,), rule="nonzero", curved=True, half_width=coarse - distance)]
    return [replace(shape, rings=(ring,)) for ring in shape.rings]


def _nested(parts: Sequence[tuple[int, Shape]]) -> list[tuple[int, Shape]]:
    """Return the solids among the closed outlines of one layer, each with its holes.

    Args:
        parts: outlines, each with the index of the shape to which it belongs.

    Returns:
        Solids, each with the index of its outer outline's shape.
    """
    polygons = np.array([_simple(part.rings[0]) for _, part in parts])
    once = _without_duplicates(polygons)
    parts = [parts[k] for k in once]
    polygons = polygons[once]
    outer, inner = _within(polygons)
    depth = np.bincount(inner, minlength=len(parts))
    found = []
    for k, (owner, part) in enumerate(parts):
        if depth[k] % 2 == 0:
            holes = [parts[j][1] for j in inner[outer == k] if depth[j] == depth[k] + 1]
            members = [part, *holes]
            rings = tuple(member.rings[0] for member in members)
            curved = any(member.curved for member in members)
            half_width = max(member.half_width for member in members)
            solid = replace(part, rings=rings, rule="evenodd", curved=curved, half_width=half_width)
            found.append((owner, solid if holes else part))
    return found


def _simple(ring: FloatArray) -> shapely.Polygon:
    """Return the polygon of a ring of shape (k, 2); an empty polygon if the ring is invalid or has no area."""
    polygon = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
    return polygon if polygon.is_valid and polygon.area > 0.0 else shapely.Polygon()


def _without_duplicates(polygons: np.ndarray) -> list[int]:
    """Return the indices of the polygons whose outline does not repeat that of an earlier polygon."""
    boxes = shapely.bounds(polygons)
    whole = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    if len(whole) == 0:
        return list(range(len(polygons)))
    same = _SAME * float(np.ptp(boxes[whole]))
    places, of = np.unique(boxes[whole], axis=0, return_inverse=True)
    # Of equal boxes the first stands for all; others are compared with those whose boxes are nearly equal.
    groups: dict[int, list[int]] = {}
    for k, place in zip(whole.tolist(), of.reshape(-1).tolist(), strict=True):
        groups.setdefault(place, []).append(k)
    tree = cKDTree(places)
    lost: set[int] = set()
    for place, box in enumerate(places):
        rivals = sorted(k for neighbour in tree.query_ball_point(box, same) for k in groups[neighbour])
        for k in groups[place]:
            earlier = (j for j in rivals if j < k and j not in lost)
            ring = polygons[k].exterior
            if any(shapely.covers(shapely.buffer(polygons[j].exterior, same), ring) for j in earlier):
                lost.add(k)
    return [k for k in range(len(polygons)) if k not in lost]


def _within(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of polygons of which the second lies inside the first without contact.

    Returns:
        Indices of the outer and of the inner polygon of each pair, both of shape (pairs,).

    Raises:
        ProblemError: there are too many pairs.
    """
    tree = shapely.STRtree(polygons)
    at_once = max(1, IMPORT.most_nested // len(polygons))
    pairs = []
    left = IMPORT.most_nested
    for k in range(0, len(polygons), at_once):
        boxed = tree.query(polygons[k : k + at_once], predicate="contains_properly")
        left -= boxed.shape[1]
        if left < 0:
            raise ProblemError("it has too many nested outlines; draw them on several layers, or hatch them")
        pairs.append(boxed + np.array([[k], [0]]))
    outer, inner = np.concatenate(pairs, axis=1)
    return outer, inner


_MOST_CROSSINGS = 1000
"""Maximum number of intersecting pairs of non-adjacent edges for which an outline is repaired. Measured: 0.5 s at this
number, ten seconds at four times as many."""
_REPAIR_SHARE = 1e-3
"""Maximum change of the enclosed area by a repair, as a fraction of the area; a larger change means that another shape
was intended. Heuristic."""


def filled(rings: Sequence[FloatArray], rule: FillRule) -> list[shapely.Polygon]:
    """Return the polygons that a set of nested rings encloses under a fill rule.

    Args:
        rings: points of each ring, shape (k, 2), k ≥ 3.
        rule: fill rule for rings within rings, see ``Shape.rule``.

    Returns:
        Valid polygons with area, at least one; holes are kept.

    Raises:
        ProblemError: a ring encloses no area, or crosses itself so that a repair would change its area too much.
    """
    if rule == "polygon":
        return repaired(shapely.Polygon(rings[0], rings[1:]))
    solids = [shapely.MultiPolygon(repaired(shapely.Polygon(ring))) for ring in rings]
    # 1 for a counter-clockwise ring, -1 for a clockwise one: the winding that the rule ``nonzero`` counts.
    turns = np.array([1 if shapely.LinearRing(ring).is_ccw else -1 for ring in rings])
    boxed = STRtree(solids).query(solids)
    if boxed.shape[1] > IMPORT.most_nested:
        raise ProblemError(f"it has {len(rings)} nested rings, too many to fill; draw them as several shapes")
    # Groups of rings with disjoint boxes are independent and filled separately.
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
        found += polygon_parts(_filled_inwards(solids, around, inside, list(group)))
    return found


def _filled_inwards(
    solids: Sequence[shapely.MultiPolygon], around: IntArray, inside: BoolArray, order: Sequence[int]
) -> shapely.Geometry:
    """Return the area enclosed by nested rings: filled or cleared one nesting level after the other, outermost first.

    Args:
        solids: area enclosed by each of the n rings alone.
        around: number of rings that contain each ring, itself included, shape (n,).
        inside: whether the area just inside each ring is filled, shape (n,).
        order: indices of the rings, sorted by ``around`` and then by ``inside``.
    """
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
    """Return valid polygons that cover the area of a polygon whose outline may cross itself.

    Args:
        polygon: any polygon.

    Returns:
        At least one valid polygon with area. Together they differ from the given polygon by at most a thousandth of its
        area. Holes smaller than that, which a repair may leave at a crossing, are filled.

    Raises:
        ProblemError: the polygon has no area, crosses itself too often, or would change too much by a repair.
    """
    if polygon.is_valid and polygon.area > 0.0:
        return [polygon]
    why = shapely.is_valid_reason(polygon)
    if _is_tangled(polygon):
        raise ProblemError(
            f"the outline crosses or touches itself more than {_MOST_CROSSINGS} times, too often to be "
            "repaired; list the corners in order around the shape"
        )
    # GEOS keeps both halves of a bow tie, so a change of area reveals a repair of more than a small slip.
    mended = polygon_parts(shapely.make_valid(polygon))
    area = sum(part.area for part in mended)
    if area == 0.0:
        raise ProblemError("the outline encloses no area; expected at least three corners that are not collinear")
    allowed = _REPAIR_SHARE
    if abs(area - polygon.area) > allowed * area:
        raise ProblemError(
            f"the outline {_sentence(why)}; a repair would change its area by "
            f"{abs(area - polygon.area) / area:.1%}, more than the {allowed:.1%} allowed; list the corners "
            "in order around the shape"
        )
    specks = allowed * area
    kept = [[ring for ring in part.interiors if shapely.Polygon(ring).area > specks] for part in mended]
    return [shapely.Polygon(part.exterior, holes) for part, holes in zip(mended, kept, strict=True)]


def polygon_parts(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the polygons of non-zero area within a geometry, which may be a nested collection."""
    parts = [geometry]
    # Collections may hold collections; they are taken apart until only single geometries are left.
    while any(hasattr(part, "geoms") for part in parts):
        parts = [inner for part in parts for inner in getattr(part, "geoms", [part])]
    return [part for part in parts if isinstance(part, shapely.Polygon) and part.area > 0.0]


def _is_tangled(polygon: shapely.Polygon) -> bool:
    """Return whether more pairs of non-adjacent edges of a polygon intersect than a repair can handle in time."""
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
    """Return a closed ring without points equal to their predecessor; at least the first and the last point remain."""
    moves = np.any(ring[1:] != ring[:-1], axis=1)
    moves[-1] = True
    return ring[np.concatenate(([True], moves))]


def _sentence(why: str) -> str:
    """Return the reason of GEOS for an invalid polygon, for example ``Self-intersection[1 2]``, in plain words."""
    place = re.search(r"\[(\S+) (\S+)\]", why)
    where = f" at ({float(place[1]):.6g}, {float(place[2]):.6g})" if place else ""
    reason = why.split("[", maxsplit=1)[0].strip().lower()
    words = {"self-intersection": "crosses itself", "ring self-intersection": "touches itself"}
    return f"{words.get(reason, f'is not a polygon ({reason})')}{where}"
