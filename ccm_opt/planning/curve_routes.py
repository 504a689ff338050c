"""Routes of a planar arm from the base to the goal, and guesses of goal configurations along the routes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ConfigurationNotFound, ProblemError, UnreachableGoal
from ccm_opt.core.polyline import path_length, unit_vector
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.planning.ends import Ends
from ccm_opt.planning.goal_members import GoalMember, goal_members
from ccm_opt.planning.neighbourhood import route_workspace
from ccm_opt.planning.tip_paths import CORNER_DISTANCE, TipPath, find_tip_paths, turning_least, with_base_turn
from ccm_opt.problem import Problem
from ccm_opt.robot.mapping import map_curve
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.corridor import Corridor, Route
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.free_space_settings import FINE_FREE_SPACE
from ccm_opt.scene.narrow_gates import GateRuns

_ROUTE_INFLATION = 0.001
"""Inflation of obstacles for routes beyond radius and clearance, as a fraction of the arm's length. Heuristic."""
_RUN_IN = (2.0, 1.0, 0.5, 0.0)
"""Lengths of the straight approach to the goal along its heading that are tried, longest first, in nominal links.
Heuristic."""
_RUN_IN_SAMPLES = 9
"""Number of points on the straight approach that are checked for being free. Heuristic."""

_LEAST_MARGIN = 1e-3
"""Smallest inflation of obstacles for routes, as a fraction of the usual one, so that free space never degenerates to
zero width. Heuristic."""
_ROUNDING = 1e-9
"""Relative tolerance for rounding if the length of a route is compared with that of the stretched arm. Derived."""
_CONFIGURATIONS = 2
"""Number of routes for which a goal configuration is sought by the NLP. Heuristic."""
_ATTEMPTS = 2
"""Number of attempts of the NLP at one configuration. Derived: the first guess with the surplus length on either
side."""

_GATE_WIDTH = 4e-3
"""Width of free space, as a fraction of the arm's length, below which the tip is led straight through a gate.
Heuristic: a link with more clearance can pass askew."""
_GATE_RUN = 0.6
"""Straight piece before and behind a narrow gate, in links, or in nominal links if these are longer. Measured: with 0.3
one of three scenes of doors and none of three gates is solved, and one takes six times as long; with 0.6 and 1.0 all
six are solved, as fast. With 1.2 an arm with 3 % of its length to spare came through one gate but not through three."""
_LONGEST_ROUTE = 0.985
"""Length of a route, as a fraction of the arm's length, above which it is discarded. Heuristic: the arm needs length to
bend."""
CURVATURE_SHARE = 0.9
"""Fraction of the greatest curvature (joint limit over link length) that the curve may use. Heuristic: links on a curve
bend slightly more than the curve."""
FULL_CURVATURE_SHARE = 1.0
"""Fraction of the greatest curvature that the curve may use if none is found with ``CURVATURE_SHARE``. Heuristic."""
FURTHER_ATTEMPTS = 4
"""Number of attempts at a configuration when the search needs further ones. Heuristic."""


def route_room(problem: Problem, ends: Ends) -> FreeSpace:
    """Return the free space for routes of a planar arm, without walls that no pose at the goal comes near.

    Walls are inflated by slightly more than the arm needs, but not beyond the clearance at the goal. If base, tip at
    the start and goal are then disconnected, walls are inflated by hardly more than the arm needs; if the three are
    still disconnected, the corners of walls are also rounded more finely.

    Args:
        problem: the problem.
        ends: start and goal in the form that planning uses.
    """
    least = problem.arm.tip_radius + problem.workspace.clearance
    inflation = _ROUTE_INFLATION * problem.arm.length
    kept = _LEAST_MARGIN * inflation
    wide = least + inflation
    workspace = route_workspace(problem, ends)
    if not ends.goal.is_set:
        goal = shapely.Point(ends.goal.position)
        _, room = workspace.nearest(goal)
        wide = least + float(np.clip(room - least - kept, kept, inflation))
    free = FreeSpace(workspace, wide)
    if _connected(problem, ends, free):
        return free
    narrow = FreeSpace(workspace, least + kept)
    if _connected(problem, ends, narrow):
        return narrow
    return FreeSpace(workspace, least + kept, settings=FINE_FREE_SPACE)


def _connected(problem: Problem, ends: Ends, room: FreeSpace) -> bool:
    """Return whether base, tip at the start and goal lie in one connected component of free space.

    Each of the three is assigned to the nearest component. For a goal set, one accessible member is enough.
    """
    pieces = shapely.get_parts(room.polygons)
    places = [problem.arm.base, problem.arm.joint_positions_at(ends.start)[-1]]
    if ends.goal.is_set:
        if len(pieces) == 0 or not goal_members(problem.arm, ends.goal, room):
            return False
    else:
        places.append(ends.goal.position)
    if len(pieces) < 2:
        return len(pieces) == 1
    nearest = {int(np.argmin(shapely.distance(pieces, shapely.Point(place)))) for place in places}
    return len(nearest) == 1


def find_routes(problem: Problem, ends: Ends, room: FreeSpace) -> tuple[Route, ...]:
    """Return the routes from the base to the goal, each ending with a straight approach, shortest first.

    For a goal set, the routes lead to several members.

    Args:
        problem: the problem.
        ends: start and goal of the motion.
        room: free space.

    Returns:
        The routes; none if the arm is too short for every route found, which does not prove that no route exists.
    """
    members = goal_members(problem.arm, ends.goal, room)
    count = problem.planner.routes
    found = [member_routes(problem, member, room, count) for member in members]
    # The shortest route to every member ranks before the second to any.
    ranked = [(rank, route) for routes in found for rank, route in enumerate(routes)]
    ranked.sort(key=lambda each: (each[0], each[1].length))
    chosen = [route for _, route in ranked[: count + len(members) - 1]]
    if chosen:
        return tuple(sorted(chosen, key=lambda route: route.length))
    direct = [
        replace(route, heading=member.heading)
        for member in members
        for route in room.routes(problem.arm.base, member.position, 1, shrink=0.0)
    ]
    fitting = [route for route in direct if route.length <= (1.0 + _ROUNDING) * problem.arm.length]
    return (min(fitting, key=lambda route: route.length),) if fitting else ()


def member_routes(problem: Problem, member: GoalMember, room: FreeSpace, count: int) -> list[Route]:
    """Return at most ``count`` routes to one member of the goal that are not too long for the arm, shortest first."""
    arm = problem.arm
    entry = run_in(room, member.position, member.heading, arm.length / NOMINAL_LINKS)
    longest = _LONGEST_ROUTE * arm.length - float(np.hypot(*(member.position - entry)))
    shrink = CORNER_DISTANCE * arm.length
    routes = room.routes(arm.base, entry, count, longest=longest, shrink=shrink)
    return [_led_on(room, route, member) for route in routes]


def _led_on(room: FreeSpace, route: Route, member: GoalMember) -> Route:
    """Return a route extended straight to a member of the goal."""
    path = np.vstack((route.taut, member.position))
    return Route(room.sleeve_of(path), path, path_length(path), member.heading)


def run_in(room: FreeSpace, place: FloatArray, heading: float | None, nominal_length: float) -> FloatArray:
    """Return the point at which the straight approach to a goal position along the goal's heading begins, (2,) [m].

    Args:
        room: free space.
        place: position of the goal, shape (2,) [m].
        heading: heading of the last link at the goal [rad]; None for no approach.
        nominal_length: length of a nominal link [m].
    """
    if heading is None:
        return place
    for links in _RUN_IN:
        entry = place - links * nominal_length * unit_vector(heading)
        if room.contains(np.linspace(entry, place, _RUN_IN_SAMPLES)).all():
            return np.asarray(entry)
    return place


def tip_paths_along(
    problem: Problem,
    ends: Ends,
    routes: tuple[Route, ...],
    room: FreeSpace,
) -> tuple[TipPath, ...]:
    """Return tip paths, one per homotopy class: along every route, or along the arm in a given goal pose.

    Args:
        problem: the problem.
        ends: start and goal of the motion.
        routes: routes from the base to the goal.
        room: free space in which the routes were found; that of the tip has equal inflation and settings.

    Returns:
        The tip paths. Empty if the tip has no path in free space, whose corners are approximated; that does not prove
        that there is no path.
    """
    arm = problem.arm
    points = arm.joint_positions_at(ends.start)
    if ends.goal_pose is not None:
        ways: tuple[FloatArray, ...] = (arm.joint_positions_at(ends.goal_pose),)
    else:
        ways = tuple(route.taut for route in routes)
    link = max(arm.link_length, arm.length / NOMINAL_LINKS)
    gate_runs = GateRuns(_GATE_WIDTH * arm.length, _GATE_RUN * link, arm.base, 1.1 * room.inflation)
    drawn = FreeSpace(problem.workspace, room.inflation, settings=room.settings, gate_runs=gate_runs)
    try:
        paths = find_tip_paths(drawn, points, ways, CORNER_DISTANCE * arm.length)
    except UnreachableGoal:
        return ()
    if ends.goal_pose is None:
        return turning_least(paths, float(ends.start[0]), arm.base_limit)
    return with_base_turn(paths, float(ends.goal_pose[0] - ends.start[0]))


def find_guesses(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    routes: tuple[Route, ...],
) -> Iterator[FloatArray]:
    """Yield at most one guess of a configuration (c,) at the goal.

    The guess is a goal of the whole arm itself, or the configuration of a curve along one of the first routes.
    """
    if ends.goal_pose is not None:
        yield ends.goal_pose
        return
    tries = [(route, _ATTEMPTS, CURVATURE_SHARE) for route in routes[:_CONFIGURATIONS]]
    tries += [(route, 1, FULL_CURVATURE_SHARE) for route in routes[:1]]
    for route, attempts, share in tries:
        guess = guess_along(problem, ends, room, route, attempts, share)
        if guess is not None:
            yield guess
            return


def further_guesses(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    routes: tuple[Route, ...],
) -> Iterator[FloatArray]:
    """Yield configurations (c,) at the goal along every route, with more attempts for each than ``find_guesses``."""
    for route in routes:
        guess = guess_along(problem, ends, room, route, FURTHER_ATTEMPTS, CURVATURE_SHARE)
        if guess is not None:
            yield guess


def guess_along(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    route: Route,
    attempts: int,
    share: float,
) -> FloatArray | None:
    """Return a configuration (c,) at the goal along a route, or None if the NLP finds no curve that links can follow.

    None is not a failure: the search for a motion can lead the tip to the goal without such a configuration.

    Args:
        problem: the problem.
        ends: start and goal of the motion.
        room: free space.
        route: route from the base to the goal.
        attempts: maximum number of attempts of the NLP.
        share: fraction of the greatest curvature that the curve may use.
    """
    try:
        task = configuration_task(problem, ends, room, route, share)
        configuration = find_configuration(task, attempts)
        return map_curve(problem.arm, configuration, problem.planner.mapping)
    except (ConfigurationNotFound, ProblemError):
        return None


def configuration_task(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    route: Route,
    share: float = CURVATURE_SHARE,
) -> ConfigurationTask:
    """Return the task of finding a curve of the arm's length along a route to the goal, for the configuration NLP.

    Args:
        problem: problem with arm, goal and weights.
        ends: start and goal of the motion.
        room: free space.
        route: route from the base to the goal.
        share: fraction of the greatest curvature (joint limit over link length) that the curve may use.
    """
    arm = problem.arm
    # Of a goal set, the configuration takes the member that the route leads to.
    taut = room.sleeve_path(route.sleeve, arm.base, route.taut[-1])
    corridor = room.corridor(Route(route.sleeve, taut, path_length(taut)))
    weights = problem.planner.weights
    return ConfigurationTask(
        base=arm.base,
        base_heading_range=base_heading_range(problem, ends),
        length=arm.length,
        curvature_limit=share * arm.joint_limit / arm.link_length,
        goal=route.taut[-1],
        goal_heading=route.heading,
        corridor=corridor,
        mount_length=arm.mount_length,
        bending_weight=weights.bending,
        clearance_weight=weights.clearance,
        side_gaps=side_gaps(room, corridor) if weights.clearance > 0.0 else (),
    )


def side_gaps(room: FreeSpace, corridor: Corridor) -> tuple[FloatArray, ...]:
    """Return, for each region of a corridor, the distances from its sides to inflated walls behind them, (sides,) [m].

    Distances are measured where a side is nearest to the route, and positive for sides that touch no wall.
    """
    walls = room.workspace.walls
    cores = np.array([wall.core for wall in walls])
    rounding = np.array([wall.rounding for wall in walls])
    route = shapely.LineString(corridor.route.taut)
    gaps = []
    for region in corridor.regions:
        sides = shapely.linestrings(np.stack((region.vertices, np.roll(region.vertices, -1, axis=0)), axis=1))
        nearest = shapely.get_point(shapely.shortest_line(sides, route), 0)
        least = (shapely.distance(np.asarray(nearest)[:, None], cores) - rounding).min(axis=1)
        gaps.append(np.maximum(least - room.inflation, 0.0))
    return tuple(gaps)


def base_heading_range(problem: Problem, ends: Ends) -> tuple[float, float]:
    """Return the lower and upper bound on the heading of the curve at the base [rad]; equal for a clamped base."""
    arm = problem.arm
    if ends.clamped:
        heading = float(arm.headings(ends.start)[0])
        return heading, heading
    return arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit
