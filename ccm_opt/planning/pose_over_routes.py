"""Goal poses over several routes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ConfigurationNotFound, ProblemError
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import unit_vector
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import attempt, attempts
from ccm_opt.ik.infeasibility import FailedAttempt, beyond_reach, diagnose
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.planning.curve_routes import (
    CURVATURE_SHARE,
    FULL_CURVATURE_SHARE,
    FURTHER_ATTEMPTS,
    configuration_task,
    find_routes,
    route_room,
)
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.ends import Ends, clamped_arm, resolve_ends
from ccm_opt.planning.goal_members import GoalMember, goal_members
from ccm_opt.planning.goal_pose import GoalPoseSearch, for_arm
from ccm_opt.planning.link_space import KNOTS, LinkSpace
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.mapping import map_curve
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.free_space import FreeSpace

_DIFFERENT = 0.3
"""Largest turn of a link by which two configurations count as different [rad]. Taste."""

_BEGINNINGS = 2
"""Configurations along each route from which the static question is asked. Taste: the surplus length to either side."""
_BROUGHT_ROUNDS = 20
"""Rounds of random poses that Newton's method brings onto the goal, where neither routes nor drawn poses answer the
static question. Taste: a tenth of a second each."""
_BROUGHT = 6
"""Of these poses so many at most are improved by the NLP, until one serves. Taste."""


def brought_poses(
    problem: Problem,
    arm: Arm,
    ends: Ends,
    members: tuple[GoalMember, ...],
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> Iterator[FloatArray]:
    """Link headings of random poses with the tip on members of the goal that touch nothing for all that samples show.

    Args:
        problem: with the walls, and a seed.
        arm: that is to get there.
        ends: with the goal.
        members: of the goal, that have a route.
        settings: numbers.

    Yields:
        Poses of shape (links,) [rad]; of members in turn.
    """
    connect = settings.motion.connect
    rng = np.random.default_rng(problem.planner.seed)
    space, _ = LinkSpace.through(arm, ends.start, NOMINAL_LINKS, clamped=ends.clamped)
    share = settings.motion.step.limit_share
    shapes = TargetDraws.within(space, [ends.start], KNOTS + 1, share, connect)
    check = SampledCheck.of(arm, problem.workspace)
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
            yield from next(drawn)


@dataclass(frozen=True, eq=False)
class PoseTry:
    """What came of one beginning.

    Attributes:
        start: where it began, in words.
        search: that improved it.
        poses: solutions of the NLP, each from the one before; none when there was nothing to begin with.
        starts: link headings that each of them began with, of shape (links,) [rad].
        reason: why there was nothing to begin with; empty when there was.
    """

    start: str
    search: GoalPoseSearch
    poses: tuple[ArmPose, ...] = ()
    starts: tuple[FloatArray, ...] = ()
    reason: str = ""

    @property
    def best(self) -> int | None:
        """Which of the poses is the best feasible one; None when none is."""
        feasible = [k for k, pose in enumerate(self.poses) if self.search.feasible(pose)]
        return min(feasible, key=lambda k: self.poses[k].answer.cost, default=None)

    @property
    def cost(self) -> float:
        """That of the best pose; infinite without one."""
        return float("inf") if self.best is None else self.poses[self.best].answer.cost


def pose_search(
    problem: Problem, terms: UserTerms | None = None, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
) -> GoalPoseSearch:
    """The goal-pose NLP for a problem whose goal is for the tip.

    Raises:
        UnreachableGoal: the start or the goal touches something, or the start breaks a joint limit.
    """
    ends = resolve_ends(problem)
    arm = clamped_arm(problem.arm) if ends.clamped else problem.arm
    return GoalPoseSearch(for_arm(problem, arm), ends, problem.arm.headings(ends.start), terms, settings.goal_pose)


def pose_tries(search: GoalPoseSearch, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> Iterator[PoseTry]:
    """A try from a configuration of the curve along every route, shortest first.

    Args:
        search: for the problem.
        settings: of routes and configurations.

    Raises:
        UnreachableGoal: there is no route that the arm is long enough for.
    """
    problem = search.problem
    ends = search.ends
    room = route_room(problem, ends)
    for number, route in enumerate(find_routes(problem, ends, room, settings), start=1):
        start = f"route {number}, {long_length(route.length)}"
        try:
            beginnings = _along(problem, ends, room, route)
        except ConfigurationNotFound as error:
            yield PoseTry(start, search, reason=error.diagnosis.reason)
            continue
        for letter, headings in zip("abcdefgh", beginnings, strict=False):
            yield tried_from(search, f"{start}, {letter}" if len(beginnings) > 1 else start, headings)


def drawn_tries(search: GoalPoseSearch, tries: Sequence[PoseTry]) -> Iterator[PoseTry]:
    """Tries from poses of other classes that are drawn at random about what costs least without walls.

    Args:
        search: for the problem.
        tries: made so far; the best of them says below which cost a pose is worth drawing.
    """
    best = min(tries, key=lambda each: each.cost, default=None)
    near = search.problem.arm.headings(search.ends.start)
    if best is not None and best.best is not None:
        near = best.poses[best.best].headings
    elif best is not None and best.starts:
        near = best.starts[0]
    for number, candidate in enumerate(search.candidates(near), start=1):
        yield tried_from(search, f"drawn pose {number}", candidate.pose.headings)


def brought_tries(search: GoalPoseSearch, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER) -> Iterator[PoseTry]:
    """Tries from random poses that are brought onto the goal, until one serves; for where nothing else does.

    Args:
        search: for the problem.
        settings: how many.
    """
    problem = search.problem
    members = goal_members(problem.arm, search.ends.goal, route_room(problem, search.ends))
    poses = brought_poses(problem, problem.arm, search.ends, members, settings)
    for number, headings in enumerate(islice(poses, _BROUGHT), start=1):
        found = tried_from(search, f"pose brought onto the goal {number}", headings)
        yield found
        if found.best is not None:
            return


def tried_from(search: GoalPoseSearch, start: str, headings: FloatArray) -> PoseTry:
    """The poses to which a beginning is improved."""
    poses = search.improved(headings)
    begun = (headings, *(pose.headings for pose in poses[:-1]))
    return PoseTry(start, search, poses, begun)


def _along(problem: Problem, ends: Ends, room: FreeSpace, route: Route) -> list[FloatArray]:
    """Link headings of different configurations of the curve along a route, at least one.

    Raises:
        ConfigurationNotFound: with all of its bend, too, the curve finds no way through the corridor.
    """
    for share in (CURVATURE_SHARE, FULL_CURVATURE_SHARE):
        task = configuration_task(problem, ends, room, route, share)
        found, failures = _configurations(problem, task)
        if found:
            return found
    raise ConfigurationNotFound(beyond_reach(task) or diagnose(task, failures))


def _configurations(problem: Problem, task: ConfigurationTask) -> tuple[list[FloatArray], list[FailedAttempt]]:
    """Different configurations through one corridor as link headings, and the attempts that failed."""
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
        # The surplus length may swing to either side of the route: two poses of one class, and neither the better.
        if all(np.max(np.abs(headings - other)) > _DIFFERENT for other in found):
            found.append(headings)
        if len(found) == _BEGINNINGS:
            break
    return found, failures
