"""Routes from a start to a goal in different homotopy classes, shortest first (the connectivity graph of section 4.1).

The classes come nearly in order of length; each gets its taut string, and these are put in the order of true length.
"""

import bisect
import itertools

import numpy as np

from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.freespace.funnel import taut_string
from ccm_opt.freespace.homotopy_classes import homotopy_classes
from ccm_opt.freespace.junctions import EdgeMetric
from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.polyline import path_length


def shortest_routes(
    metric: EdgeMetric,
    ends: IntArray,
    points: FloatArray,
    count: int,
    longest: float = np.inf,
    shrink: float = 0.0,
    settings: FreeSpaceSettings = DEFAULT_FREE_SPACE,
) -> tuple[Route, ...]:
    """Up to ``count`` routes in different homotopy classes by increasing taut length.

    Args:
        metric: of the triangulation of free space.
        ends: the triangles of start and goal, shape (2,).
        points: start and goal, free points, shape (2, 2) [m].
        count: number of routes wanted.
        longest: routes with a longer taut string are left out [m].
        shrink: distance kept from corners where there is room [m].
        settings: how many classes are looked at.

    Returns:
        The routes; none when start and goal are in different components or all routes are too long.
    """
    mesh = metric.triangulation
    if mesh.components[ends[0]] != mesh.components[ends[1]]:
        return ()
    best: list[tuple[float, Route]] = []
    excess = settings.sampled_excess
    effort = settings.walks_per_route * max(count, settings.least_routes)
    classes = homotopy_classes(metric, ends, points, excess * longest, effort)
    for sampled, sleeve in itertools.islice(classes, max(settings.route_surplus * count, settings.least_classes)):
        # The classes come by sampled length: once it exceeds the worst kept by all that sampling may add, none is left.
        if len(best) >= count and sampled > excess * best[count - 1][0]:
            break
        route = route_of_sleeve(mesh, sleeve, points[0], points[1], shrink)
        bisect.insort(best, (route.length, route), key=lambda pair: pair[0])
    return tuple(route for length, route in best[:count] if length <= longest)


def route_of_sleeve(
    mesh: Triangulation, sleeve: tuple[int, ...], start: FloatArray, goal: FloatArray, shrink: float
) -> Route:
    """The route with the taut string of a sleeve."""
    taut = taut_string(mesh.portals(sleeve), start, goal, shrink)
    return Route(sleeve, taut, path_length(taut))
