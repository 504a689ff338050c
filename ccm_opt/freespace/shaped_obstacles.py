"""Obstacles from shapely's geometries: polygons with holes, several at once, lines, buffered or not."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.errors import ProblemError
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.ground.arguments import Arguments
from ccm_opt.ground.expected import in_words
from ccm_opt.ground.length_units import LengthUnit

Shapes: TypeAlias = shapely.Geometry | Obstacle | Sequence[shapely.Geometry | Obstacle] | Mapping[str, shapely.Geometry]
"""One geometry, several, or several with names."""
WANTED = "a polygon, a line, or several of them"


def obstacles_of(shapes: Shapes, *, unit: LengthUnit = "m") -> tuple[Obstacle, ...]:
    """Obstacles from shapely's geometries.

    A polygon is an obstacle, its holes are free. A line string is a wall without thickness; buffered, it is a polygon.
    What has several parts gives an obstacle for each, numbered behind the name. Heights (z) are left out. A geometry
    counts as it is: round ends and discs that shapely has buffered are polygons inside the true arcs.

    Args:
        shapes: a geometry, a list of them, called "obstacle 1" and so on, or names with geometries.
        unit: of the coordinates: "m", "mm" or "in".

    Returns:
        The obstacles, in metres; obstacles among the shapes, which are in metres, as they are.

    Raises:
        ProblemError: with all that is wrong: what is no geometry, is empty, has no area, crosses itself.
    """
    given = Arguments("these obstacles", unit)
    found: list[Obstacle] = []
    for name, shape in named_shapes(shapes, given):
        try:
            found += [shape] if isinstance(shape, Obstacle) else _in_metres(parts_of(name, shape), given.metres)
        except ProblemError as error:
            given.must(holds=False, line=str(error))
    given.refuse()
    return tuple(found)


def named_shapes(shapes: object, given: Arguments, first: int = 1) -> Iterator[tuple[str, object]]:
    """Every shape with its name, or a number from the first on; what is no list and no table of shapes is noted."""
    if isinstance(shapes, Mapping):
        yield from ((str(name), shape) for name, shape in shapes.items())
    elif isinstance(shapes, (shapely.Geometry, Obstacle)):
        yield f"obstacle {first}", shapes
    elif isinstance(shapes, (Sequence, np.ndarray)) and not isinstance(shapes, (str, bytes)):
        yield from ((f"obstacle {k}", shape) for k, shape in enumerate(shapes, start=first))
    else:
        given.must(holds=False, line=f"expected a geometry, a list of them, or names with them, got {in_words(shapes)}")


def parts_of(name: str, shape: object) -> list[Obstacle]:
    """The obstacles that a geometry is, in its own unit.

    Raises:
        ProblemError: it is none, or no usable one.
    """
    if not isinstance(shape, shapely.Geometry):
        raise ProblemError(f"'{name}': expected a geometry of shapely, {WANTED}, got {in_words(shape)}")
    kind = type(shape).__name__
    flat = shapely.force_2d(shape)
    if shapely.is_empty(flat):
        raise ProblemError(f"'{name}': the {kind} is empty; expected {WANTED}")
    if not np.all(np.isfinite(shapely.get_coordinates(flat))):
        raise ProblemError(f"'{name}': the {kind} has a coordinate that is not finite")
    if not shapely.is_valid(flat):
        raise ProblemError(f"'{name}': the {kind} is not valid: {shapely.is_valid_reason(flat)}")
    parts = _flattened(flat)
    names = [name] if len(parts) == 1 else [f"{name} {k}" for k in range(1, len(parts) + 1)]
    return [_obstacle(own, part) for own, part in zip(names, parts, strict=True)]


def _flattened(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """Geometries without collections in each other."""
    if not hasattr(shape, "geoms"):
        return [shape]
    return [part for each in shape.geoms for part in _flattened(each)]


def _obstacle(name: str, part: shapely.Geometry) -> Obstacle:
    if isinstance(part, shapely.Point):
        raise ProblemError(f"'{name}': a Point has no size; expected {WANTED}; point.buffer(radius) is a disc")
    if isinstance(part, shapely.LinearRing):
        return Obstacle(name, shapely.LineString(part.coords))
    return Obstacle(name, part)


def _in_metres(obstacles: Sequence[Obstacle], metres: float) -> list[Obstacle]:
    """Obstacles without rounding in a unit of so many metres, in metres."""
    return [replace(each, core=shapely.transform(each.core, lambda points: metres * points)) for each in obstacles]
