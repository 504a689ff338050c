"""Distances of segments from every obstacle of a workspace: from walls in the plane, from surfaces in space."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.scene.distances.enclosures import deepest_enclosure
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, Workspace

_SAMPLES = np.linspace(0.0, 1.0, 9)
"""Positions along a segment, as fractions, at which its depth in a body is measured; in between it is hardly deeper."""
_STEP = 2e-3
"""Spacing of the points of the arm's axis at which its depth in a polygon is measured [m]."""
_BESIDE = 1.3
"""Multiple of the nearest obstacle's distance up to which obstacles count as near a position. Heuristic."""
_FAR = 1e9
"""Length that exceeds any distance in a scene [m]."""
_MOST_BESIDE = 3
"""Largest number of obstacles that are reported as near a position. Heuristic."""

_FIRST_STEP = 0.1
"""First displacement from a position, as a fraction of the distance that must be kept. Heuristic."""

WORKSPACE_NAMES = frozenset((BOUNDARY_NAME, ROOM_NAME))
"""Names of the boundaries of the workspace, which cannot be removed like obstacles."""


@dataclass(frozen=True)
class ObstacleGap:
    """Distances of k segments from one obstacle.

    Attributes:
        name: name of the obstacle, or of the workspace boundary.
        gaps: distances of the segments from the obstacle, or negative depths for segments inside, shape (k,) [m].
        places: position of the greatest depth or least distance on each segment, shape (k, d) [m].
        error: largest distance by which the surfaces used extend beyond the obstacle itself [m].
        outside: whether the obstacle is the workspace boundary and a segment reaches out of the workspace.
    """

    name: str
    gaps: FloatArray
    places: FloatArray
    error: float = 0.0
    outside: bool = False


class Gaps(Protocol):
    """Protocol for distances of segments from all obstacles of a workspace."""

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Return the distances of segments (k, 2, d) from the nearest obstacle, capped at `reach`, shape (k,) [m]."""

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each obstacle or boundary nearer than `reach` [m] to any of k segments (k, 2, d)."""

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each obstacle or boundary that is nearer than `need` [m] by more than rounding errors."""


def gaps_of(workspace: Workspace) -> Gaps:
    """Return the object that computes distances from all obstacles of a workspace."""
    return WallGaps(workspace) if workspace.dimension == 2 else SurfaceGaps(workspace)


def beside(gaps: Gaps, place: FloatArray, least: float) -> tuple[str, ...]:
    """Return the names of the nearest obstacle to a position and of others at a similar distance, the nearest first.

    Args:
        gaps: distances from the obstacles of the workspace.
        place: the position, shape (d,) [m].
        least: difference of distances that always counts as small [m].
    """
    point = np.stack((place, place))[None]
    near = float(gaps.distances(point, _FAR)[0])
    found = sorted(gaps.each(point, _BESIDE * near + max(least, ROUNDING)), key=lambda each: float(each.gaps[0]))
    return tuple(each.name for each in found[:_MOST_BESIDE])


def depth_beyond(gaps: Gaps, place: FloatArray, direction: FloatArray, room: float, most: float) -> float:
    """Return the distance by which the arm's axis may be moved from a position in a direction [m].

    Args:
        gaps: distances from the obstacles of the workspace.
        place: the position, shape (d,) [m].
        direction: unit vector, shape (d,).
        room: distance that must be kept from all obstacles [m].
        most: largest displacement considered [m].
    """
    # At the position itself the axis may have no clearance beyond the required distance, so start a step away.
    depth = _FIRST_STEP * room
    while depth < most:
        here = place + depth * direction
        spare = float(gaps.distances(np.stack((here, here))[None], room + most)[0]) - room
        # The axis can move by its spare distance from obstacles without violating the required one.
        if spare <= 1e-3 * room:
            break
        depth += spare
    return min(depth, most)


@dataclass(frozen=True)
class WallGaps:
    """Distances of segments from the walls of a planar workspace.

    Attributes:
        workspace: the walls.
    """

    workspace: Workspace

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Return the distances of segments (k, 2, 2) from the nearest wall, capped at `reach`, shape (k,) [m]."""
        lines = _lines(segments)
        gaps = [shapely.distance(lines, wall.core) - wall.rounding for wall in self.workspace.walls]
        return np.asarray(np.clip(np.min(gaps, axis=0), 0.0, reach))

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each wall that is nearer than `reach` [m] to any of the segments (k, 2, 2)."""
        lines = _lines(segments)
        for wall in self.workspace.walls:
            found = self._from_wall(wall, lines)
            if float(found.gaps.min()) < reach:
                yield found

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each wall nearer than `need` [m] by more than rounding errors."""
        return self.each(segments, need - ROUNDING)

    def _from_wall(self, wall: Obstacle, lines: Any) -> ObstacleGap:
        """Return the gaps to one wall, which are negative depths inside a polygon or outside the workspace."""
        gaps = shapely.distance(lines, wall.core) - wall.rounding
        of_clearance = wall.name == BOUNDARY_NAME
        room = self.workspace.boundary
        places = shapely.get_coordinates([shapely.get_point(shapely.shortest_line(lines, wall.core), 0)])
        hidden = np.zeros(len(lines), dtype=bool)
        if of_clearance:
            hidden = ~shapely.covers(room, lines)
        elif isinstance(wall.core, shapely.Polygon):
            hidden = gaps <= 0.0
        for k in np.flatnonzero(hidden):
            part = shapely.difference(lines[k], room) if of_clearance else shapely.intersection(lines[k], wall.core)
            # For segments inside, the distance is zero, so the depth of the axis is computed.
            points = shapely.get_coordinates(shapely.segmentize(part, _STEP))
            edge = room.exterior if of_clearance else shapely.boundary(wall.core)
            depths = np.atleast_1d(shapely.distance(shapely.points(points), edge))
            if len(depths) and depths.max() > 0.0:
                gaps[k] = -depths.max()
                places[k] = points[np.argmax(depths)]
        return ObstacleGap(wall.name, gaps, places, outside=bool(of_clearance and gaps.min() < 0.0))


def _lines(segments: FloatArray) -> Any:
    """Convert segments (k, 2, 2) to line geometries, or to points if their length is zero, shape (k,)."""
    stand = np.all(segments[:, 0] == segments[:, 1], axis=1)
    lines: Any = shapely.linestrings(segments)
    points: Any = shapely.points(segments[:, 0])
    return np.where(stand, points, lines)


@dataclass(frozen=True, eq=False)
class SurfaceGaps:
    """Distances of segments from every obstacle of a workspace in space.

    Attributes:
        workspace: the scene.
        tree: bounding-box tree of all surfaces.
    """

    workspace: Workspace
    tree: SurfaceTree = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tree", self.workspace.surface_tree)

    @cached_property
    def stands_out(self) -> float:
        """Largest distance by which a surface used in planning extends beyond its obstacle [m]."""
        return max((each.body.error for each in self.workspace.obstacles), default=0.0)

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Return the distances of segments (k, 2, 3) from the nearest surface, capped at `reach`, shape (k,) [m]."""
        return self.tree.distances(segments, reach)

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each obstacle or boundary nearer than `reach` [m] to any of the segments (k, 2, 3)."""
        low = segments.min(axis=(0, 1)) - reach
        high = segments.max(axis=(0, 1)) + reach
        for obstacle in self.workspace.obstacles:
            body = obstacle.body
            triangles = body.triangles
            apart = (triangles.min(axis=(0, 1)) - body.rounding > high) | (
                triangles.max(axis=(0, 1)) + body.rounding < low
            )
            if not np.any(apart):
                found = _from_obstacle(obstacle, segments, reach)
                if float(found.gaps.min()) < reach:
                    yield found
        if self.workspace.bounds is not None:
            found = _from_bounds(self.workspace.bounds, segments)
            if float(found.gaps.min()) < reach:
                yield found

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Yield the gaps to each obstacle or boundary nearer than `need` [m] by more than rounding errors."""
        # One query of all surfaces first: mostly nothing is near, and obstacles need not be checked one by one.
        nearest = float(self.tree.distances(segments, need).min())
        if nearest < need - ROUNDING or deepest_enclosure(self.workspace, segments[:, 1]) is not None:
            yield from self.each(segments, need - ROUNDING)


def _from_obstacle(obstacle: Obstacle, segments: FloatArray, reach: float) -> ObstacleGap:
    """Return the gaps of segments to one obstacle, which are negative depths inside the obstacle."""
    body = obstacle.body
    tree = SurfaceTree.from_triangles(TriangleSoup.joined([(obstacle.name, body.triangles, body.rounding)]))
    near = tree.nearest(segments, reach)
    gaps = near.gap.copy()
    places = near.point.copy()
    # Spheres and bars consist of degenerate triangles with a radius; distances from them already include depths.
    if body.closed and body.has_inside:
        for k, segment in enumerate(segments):
            along = segment[0] + _SAMPLES[:, None] * (segment[1] - segment[0])
            depths = [depth_inside(body, place) for place in along]
            deepest = int(np.argmax(depths))
            if depths[deepest] > 0.0:
                gaps[k] = -depths[deepest]
                places[k] = along[deepest]
    return ObstacleGap(obstacle.name, gaps, places, body.error)


def _from_bounds(bounds: FloatArray, segments: FloatArray) -> ObstacleGap:
    """Return the gaps to the sides of a box-shaped workspace, negative for segments that reach out of the box.

    The distance from a side is linear along a segment, so its minimum is at an end.
    """
    inside = np.minimum(segments - bounds[0], bounds[1] - segments).min(axis=2)
    end = np.argmin(inside, axis=1)
    number = np.arange(len(segments))
    gaps = inside[number, end]
    return ObstacleGap(ROOM_NAME, gaps, segments[number, end], outside=bool(gaps.min() < 0.0))
