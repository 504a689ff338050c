"""The workspace: a bounded room and named obstacles, each a core shape swept by a disc."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray

BOUNDARY_NAME = "workspace boundary"


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

    def apart(self, shape: shapely.Geometry) -> FloatArray:
        """Distance of a shape from every wall, in the order of the walls, shape (walls,) [m]."""
        return np.asarray(shapely.distance(self._cores, shape)) - self.flat_walls.rounding

    def near(self, shape: shapely.Geometry, distance: float) -> "Workspace":
        """The room with those obstacles alone that come within a distance [m] of a shape."""
        if not self.obstacles:
            return self
        apart = self.apart(shape)[: len(self.obstacles)]
        kept = [obstacle for obstacle, gap in zip(self.obstacles, apart, strict=True) if gap <= distance]
        return self if len(kept) == len(self.obstacles) else replace(self, obstacles=tuple(kept))
