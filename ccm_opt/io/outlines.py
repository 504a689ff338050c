"""What closed outlines of a drawing stand for: solids with holes, walls, or the room (the key ``workspace.closed``)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polygons import mitred
from ccm_opt.errors import ProblemError
from ccm_opt.io.dxf_entities import flatten_arc
from ccm_opt.io.found_shapes import IMPORT, Disc, Line, Region, Shape
from ccm_opt.io.rings import repaired

_SAME = 1e-6
"""Outlines nearer to each other than this, relative to the drawing's extent, are one that is drawn twice."""

_ROUND = 1e-7
"""Circles need not be nearer to their polygons than this, relative to their radius: 7000 corners."""


def as_walls(shapes: Sequence[Shape], distance: float) -> list[Shape]:
    """The shapes with all outlines as lines; areas stay what they are."""
    found: list[Shape] = []
    for shape in shapes:
        if isinstance(shape, Line) or shape.drawn == "area":
            found.append(shape)
            continue
        for part in _apart(shape, distance):
            ring = np.vstack((part.rings[0], part.rings[0][:1]))
            found.append(Line(part.name, ring, part.curved, part.half_width, part.layer))
    return found


def with_holes(shapes: Sequence[Shape], distance: float) -> list[Shape]:
    """The shapes with outlines that are drawn as lines alone, and lie within others of their layer, as holes of those.

    What lies in a hole is solid again. Outlines that touch or cross each other are solids all.

    Args:
        shapes: in one unit of length.
        distance: allowed between a circle and its polygon.

    Raises:
        ProblemError: too many outlines lie within each other.
    """
    layers: dict[str, list[tuple[int, Region]]] = {}
    for k, shape in enumerate(shapes):
        if not isinstance(shape, Line) and shape.drawn == "outline":
            layers.setdefault(shape.layer, []).extend((k, part) for part in _apart(shape, distance))
    found: list[list[Shape]] = [[shape] for shape in shapes]
    for parts in layers.values():
        for k, _ in parts:
            found[k] = []
        for k, solid in _nested(parts):
            # A circle without holes stays a true one.
            untouched = len(solid.rings) == 1 and isinstance(shapes[k], Disc)
            found[k].append(shapes[k] if untouched else solid)
    return [shape for group in found for shape in group]


def room_of(shapes: Sequence[Shape], growth: float, distance: float) -> tuple[shapely.Polygon, list[Shape]]:
    """The largest outline as a room, smaller by what its curves and its line may take, and the other shapes.

    Raises:
        ProblemError: there is no closed outline, or the largest is no simple polygon.
    """
    parts = [
        part
        for shape in shapes
        if not isinstance(shape, Line) and shape.drawn != "area"
        for part in _apart(shape, distance)
    ]
    parts = [parts[k] for k in _drawn_once(np.array([_simple(part.rings[0]) for part in parts]))]
    areas = [abs(shapely.Polygon(part.rings[0]).area) if len(part.rings[0]) > 2 else 0.0 for part in parts]
    if not areas or max(areas) == 0.0:
        raise ProblemError('it has no closed outline that could be the room; give bounds, and closed = "solid"')
    taken = int(np.argmax(areas))
    outline = parts[taken]
    polygons = repaired(shapely.Polygon(outline.rings[0]))
    shrunk = mitred(polygons[0], -(outline.half_width + (growth if outline.curved else 0.0)))
    if len(polygons) > 1 or not isinstance(shrunk, shapely.Polygon) or shrunk.is_empty or shrunk.interiors:
        raise ProblemError(f"its largest outline '{outline.name}' is no simple polygon and cannot be the room")
    kept: list[Shape] = [shape for shape in shapes if isinstance(shape, Line) or shape.drawn == "area"]
    others = [replace(part, drawn="outline") for k, part in enumerate(parts) if k != taken]
    return shrunk, [*others, *kept]


def _apart(shape: Disc | Region, distance: float) -> list[Region]:
    """The rings of a shape as shapes of their own, a circle as a polygon; a huge one as a coarser one that is wider."""
    if isinstance(shape, Disc):
        coarse = max(distance, _ROUND * shape.radius)
        ring = flatten_arc(shape.center, shape.radius, 0.0, 2.0 * np.pi, coarse)[:-1]
        whole = Region(shape.name, (ring,), "nonzero", layer=shape.layer, drawn=shape.drawn)
        return [replace(whole, curved=True, half_width=coarse - distance)]
    return [replace(shape, rings=(ring,)) for ring in shape.rings]


def _nested(parts: Sequence[tuple[int, Region]]) -> list[tuple[int, Region]]:
    """The solids among outlines, each with its holes, and what each was given with."""
    polygons = np.array([_simple(part.rings[0]) for _, part in parts])
    once = _drawn_once(polygons)
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
    """The polygon of a ring; an empty one, which lies within nothing, where it is tangled or has no area."""
    polygon = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
    return polygon if polygon.is_valid and polygon.area > 0.0 else shapely.Polygon()


def _drawn_once(polygons: np.ndarray) -> list[int]:
    """Numbers of the polygons that are no repetition of an earlier one."""
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
    """Pairs of polygons of which the second lies within the first without touching it."""
    tree = shapely.STRtree(polygons)
    at_once = max(1, IMPORT.most_nested // len(polygons))
    pairs = []
    left = IMPORT.most_nested
    for k in range(0, len(polygons), at_once):
        boxed = tree.query(polygons[k : k + at_once], predicate="contains_properly")
        left -= boxed.shape[1]
        if left < 0:
            raise ProblemError("it has too many outlines within outlines; draw them on several layers, or hatch them")
        pairs.append(boxed + np.array([[k], [0]]))
    outer, inner = np.concatenate(pairs, axis=1)
    return outer, inner
