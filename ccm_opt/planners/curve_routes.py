"""Routes from the base to the goal through free space, and the tip's ways along them (section 4.1 of the paper)."""

import numpy as np
import shapely

from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.motion.ends import Ends
from ccm_opt.motion.link_space import NOMINAL_LINKS
from ccm_opt.motion.tip_paths import TipPath, find_tip_paths, turning_by
from ccm_opt.planners.curve_settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import Problem


def route_inflation(problem: Problem, ends: Ends, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> float:
    """Inflation of the walls for routes [m]: a little more than the arm needs, but no more than the goal has.

    Where that closes every way from the base to the goal it is hardly more than the arm needs.
    """
    least = problem.arm.radius + problem.workspace.clearance
    goal = shapely.Point(ends.goal.position)
    room = min(shapely.distance(goal, wall.core) - wall.rounding for wall in problem.workspace.walls)
    inflation = settings.route_inflation * problem.arm.length
    kept = settings.least_margin * inflation
    wide = least + float(np.clip(room - least - kept, kept, inflation))
    if ends.goal_headings is not None or _connected(problem, ends, wide):
        return wide
    return least + kept


def _connected(problem: Problem, ends: Ends, inflation: float) -> bool:
    """Whether the free places nearest to the base and to the goal are in one piece."""
    pieces = shapely.get_parts(FreeSpace(problem.workspace, inflation).polygons)
    if len(pieces) < 2:
        return len(pieces) == 1
    nearest = [np.argmin(shapely.distance(pieces, shapely.Point(p))) for p in (problem.arm.base, ends.goal.position)]
    return bool(nearest[0] == nearest[1])


def find_routes(
    problem: Problem, ends: Ends, room: FreeSpace, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> tuple[Route, ...]:
    """Routes from the base to the start of the run onto the goal, shortest first.

    Raises:
        UnreachableGoal: when there is none that the arm is long enough for.
    """
    arm = problem.arm
    entry = run_in(room, ends, arm.length / NOMINAL_LINKS, settings)
    longest = settings.longest_route * arm.length - float(np.hypot(*(ends.goal.position - entry)))
    shrink = settings.corner_distance * arm.length
    routes = room.routes(arm.base, entry, problem.planner.routes, longest=longest, shrink=shrink)
    if routes:
        return tuple(_led_on(room, route, ends.goal.position) for route in routes)
    shortest = room.routes(arm.base, ends.goal.position, 1, shrink=0.0)
    if shortest and shortest[0].length <= (1.0 + settings.rounding) * arm.length:
        return shortest
    raise UnreachableGoal(_no_route(problem, shortest))


def _led_on(room: FreeSpace, route: Route, goal: FloatArray) -> Route:
    """A route led straight on to the goal."""
    path = np.vstack((route.taut, goal))
    return Route(room.sleeve_of(path), path, path_length(path))


def _no_route(problem: Problem, shortest: tuple[Route, ...]) -> Diagnosis:
    arm = problem.arm
    if not shortest:
        reason = (
            f"no route from the base to the goal is wide enough for the arm: diameter {2e3 * arm.radius:.1f} mm, "
            f"clearance {1e3 * problem.workspace.clearance:.1f} mm"
        )
        return Diagnosis(
            reason, "free space", ("use a smaller arm.radius or workspace.clearance", "remove an obstacle")
        )
    need = shortest[0].length
    reason = f"the shortest route to the goal is {need:.3f} m long, the arm only {arm.length:.3f} m"
    return Diagnosis(reason, "free space", (f"use an arm longer than {need:.3f} m",), {"route_length": need})


def run_in(
    room: FreeSpace, ends: Ends, nominal_length: float, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> FloatArray:
    """Where the straight run onto the goal along its heading begins, shape (2,) [m].

    Args:
        room: free space.
        ends: of the motion.
        nominal_length: of a nominal link [m].
        settings: numbers.
    """
    goal = ends.goal
    if goal.heading is None:
        return goal.position
    direction = unit_vector(goal.heading)
    for links in settings.run_in:
        entry = goal.position - links * nominal_length * direction
        if room.contains(np.linspace(entry, goal.position, settings.run_in_samples)).all():
            return entry
    return goal.position


def tip_paths_along(
    problem: Problem, ends: Ends, routes: tuple[Route, ...], settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> tuple[TipPath, ...]:
    """Classes of tip motions: along every route, or along the goal pose itself when that is given."""
    arm = problem.arm
    points = arm.joint_positions(ends.start)
    if ends.goal_headings is not None:
        ways: tuple[FloatArray, ...] = (arm.joint_positions(ends.goal_headings),)
    else:
        ways = tuple(route.taut for route in routes)
    inflation = route_inflation(problem, ends, settings)
    paths = find_tip_paths(problem.workspace, points, ways, inflation, settings.corner_distance * arm.length)
    if ends.goal_headings is None:
        return paths
    return turning_by(paths, points, float(ends.goal_headings[0] - ends.start[0]))
