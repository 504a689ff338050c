"""Routes from the base to the goal through free space, and the tip's ways along them (section 4.1 of the paper)."""

from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.errors import UnreachableGoal
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.freespace.free_space_settings import FINE_FREE_SPACE
from ccm_opt.freespace.narrow_gates import GateRuns
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.motion.ends import Ends
from ccm_opt.motion.link_space import NOMINAL_LINKS
from ccm_opt.motion.tip_paths import TipPath, find_tip_paths, turning_by, turning_least
from ccm_opt.planners.curve_settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.planners.goal_members import GoalMember, goal_members
from ccm_opt.planners.neighbourhood import route_workspace
from ccm_opt.problem import Problem


def route_room(problem: Problem, ends: Ends, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> FreeSpace:
    """Free space for routes, walls that no pose at the goal comes near to left out.

    Walls are inflated by a little more than the arm needs, but by no more than the goal has. Where that closes every
    way from the base to the goal, or from where the arm lies, by hardly more than the arm needs; where that does too,
    their corners are drawn finely.
    """
    least = problem.arm.radius + problem.workspace.clearance
    inflation = settings.route_inflation * problem.arm.length
    kept = settings.least_margin * inflation
    wide = least + inflation
    workspace = route_workspace(problem, ends, settings)
    if not ends.goal.is_set:
        goal = shapely.Point(ends.goal.position)
        _, room = workspace.nearest(goal)
        wide = least + float(np.clip(room - least - kept, kept, inflation))
    free = FreeSpace(workspace, wide)
    if _connected(problem, ends, free, settings):
        return free
    narrow = FreeSpace(workspace, least + kept)
    if _connected(problem, ends, narrow, settings):
        return narrow
    return FreeSpace(workspace, least + kept, settings=FINE_FREE_SPACE)


def _connected(problem: Problem, ends: Ends, room: FreeSpace, settings: CurvePlannerSettings) -> bool:
    """Whether the free places nearest to the base, the tip as it is, and a member of the goal are in one piece."""
    pieces = shapely.get_parts(room.polygons)
    places = [problem.arm.base, problem.arm.joint_positions(ends.start)[-1]]
    if ends.goal.is_set:
        if len(pieces) == 0 or not goal_members(problem.arm, ends.goal, room, settings.members):
            return False
    else:
        places.append(ends.goal.position)
    if len(pieces) < 2:
        return len(pieces) == 1
    nearest = {int(np.argmin(shapely.distance(pieces, shapely.Point(place)))) for place in places}
    return len(nearest) == 1


def find_routes(
    problem: Problem, ends: Ends, room: FreeSpace, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> tuple[Route, ...]:
    """Routes from the base to the start of the run onto the goal, shortest first; of a set, onto several members.

    Args:
        problem: what is asked.
        ends: of the motion.
        room: free space.
        settings: numbers.

    Returns:
        None when the arm is long enough for none of those that were looked for; that proves nothing.
    """
    members = goal_members(problem.arm, ends.goal, room, settings.members)
    count = problem.planner.routes
    found = [routes_to(problem, member, room, count, settings) for member in members]
    # The shortest route to every member before the second to any.
    ranked = sorted(((rank, route.length, route) for routes in found for rank, route in enumerate(routes)), key=_order)
    chosen = [route for _, _, route in ranked[: count + len(members) - 1]]
    if chosen:
        return tuple(sorted(chosen, key=lambda route: route.length))
    direct = [route for member in members for route in _direct(problem, member, room)]
    fitting = [route for route in direct if route.length <= (1.0 + settings.rounding) * problem.arm.length]
    return (min(fitting, key=lambda route: route.length),) if fitting else ()


def _order(ranked: tuple[int, float, Route]) -> tuple[int, float]:
    rank, length, _ = ranked
    return rank, length


def routes_to(
    problem: Problem, member: GoalMember, room: FreeSpace, count: int, settings: CurvePlannerSettings
) -> list[Route]:
    """Routes onto one member of the goal that are not too long, shortest first."""
    arm = problem.arm
    entry = run_in(room, member, arm.length / NOMINAL_LINKS, settings)
    longest = settings.longest_route * arm.length - float(np.hypot(*(member.position - entry)))
    shrink = settings.corner_distance * arm.length
    routes = room.routes(arm.base, entry, count, longest=longest, shrink=shrink)
    return [_led_on(room, route, member) for route in routes]


def _direct(problem: Problem, member: GoalMember, room: FreeSpace) -> list[Route]:
    """The shortest route to a member of the goal, whatever its heading."""
    shortest = room.routes(problem.arm.base, member.position, 1, shrink=0.0)
    return [replace(route, heading=member.heading) for route in shortest]


def _led_on(room: FreeSpace, route: Route, member: GoalMember) -> Route:
    """A route led straight on to a member of the goal."""
    path = np.vstack((route.taut, member.position))
    return Route(room.sleeve_of(path), path, path_length(path), member.heading)


def run_in(
    room: FreeSpace, member: GoalMember, nominal_length: float, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> FloatArray:
    """Where the straight run onto a member of the goal along its heading begins, shape (2,) [m].

    Args:
        room: free space.
        member: where the run ends.
        nominal_length: of a nominal link [m].
        settings: numbers.
    """
    if member.heading is None:
        return member.position
    direction = unit_vector(member.heading)
    for links in settings.run_in:
        entry = member.position - links * nominal_length * direction
        if room.contains(np.linspace(entry, member.position, settings.run_in_samples)).all():
            return entry
    return member.position


def tip_paths_along(
    problem: Problem,
    ends: Ends,
    routes: tuple[Route, ...],
    room: FreeSpace,
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> tuple[TipPath, ...]:
    """Classes of tip motions: along every route, or along the goal pose itself when that is given.

    None where free space, which gives a little away at corners, is closed to the tip; that proves nothing.

    Args:
        problem: what is asked.
        ends: of the motion.
        routes: from the base to the goal.
        room: free space that the routes were found in; the tip's is drawn alike.
        settings: numbers.
    """
    arm = problem.arm
    points = arm.joint_positions(ends.start)
    if ends.goal_headings is not None:
        ways: tuple[FloatArray, ...] = (arm.joint_positions(ends.goal_headings),)
    else:
        ways = tuple(route.taut for route in routes)
    link = max(arm.link_length, arm.length / NOMINAL_LINKS)
    gate_runs = GateRuns(settings.gate_width * arm.length, settings.gate_run * link, arm.base, 1.1 * room.inflation)
    drawn = FreeSpace(problem.workspace, room.inflation, settings=room.settings, gate_runs=gate_runs)
    try:
        paths = find_tip_paths(drawn, points, ways, settings.corner_distance * arm.length)
    except UnreachableGoal:
        return ()
    if ends.goal_headings is None:
        return turning_least(paths, float(arm.bends(ends.start)[0]), arm.base_limit)
    return turning_by(paths, float(ends.goal_headings[0] - ends.start[0]))
