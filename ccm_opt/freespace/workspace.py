"""The workspace: a bounded room and named obstacles, each a core shape swept by a disc."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY

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
