"""Obstacles in the plane from the shapes of a drawing, and their tables in a problem file."""

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.core.polygons import mitred
from ccm_opt.io.outlines import filled, polygon_parts
from ccm_opt.io.scene_tables import ObstacleTable, WallTable
from ccm_opt.io.shape_tables import CircleTable
from ccm_opt.io.shapes import Shape
from ccm_opt.scene.workspace import Obstacle, PlaneShape

_CORNER_REACH = 1.9
"""Distance from a sharp corner at which the offset corner is cut off, in units of the offset. Derived: below 2, which
keeps the corner within the tolerance."""
_FLAT = 1e-12
"""Thickness of an outline, relative to its length and coordinates, up to which it counts as a line. Derived: about 5000
rounding errors."""


def obstacles_of(shape: Shape, growth: float, wall_thickness: float) -> list[Obstacle]:
    """Return a shape of a drawing as planar obstacles.

    Args:
        shape: the shape, in the coordinates and unit of the obstacles.
        growth: maximum distance between flattened and exact curves, by which shapes with curves are offset outward.
        wall_thickness: minimum thickness of open lines.

    Returns:
        At least one obstacle, all with the name of the shape.

    Raises:
        ProblemError: the shape cannot be an obstacle.
    """
    growth = growth if shape.curved else 0.0
    if shape.is_circle:
        return [Obstacle(shape.name, PlaneShape(shapely.Point(shape.rings[0]), shape.half_width))]
    if shape.drawn == "line":
        rounding = max(shape.half_width, 0.5 * wall_thickness) + growth
        return [Obstacle(shape.name, PlaneShape(shapely.LineString(shape.rings[0]), rounding))]
    # Chords cut off outward bulges; growing by as much contains the true curve again.
    grow = shape.half_width + growth
    polygons = filled(shape.rings, shape.rule)
    if grow > 0.0:
        # Mitred corners do not add vertices, but a very sharp one would reach far beyond the growth.
        whole = shapely.MultiPolygon(polygons)
        polygons = polygon_parts(shapely.intersection(mitred(whole, grow), whole.buffer(_CORNER_REACH * grow)))
    return [Obstacle(shape.name, PlaneShape(polygon)) for polygon in polygons]


def divided(shape: Shape, largest: float) -> list[Shape]:
    """Return a shape split into its area and, as separate lines, its rings without area.

    The list is empty if all points of the shape coincide.

    Args:
        shape: the shape, in the coordinates of the obstacles.
        largest: maximum absolute coordinate.

    Raises:
        ProblemError: the shape has no outline, or coordinates or a radius that are not finite, too large or negative.
    """
    if not shape.rings:
        raise ProblemError("it has no outline")
    worst = float(np.max(np.abs(np.append(np.concatenate(shape.rings), shape.half_width))))
    if not math.isfinite(worst):
        raise ProblemError("it has a coordinate that is not a finite number")
    if worst > largest:
        raise ProblemError(f"it has a coordinate of {worst:.6g}; expected at most {largest:g}; check the scale")
    if shape.half_width < 0.0:
        raise ProblemError(f"it is a circle of radius {shape.half_width:g}; expected a positive radius")
    if shape.is_circle:
        return [shape] if shape.half_width > 0.0 else []
    if shape.drawn == "line":
        return [shape] if np.any(shape.rings[0] != shape.rings[0][0]) else []
    flat = [_is_flat(ring) for ring in shape.rings]
    if shape.rule == "polygon" and flat[0]:
        flat = [True] * len(flat)
    full = tuple(ring for ring, is_line in zip(shape.rings, flat, strict=True) if not is_line)
    lines = [
        replace(shape, rings=(np.vstack((ring, ring[:1])),), drawn="line")
        for ring, is_line in zip(shape.rings, flat, strict=True)
        if is_line and np.any(ring != ring[0])
    ]
    return [*([replace(shape, rings=full)] if full else []), *lines]


def _is_flat(ring: FloatArray) -> bool:
    """Return whether a ring, shape (k, 2), is so thin that rounding would decide which points lie inside it."""
    hull = shapely.MultiPoint(ring).convex_hull
    return bool(hull.area <= _FLAT * (hull.length + float(np.abs(ring).max())) * hull.length)


def with_unique_names(obstacles: Iterable[Obstacle], taken: Collection[str] = ()) -> tuple[Obstacle, ...]:
    """Return obstacles with unique names: a name that is already taken gets the first free number from 2 appended.

    Args:
        obstacles: the obstacles.
        taken: names of other obstacles.
    """
    used = set(taken)
    result = []
    # One running counter per name, so that ten thousand equal names do not take quadratic time.
    counters: dict[str, Iterator[int]] = {}
    for obstacle in obstacles:
        name = obstacle.name
        if name in used:
            numbers = counters.setdefault(obstacle.name, count(2))
            name = next(candidate for k in numbers if (candidate := f"{obstacle.name} {k}") not in used)
        # Generated names are taken as well: "wall", "wall", "wall 2" must not give "wall 2" twice.
        used.add(name)
        result.append(replace(obstacle, name=name))
    return tuple(result)


def obstacle_table(obstacle: Obstacle, unit: LengthUnit = "m") -> dict[str, object]:
    """Return a planar obstacle as a table of a problem file, with lengths in ``unit``.

    Raises:
        ProblemError: the obstacle cannot be expressed in a problem file.
    """
    core = obstacle.core
    entries: dict[str, object] = {}
    if isinstance(core, shapely.LineString):
        entries["wall"] = WallTable.from_object(None, points=corner_list(core), thickness=2.0 * obstacle.rounding)
    elif isinstance(core, shapely.Polygon) and obstacle.rounding == 0.0:
        entries = {
            "polygon": corner_list(core.exterior)[:-1],
            "holes": [corner_list(ring)[:-1] for ring in core.interiors] or None,
        }
    elif isinstance(core, shapely.Point) and obstacle.rounding > 0.0:
        entries["circle"] = CircleTable.from_object(None, center=corner_list(core)[0], radius=obstacle.rounding)
    elif isinstance(core, shapely.MultiPoint) and obstacle.rounding > 0.0:
        entries = {"points": corner_list(core), "point_radius": obstacle.rounding}
    else:  # a rounded polygon has no table of its own, and a point without rounding is no obstacle
        raise ProblemError(
            f"obstacle '{obstacle.name}', a {type(core).__name__} with rounding {obstacle.rounding:g} m, "
            "cannot be written to a problem file; expected a polygon without rounding, points with "
            "rounding, or a line"
        )
    return ObstacleTable.from_object(obstacle, **entries).written(unit)


def corner_list(geometry: shapely.Geometry) -> list[list[float]]:
    """Return the points of a planar geometry as lists of their two coordinates [m]."""
    points: list[list[float]] = shapely.get_coordinates(geometry).tolist()
    return points
