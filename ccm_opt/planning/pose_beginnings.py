"""Initial guesses of the goal-pose NLP: along routes to the goal, at the end of a motion, and sampled poses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ConfigurationNotFound, Diagnosis, NoPlanFound, ProblemError
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import attempt, attempts
from ccm_opt.ik.infeasibility import FailedAttempt, beyond_reach, diagnose
from ccm_opt.planning.curve_routes import (
    CURVATURE_SHARE,
    FULL_CURVATURE_SHARE,
    FURTHER_ATTEMPTS,
    configuration_task,
    find_routes,
    route_room,
)
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.ends import Ends
from ccm_opt.planning.goal_members import GoalMember, goal_members
from ccm_opt.planning.link_space import KNOTS, LinkSpace
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.refinement import nominal_task, refine_space_motion
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.sampled_poses import goal_poses
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.mapping import map_curve
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace

_DIFFERENT = 0.3
"""Difference in the heading of a link above which two configurations count as different [rad]. Heuristic."""
_BEGINNINGS = 2
"""Maximum number of configurations along each route. Heuristic: one for each side to which the arm's surplus length can
bulge."""
_BROUGHT_ROUNDS = 20
"""Maximum number of rounds of random poses that are moved onto the goal. Heuristic: a tenth of a second each."""


@dataclass(frozen=True)
class PoseSearchSettings:
    """Settings of the search for the best pose at a goal.

    Attributes:
        drawn: maximum number of sampled poses, each of which the goal-pose NLP improves. Heuristic: each takes a
            quarter of a second.
        rounds: maximum number of solutions from each initial guess. Measured: among the shared problems, the fork gains
            from ten.
        draw_share: fraction of the remaining time that sampling in space may take if a motion was found. Heuristic:
            ducts admit so few poses that sampling finds none in any time; the default amounts to 1.5 s, in which an
            open scene yields the full number of poses.
        motion_share: fraction of the remaining time that the search for a motion in space may take; its last pose is
            an initial guess. Heuristic.
    """

    drawn: int = 6
    rounds: int = 12
    draw_share: float = 0.025
    motion_share: float = 0.4


@dataclass(frozen=True, eq=False)
class PoseBeginning:
    """An initial guess at the goal, nearly free of contact, or the reason why there is none.

    Attributes:
        name: description of the guess's origin.
        q: the configuration, shape (c,) [rad, m]; None if there is none.
        missing: diagnosis of why there is none; None if there is one.
    """

    name: str
    q: FloatArray | None = None
    missing: Diagnosis | None = None


def along_routes(problem: Problem, ends: Ends) -> Iterator[PoseBeginning]:
    """Yield guesses along each route, shortest first: configurations with a curve along it, or why there is none.

    Args:
        problem: problem in the plane, with a goal for the tip.
        ends: its resolved ends.

    Raises:
        UnreachableGoal: there is no route that the arm is long enough for.
    """
    room = route_room(problem, ends)
    for number, route in enumerate(find_routes(problem, ends, room), start=1):
        name = f"route {number}, {long_length(route.length)}"
        try:
            beginnings = _along(problem, ends, room, route)
        except ConfigurationNotFound as error:
            yield PoseBeginning(name, missing=error.diagnosis)
            continue
        for letter, headings in zip("abcdefgh", beginnings, strict=False):
            lettered = f"{name}, {letter}" if len(beginnings) > 1 else name
            yield PoseBeginning(lettered, problem.arm.bends(headings))


def in_plane(
    problem: Problem, ends: Ends, search: PoseSearchSettings, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> Iterator[PoseBeginning]:
    """Yield guesses along routes, and sampled poses at the goal, in the plane.

    Args:
        problem: problem in the plane, with a goal for the tip.
        ends: its resolved ends.
        search: settings of the pose search.
        settings: settings of the planner.

    Raises:
        UnreachableGoal: there is no route that the arm is long enough for.
    """
    yield from along_routes(problem, ends)
    members = goal_members(problem.arm, ends.goal, route_room(problem, ends))
    poses = islice(brought_poses(problem, problem.arm, ends, members, settings), search.drawn)
    for number, q in enumerate(poses, start=1):
        yield PoseBeginning(f"sampled pose {number}", q)


def in_space(task: SpaceTask, search: PoseSearchSettings) -> Iterator[PoseBeginning]:
    """Yield the last pose of a motion to the goal, or the reason why none was found, and sampled poses at the goal.

    Args:
        task: search task in space with a goal for the tip.
        search: settings of the pose search.
    """
    limit = max(task.deadline.left, 0.0)
    try:
        motion = any_motion(task.deadline_within(search.motion_share * limit))
        yield PoseBeginning(f"the end of a motion ({motion.candidate})", motion.configurations[-1])
        drawing = task.deadline_within(search.draw_share * limit)
    except NoPlanFound as failure:
        yield PoseBeginning("the end of a motion", missing=failure.diagnosis)
        # Without a motion, sampling may use all the time that is left.
        drawing = task
    curve, _ = unknowns_through(drawing.arm, drawing.start)
    poses = goal_poses(drawing, drawing.stepper(curve), np.random.default_rng(drawing.seed))
    for number, pose in enumerate(islice(poses, search.drawn), start=1):
        yield PoseBeginning(f"sampled pose {number}", pose.q)


def any_motion(task: SpaceTask) -> SpaceMotion:
    """Return the first motion found from the start to the goal.

    Raises:
        NoPlanFound: no motion was found before the deadline.
    """
    few = nominal_task(task)
    if few is not None:
        try:
            refined = refine_space_motion(task, find_by_ways(few))
        except NoPlanFound:
            refined = None
        if refined is not None:
            return refined
    return find_by_ways(task)


def brought_poses(
    problem: Problem,
    arm: Arm,
    ends: Ends,
    members: tuple[GoalMember, ...],
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> Iterator[FloatArray]:
    """Yield random poses with the tip on members of the goal for which the sampled check finds no contact.

    Args:
        problem: problem in the plane; gives walls and seed.
        arm: the arm.
        ends: resolved ends.
        members: members of the goal.
        settings: settings of the planner.

    Yields:
        Configurations, each of shape (c,) [rad], for the members in turn.
    """
    rng = np.random.default_rng(problem.planner.seed)
    space, _ = LinkSpace.through(arm, ends.start, NOMINAL_LINKS, clamped=ends.clamped)
    share = settings.motion.step.limit_share
    shapes = TargetDraws.within(space, [ends.start], KNOTS + 1, share)
    check = SampledCheck.for_workspace(arm, problem.workspace)
    goals = [
        replace(
            ends.goal,
            position=each.position,
            direction=None if each.heading is None else unit_vector(each.heading),
            room=(0.0, 0.0),
        )
        for each in members
    ]
    draws = [GoalDraws(shapes, goal, check).poses(rng) for goal in goals]
    for _ in range(_BROUGHT_ROUNDS):
        for drawn in draws:
            yield from arm.bends(next(drawn))


def _along(problem: Problem, ends: Ends, room: FreeSpace, route: Route) -> list[FloatArray]:
    """Return link headings of one or more different configurations whose curve follows a route, each (links,) [rad].

    Args:
        problem: problem in the plane.
        ends: its resolved ends.
        room: free space of the arm's centre line.
        route: the route.

    Raises:
        ConfigurationNotFound: no curve fits through the corridor about the route, even with the full curvature.
    """
    for share in (CURVATURE_SHARE, FULL_CURVATURE_SHARE):
        task = configuration_task(problem, ends, room, route, share)
        found, failures = _configurations(problem, task)
        if found:
            return found
    raise ConfigurationNotFound(beyond_reach(task) or diagnose(task, failures))


def _configurations(problem: Problem, task: ConfigurationTask) -> tuple[list[FloatArray], list[FailedAttempt]]:
    """Return link headings (links,) of different configurations along one corridor [rad], and the failed attempts."""
    found: list[FloatArray] = []
    failures: list[FailedAttempt] = []
    if beyond_reach(task) is not None:
        return found, failures
    for regions, profile, bulge in islice(attempts(task), FURTHER_ATTEMPTS):
        outcome = attempt(task, regions, profile, bulge)
        if isinstance(outcome, FailedAttempt):
            failures.append(outcome)
            continue
        try:
            headings = problem.arm.headings(map_curve(problem.arm, outcome, problem.planner.mapping))
        except ProblemError:
            continue  # the links cannot follow this curve
        # The surplus length may swing to either side of the route: two poses of one class, neither better in general.
        if all(np.max(np.abs(headings - other)) > _DIFFERENT for other in found):
            found.append(headings)
        if len(found) == _BEGINNINGS:
            break
    return found, failures
