"""The planner of this package: plans a continuous curve, then the links in the curve's coordinates.

Free space and routes (section 4.1), a goal configuration of the continuous curve by the NLP, tip paths, the
certified motion on the links, and a smooth path through joint space.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import shapely
from scipy.interpolate import BSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import ConfigurationNotFound, Diagnosis, MotionNotFound, UnreachableGoal
from ccm_opt.freespace.corridor import Corridor, Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.geometry.angles import unit_vector
from ccm_opt.geometry.polyline import path_length
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.motion.continuation import Deadline
from ccm_opt.motion.ends import Ends, clamped_arm, resolve_ends
from ccm_opt.motion.limits.limit import Limit
from ccm_opt.motion.limits.user_limit import UserLimit
from ccm_opt.motion.link_space import nearest_curve
from ccm_opt.motion.motion_task import CachedItems, JointSlowness, Motion, MotionTask
from ccm_opt.motion.search import find_motion
from ccm_opt.motion.smooth_path import smooth_path
from ccm_opt.motion.tip_paths import TipPath, find_tip_paths, turning_by
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.find_configuration import find_configuration
from ccm_opt.planners.curve_settings import CurvePlannerSettings
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath
from ccm_opt.stages import Stages
from ccm_opt.user_terms.compiled_terms import UserTerms

ROUTE_MARGIN = 1e-3
"""Free space for routes is inflated by this share of the arm's length beyond radius and clearance."""
STRETCH = 1e-9
"""Rounding allowed when a goal at full stretch is compared with the arm's length, as a share of it."""
LEAST_SPARE = 1e-3
"""Share of that inflation that is always kept, so that free space is never empty of width."""
CORNER_DISTANCE = 0.016
"""Distance that taut paths keep from corners where there is room, as a share of the arm's length."""
RUN_IN = (2.0, 1.0, 0.5, 0.0)
"""Straight run onto the goal along its heading, in nominal links (24 to the arm); the longest that is free."""
LONGEST_ROUTE = 0.985
"""Routes longer than this share of the arm's length are not looked at."""
CONFIGURATIONS_TRIED = 2
"""Routes for which a goal configuration is asked of the NLP."""
ATTEMPTS = 2
"""Attempts of the NLP at one configuration: its first guess with the spare length on either side."""
FURTHER_ATTEMPTS = 4
"""Attempts when the search asks for more configurations."""
CURVATURE_SHARE = 0.9
"""Share of the tightest bend (joint limit over link length) that the curve may use."""
FULL_CURVATURE_SHARE = 0.995
"""The same for another guess when there is none at that share."""
PLANNING_SHARE = 0.9
"""Share of the time limit that the search may use."""


@dataclass(frozen=True)
class CurvePlanner:
    """Plans by the continuous curve; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
        terms: the user's own constraints and costs, or None.
        settings: numbers of every stage.
    """

    stages: Stages = field(default_factory=Stages)
    terms: UserTerms | None = None
    settings: CurvePlannerSettings = field(default_factory=CurvePlannerSettings)

    @property
    def user_limits(self) -> tuple[Limit, ...]:
        """The user's constraints and costs as limits of the motion; usually none."""
        return () if self.terms is None else (UserLimit(self.terms, self.settings.motion.user_limits),)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        deadline = Deadline(time.monotonic() + PLANNING_SHARE * problem.planner.time_limit)
        with self.stages("mapping"):
            ends = resolve_ends(problem)
            for limit in self.user_limits:
                limit.refuse_ends(ends.start, ends.goal_headings)
        task, motion = self.motion_between(problem, ends, deadline)
        with self.stages("motion"):
            return joint_path(problem, task, motion)

    def motion_between(self, problem: Problem, ends: Ends, deadline: Deadline) -> tuple[MotionTask, Motion]:
        """The certified motion between ends that are already resolved, and what was asked of the search for it.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        with self.stages("free space"):
            room = FreeSpace(problem.workspace, route_margin(problem, ends))
            routes = find_routes(problem, ends, room) if ends.goal_headings is None else ()
            tip_paths = tip_paths_along(problem, ends, routes)
        guesses = CachedItems(self._in_stage(find_guesses(problem, ends, room, routes)))
        further = CachedItems(self._in_stage(further_guesses(problem, ends, room, routes)))
        with self.stages("motion"):
            task = MotionTask(
                clamped_arm(problem.arm) if ends.clamped else problem.arm,
                problem.workspace,
                ends.start,
                ends.goal,
                ends.goal_headings,
                guesses,
                tip_paths,
                deadline,
                clamped=ends.clamped,
                further_guesses=further,
                optimiser=problem.planner.optimiser,
                seed=problem.planner.seed,
                weights=problem.planner.weights,
                slowness=slowness(problem),
                user_limits=self.user_limits,
                settings=self.settings.motion,
            )
            return task, find_motion(task)

    def _in_stage(self, configurations: Iterator[FloatArray]) -> Iterator[FloatArray]:
        """Configurations, each made in the stage of that name when it is asked for."""
        while True:
            with self.stages("configuration"):
                found = next(configurations, None)
            if found is None:
                return
            yield found


def slowness(problem: Problem) -> JointSlowness:
    """What the joints can do by their limits; planar motion turns the second revolute of every ball."""
    return JointSlowness.from_limits(problem.limits.velocity[1::3], problem.limits.acceleration[1::3])


def route_margin(problem: Problem, ends: Ends) -> float:
    """Inflation of the walls for routes [m]: a little more than the arm needs, but no more than the goal has.

    Where that closes every way from the base to the goal it is hardly more than the arm needs.
    """
    least = problem.arm.radius + problem.workspace.clearance
    goal = shapely.Point(ends.goal.position)
    room = min(shapely.distance(goal, wall.core) - wall.rounding for wall in problem.workspace.walls)
    spare = ROUTE_MARGIN * problem.arm.length
    wide = least + float(np.clip(room - least - LEAST_SPARE * spare, LEAST_SPARE * spare, spare))
    if ends.goal_headings is not None or _connected(problem, ends, wide):
        return wide
    return least + LEAST_SPARE * spare


def _connected(problem: Problem, ends: Ends, margin: float) -> bool:
    """Whether the free places nearest to the base and to the goal are in one piece."""
    pieces = shapely.get_parts(FreeSpace(problem.workspace, margin).polygons)
    if len(pieces) < 2:
        return len(pieces) == 1
    nearest = [np.argmin(shapely.distance(pieces, shapely.Point(p))) for p in (problem.arm.base, ends.goal.position)]
    return bool(nearest[0] == nearest[1])


def find_routes(problem: Problem, ends: Ends, room: FreeSpace) -> tuple[Route, ...]:
    """Routes from the base to the start of the run onto the goal, shortest first.

    Raises:
        UnreachableGoal: when there is none that the arm is long enough for.
    """
    arm = problem.arm
    entry = run_in(room, ends, arm.length / 24.0)
    longest = LONGEST_ROUTE * arm.length - float(np.hypot(*(ends.goal.position - entry)))
    shrink = CORNER_DISTANCE * arm.length
    routes = room.routes(arm.base, entry, problem.planner.routes, longest=longest, shrink=shrink)
    if routes:
        return tuple(_led_on(room, route, ends.goal.position) for route in routes)
    shortest = room.routes(arm.base, ends.goal.position, 1, shrink=0.0)
    if shortest and shortest[0].length <= (1.0 + STRETCH) * arm.length:
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


def run_in(room: FreeSpace, ends: Ends, unit: float) -> FloatArray:
    """Where the straight run onto the goal along its heading begins, shape (2,) [m]."""
    goal = ends.goal
    if goal.heading is None:
        return goal.position
    direction = unit_vector(goal.heading)
    for links in RUN_IN:
        entry = goal.position - links * unit * direction
        if room.contains(np.linspace(entry, goal.position, 9)).all():
            return entry
    return goal.position


def tip_paths_along(problem: Problem, ends: Ends, routes: tuple[Route, ...]) -> tuple[TipPath, ...]:
    """Classes of tip motions: along every route, or along the goal pose itself when that is given."""
    arm = problem.arm
    points = arm.joint_positions(ends.start)
    if ends.goal_headings is not None:
        ways: tuple[FloatArray, ...] = (arm.joint_positions(ends.goal_headings),)
    else:
        ways = tuple(route.taut for route in routes)
    paths = find_tip_paths(problem.workspace, points, ways, route_margin(problem, ends), CORNER_DISTANCE * arm.length)
    if ends.goal_headings is None:
        return paths
    return turning_by(paths, points, float(ends.goal_headings[0] - ends.start[0]))


def find_guesses(problem: Problem, ends: Ends, room: FreeSpace, routes: tuple[Route, ...]) -> Iterator[FloatArray]:
    """Link headings of a goal pose: the goal itself, or a configuration of the curve along one of the first routes."""
    if ends.goal_headings is not None:
        yield ends.goal_headings
        return
    tries = [(route, ATTEMPTS, CURVATURE_SHARE) for route in routes[:CONFIGURATIONS_TRIED]]
    tries += [(route, 1, FULL_CURVATURE_SHARE) for route in routes[:1]]
    for route, attempts, share in tries:
        guess = guess_along(problem, ends, room, route, attempts, share)
        if guess is not None:
            yield guess
            return


def further_guesses(problem: Problem, ends: Ends, room: FreeSpace, routes: tuple[Route, ...]) -> Iterator[FloatArray]:
    """Link headings of goal poses along every route, with more patience."""
    for route in routes:
        guess = guess_along(problem, ends, room, route, FURTHER_ATTEMPTS)
        if guess is not None:
            yield guess


def guess_along(
    problem: Problem, ends: Ends, room: FreeSpace, route: Route, attempts: int, share: float = CURVATURE_SHARE
) -> FloatArray | None:
    """Link headings of a configuration at the goal along a route; None when the NLP finds none.

    That is no failure: the motion search can lead the tip to the goal by itself.
    """
    try:
        configuration = find_configuration(configuration_task(problem, ends, room, route, share), attempts)
    except ConfigurationNotFound:
        return None
    return map_curve(problem.arm, configuration, problem.planner.mapping)


def configuration_task(
    problem: Problem, ends: Ends, room: FreeSpace, route: Route, share: float = CURVATURE_SHARE
) -> ConfigurationTask:
    """The configuration NLP's question along one route, with a share of the tightest bend."""
    arm = problem.arm
    taut = room.path_of_sleeve(route.sleeve, arm.base, ends.goal.position)
    corridor = room.corridor(Route(route.sleeve, taut, path_length(taut)))
    weights = problem.planner.weights
    return ConfigurationTask(
        base=arm.base,
        base_heading_range=base_heading_range(problem, ends),
        length=arm.length,
        curvature_limit=share * arm.joint_limit / arm.link_length,
        goal=ends.goal.position,
        goal_heading=ends.goal.heading,
        corridor=corridor,
        mount_length=arm.mount_length,
        bending_weight=weights.bending,
        clearance_weight=weights.clearance,
        side_gaps=side_gaps(room, corridor) if weights.clearance > 0.0 else (),
    )


def side_gaps(room: FreeSpace, corridor: Corridor) -> tuple[FloatArray, ...]:
    """How far behind every side of every region the inflated walls begin [m], for sides may lie in the open.

    Measured where the side is nearest to the route.
    """
    walls = room.workspace.walls
    cores, rounding = np.array([wall.core for wall in walls]), np.array([wall.rounding for wall in walls])
    route, gaps = shapely.LineString(corridor.route.taut), []
    for region in corridor.regions:
        sides = shapely.linestrings(np.stack((region.vertices, np.roll(region.vertices, -1, axis=0)), axis=1))
        nearest = shapely.get_point(shapely.shortest_line(sides, route), 0)
        least = (shapely.distance(np.asarray(nearest)[:, None], cores) - rounding).min(axis=1)
        gaps.append(np.maximum(least - room.margin, 0.0))
    return tuple(gaps)


def base_heading_range(problem: Problem, ends: Ends) -> tuple[float, float]:
    """Least and greatest heading of the curve at the base [rad]."""
    arm = problem.arm
    if ends.clamped:
        return float(ends.start[0]), float(ends.start[0])
    return arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit


def joint_path(problem: Problem, task: MotionTask, motion: Motion) -> JointPath:
    """The smooth, certified path through joint space along a motion.

    Raises:
        MotionNotFound: when no smooth path near the motion can be certified.
    """
    path = smooth_path(motion, task)
    if path is None:
        reason = "the motion leaves no room for a smooth path"
        names = ", ".join(f"'{name}'" for limit in task.user_limits for name in limit.names)
        if names:
            reason = f"{reason} that keeps the joint limits and the constraints {names}"
        raise MotionNotFound(Diagnosis(reason, "motion", ("use a smaller radius or clearance",)))
    control = problem.arm.bends(path.spline.c)
    curves = tuple(nearest_curve(problem.arm, headings) for headings in motion.headings)
    keyframes = problem.arm.bends(motion.headings)
    spline = BSpline(path.spline.t, control, path.spline.k)
    return JointPath(spline, keyframes, curves, motion.candidate, spare=path.spare)
