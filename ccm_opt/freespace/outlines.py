"""Outlines with fewer vertices, outwards: what takes an obstacle's place contains it.

Douglas and Peucker's algorithm (1973) leaves out vertices that are no farther than an error from the edges that stay;
the simpler outline swept by a disc of that radius contains the old one. The distance is measured again here.
"""

from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polygons import nearest_on_segments


def simplified(obstacle: Obstacle, error: float, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE) -> Obstacle:
    """An obstacle that contains the given one, grown by at most twice the error [m] and with far fewer vertices.

    The obstacle itself where that saves few vertices, or where it cannot be shown to contain the obstacle.
    """
    core = obstacle.core
    if not isinstance(core, shapely.Polygon) or error <= 0.0:
        return obstacle
    before = shapely.get_num_coordinates(core)
    if before < settings.many_vertices:
        return obstacle
    # A ring that loses the vertex at which it begins may move by up to twice what it was allowed.
    for allowed in (error, 0.5 * error):
        simple = shapely.simplify(core, allowed, preserve_topology=True)
        if not isinstance(simple, shapely.Polygon) or shapely.get_num_interior_rings(simple) != len(core.interiors):
            return obstacle
        if shapely.get_num_coordinates(simple) > settings.vertices_kept * before:
            return obstacle
        moved = _rings_moved(core, simple)
        # Between vertices the old outline is no farther from a new edge than at its ends, for distance is convex.
        if moved <= error:
            return replace(obstacle, core=simple, rounding=obstacle.rounding + moved)
    return obstacle


def _rings_moved(old: shapely.Polygon, new: shapely.Polygon) -> float:
    """Largest distance of a vertex of any ring from the ring that takes its place [m]."""
    rings = zip((old.exterior, *old.interiors), (new.exterior, *new.interiors), strict=True)
    return max(_largest_move(shapely.get_coordinates(one), shapely.get_coordinates(other)) for one, other in rings)


def _largest_move(old: FloatArray, new: FloatArray) -> float:
    """Largest distance of a ring's vertices (m, 2) from the edges of the new ring (k, 2) that take their place.

    Infinite when the new ring's vertices are not some of the old ones in the same order.
    """
    places = old[:-1, 0] + 1j * old[:-1, 1]
    order = np.argsort(places, kind="stable")
    wanted = new[:-1, 0] + 1j * new[:-1, 1]
    kept = order[np.minimum(np.searchsorted(places[order], wanted), len(order) - 1)]
    if not np.array_equal(places[kept], wanted):
        return np.inf
    # From the first old vertex that stays once round.
    stays = np.roll(kept, -int(np.argmin(kept)))
    if not bool(np.all(np.diff(stays) > 0)):
        return np.inf
    turned = np.roll(old[:-1], -stays[0], axis=0)
    edge = np.searchsorted(stays - stays[0], np.arange(len(turned)), side="right") - 1
    corners = turned[stays - stays[0]]
    feet = nearest_on_segments(turned, np.stack((corners[edge], np.roll(corners, -1, axis=0)[edge]), axis=1))
    return float(np.linalg.norm(turned - feet, axis=1).max())
