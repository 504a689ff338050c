"""The walls that planning looks at.

Douglas and Peucker's algorithm (1973) leaves out vertices that are no farther than an error from the edges that stay;
the simpler outline swept by a disc of that radius contains the old one. The distance is measured again here.

An arm on a fixed base never leaves the disc of its length about the base, and a pose with the tip at the goal never
the ellipse of all points whose distances from base and goal add up to its length: walls farther away are left out.
Outlines of very many vertices are simplified outwards. The verifier knows nothing of this: it sees the problem's own
walls.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polygons import nearest_on_segments
from ccm_opt.planning.ends import Ends
from ccm_opt.problem import Problem
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

_NEIGHBOURHOOD = 0.1
"""Walls are left out that are farther beyond the arm's reach than this share of its length. Taste: more than any row of
the search or of the optimisation looks ahead."""
_OUTLINE_ERROR = 5e-5
"""Distance by which outlines of many vertices may be simplified, as a share of the arm's length. Taste: less than a
tenth of what the optimisation keeps off."""
_OUTLINE_GAP_SHARE = 0.02
"""The same as a share of the least gap at the ends. Taste."""
_MANY_VERTICES = 100
"""Outlines of fewer vertices are not simplified. Taste."""
_VERTICES_KEPT = 0.7
"""Outlines of which more than this share of the vertices would stay are left as they are. Taste."""


def simplified(obstacle: Obstacle, error: float) -> Obstacle:
    """An obstacle that contains the given one, grown by at most twice the error [m] and with far fewer vertices.

    The obstacle itself where that saves few vertices, or where it cannot be shown to contain the obstacle.
    """
    core = obstacle.core
    if not isinstance(core, shapely.Polygon) or error <= 0.0:
        return obstacle
    before = shapely.get_num_coordinates(core)
    if before < _MANY_VERTICES:
        return obstacle
    # A ring that loses the vertex at which it begins may move by up to twice what it was allowed.
    for allowed in (error, 0.5 * error):
        simple = shapely.simplify(core, allowed, preserve_topology=True)
        if not isinstance(simple, shapely.Polygon) or shapely.get_num_interior_rings(simple) != len(core.interiors):
            return obstacle
        if shapely.get_num_coordinates(simple) > _VERTICES_KEPT * before:
            return obstacle
        moved = _rings_moved(core, simple)
        # Between vertices the old outline is no farther from a new edge than at its ends, for distance is convex.
        if moved <= error:
            return replace(obstacle, shape=PlaneShape(simple, obstacle.rounding + moved))
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


def neighbourhood(problem: Problem, ends: Ends) -> Problem:
    """The problem with the walls that the arm can come near to, outlines simplified within a share of its gap."""
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
    """How far outlines may grow [m]: a small share of the arm's length, and of the gaps that the ends have."""
    arm = problem.arm
    shapes: list[shapely.Geometry] = [shapely.LineString(arm.joint_positions(ends.start))]
    if ends.goal_pose is None:
        shapes.append(shapely.Point(ends.goal.position))
    else:
        shapes.append(shapely.LineString(arm.joint_positions(ends.goal_pose)))
    apart = [
        float(np.min(shapely.distance(_cores(near), shape) - _roundings(near), initial=np.inf)) for shape in shapes
    ]
    gap = max(0.0, min(apart) - arm.radius - problem.workspace.clearance)
    return min(_OUTLINE_ERROR * arm.length, _OUTLINE_GAP_SHARE * gap)


def route_workspace(problem: Problem, ends: Ends) -> Workspace:
    """The room with those obstacles that poses at the goal can come near to."""
    arm = problem.arm
    workspace = problem.workspace
    if arm.base_axes or not workspace.obstacles:
        return workspace
    goal = ends.goal.position if ends.goal_pose is None else arm.joint_positions(ends.goal_pose)[-1]
    # A disc about each obstacle: the sum of the distances of its points is that of its middle, less at most twice the
    # disc's radius.
    boxes = shapely.bounds(_cores(workspace))
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    radii = 0.5 * np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1) + _roundings(workspace)
    nearest = _sum_of_distances(middles, arm.base, goal) - 2.0 * (radii + 2.0 * (arm.radius + workspace.clearance))
    within: BoolArray = nearest <= (1.0 + _NEIGHBOURHOOD) * arm.length + ends.goal.room[0]
    kept = tuple(obstacle for obstacle, matters in zip(workspace.obstacles, within, strict=True) if matters)
    return replace(workspace, obstacles=kept)


def _sum_of_distances(points: FloatArray, base: FloatArray, goal: FloatArray) -> FloatArray:
    """Of points (m, 2) from base and goal, shape (m,) [m]."""
    return np.asarray(np.linalg.norm(points - base, axis=1) + np.linalg.norm(points - goal, axis=1))


def _cores(workspace: Workspace) -> npt.NDArray[np.object_]:
    return np.array([obstacle.core for obstacle in workspace.obstacles], dtype=np.object_)


def _roundings(workspace: Workspace) -> FloatArray:
    return np.array([obstacle.rounding for obstacle in workspace.obstacles])
