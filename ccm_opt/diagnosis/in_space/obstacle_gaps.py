"""How far segments are from each obstacle of a scene by itself, and how deep inside of it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.distances.insides import depth_inside
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.scene.bodies import CylinderBody
from ccm_opt.space.scene.scene import ROOM_NAME, SpaceObstacle, SpaceWorkspace
from ccm_opt.space.scene.surfaces import SurfaceSoup

_SAMPLES = np.linspace(0.0, 1.0, 9)
"""Places along a segment at which its depth is measured; between them it is hardly deeper."""


@dataclass(frozen=True)
class ObstacleGap:
    """How far segments are from one obstacle.

    Attributes:
        name: of the obstacle, or what the room is called.
        gaps: distance of each segment's axis from it, negative by how deep it is inside, shape (k,) [m].
        places: where the obstacle, or else the segment, is deepest in the other or nearest, shape (k, 3) [m].
        error: by how much the surfaces that are looked at may stand out of the obstacle itself [m].
        outside: whether it is the room, and a segment reaches out of it.
    """

    name: str
    gaps: FloatArray
    places: FloatArray
    error: float = 0.0
    outside: bool = False


@dataclass(frozen=True, eq=False)
class ObstacleGaps:
    """Distances from every obstacle of a scene.

    Args:
        workspace: the scene.
    """

    workspace: SpaceWorkspace

    @cached_property
    def whole(self) -> SurfaceTree:
        """All surfaces at once."""
        return SurfaceTree.of(self.workspace.soup)

    def of(self, segments: FloatArray, reach: float) -> Iterator[ObstacleGap]:
        """Every obstacle, and the room, that is nearer to some segment than a distance.

        Args:
            segments: ends, shape (k, 2, 3) [m].
            reach: distances are cut off here [m].
        """
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


def _from_obstacle(obstacle: SpaceObstacle, segments: FloatArray, reach: float) -> ObstacleGap:
    """Distances from one obstacle: from its surface, and inside of it the depth."""
    body = obstacle.body
    tree = SurfaceTree.of(SurfaceSoup.joined([(obstacle.name, body.triangles, body.rounding)]))
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
    return ObstacleGap(obstacle.name, gaps, places, stands_out(obstacle))


def stands_out(obstacle: SpaceObstacle) -> float:
    """By how much the surfaces that planning keeps away from may stand out of an obstacle itself [m]."""
    body = obstacle.body
    return body.error if isinstance(body, CylinderBody) else 0.0


def _from_room(bounds: FloatArray, segments: FloatArray) -> ObstacleGap:
    """Distances from the sides of the room, negative by how far a segment reaches out of it.

    The distance from a side is linear along a segment, so that its ends tell the least.
    """
    inside = np.minimum(segments - bounds[0], bounds[1] - segments).min(axis=2)
    end = np.argmin(inside, axis=1)
    number = np.arange(len(segments))
    gaps = inside[number, end]
    return ObstacleGap(ROOM_NAME, gaps, segments[number, end], outside=bool(gaps.min() < 0.0))
