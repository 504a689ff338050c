"""Poses of the arm at the goal: the goal itself, or configurations of the continuous curve found by the NLP."""

from collections.abc import Iterator

import numpy as np
import shapely

from ccm_opt.errors import ConfigurationNotFound, ProblemError
from ccm_opt.freespace.corridor import Corridor, Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.motion.ends import Ends
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.find_configuration import find_configuration
from ccm_opt.planners.curve_settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import Problem


def find_guesses(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    routes: tuple[Route, ...],
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> Iterator[FloatArray]:
    """Link headings of a goal pose: the goal itself, or a configuration of the curve along one of the first routes."""
    if ends.goal_headings is not None:
        yield ends.goal_headings
        return
    tries = [(route, settings.attempts, settings.curvature_share) for route in routes[: settings.configurations]]
    tries += [(route, 1, settings.full_curvature_share) for route in routes[:1]]
    for route, attempts, share in tries:
        guess = guess_along(problem, ends, room, route, attempts, share, settings)
        if guess is not None:
            yield guess
            return


def further_guesses(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    routes: tuple[Route, ...],
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> Iterator[FloatArray]:
    """Link headings of goal poses along every route, with more patience."""
    for route in routes:
        guess = guess_along(problem, ends, room, route, settings.further_attempts, settings.curvature_share, settings)
        if guess is not None:
            yield guess


def guess_along(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    route: Route,
    attempts: int,
    share: float,
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> FloatArray | None:
    """Link headings of a configuration at the goal along a route; None when the NLP finds none that links can follow.

    That is no failure: the motion search can lead the tip to the goal by itself.
    """
    try:
        task = configuration_task(problem, ends, room, route, share, settings)
        configuration = find_configuration(task, attempts)
        return map_curve(problem.arm, configuration, problem.planner.mapping)
    except (ConfigurationNotFound, ProblemError):
        return None


def configuration_task(
    problem: Problem,
    ends: Ends,
    room: FreeSpace,
    route: Route,
    share: float | None = None,
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> ConfigurationTask:
    """What the configuration NLP is asked along one route.

    Args:
        problem: arm, goal and weights.
        ends: of the motion.
        room: free space.
        route: from the base to the goal.
        share: of the tightest bend that the curve may use; that of the settings when None.
        settings: numbers.
    """
    arm = problem.arm
    # Of a goal that is a set, the configuration takes the member that the route leads to.
    taut = room.path_of_sleeve(route.sleeve, arm.base, route.taut[-1])
    corridor = room.corridor(Route(route.sleeve, taut, path_length(taut)))
    weights = problem.planner.weights
    return ConfigurationTask(
        base=arm.base,
        base_heading_range=base_heading_range(problem, ends),
        length=arm.length,
        curvature_limit=(settings.curvature_share if share is None else share) * arm.joint_limit / arm.link_length,
        goal=route.taut[-1],
        goal_heading=route.heading,
        corridor=corridor,
        mount_length=arm.mount_length,
        bending_weight=weights.bending,
        clearance_weight=weights.clearance,
        side_gaps=side_gaps(room, corridor) if weights.clearance > 0.0 else (),
        settings=settings.configuration,
    )


def side_gaps(room: FreeSpace, corridor: Corridor) -> tuple[FloatArray, ...]:
    """How far behind every side of every region the inflated walls begin [m], for sides may lie in the open.

    Measured where the side is nearest to the route.
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
    """Least and greatest heading of the curve at the base [rad]."""
    arm = problem.arm
    if ends.clamped:
        return float(ends.start[0]), float(ends.start[0])
    return arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit
