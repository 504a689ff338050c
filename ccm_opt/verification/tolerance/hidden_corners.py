"""Corners of walls that a straight link cannot touch before it touches something beside them.

Where the room about a corner spans less than half a turn, as in the corners of a room seen from inside, a link whose
axis is nearest to the corner in its own middle is nearer still to one of the two edges that meet there: the one at
less than a right angle to the shortest line. The nearest points of that edge and the link involve another end of
either, so a first touch is never at such a corner alone.
"""

import numpy as np
import shapely

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray


def hidden_corners(workspace: Workspace) -> BoolArray:
    """Which ends of the walls' edges are such corners, in the order of ``wall_edges``, shape (E, 2)."""
    parts = [_of_part(part) for wall in workspace.obstacles for part in shapely.get_parts(wall.core)]
    parts.append(_of_ring(workspace.boundary.exterior, room_inside=True))
    return np.concatenate(parts)


def _of_part(part: shapely.Geometry) -> BoolArray:
    if isinstance(part, shapely.Polygon):
        holes = [_of_ring(ring, room_inside=True) for ring in part.interiors]
        return np.concatenate([_of_ring(part.exterior, room_inside=False), *holes])
    # The room is on both sides of a line, and all about a point.
    edges = max(len(shapely.get_coordinates(part)) - 1, 1)
    return np.zeros((edges, 2), dtype=bool)


def _of_ring(ring: shapely.LinearRing, *, room_inside: bool) -> BoolArray:
    points = shapely.get_coordinates(ring)
    after = np.diff(points, axis=0)
    before = np.roll(after, 1, axis=0)
    left = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    inwards = left if shapely.is_ccw(ring) else -left
    at_start = inwards > 0.0 if room_inside else inwards < 0.0
    return np.stack((at_start, np.roll(at_start, -1)), axis=1)
