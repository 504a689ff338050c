"""Workspace of an arm, in the plane or in space: room, obstacles and clearance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arguments import Arguments, in_words
from ccm_opt.core.arrays import TINY, FloatArray, in_space
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.scene.bodies import BOX_FACES, Body, MeshBody, box_corners
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.point_clouds import SPREAD_SHARE, BallRadii, thin_points
from ccm_opt.scene.surfaces import TriangleSoup, box_about
from ccm_opt.scene.walls import Walls, WallSegments


class Shape(Protocol):
    """Protocol of an obstacle's shape, a ``PlaneShape`` in the plane or a body in space."""

    @property
    def rounding(self) -> float:
        """Radius by which the core of the shape, or its triangles, are inflated [m]."""
        ...

    @property
    def middle(self) -> FloatArray:
        """Centre of the shape, shape (d,) [m]."""
        ...

    def moved(self, offset: FloatArray) -> "Shape":
        """Return the shape translated by a displacement, shape (d,) [m]."""
        ...


@dataclass(frozen=True)
class PlaneScan:
    """Record of a scan in the plane.

    Attributes:
        file: path of the file as given in the problem file.
        points_read: number of points in the file.
        radii: radii of the discs about the points that are kept.
        scale: length of one unit of the file [m].
        origin: where the origin of the file comes to lie [m].
        notes: remarks for the user.
    """

    file: str
    points_read: int
    radii: BallRadii
    scale: float = 1.0
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlaneShape:
    """A shape in the plane, exact for every kind in a problem file: all points within ``rounding`` of ``core``.

    Attributes:
        core: a polygon (polygon, box), a point (circle), a line string (wall) or several points (scan) [m].
        rounding: radius by which the core is inflated [m]: a circle's radius, half a wall's thickness, the radius of
            the discs about the points of a scan, else 0.
        scan: the file that the points of a scan were read from; None for other shapes.
    """

    core: shapely.Geometry
    rounding: float = 0.0
    scan: PlaneScan | None = None

    @classmethod
    def of_scan(cls, points: FloatArray, radii: BallRadii, file: str, **of_file: Any) -> "PlaneShape":
        """Return points of a file, shape (n, 2) [m], as discs, thinned; further arguments are those of PlaneScan."""
        kept, spread = thin_points(points, SPREAD_SHARE * radii.point)
        radii = replace(radii, spread=spread)
        return cls(shapely.MultiPoint(kept), radii.whole, PlaneScan(file, len(points), radii, **of_file))

    @property
    def vertices(self) -> FloatArray:
        """Coordinates of the core, shape (n, 2) [m]."""
        return np.asarray(shapely.get_coordinates(self.core))

    @property
    def middle(self) -> FloatArray:
        """Centroid of the core, shape (2,) [m]."""
        return np.asarray(shapely.get_coordinates(shapely.centroid(self.core))[0], dtype=np.float64)

    def moved(self, offset: FloatArray) -> "PlaneShape":
        """Return the shape translated by a displacement, shape (2,) [m]."""
        return replace(self, core=shapely.transform(self.core, lambda points: points + offset))


@dataclass(frozen=True)
class Obstacle:
    """A named shape that the arm must avoid.

    Attributes:
        name: the user's name for the obstacle, used in every message.
        shape: shape of the obstacle at its position in the room: a ``PlaneShape`` in the plane, a body in space.
    """

    name: str
    shape: Shape

    @property
    def rounding(self) -> float:
        """Radius by which the core of the obstacle, or its triangles, are inflated [m]."""
        return self.shape.rounding

    @property
    def core(self) -> shapely.Geometry:
        """Geometry of a planar obstacle before inflation by its radius."""
        return cast("PlaneShape", self.shape).core

    @property
    def body(self) -> Body:
        """Body of an obstacle in space."""
        return cast("Body", self.shape)

    def outline(self, grow: float = 0.0, quad_segs: int = 8) -> shapely.Geometry:
        """Return a geometry that *contains* the planar obstacle, inflated further by ``grow`` [m].

        Arcs are replaced by circumscribed polylines.
        """
        radius = self.rounding + grow
        if radius <= 0.0:
            return self.core
        return self.buffered(radius / np.cos(np.pi / (4 * quad_segs)), quad_segs)

    def buffered(self, radius: float, quad_segs: int = 16) -> shapely.Geometry:
        """Return a geometry that all points within ``radius`` [m] of the core contain, with inscribed arcs."""
        if isinstance(self.core, shapely.MultiPoint):
            # Some thirty times as fast as buffering all points at once.
            discs = shapely.buffer(shapely.get_parts(self.core), radius, quad_segs=quad_segs)
            return shapely.union_all(discs)
        grown: shapely.Geometry = shapely.buffer(self.core, radius, quad_segs=quad_segs)
        return grown


BOUNDARY_NAME = "workspace boundary"
ROOM_NAME = "room"
"""Name of the sides of the room of a workspace in space."""
_LOOKED_AT_FIRST = 4
"""Number of walls whose exact distances are computed first, to rule out most of the others."""


@dataclass(frozen=True)
class Workspace:
    """The room of an arm, the obstacles in the room, and the clearance that the arm keeps from both.

    Attributes:
        boundary: a simple polygon, the room in the plane, whose edge is a wall like any obstacle [m]; empty in space.
        obstacles: the obstacles, in file order.
        clearance: least clearance between the arm's surface and every obstacle [m].
        bounds: lower and upper corner of a room in space, whose sides are walls, shape (2, 3) [m]; None without a room,
            and in the plane.
    """

    boundary: shapely.Polygon = field(default_factory=shapely.Polygon)
    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.0
    bounds: FloatArray | None = None

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point, 2 in the plane and 3 in space."""
        return 3 if self.boundary.is_empty else 2

    @property
    def box(self) -> FloatArray | None:
        """Lower and upper corner of the bounding box of the room, shape (2, d) [m]; None if there is no room."""
        return self.bounds if self.dimension == 3 else np.reshape(self.boundary.bounds, (2, 2))

    @property
    def is_box(self) -> bool:
        """Whether the room is an axis-aligned box."""
        box = self.box
        return box is not None and (
            self.dimension == 3 or bool(shapely.equals(self.boundary, shapely.box(*box.ravel())))
        )

    def within(self, box: FloatArray) -> "Workspace":
        """Return the workspace with the box between two corners, shape (2, d) [m], as its room."""
        return replace(self, bounds=box) if self.dimension == 3 else replace(self, boundary=shapely.box(*np.ravel(box)))

    @property
    def meshes(self) -> tuple[tuple[int, str, MeshBody], ...]:
        """Meshes among the obstacles, each with its index among the obstacles and its name."""
        found = [] if self.dimension == 2 else [(k, each.name, each.body) for k, each in enumerate(self.obstacles)]
        return tuple((k, name, body) for k, name, body in found if body.kind == "mesh")

    def obstacle_centre(self, name: str) -> FloatArray:
        """Return the centre of the first obstacle with a given name, shape (d,) [m]."""
        return next(obstacle.shape.middle for obstacle in self.obstacles if obstacle.name == name)

    def with_moved(self, name: str, offset: FloatArray) -> "Workspace":
        """Return the workspace with all obstacles of a given name translated by a displacement, shape (d,) [m]."""
        moved = [
            replace(each, shape=each.shape.moved(offset)) if each.name == name else each for each in self.obstacles
        ]
        return replace(self, obstacles=tuple(moved))

    def without_obstacle(self, name: str) -> "Workspace":
        """Return the workspace without the obstacles of a given name."""
        return replace(self, obstacles=tuple(each for each in self.obstacles if each.name != name))

    @cached_property
    def triangle_soup(self) -> TriangleSoup:
        """Triangles of all obstacles in order, then of the sides of the room; planar walls as flat triangles."""
        if self.dimension == 2:
            edges = self.wall_segments
            return TriangleSoup(in_space(edges.ends[:, [0, 1, 1]]), edges.rounding, edges.owner, self.flat_walls.names)
        named = [(each.name, each.body.triangles, each.rounding) for each in self.obstacles]
        if self.bounds is not None:
            named.append((ROOM_NAME, box_corners(self.bounds[0], self.bounds[1])[BOX_FACES], 0.0))
        return TriangleSoup.joined(named)

    @cached_property
    def surface_tree(self) -> SurfaceTree:
        """Tree of boxes around the triangles, for distance queries.

        Raises:
            ProblemError: a coordinate is not a number, or too large.
        """
        return SurfaceTree.from_triangles(self.triangle_soup)

    @cached_property
    def surface_errors(self) -> FloatArray:
        """How far true surfaces may be from those of the obstacles, and of the room as the last, shape (n + 1,) [m].

        It is that of meshes and scans, and of prisms that stand for cylinders; other shapes are exact.
        """
        found = []
        for obstacle in self.obstacles:
            shape = cast("PlaneShape | Body", obstacle.shape)
            if isinstance(shape, PlaneShape):
                found.append(shape.rounding if isinstance(shape.core, shapely.MultiPoint) else 0.0)
            else:
                found.append(shape.rounding if shape.kind == "mesh" else shape.error)
        return np.array([*found, 0.0])

    @cached_property
    def extent(self) -> FloatArray:
        """Lower and upper corner of the box around everything in space, shape (2, 3) [m]; zeros if empty."""
        parts = [part for part in (self.extent_of_bodies, self.bounds) if part is not None]
        return box_about(np.stack(parts)) if len(self.triangle_soup) else np.zeros((2, 3))

    @cached_property
    def extent_of_bodies(self) -> FloatArray | None:
        """Lower and upper corner of the box around all obstacles in space, shape (2, 3) [m]; None without any."""
        bodies = [each.body for each in self.obstacles if len(each.body.triangles)]
        grown = [box_about(body.triangles) + body.rounding * np.array([[-1.0], [1.0]]) for body in bodies]
        return box_about(np.stack(grown)) if grown else None

    @cached_property
    def walls(self) -> tuple[Obstacle, ...]:
        """Everything that a planar arm must avoid, first the obstacles, then the edge of the room."""
        return (*self.obstacles, Obstacle(BOUNDARY_NAME, PlaneShape(shapely.LinearRing(self.boundary.exterior.coords))))

    @cached_property
    def flat_walls(self) -> Walls:
        """Edges and vertices of all walls in the plane as arrays, in the order of ``walls``."""
        return Walls.from_obstacles(self.walls)

    @cached_property
    def wall_segments(self) -> WallSegments:
        """All walls in the plane as one list of inflated segments."""
        return WallSegments.from_obstacles(self.walls, self.flat_walls)

    @cached_property
    def _cores(self) -> npt.NDArray[np.object_]:
        """Geometries of all walls before inflation by their radii, shape (walls,)."""
        return np.array([wall.core for wall in self.walls], dtype=np.object_)

    @cached_property
    def _roundings(self) -> FloatArray:
        """Radii by which the walls are inflated, shape (walls,) [m]."""
        return np.array([wall.rounding for wall in self.walls])

    @cached_property
    def _boxes(self) -> FloatArray:
        """Bounding boxes of the walls before inflation, as low x, low y, high x, high y, shape (walls, 4) [m]."""
        return np.asarray(shapely.bounds(self._cores))

    def apart(self, shape: shapely.Geometry) -> FloatArray:
        """Return the distances of a planar geometry from all walls, in the order of ``walls``, shape (walls,) [m]."""
        return np.asarray(shapely.distance(self._cores, shape)) - self._roundings

    def nearest(self, shape: shapely.Geometry) -> tuple[int, float]:
        """Return the index of the wall nearest to a planar geometry, and its distance [m]."""
        least = self._least_apart(shape)
        # The boundary's box contains everything, so its bound rules out nothing; several of the lowest bounds do.
        first = np.argsort(least, kind="stable")[:_LOOKED_AT_FIRST]
        best = np.min(shapely.distance(self._cores[first], shape) - self._roundings[first])
        maybe = np.flatnonzero(least <= best)
        gaps = shapely.distance(self._cores[maybe], shape) - self._roundings[maybe]
        nearest = int(np.argmin(gaps))
        return int(maybe[nearest]), float(gaps[nearest])

    def _least_apart(self, shape: shapely.Geometry) -> FloatArray:
        """Return lower bounds on the distances of a planar geometry from all walls, shape (walls,) [m]."""
        low_x, low_y, high_x, high_y = shapely.bounds(shape)
        boxes = self._boxes
        across = np.maximum(np.maximum(boxes[:, 0] - high_x, low_x - boxes[:, 2]), 0.0)
        along = np.maximum(np.maximum(boxes[:, 1] - high_y, low_y - boxes[:, 3]), 0.0)
        # Rounding: a bound may slightly exceed the distance that shapely measures.
        return np.asarray(np.hypot(across, along) * (1.0 - TINY) - self._roundings)

    def near(self, shape: shapely.Geometry, distance: float) -> "Workspace":
        """Return the workspace with only the obstacles at most a distance [m] away from a planar geometry."""
        if not self.obstacles:
            return self
        maybe = np.flatnonzero(self._least_apart(shape)[: len(self.obstacles)] <= distance)
        gaps = np.asarray(shapely.distance(self._cores[maybe], shape)) - self._roundings[maybe]
        kept = tuple(self.obstacles[k] for k in maybe[gaps <= distance])
        return self if len(kept) == len(self.obstacles) else replace(self, obstacles=kept)


Shapes: TypeAlias = shapely.Geometry | Obstacle | Sequence[shapely.Geometry | Obstacle] | Mapping[str, shapely.Geometry]
"""A shapely geometry or obstacle, a sequence of them, or a mapping from names to geometries."""
WANTED = "a polygon, a line, or several of them"


def obstacles_of(shapes: Shapes, *, unit: LengthUnit = "m") -> tuple[Obstacle, ...]:
    """Convert shapely geometries to planar obstacles, in metres.

    A polygon is an obstacle, and its holes are free. A line string is a wall without thickness; buffered, it is a
    polygon. A geometry with several parts gives one obstacle per part, with numbers after the name. Heights (z) are
    dropped. A geometry is taken as it is: round ends and discs that shapely has buffered are polygons inside the true
    arcs.

    Args:
        shapes: a geometry, a list of geometries, named "obstacle 1" and so on, or a mapping from names to geometries.
        unit: unit of the coordinates: "m", "mm" or "in".

    Returns:
        The obstacles; ``Obstacle`` objects among the shapes are already in metres and are returned unchanged.

    Raises:
        ProblemError: a shape is not a geometry, is empty, has no area or crosses itself; the message lists all such
            shapes.
    """
    given = Arguments("these obstacles", unit)
    found: list[Obstacle] = []
    for name, shape in named_shapes(shapes, given):
        try:
            found += [shape] if isinstance(shape, Obstacle) else _in_metres(edge_parts(name, shape), given.metres)
        except ProblemError as error:
            given.must(holds=False, line=str(error))
    given.refuse()
    return tuple(found)


def named_shapes(shapes: object, given: Arguments, first: int = 1) -> Iterator[tuple[str, object]]:
    """Yield the shapes in a geometry, list or mapping, each with its name, or with a number counted up from ``first``.

    Any other object is recorded as an error in ``given``.
    """
    if isinstance(shapes, Mapping):
        yield from ((str(name), shape) for name, shape in shapes.items())
    elif isinstance(shapes, (shapely.Geometry, Obstacle)):
        yield f"obstacle {first}", shapes
    elif isinstance(shapes, (Sequence, np.ndarray)) and not isinstance(shapes, (str, bytes)):
        yield from ((f"obstacle {k}", shape) for k, shape in enumerate(shapes, start=first))
    else:
        given.must(holds=False, line=f"expected a geometry, a list of them, or names with them, got {in_words(shapes)}")


def edge_parts(name: str, shape: object) -> list[Obstacle]:
    """Return the obstacles that a geometry consists of, one per part, in the unit of the geometry.

    Raises:
        ProblemError: the shape is not a geometry, or not a usable one.
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
    """Return the single geometries of which a geometry consists, with nested collections unpacked."""
    if not hasattr(shape, "geoms"):
        return [shape]
    return [part for each in shape.geoms for part in _flattened(each)]


def _obstacle(name: str, part: shapely.Geometry) -> Obstacle:
    if isinstance(part, shapely.Point):
        raise ProblemError(f"'{name}': a Point has no size; expected {WANTED}; point.buffer(radius) is a disc")
    if isinstance(part, shapely.LinearRing):
        return Obstacle(name, PlaneShape(shapely.LineString(part.coords)))
    return Obstacle(name, PlaneShape(part))


def _in_metres(obstacles: Sequence[Obstacle], metres: float) -> list[Obstacle]:
    """Convert obstacles to metres from a unit of the given length [m]."""
    return [
        replace(each, shape=PlaneShape(shapely.transform(each.core, lambda points: metres * points)))
        for each in obstacles
    ]
