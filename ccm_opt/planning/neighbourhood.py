"""Reduction of a planar workspace to the walls that planning has to consider, with simplified outlines.

An arm on a fixed base never leaves the disc of its length about the base, and a pose with the tip at the goal never
leaves the ellipse of all points whose distances from base and goal add up to its length: walls farther away are left
out.

Outlines of very many vertices are simplified outwards: the algorithm of Douglas and Peucker (1973) omits vertices that
are no farther than an error from the remaining edges, and the simpler outline swept by a disc of that radius contains
the original one. The verifier checks against the original walls.
"""

from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.planning.ends import Ends
from ccm_opt.problem import Problem
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

_NEIGHBOURHOOD = 0.1
"""Distance beyond the arm's reach above which walls are left out, as a fraction of the arm's length. Heuristic: more
than the search distance of any contact constraint."""
_OUTLINE_ERROR = 5e-5
"""Maximum error of simplified outlines, as a fraction of the arm's length. Heuristic: less than a tenth of the
clearance that the optimisation keeps."""
_OUTLINE_GAP_SHARE = 0.02
"""Maximum error of simplified outlines, as a fraction of the least gap at start and goal. Heuristic."""
_MANY_VERTICES = 100
"""Minimum number of vertices of an outline that is simplified. Heuristic."""
_VERTICES_KEPT = 0.7
"""Fraction of vertices that a simplified outline may keep; if it keeps more, the original outline is used.
Heuristic."""


def simplified(obstacle: Obstacle, error: float) -> Obstacle:
    """Return an obstacle with fewer vertices that contains a given one and is larger by at most twice the error [m].

    The given obstacle is returned if the simplification removes few vertices.
    """
    core = obstacle.core
    before = shapely.get_num_coordinates(core)
    if not isinstance(core, shapely.Polygon) or error <= 0.0 or before < _MANY_VERTICES:
        return obstacle
    # A ring that loses its first vertex may move by up to twice the tolerance. Between vertices the old outline is no
    # farther from a new edge than at its ends, since distance is convex.
    simple = shapely.simplify(core, 0.5 * error, preserve_topology=True)
    alike = isinstance(simple, shapely.Polygon) and len(simple.interiors) == len(core.interiors)
    if not alike or shapely.get_num_coordinates(simple) > _VERTICES_KEPT * before:
        return obstacle
    return replace(obstacle, shape=PlaneShape(simple, obstacle.rounding + error))


def neighbourhood(problem: Problem, ends: Ends) -> Problem:
    """Return a problem with only the walls that the arm can come near, their outlines simplified.

    Problems with a feed axis are unchanged.

    Args:
        problem: the problem.
        ends: start and goal of the motion.
    """
    arm = problem.arm
    workspace = problem.workspace
    if arm.base_axes or not workspace.obstacles:
        return problem
    farthest = (1.0 + _NEIGHBOURHOOD) * arm.length + arm.radius + workspace.clearance + problem.wanted_gap
    near = workspace.near(shapely.Point(arm.base), farthest)
    error = _outline_error(problem, near, ends)
    simpler = tuple(simplified(obstacle, error) for obstacle in near.obstacles)
    unchanged = all(one is other for one, other in zip(simpler, near.obstacles, strict=True))
    return replace(problem, workspace=near if unchanged else replace(near, obstacles=simpler))


def _outline_error(problem: Problem, near: Workspace, ends: Ends) -> float:
    """Return the allowed error of outlines: the least of fractions of the arm length and the gaps at both ends [m]."""
    arm = problem.arm
    shapes: list[shapely.Geometry] = [shapely.LineString(arm.joint_positions_at(ends.start))]
    if ends.goal_pose is None:
        shapes.append(shapely.Point(ends.goal.position))
    else:
        shapes.append(shapely.LineString(arm.joint_positions_at(ends.goal_pose)))
    apart = [float(np.min(near.apart(shape)[:-1], initial=np.inf)) for shape in shapes]
    gap = max(0.0, min(apart) - arm.radius - problem.workspace.clearance)
    return min(_OUTLINE_ERROR * arm.length, _OUTLINE_GAP_SHARE * gap)


def route_workspace(problem: Problem, ends: Ends) -> Workspace:
    """Return the workspace of a problem with only the obstacles that poses at the goal can come near.

    It is unchanged for an arm on a feed axis.
    """
    arm = problem.arm
    workspace = problem.workspace
    if arm.base_axes or not workspace.obstacles:
        return workspace
    goal = ends.goal.position if ends.goal_pose is None else arm.joint_positions_at(ends.goal_pose)[-1]
    # Each obstacle is replaced by a disc: the sum of distances of any of its points is that of its middle, less at most
    # twice the disc's radius.
    boxes = shapely.bounds([obstacle.core for obstacle in workspace.obstacles])
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    radii = 0.5 * np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1)
    radii += [obstacle.rounding for obstacle in workspace.obstacles]
    apart = np.linalg.norm(middles - arm.base, axis=1) + np.linalg.norm(middles - goal, axis=1)
    nearest = apart - 2.0 * (radii + 2.0 * (arm.radius + workspace.clearance))
    within = nearest <= (1.0 + _NEIGHBOURHOOD) * arm.length + ends.goal.room[0]
    kept = tuple(obstacle for obstacle, matters in zip(workspace.obstacles, within, strict=True) if matters)
    return replace(workspace, obstacles=kept)
