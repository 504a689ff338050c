"""The workspace in the plane: boundary, obstacles and clearance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arguments import Arguments
from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.expected import in_words
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.errors import ProblemError
from ccm_opt.scene.walls import Walls, WallSegments


@dataclass(frozen=True)
class Obstacle:
    """One obstacle, the set of points within ``rounding`` of ``core``; exact for every kind in a problem file.

    Attributes:
        name: the user's name for it, used in every message.
        core: a polygon (polygon, box), a point (circle) or a line string (wall) [m].
        rounding: radius of the disc that sweeps the core [m]; a circle's radius, half a wall's thickness, else 0.
    """

    name: str
    core: shapely.Geometry
    rounding: float = 0.0

    def outline(self, grow: float = 0.0, quad_segs: int = 8) -> shapely.Geometry:
        """The obstacle grown by ``grow`` [m], as a geometry that *contains* it (arcs are circumscribed)."""
        radius = self.rounding + grow
        if radius <= 0.0:
            return self.core
        circumscribed = radius / np.cos(np.pi / (4 * quad_segs))
        grown: shapely.Geometry = shapely.buffer(self.core, circumscribed, quad_segs=quad_segs)
        return grown


BOUNDARY_NAME = "workspace boundary"
_LOOKED_AT_FIRST = 4
"""Walls whose distance says which others may be nearer."""


@dataclass(frozen=True)
class Workspace:
    """The room the arm moves in.

    Attributes:
        boundary: simple polygon [m]; its edge is a wall like any obstacle.
        obstacles: the obstacles, in the order of the file.
        clearance: least gap kept between the arm's surface and every obstacle [m].
    """

    boundary: shapely.Polygon
    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.0

    def middle_of(self, name: str) -> FloatArray:
        """Centre of an obstacle of a name, shape (2,) [m]."""
        core = next(obstacle.core for obstacle in self.obstacles if obstacle.name == name)
        return np.asarray(shapely.get_coordinates(shapely.centroid(core))[0], dtype=np.float64)

    def with_moved(self, name: str, by: FloatArray) -> "Workspace":
        """The room with the obstacles of a name moved by so much, shape (2,) [m]."""

        def moved(obstacle: Obstacle) -> Obstacle:
            return replace(obstacle, core=shapely.transform(obstacle.core, lambda points: points + by))

        obstacles = tuple(moved(each) if each.name == name else each for each in self.obstacles)
        return replace(self, obstacles=obstacles)

    @cached_property
    def walls(self) -> tuple[Obstacle, ...]:
        """All that the arm must keep away from, the obstacles first, then the boundary's edge."""
        return (*self.obstacles, Obstacle(BOUNDARY_NAME, shapely.LinearRing(self.boundary.exterior.coords)))

    @cached_property
    def flat_walls(self) -> Walls:
        """The same as arrays of edges and vertices, in the same order."""
        return Walls.of(self.walls)

    @cached_property
    def wall_segments(self) -> WallSegments:
        """The same as one list of segments."""
        return WallSegments.of(self.walls, self.flat_walls)

    @cached_property
    def _cores(self) -> npt.NDArray[np.object_]:
        """Cores of all walls, shape (walls,)."""
        return np.array([wall.core for wall in self.walls], dtype=np.object_)

    @cached_property
    def _roundings(self) -> FloatArray:
        """Roundings of all walls, shape (walls,) [m]."""
        return np.array([wall.rounding for wall in self.walls])

    @cached_property
    def _boxes(self) -> FloatArray:
        """Bounds of the cores of all walls: x low, y low, x high, y high, shape (walls, 4) [m]."""
        return np.asarray(shapely.bounds(self._cores))

    def apart(self, shape: shapely.Geometry) -> FloatArray:
        """Distance of a shape from every wall, in the order of the walls, shape (walls,) [m]."""
        return np.asarray(shapely.distance(self._cores, shape)) - self._roundings

    def nearest(self, shape: shapely.Geometry) -> tuple[int, float]:
        """Number of the wall that is nearest to a shape, and its distance [m]; few outlines are looked at."""
        least = self._least_apart(shape)
        # The boundary's box holds everything, so that its bound says nothing: a few of the lowest do.
        first = np.argsort(least, kind="stable")[:_LOOKED_AT_FIRST]
        best = np.min(shapely.distance(self._cores[first], shape) - self._roundings[first])
        maybe = np.flatnonzero(least <= best)
        gaps = shapely.distance(self._cores[maybe], shape) - self._roundings[maybe]
        nearest = int(np.argmin(gaps))
        return int(maybe[nearest]), float(gaps[nearest])

    def _least_apart(self, shape: shapely.Geometry) -> FloatArray:
        """Lower bounds of the distances of a shape from the walls, by bounding boxes, shape (walls,) [m]."""
        low_x, low_y, high_x, high_y = shapely.bounds(shape)
        boxes = self._boxes
        across = np.maximum(np.maximum(boxes[:, 0] - high_x, low_x - boxes[:, 2]), 0.0)
        along = np.maximum(np.maximum(boxes[:, 1] - high_y, low_y - boxes[:, 3]), 0.0)
        # Rounding: a bound may be a hair above what shapely measures.
        return np.asarray(np.hypot(across, along) * (1.0 - TINY) - self._roundings)

    def near(self, shape: shapely.Geometry, distance: float) -> "Workspace":
        """The room with those obstacles alone that come within a distance [m] of a shape."""
        if not self.obstacles:
            return self
        maybe = np.flatnonzero(self._least_apart(shape)[: len(self.obstacles)] <= distance)
        gaps = np.asarray(shapely.distance(self._cores[maybe], shape)) - self._roundings[maybe]
        kept = tuple(self.obstacles[k] for k in maybe[gaps <= distance])
        return self if len(kept) == len(self.obstacles) else replace(self, obstacles=kept)


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
