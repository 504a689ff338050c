"""From shapes of a drawing to obstacles: grown by what flattening cut off, and named so that no two names are equal."""

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.found_shapes import Disc, Line, Region, Shape
from ccm_opt.files.scene_import.import_settings import IMPORT, ImportSettings
from ccm_opt.files.scene_import.rings import filled, polygons_of
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.mitred import mitred

_FLAT = 1e-12
"""Outlines thinner than this share of their length and coordinates are lines. Derived: some 5000 roundings."""


def obstacles_of(
    shape: Shape, growth: float, wall_thickness: float, settings: ImportSettings = IMPORT
) -> list[Obstacle]:
    """The obstacles that a placed shape stands for.

    Args:
        shape: in the coordinates of the result.
        growth: distance between flattened curves and the true ones; whatever is curved grows by it.
        wall_thickness: least thickness of open lines.
        settings: tolerances of the import.

    Returns:
        At least one obstacle, all of the shape's name.

    Raises:
        ProblemError: the shape cannot be an obstacle.
    """
    if isinstance(shape, Disc):
        return [Obstacle(shape.name, shapely.Point(shape.center), shape.radius)]
    if isinstance(shape, Line):
        rounding = max(shape.half_width, 0.5 * wall_thickness) + (growth if shape.curved else 0.0)
        return [Obstacle(shape.name, shapely.LineString(shape.points), rounding)]
    # Chords cut off what bulges outwards; growing by as much holds the true curve inside again.
    grow = shape.half_width + (growth if shape.curved else 0.0)
    polygons = filled(shape.rings, shape.rule, settings)
    if grow > 0.0:
        polygons = _grown(shapely.MultiPolygon(polygons), grow, settings.corner_reach)
    return [Obstacle(shape.name, polygon) for polygon in polygons]


def divided(shape: Shape, largest: float) -> list[Shape]:
    """A placed shape, its rings without area as lines of their own; none where it has no extent.

    Args:
        shape: in the coordinates of the result.
        largest: coordinate that is allowed.

    Raises:
        ProblemError: it has numbers that cannot be used.
    """
    _check_coordinates(shape, largest)
    if isinstance(shape, Disc):
        return [shape] if shape.radius > 0.0 else []
    if isinstance(shape, Line):
        return [shape] if np.any(shape.points != shape.points[0]) else []
    flat = [_is_flat(ring) for ring in shape.rings]
    if shape.rule == "polygon" and flat[0]:
        flat = [True] * len(flat)
    full = tuple(ring for ring, is_line in zip(shape.rings, flat, strict=True) if not is_line)
    lines = [
        Line(shape.name, np.vstack((ring, ring[:1])), shape.curved, shape.half_width, shape.layer)
        for ring, is_line in zip(shape.rings, flat, strict=True)
        if is_line and np.any(ring != ring[0])
    ]
    return [*([replace(shape, rings=full)] if full else []), *lines]


def _is_flat(ring: FloatArray) -> bool:
    """Whether a ring is so thin that rounding decides what is inside."""
    hull = shapely.MultiPoint(ring).convex_hull
    return bool(hull.area <= _FLAT * (hull.length + float(np.abs(ring).max())) * hull.length)


def with_unique_names(obstacles: Iterable[Obstacle], taken: Collection[str] = ()) -> tuple[Obstacle, ...]:
    """The same obstacles; a name that is taken gets the first free number from 2 behind it."""
    used = set(taken)
    result = []
    # A counter for each name goes on where it stopped, so that ten thousand equal names take no longer than others.
    counters: dict[str, Iterator[int]] = {}
    for obstacle in obstacles:
        name = obstacle.name
        if name in used:
            numbers = counters.setdefault(obstacle.name, count(2))
            name = next(candidate for k in numbers if (candidate := f"{obstacle.name} {k}") not in used)
        # New names count as well: "wall", "wall", "wall 2" must not give "wall 2" twice.
        used.add(name)
        result.append(replace(obstacle, name=name))
    return tuple(result)


def _grown(polygons: shapely.MultiPolygon, growth: float, corner_reach: float) -> list[shapely.Polygon]:
    """Polygons that hold every point within ``growth``; corners stay corners, but for very sharp ones."""
    # Mitred corners keep the number of vertices, but a very sharp one would reach far beyond the growth.
    return polygons_of(shapely.intersection(mitred(polygons, growth), polygons.buffer(corner_reach * growth)))


def _check_coordinates(shape: Shape, largest: float) -> None:
    if isinstance(shape, Region) and not shape.rings:
        raise ProblemError("it has no outline")
    worst = float(np.max(np.abs(_numbers(shape))))
    if not math.isfinite(worst):
        raise ProblemError("it has a coordinate that is not a finite number")
    if worst > largest:
        raise ProblemError(f"it has a coordinate of {worst:.6g}; expected at most {largest:g}; check the scale")
    if isinstance(shape, Disc) and shape.radius < 0.0:
        raise ProblemError(f"it is a circle of radius {shape.radius:g}; expected a positive radius")


def _numbers(shape: Shape) -> FloatArray:
    """All coordinates and lengths of a shape."""
    if isinstance(shape, Disc):
        return np.append(shape.center, shape.radius)
    points = shape.points if isinstance(shape, Line) else np.concatenate(shape.rings)
    return np.append(points, shape.half_width)
