"""The part of a problem's room that can matter, drawn with as few vertices as it needs.

An arm on a fixed base never leaves the disc of its length about the base, and a pose with the tip at the goal never
the ellipse of all points whose distances from base and goal add up to its length: walls farther away are left out.
Outlines of very many vertices are simplified outwards. The verifier knows nothing of this: it sees the problem's own
walls.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.freespace.outlines import simplified
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.motion.ends import Ends
from ccm_opt.planners.curve_settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import Problem


def neighbourhood(problem: Problem, ends: Ends, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> Problem:
    """The problem with the walls that the arm can come near to, outlines simplified within a share of its gap."""
    arm = problem.arm
    workspace = problem.workspace
    if arm.base_axes or not workspace.obstacles:
        return problem
    farthest = (1.0 + settings.neighbourhood) * arm.length + arm.radius + workspace.clearance + problem.wanted_gap
    near = workspace.near(shapely.Point(arm.base), farthest)
    error = _outline_error(problem, near, ends, settings)
    simpler = tuple(simplified(obstacle, error) for obstacle in near.obstacles)
    unchanged = all(one is other for one, other in zip(simpler, near.obstacles, strict=True))
    return replace(problem, workspace=near if unchanged else replace(near, obstacles=simpler))


def _outline_error(problem: Problem, near: Workspace, ends: Ends, settings: CurvePlannerSettings) -> float:
    """How far outlines may grow [m]: a small share of the arm's length, and of the gaps that the ends have."""
    arm = problem.arm
    shapes: list[shapely.Geometry] = [shapely.LineString(arm.joint_positions(ends.start))]
    if ends.goal_headings is None:
        shapes.append(shapely.Point(ends.goal.position))
    else:
        shapes.append(shapely.LineString(arm.joint_positions(ends.goal_headings)))
    apart = [
        float(np.min(shapely.distance(_cores(near), shape) - _roundings(near), initial=np.inf)) for shape in shapes
    ]
    gap = max(0.0, min(apart) - arm.radius - problem.workspace.clearance)
    return min(settings.outline_error * arm.length, settings.outline_gap_share * gap)


def route_workspace(problem: Problem, ends: Ends, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> Workspace:
    """The room with those obstacles that poses at the goal can come near to."""
    arm = problem.arm
    workspace = problem.workspace
    if arm.base_axes or not workspace.obstacles:
        return workspace
    goal = ends.goal.position if ends.goal_headings is None else arm.joint_positions(ends.goal_headings)[-1]
    # A disc about each obstacle: the sum of the distances of its points is that of its middle, less at most twice the
    # disc's radius.
    boxes = shapely.bounds(_cores(workspace))
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    radii = 0.5 * np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1) + _roundings(workspace)
    nearest = _sum_of_distances(middles, arm.base, goal) - 2.0 * (radii + 2.0 * (arm.radius + workspace.clearance))
    within: BoolArray = nearest <= (1.0 + settings.neighbourhood) * arm.length + ends.goal.room[0]
    kept = tuple(obstacle for obstacle, matters in zip(workspace.obstacles, within, strict=True) if matters)
    return replace(workspace, obstacles=kept)


def _sum_of_distances(points: FloatArray, base: FloatArray, goal: FloatArray) -> FloatArray:
    """Of points (m, 2) from base and goal, shape (m,) [m]."""
    return np.asarray(np.linalg.norm(points - base, axis=1) + np.linalg.norm(points - goal, axis=1))


def _cores(workspace: Workspace) -> npt.NDArray[np.object_]:
    return np.array([obstacle.core for obstacle in workspace.obstacles], dtype=np.object_)


def _roundings(workspace: Workspace) -> FloatArray:
    return np.array([obstacle.rounding for obstacle in workspace.obstacles])
