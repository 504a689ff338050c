"""Checks of places in a problem file: the base outside every obstacle. An unreachable goal is no defect of a file."""

from collections.abc import Sequence

import numpy as np
import shapely

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.reading_settings import READING
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import BOUNDARY_NAME, Workspace
from ccm_opt.ground.length_words import file_length


def depth_inside(obstacle: Obstacle, point: Sequence[float]) -> float:
    """How far a point is inside an obstacle [m]; negative outside, minus the distance to it."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # of coordinates like 1e-320, whose distances are right all the same
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def depth_outside(workspace: Workspace, point: Sequence[float]) -> float:
    """How far a point is outside the boundary [m]; negative inside, minus the distance to it."""
    return -depth_inside(Obstacle(BOUNDARY_NAME, workspace.boundary), point)


def check_base(workspace: Workspace, base: Sequence[float], issues: Issues) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    rounding = READING.depth_rounding * max(xmax - xmin, ymax - ymin)
    for obstacle in workspace.obstacles:
        if (depth := depth_inside(obstacle, base)) > rounding:
            issues.add(("arm", "base"), f"the base is {file_length(depth)} inside '{obstacle.name}'; move it out")
    if (depth := depth_outside(workspace, base)) > rounding:
        issues.add(("arm", "base"), f"the base is {file_length(depth)} outside the {BOUNDARY_NAME}; move it in")
