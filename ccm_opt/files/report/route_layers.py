"""Layers of the scene that can be switched on: the shortest way to where the tip ends, and convex regions along it."""

import numpy as np

from ccm_opt.errors import CcmError
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.problem import Problem

_NO_WIDTH = 1e-6
"""Stands for the radius of an arm of no width, as a share of its length."""


def route_layers(problem: Problem, end: FloatArray, settings: ReportSettings = REPORT) -> dict[str, object]:
    """The way that the arm takes round the obstacles in its last pose, drawn taut, and the regions along it.

    Args:
        problem: what was asked.
        end: the last pose, joints and tip, shape (links + 1, 2) [m].
        settings: with how many obstacles they are still drawn.

    Returns:
        ``route``, ``length`` [m] and ``regions``; empty where there are too many obstacles or no such way.
    """
    if len(problem.workspace.obstacles) > settings.most_obstacles:
        return {}
    inflation = problem.arm.radius + problem.workspace.clearance or _NO_WIDTH * problem.arm.length
    space = FreeSpace(problem.workspace, inflation)
    try:
        sleeve = space.sleeve_of(end)
        taut = space.path_of_sleeve(sleeve, end[0], end[-1])
        corridor = space.corridor(Route(sleeve, taut, path_length(taut)))
    except CcmError:
        # The base may stand in a wall, and the mount may lead through one: then there is no such way.
        return {}
    regions = [np.round(region.vertices, 6).tolist() for region in corridor.regions]
    return {"route": np.round(taut, 6).tolist(), "length": path_length(taut), "regions": regions}
