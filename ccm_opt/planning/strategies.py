"""Strategies of the search for a motion, in order of trial: guides along routes in the plane, tip paths in space."""

from collections.abc import Iterator
from dataclasses import replace
from enum import IntEnum
from functools import partial
from itertools import islice

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.continuation import Stalled
from ccm_opt.planning.draws import Connecting
from ccm_opt.planning.ending import optimised_to_end_pose
from ccm_opt.planning.goal_members import ArcsAtLimits
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.passage_exit import backward_tasks, ending_in, laid_backward_tasks, reversed_motion
from ccm_opt.planning.passage_widths import MARGINS, fitting_margins, required_nominal_links
from ccm_opt.planning.random_tip_paths import WALKS, find_by_walks, is_walked
from ccm_opt.planning.refinement import coarse_task, taken_over
from ccm_opt.planning.rrt_connect import CONNECT, FEW_LINKS
from ccm_opt.planning.sampled_check import LEAST_SPACING, POSE_SPACING
from ccm_opt.planning.sampled_run import SAMPLED_ROUNDS
from ccm_opt.planning.search import Failure, Strategy, first_found
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.shortcuts import straightened
from ccm_opt.planning.smooth_path import smooth_path
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.problem import Weights
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_MOST_LINKS = 48
"""Number of links above which RRT-Connect is not used. Heuristic: the cost of a pose grows with the links."""

_WORTH_SHORTENING = 1.2
"""Duration of a motion along a leader's path above which it is optimised, as a multiple of the duration of a motion
that is linear from start to goal. Heuristic."""


FEW_BUDGETS = (5000, 10000, 20000)
"""Numbers of extensions of successive RRT-Connect searches before all other strategies, for arms of few links.
Measured: most scenes take about a thousand; a search that takes long mostly succeeds sooner when restarted."""
_WHOLE_ARM_BUDGETS = (8000,)
"""Numbers of extensions of the early search for other arms with a goal for the whole arm, except arms so thin that
poses have to be checked at spacings below their width. Heuristic: a quarter of a second."""
_SOON_BUDGETS = (4000,)
"""Numbers of extensions of the RRT-Connect searches for goals of the tip that follow the first candidates. Measured on
arms wound among walls: most searches take less than 2000, a tenth of a second."""
_BEFORE_SAMPLING = 2
"""Number of candidates that are tried before that RRT-Connect search: those of the first tip path. Heuristic."""
_MIDDLE_BUDGETS = (60000, 60000)
"""Numbers of extensions of the searches after the candidates with the widest margin, for arms of many links. Heuristic:
three seconds."""
_LATE_BUDGETS = (60000, 60000)
"""Numbers of extensions of the late searches for all arms. Heuristic: a few seconds."""


class Turn(IntEnum):
    """When RRT-Connect is tried: EARLY before, MIDDLE among, LATE after the candidates.

    SOON is before those candidates that need poses at the goal, which are costly to find.
    """

    EARLY = 0
    LATE = 1
    MIDDLE = 2
    SOON = 4


def goes_straight_to_pose(task: MotionTask) -> bool:
    """Return whether ``straight`` applies: the goal is a whole-arm pose, and no limit depends on the path parameter."""
    return task.goal_pose is not None and not task.parametric


def straight(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return a motion found by interpolation from the start to a goal of the whole arm, or back from it, or None.

    QP steps make the motion deviate from the interpolation if limits require that.

    Args:
        task: search task with a goal for the whole arm.
        failures: list to which failures are appended.
    """
    margins = fitting_margins(task)
    forward = PlanarRun.from_task(task, margins[0])
    motion = forward.run(forward.direct(), failures)
    if motion is not None:
        return motion
    for turned in backward_tasks(task, forward.stepper):
        if turned is not None and not task.deadline.passed():
            backward = PlanarRun.from_task(turned, margins[0])
            motion = backward.run(backward.direct(), failures)
            return reversed_motion(motion) if motion is not None else None
    return None


def connects(task: MotionTask, turn: Turn = Turn.EARLY) -> bool:
    """Return whether RRT-Connect is tried for a task at one of its times (``turn``).

    It never is under user limits, which refuse motions that are linear in the coordinates.
    """
    refused = task.parametric or bool(task.user_limits)
    return not refused and len(_budgets(task, turn)) > 0


def connected(task: MotionTask, failures: list[Failure], turn: Turn = Turn.EARLY) -> Motion | None:
    """Return a motion found by RRT-Connect in the coordinates of the curve, or None.

    Args:
        task: search task.
        failures: list to which a failure is appended.
        turn: time at which RRT-Connect is tried, which determines the numbers of extensions.
    """
    budgets = _budgets(task, turn)
    if task.arm.links > _MOST_LINKS:
        return None
    if turn is Turn.SOON:
        task = replace(task, guesses=(), further_guesses=())
    run = PlanarRun.from_task(task.at_full_limits(), MARGINS[-1])
    search = Connecting(run.task, run.stepper.space, run.start, run.goal, run.goal_poses)
    motion = search.find(budgets, (task.seed, turn))
    if motion is None:
        ended = Stalled(f"{len(budgets)} searches of up to {max(budgets)} extensions found no connection", [run.start])
        failures.append(run.failure(CONNECT, ended))
    return motion


def _budgets(task: MotionTask, turn: Turn) -> tuple[int, ...]:
    few = task.arm.links <= FEW_LINKS
    # Without a tip path a motion of the arm is unlikely; with few links there may still be one closer to a wall.
    if not task.tip_paths and not few:
        return ()
    if turn is Turn.LATE:
        return _LATE_BUDGETS
    if few:
        return FEW_BUDGETS if turn is Turn.EARLY else ()
    # Checking poses of thin arms takes long.
    if needs_dense_sampling(task) or (task.goal_pose is None) != (turn is Turn.SOON):
        return ()
    if turn is Turn.SOON:
        return _SOON_BUDGETS
    return _WHOLE_ARM_BUDGETS if turn is Turn.EARLY else _MIDDLE_BUDGETS


def bends_freely(task: MotionTask) -> bool:
    """Return whether a search for goal poses with joints at their limits makes sense for a task.

    The goal must be one of the tip with a tip path, the base fixed but free to turn, and there must be no user limits.
    """
    free = not task.clamped and not task.arm.base_axes and not task.user_limits
    return free and task.goal_pose is None and len(task.tip_paths) > 0


def find_by_limit_arcs(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return a motion to a goal pose with joints at their limits, by interpolation or RRT-Connect, or None.

    Only goals of the tip that need such a pose are tried: those where guides that lead the tip end near the goal with a
    few joints at their limits and the others below theirs.
    """
    poses = ArcsAtLimits(task.arm, task.goal).where_needed(task.settings.step.full_limit_share)
    ending = [ending_in(task.at_full_limits(), pose) for pose in poses if _touches_nothing(task, pose)]
    for applies, find in ((goes_straight_to_pose, straight), (connects, connected)):
        for whole_arm in filter(applies, ending):
            motion = find(whole_arm, failures)
            if motion is not None or task.deadline.passed():
                return motion
    return None


def find_by_candidates(task: MotionTask, failures: list[Failure], *, narrow: bool = False) -> Motion | None:
    """Return the first certified motion of the candidates, trying one planning margin after another, or None.

    Args:
        task: search task.
        failures: list to which failures of candidates are appended.
        narrow: whether the widest margin is left out, if RRT-Connect is tried after the widest margin.
    """
    margins = fitting_margins(task)
    if is_divided(task):
        margins = margins[1:] if narrow else margins[:1]
    sampled = connects(task, Turn.SOON)
    for margin in margins:
        for motion in candidate_motions(task, margin, failures, sampled=sampled):
            if motion is not None:
                return motion
            if task.deadline.passed():
                return None
        sampled = False
    return None


def is_divided(task: MotionTask) -> bool:
    """Return whether RRT-Connect is tried for a task between the candidates with the widest margin and the others."""
    return not task.parametric and task.arm.links <= _MOST_LINKS and connects(task, Turn.MIDDLE)


def tracked(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return a motion that tracks, under the user's limits, a motion found without them; None if that fails.

    Tracking is needed for limits that depend on the path parameter, and can satisfy other limits under which candidates
    fail. One motion is tried for each planning margin.

    Args:
        task: search task with user limits.
        failures: list to which failures are appended.
    """
    free = replace(task, user=None)
    for margin in fitting_margins(task):
        found = next((each for each in candidate_motions(free, margin, []) if each is not None), None)
        if found is None:
            continue
        motion = PlanarRun.from_task(task, margin).tracked(found, failures)
        if motion is not None or task.deadline.passed():
            return motion
    return None


def _independent_of_path_parameter(task: MotionTask) -> bool:
    """Return whether no limit of a task depends on the path parameter, which candidates do not have."""
    return not task.parametric


def needs_dense_sampling(task: MotionTask) -> bool:
    """Return whether the arm is so thin that RRT-Connect has to sample edges more finely than usual, and is slow."""
    return POSE_SPACING * task.kept < LEAST_SPACING * task.arm.length


def candidate_motions(
    task: MotionTask, margin: float, failures: list[Failure], *, sampled: bool = False
) -> Iterator[Motion | None]:
    """Yield the motion of each pass over the candidates of a task with one planning margin, or None if all fail.

    The passes plan from the start, then backwards from every goal pose, then from the start with the other candidates.
    Planning backwards comes first if the tip path leads into narrow gates between obstacles, since an arm slides out of
    a gate more easily than into it.

    Args:
        task: search task.
        margin: planning margin, in nominal links.
        failures: list to which failures of candidates are appended.
        sampled: whether RRT-Connect is tried before candidates that need poses at the goal.
    """
    forward = PlanarRun.from_task(task, margin)
    into_gates = any(path.rails for path in task.tip_paths) and not forward.lies_in_gates()
    if not into_gates:
        before = len(failures)
        tried = forward.first()
        if sampled:
            yield forward.run(islice(tried, _BEFORE_SAMPLING), failures)
            yield connected(task, failures, Turn.SOON)
        yield forward.run(tried, failures)
        if any(_stopped_by_joint_limits(task, failure) for failure in failures[before:]):
            task = task.at_full_limits()
            forward = PlanarRun.from_task(task, margin)
            yield forward.run(forward.first(), failures)
    elif sampled:
        yield connected(task, failures, Turn.SOON)
    for turned in backward_tasks(task, forward.stepper):
        if turned is not None:
            backward = PlanarRun.from_task(turned, margin)
            motion = backward.run(backward.first(), failures)
            yield reversed_motion(motion) if motion is not None else None
    if into_gates:
        yield forward.run(forward.first(), failures)
        for turned in laid_backward_tasks(task, forward.stepper):
            backward = PlanarRun.from_task(turned, margin)
            motion = backward.run(backward.first(), failures)
            yield reversed_motion(motion) if motion is not None else None
    yield forward.run(forward.further(), failures)


def _touches_nothing(task: MotionTask, q: FloatArray) -> bool:
    """Return whether a configuration, shape (c,), is free of contact with walls and between links."""
    points = task.arm.joint_positions_at(q)
    finder = task.finder(0.0, task.arm.link_length)
    return not finder.crosses(points) and bool(finder.find(points).gap.min(initial=np.inf) > 0.0)


def _stopped_by_joint_limits(task: MotionTask, failure: Failure) -> bool:
    """Return whether a failed candidate ended near its goal with a joint bent as far as planning allows."""
    return failure.remaining < task.arm.length / NOMINAL_LINKS and task.bends_all_it_may(failure.pose)


def _connecting(name: str, turn: Turn) -> Strategy[MotionTask, Motion]:
    return Strategy(name, partial(connected, turn=turn), partial(connects, turn=turn))


STRATEGIES: tuple[Strategy[MotionTask, Motion], ...] = (
    Strategy("interpolation", straight, goes_straight_to_pose, leads_others=True),
    Strategy("arcs at the limits", find_by_limit_arcs, bends_freely),
    Strategy(WALKS, find_by_walks, is_walked, leads_others=True),
    _connecting(CONNECT, Turn.EARLY),
    Strategy("candidates", find_by_candidates, _independent_of_path_parameter, costly=True),
    _connecting(f"{CONNECT}, longer", Turn.MIDDLE),
    Strategy("candidates nearer to walls", partial(find_by_candidates, narrow=True), is_divided, costly=True),
    Strategy("tracking", tracked, lambda task: bool(task.user_limits), costly=True),
    _connecting(f"{CONNECT} again", Turn.LATE),
    Strategy(f"{WALKS} again", partial(find_by_walks, late=True), is_walked, costly=True),
)
"""Search strategies for planar arms on a fixed base, in order of trial."""
SAMPLERS = tuple(_connecting(f"{CONNECT}, turn {turn.name.lower()}", turn) for turn in Turn)
"""Search strategies for planar arms that use RRT-Connect alone."""


def find_motion(task: MotionTask, strategies: tuple[Strategy[MotionTask, Motion], ...] = STRATEGIES) -> Motion:
    """Return a certified and optimised planar motion from the start to the goal of a task.

    Arms of many links are planned with few links and the motion is refined to the arm's own links; if that fails, or
    the arm has few links, the search uses the arm's own links.

    Args:
        task: search task.
        strategies: strategies, tried in order where they apply.

    Raises:
        MotionNotFound: every candidate failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
        UnreachableGoal: it is proved that there is no motion.
    """
    ends = [task.start] if task.goal_pose is None else [task.start, task.goal_pose]
    if any(task.bends_all_it_may(end) for end in ends):
        task = task.at_full_limits()
    task = replace(task, nominal_links=required_nominal_links(task))
    coarse = coarse_task(task)

    def find(strategy: Strategy[MotionTask, Motion], failures: list[Failure]) -> Motion | None:
        # The cost of a step grows with the number of links, while a curve of 22 coordinates does not.
        found = None if coarse is None else strategy.find(coarse, failures)
        motion = None if found is None or coarse is None else taken_over(found, coarse, task, failures)
        if motion is None and (coarse is None or not strategy.leads_others):
            found = strategy.find(task, failures)
            motion = None if found is None else _finished(found, task)
        return motion

    return first_found((strategy for strategy in strategies if strategy.applies(task)), task, find)


def _finished(found: Motion, task: MotionTask) -> Motion:
    """Return a found planar motion after optimisation, or as found if that is better.

    A motion along a leader's path usually takes little longer than its feed alone, and the path has clearance.
    """
    plain = not task.user_limits and task.weights == Weights()
    if found.follows and plain:
        straight_line = found.through(found.unknowns[[0, -1]])
        if found.busiest <= _WORTH_SHORTENING * straight_line.busiest:
            return found
    ended = optimised_to_end_pose(straightened(found, task), task)
    if not task.arm.base_axes:
        return ended
    # A change of shape alone is optimised already; in a guide tube a shorter motion may leave a smooth path no
    # clearance.
    gaps = [task.least_gap(each.configurations) for each in (found, ended)]
    no_worse = plain and found.busiest <= ended.busiest and gaps[0] >= gaps[1] - 1e-6 * task.arm.length
    return found if no_worse or smooth_path(ended, task) is None else ended


def _is_fed(run: SpaceRun) -> bool:
    return run.task.arm.feed is not None


def _is_carried(run: SpaceRun) -> bool:
    """Return whether axes carry the arm, which sampling moves together with its joints sooner than ways of the tip.

    A feed axis does if drives move several joints, which do not follow the tip.
    """
    arm = run.task.arm
    return bool(arm.carrier) or (arm.feed is not None and arm.drives is not None)


def _passes_places(run: SpaceRun) -> bool:
    """Return whether a search has via points that may be goals of stages: user terms apply to whole motions only."""
    return bool(run.task.via) and run.task.user is None


def _passes_none(run: SpaceRun) -> bool:
    """Return whether a search has no via points, which only motions led by the tip can pass."""
    return not run.task.via


def _poses(*, whole: bool) -> Strategy[SpaceRun, SpaceMotion]:
    """Return the strategy in space of moving to poses at the goal, for goals of the whole arm or of the tip.

    A goal of the whole arm is known and need not be sampled, so that the strategy comes early for such goals, as tip
    paths mostly lead to other poses.

    Args:
        whole: whether the strategy is for goals of the whole arm.
    """
    return Strategy(
        "poses at the goal",
        SpaceRun.to_poses,
        lambda run: _passes_none(run) and (run.task.goal_pose is not None) == whole,
        costly=True,
    )


def _sampling(number: int, *, whole: bool | None = None) -> Strategy[SpaceRun, SpaceMotion]:
    """Return the strategy of one round of sampled trees (RRT-Connect), for arms in space.

    Fed arms of joints that bend one by one are excluded: these leave the guide tube one by one, along a curve.

    Args:
        number: index of the round.
        whole: goals for which the round is: True for goals of the whole arm, False for goals of the tip, None for both.
    """

    def applies(run: SpaceRun) -> bool:
        fits = whole is None or (run.task.goal_pose is not None) == whole
        return fits and _passes_none(run) and (not _is_fed(run) or _is_carried(run))

    return Strategy(
        f"sampled {CONNECT}", lambda run, failed: run.by_sampling(number, failed), applies, costly=number > 1
    )


def _chaining(number: int) -> Strategy[SpaceRun, SpaceMotion]:
    """Return the strategy of one round of poses made of chains of links, for goals of the tip in space on a fixed base.

    Args:
        number: index of the round.
    """

    def applies(run: SpaceRun) -> bool:
        arm = run.task.arm
        free = arm.drives is None and not arm.base_axes  # chains bend each joint by itself, from where the base is
        return free and run.task.goal_pose is None and _passes_none(run)

    return Strategy("chains of links", lambda run, failed: run.by_chains(number, failed), applies, costly=number > 0)


def _by_stages(run: SpaceRun, failures: list[Failure]) -> SpaceMotion | None:
    return run.find_by_stages(find_by_ways, failures)


def _by_withdrawing(run: SpaceRun, failures: list[Failure]) -> SpaceMotion | None:
    return run.find_by_withdrawing(find_by_ways, failures)


WAYS: tuple[Strategy[SpaceRun, SpaceMotion], ...] = (
    _sampling(0, whole=True),
    Strategy("straight way of the tip", SpaceRun.find_straight, lambda run: run.begins_bent() or _is_carried(run)),
    Strategy("withdrawal", _by_withdrawing, SpaceRun.begins_bent),
    Strategy("first ways of the tip", SpaceRun.find_along_first_ways, lambda run: not _is_carried(run)),
    Strategy("withdrawal", _by_withdrawing, SpaceRun.begins_straight),
    _sampling(0, whole=False),
    _poses(whole=True),
    _sampling(1),
    Strategy("first ways of the tip", SpaceRun.find_along_first_ways, _is_carried),
    _chaining(0),
    _sampling(2),
    _chaining(1),
    Strategy("other ways of the tip", SpaceRun.find_along_other_ways, costly=True),
    _sampling(3),
    _chaining(2),
    _poses(whole=False),
    _sampling(4),
    Strategy("ways of the tip through the finest grid", SpaceRun.find_along_finest_ways, costly=True),
    _sampling(5),
    Strategy("from place to place", _by_stages, _passes_places, costly=True),
)
"""Search strategies for arms in space, in order of trial."""
SAMPLED_WAYS = tuple(_sampling(number) for number in range(SAMPLED_ROUNDS))
"""Search strategies for arms in space on a fixed base that use RRT-Connect alone."""


def find_by_ways(task: SpaceTask, ways: tuple[Strategy[SpaceRun, SpaceMotion], ...] = WAYS) -> SpaceMotion:
    """Return a certified motion in space, found by the first search strategy that succeeds.

    Args:
        task: search task.
        ways: strategies, tried in order where they apply.

    Raises:
        MotionNotFound: no strategy reached the goal; the diagnosis says how far the best came, and what stopped it.
        UnreachableGoal: it is proved that no motion can reach the goal.
        TimeLimitReached: the deadline passed first.
    """
    run = SpaceRun.from_task(task)
    applicable = (strategy for strategy in ways if strategy.applies(run))
    return first_found(applicable, task, lambda strategy, failures: strategy.find(run, failures))
