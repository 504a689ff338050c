"""Routes from a start to a goal in different homotopy classes, shortest first (the connectivity graph of section 4.1).

The classes come nearly in order of length; each gets its taut string, and these are put in the order of true length.
"""

import bisect
import itertools

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.funnel import taut_string
from ccm_opt.freespace.homotopy_classes import homotopy_classes
from ccm_opt.freespace.junctions import EdgeMetric
from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.geometry.polyline import path_length

SURPLUS = 6  # at most so many classes are drawn taut for each one wanted
LEAST_CANDIDATES = 20  # but so many in any case: in near-empty rooms the sampled length is at its coarsest
METRIC_EXCESS = (
    1.25  # the sampled length of a class is at most this multiple of its taut length (mostly 1.01 in clutter)
)
EFFORT = 400  # partial walks looked at for each class wanted


def shortest_routes(
    metric: EdgeMetric, ends: IntArray, points: FloatArray, count: int, longest: float = np.inf, shrink: float = 0.0
) -> tuple[Route, ...]:
    """Up to ``count`` routes in different homotopy classes by increasing taut length.

    Args:
        metric: of the triangulation of free space.
        ends: the triangles of start and goal, shape (2,).
        points: start and goal, free points, shape (2, 2) [m].
        count: number of routes wanted.
        longest: routes with a longer taut string are left out [m].
        shrink: distance kept from corners where there is room [m].

    Returns:
        The routes; none when start and goal are in different components or all routes are too long.
    """
    mesh = metric.triangulation
    if mesh.components[ends[0]] != mesh.components[ends[1]]:
        return ()
    best: list[tuple[float, Route]] = []
    candidates = homotopy_classes(metric, ends, points, METRIC_EXCESS * longest, EFFORT * max(count, 4))
    for sampled, sleeve in itertools.islice(candidates, max(SURPLUS * count, LEAST_CANDIDATES)):
        if len(best) >= count and sampled > METRIC_EXCESS * best[count - 1][0]:
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
