"""How far segments are from every obstacle, in the plane from walls, in space from surfaces."""

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
"""Places along a segment at which its depth in a body is measured; between them it is hardly deeper."""
_STEP = 2e-3
"""Between places of an axis at which its depth in a polygon is measured [m], likewise."""
_BESIDE = 1.3
"""Obstacles up to this multiple of the distance of the nearest are beside a place. Taste."""
_FAR = 1e9
"""Farther than anything [m]."""
_MOST_BESIDE = 3
"""Of them at most. Taste."""

_FIRST_STEP = 0.1
"""With which an axis is moved away from a place at first, as a share of the distance that it keeps. Taste."""

ROOM_NAMES = frozenset((BOUNDARY_NAME, ROOM_NAME))
"""What the walls of the room are called, which cannot be removed."""


@dataclass(frozen=True)
class ObstacleGap:
    """How far segments are from one obstacle.

    Attributes:
        name: of the obstacle, or what the room is called.
        gaps: distance of each segment's axis from it, negative by how deep it is inside, shape (k,) [m].
        places: where the obstacle, or else the segment, is deepest in the other or nearest, shape (k, d) [m].
        error: by how much the surfaces that are looked at may stand out of the obstacle itself [m].
        outside: whether it is the room, and a segment reaches out of it.
    """

    name: str
    gaps: FloatArray
    places: FloatArray
    error: float = 0.0
    outside: bool = False


class Gaps(Protocol):
    """Distances from everything in a workspace."""

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Distance of segments (k, 2, d) from the nearest wall or surface, cut off at a reach, shape (k,) [m]."""

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Return every obstacle, and the room, that is nearer to some of the segments (k, 2, d) than a distance [m]."""

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Return every one that is nearer than is needed, by more than rounding [m]."""


def gaps_of(workspace: Workspace) -> Gaps:
    """Return distances from everything in a workspace."""
    return WallGaps(workspace) if workspace.dimension == 2 else SurfaceGaps(workspace)


def beside(gaps: Gaps, place: FloatArray, least: float) -> tuple[str, ...]:
    """Return the names of the obstacles that are nearest to a place, and of others that are hardly farther.

    The nearest first.

    Args:
        gaps: of the workspace.
        place: shape (d,) [m].
        least: so much farther is hardly farther in any case [m].
    """
    point = np.stack((place, place))[None]
    near = float(gaps.distances(point, _FAR)[0])
    found = sorted(gaps.each(point, _BESIDE * near + max(least, ROUNDING)), key=lambda each: float(each.gaps[0]))
    return tuple(each.name for each in found[:_MOST_BESIDE])


def depth_beyond(gaps: Gaps, place: FloatArray, direction: FloatArray, room: float, most: float) -> float:
    """Return how far from a place an axis may be moved in a direction [m].

    Args:
        gaps: of the workspace.
        place: shape (d,) [m].
        direction: unit vector, shape (d,).
        room: distance that is kept from everything [m].
        most: farther is not looked [m].
    """
    # Beside the place itself there may be just the room that is kept.
    depth = _FIRST_STEP * room
    while depth < most:
        here = place + depth * direction
        spare = float(gaps.distances(np.stack((here, here))[None], room + most)[0]) - room
        # As far as there is room about a place one can go from it.
        if spare <= 1e-3 * room:
            break
        depth += spare
    return min(depth, most)


@dataclass(frozen=True)
class WallGaps:
    """Distances from the walls of a workspace in the plane.

    Attributes:
        workspace: the walls.
    """

    workspace: Workspace

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Return the distance of segments (k, 2, 2) from the nearest wall, cut off at a reach, shape (k,) [m]."""
        lines = _lines(segments)
        gaps = [shapely.distance(lines, wall.core) - wall.rounding for wall in self.workspace.walls]
        return np.asarray(np.clip(np.min(gaps, axis=0), 0.0, reach))

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Yield every wall that is nearer to some of the segments (k, 2, 2) than a distance [m]."""
        lines = _lines(segments)
        for wall in self.workspace.walls:
            found = self._from_wall(wall, lines)
            if float(found.gaps.min()) < reach:
                yield found

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Return every wall that is nearer than is needed, by more than rounding [m]."""
        return self.each(segments, need - ROUNDING)

    def _from_wall(self, wall: Obstacle, lines: Any) -> ObstacleGap:
        """Return the distances from one wall: inside of a polygon, and outside of the room, the depth."""
        gaps = shapely.distance(lines, wall.core) - wall.rounding
        of_room = wall.name == BOUNDARY_NAME
        room = self.workspace.boundary
        places = shapely.get_coordinates([shapely.get_point(shapely.shortest_line(lines, wall.core), 0)])
        hidden = np.zeros(len(lines), dtype=bool)
        if of_room:
            hidden = ~shapely.covers(room, lines)
        elif isinstance(wall.core, shapely.Polygon):
            hidden = gaps <= 0.0
        for k in np.flatnonzero(hidden):
            part = shapely.difference(lines[k], room) if of_room else shapely.intersection(lines[k], wall.core)
            # Distance says nothing there: what counts is how deep the axis is.
            points = shapely.get_coordinates(shapely.segmentize(part, _STEP))
            edge = room.exterior if of_room else shapely.boundary(wall.core)
            depths = np.atleast_1d(shapely.distance(shapely.points(points), edge))
            if len(depths) and depths.max() > 0.0:
                gaps[k] = -depths.max()
                places[k] = points[np.argmax(depths)]
        return ObstacleGap(wall.name, gaps, places, outside=bool(of_room and gaps.min() < 0.0))


def _lines(segments: FloatArray) -> Any:
    """Return the segments (k, 2, 2) as geometries; those of no length as places, shape (k,)."""
    stand = np.all(segments[:, 0] == segments[:, 1], axis=1)
    lines: Any = shapely.linestrings(segments)
    points: Any = shapely.points(segments[:, 0])
    return np.where(stand, points, lines)


@dataclass(frozen=True, eq=False)
class SurfaceGaps:
    """Distances from every obstacle of a workspace in space.

    Attributes:
        workspace: the scene.
        tree: all surfaces at once.
    """

    workspace: Workspace
    tree: SurfaceTree = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tree", SurfaceTree.of(self.workspace.soup))

    @cached_property
    def stands_out(self) -> float:
        """By how much any surface that planning keeps away from may stand out of its obstacle [m]."""
        return max((each.body.error for each in self.workspace.obstacles), default=0.0)

    def distances(self, segments: FloatArray, reach: float) -> FloatArray:
        """Return the distance of segments (k, 2, 3) from the nearest surface, cut off at a reach, shape (k,) [m]."""
        return self.tree.distances(segments, reach)

    def each(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Yield every obstacle, and the room, that is nearer to some of the segments (k, 2, 3) than a distance [m]."""
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
            found = _from_room(self.workspace.bounds, segments)
            if float(found.gaps.min()) < reach:
                yield found

    def touched(self, segments: FloatArray, need: float) -> Iterator[ObstacleGap]:
        """Yield every one that is nearer than is needed, by more than rounding [m]."""
        # One look at all surfaces at once: mostly there is nothing near, and no obstacle is looked at by itself.
        nearest = float(self.tree.distances(segments, need).min())
        if nearest < need - ROUNDING or deepest_enclosure(self.workspace, segments[:, 1]) is not None:
            yield from self.each(segments, need - ROUNDING)


def _from_obstacle(obstacle: Obstacle, segments: FloatArray, reach: float) -> ObstacleGap:
    """Return the distances from one obstacle: from its surface, and inside of it the depth."""
    body = obstacle.body
    tree = SurfaceTree.of(TriangleSoup.joined([(obstacle.name, body.triangles, body.rounding)]))
    near = tree.nearest(segments, reach)
    gaps = near.gap.copy()
    places = near.point.copy()
    # Balls and bars have no triangle with an area: distances from them are depths already.
    if body.closed and body.rounding == 0.0:
        for k, segment in enumerate(segments):
            along = segment[0] + _SAMPLES[:, None] * (segment[1] - segment[0])
            depths = [depth_inside(body, place) for place in along]
            deepest = int(np.argmax(depths))
            if depths[deepest] > 0.0:
                gaps[k] = -depths[deepest]
                places[k] = along[deepest]
    return ObstacleGap(obstacle.name, gaps, places, body.error)


def _from_room(bounds: FloatArray, segments: FloatArray) -> ObstacleGap:
    """Return the distances from the sides of the room, negative by how far a segment reaches out of it.

    The distance from a side is linear along a segment, so that its ends tell the least.
    """
    inside = np.minimum(segments - bounds[0], bounds[1] - segments).min(axis=2)
    end = np.argmin(inside, axis=1)
    number = np.arange(len(segments))
    gaps = inside[number, end]
    return ObstacleGap(ROOM_NAME, gaps, segments[number, end], outside=bool(gaps.min() < 0.0))
