"""What is tried to find a motion, in its order: routes and guides in the plane, ways of the tip in space."""

from collections.abc import Iterator
from dataclasses import replace
from enum import IntEnum
from functools import partial

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
from ccm_opt.planning.search import TREES, Failure, Strategy, first_found
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.shortcuts import straightened
from ccm_opt.planning.smooth_path import smooth_path
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.tree_search import search_by_trees
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.problem import Weights
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

TREE_MARGINS = (0.12, 0.06, 0.024)
"""Margins that trees of poses are grown with, in nominal links: a wide one moves on faster, a narrow one gets through.
Taste."""
_MOST_LINKS = 48
"""Arms with more links are not planned so. Taste: a pose costs by the links."""

_WORTH_SHORTENING = 1.2
"""Times the duration of the straight line between its ends from which on a motion that follows its leader is optimised.
Taste."""


FEW_BUDGETS = (5000, 10000, 20000)
"""Extensions that searches one after the other may take before all else, for arms of few links. Measured: most scenes
take some thousand; what takes long is mostly found sooner from the beginning."""
_WHOLE_ARM_BUDGETS = (8000,)
"""The same for other arms with a goal for the whole arm, but for arms so thin that poses lie nearer to each other than
these are wide. Taste: a quarter of a second."""
_MIDDLE_BUDGETS = (60000, 60000)
"""The same once more after the candidates with the widest margin. Taste: three seconds."""
_LATE_BUDGETS = (60000, 60000)
"""The same for all, before the trees of poses. Taste: some seconds."""


class Turn(IntEnum):
    """When RRT-Connect has its turn: before the candidates, among them, after them, or after the trees."""

    EARLY = 0
    LATE = 1
    MIDDLE = 2
    LAST = 3


def goes_straight_to_pose(task: MotionTask) -> bool:
    """Return whether a straight motion may be one: poses of the whole arm alone say where straight is."""
    return task.goal_pose is not None and not task.parametric


def straight(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return the straight to a goal of the whole arm, or straight back from it, bent round obstacles by the step."""
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
    """Whether RRT-Connect has a turn: limits that move keyframes, or depend on u, refuse all straight motions."""
    refused = task.parametric or bool(task.user_limits)
    return not refused and len(_budgets(task, turn)) > 0


def connected(task: MotionTask, failures: list[Failure], turn: Turn = Turn.EARLY) -> Motion | None:
    """Return the motion that joins trees in the coordinates of the curve, with so many extensions that it costs little.

    Args:
        task: arm, room, ends and limits.
        failures: is added to.
        turn: which of its turns this is; the last is for goals of every kind.
    """
    budgets = _budgets(task, turn)
    if task.arm.links > _MOST_LINKS:
        return None
    run = PlanarRun.from_task(task.at_full_limits(), MARGINS[-1])
    search = Connecting(run.task, run.stepper.space, run.start, run.goal, run.goal_poses)
    motion = search.find(budgets, (task.seed, turn))
    if motion is None:
        ended = Stalled(f"{len(budgets)} searches of up to {max(budgets)} extensions did not meet", [run.start])
        failures.append(run.failure(CONNECT, ended))
    return motion


def _budgets(task: MotionTask, turn: Turn) -> tuple[int, ...]:
    few = task.arm.links <= FEW_LINKS
    # Without a way of the tip there is hardly one of the arm; few links may still have one closer to a wall.
    if not task.tip_paths and not few:
        return ()
    # Thin arms of many links have their late turn after the trees, for to look at them takes long.
    slow = not few and needs_dense_sampling(task)
    if turn in {Turn.LATE, Turn.LAST}:
        return _LATE_BUDGETS if slow == (turn is Turn.LAST) else ()
    if few:
        return FEW_BUDGETS if turn is Turn.EARLY else ()
    if task.goal_pose is None or slow:
        return ()
    return _WHOLE_ARM_BUDGETS if turn is Turn.EARLY else _MIDDLE_BUDGETS


def bends_freely(task: MotionTask) -> bool:
    """Whether arcs may lead to the goal: they know of no base that is carried or held, and of nothing else there."""
    free = not task.clamped and not task.arm.base_axes and not task.user_limits
    return free and task.goal_pose is None and len(task.tip_paths) > 0


def find_by_limit_arcs(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return the straight to poses with the joints bent all they may be, where a goal for the tip asks for that.

    Then RRT-Connect.

    Guides that draw the tip to such a goal end near it with some joint at its limit and others short of theirs.
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
    """Return the first candidate's motion that arrives and is certified, with one planning margin after another.

    Args:
        task: arm, room, ends and limits.
        failures: is added to.
        narrow: whether this is what is left of the margins where RRT-Connect has its turn after the widest.
    """
    margins = fitting_margins(task)
    if is_divided(task):
        margins = margins[1:] if narrow else margins[:1]
    for margin in margins:
        for motion in candidate_motions(task, margin, failures):
            if motion is not None:
                return motion
            if task.deadline.passed():
                return None
    return None


def is_divided(task: MotionTask) -> bool:
    """Return whether RRT-Connect has its turn between the widest margin of the candidates and the others."""
    return not task.parametric and task.arm.links <= _MOST_LINKS and connects(task, Turn.MIDDLE)


def tracked(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return a motion that is found without the user's limits, then tracked under them; one for each margin is tried.

    For limits over the path parameter. Where candidates fail under limits that do not depend on it, tracking is another
    way to keep them.
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


def find_by_trees(task: MotionTask, failures: list[Failure]) -> Motion | None:
    """The motion that joins trees of poses from both ends, until the deadline or until they reach nothing new."""
    if not task.tip_paths:
        return None
    full = task.at_full_limits()
    runs = [PlanarRun.from_task(full, margin) for margin in TREE_MARGINS]
    narrowest = runs[-1]
    try:
        poses = search_by_trees(runs)
        return narrowest.motion(TREES, narrowest.certified_without_pauses(poses))
    except Stalled as stalled:
        failures.append(narrowest.failure(TREES, stalled))
    return None


def _independent_of_path_parameter(task: MotionTask) -> bool:
    """Whether no limit depends on u: candidates, and poses of trees, do not know how far along the motion they are."""
    return not task.parametric


def needs_dense_sampling(task: MotionTask) -> bool:
    """Whether poses have to be looked at nearer to each other than the arm is wide, which takes RRT-Connect long."""
    return POSE_SPACING * task.kept < LEAST_SPACING * task.arm.length


def candidate_motions(task: MotionTask, margin: float, failures: list[Failure]) -> Iterator[Motion | None]:
    """Yield the forwards, then backwards from every pose at the goal, then forwards with all that is left.

    None for failures.

    Backwards first where the way leads into narrow gates: an arm can be slid out of them.
    """
    forward = PlanarRun.from_task(task, margin)
    into_gates = any(path.rails for path in task.tip_paths) and not forward.lies_in_gates()
    if not into_gates:
        before = len(failures)
        yield forward.run(forward.first(), failures)
        if any(_stopped_by_joint_limits(task, failure) for failure in failures[before:]):
            task = task.at_full_limits()
            forward = PlanarRun.from_task(task, margin)
            yield forward.run(forward.first(), failures)
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
    """Return whether a configuration, shape (c,), keeps off walls and off itself."""
    points = task.arm.joint_positions_at(q)
    finder = task.finder(0.0, task.arm.link_length)
    return not finder.crosses(points) and bool(finder.find(points).gap.min(initial=np.inf) > 0.0)


def _stopped_by_joint_limits(task: MotionTask, failure: Failure) -> bool:
    """Return whether a candidate ended near its goal with a joint bent as far as planning does."""
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
    Strategy(TREES, find_by_trees, _independent_of_path_parameter, costly=True),
    _connecting(f"{CONNECT} again", Turn.LAST),
)
"""What is tried in turn in the plane where the base is fixed."""


def find_motion(task: MotionTask, strategies: tuple[Strategy[MotionTask, Motion], ...] = STRATEGIES) -> Motion:
    """Find a certified motion from the start to the goal.

    Arms of many links are planned with few links and lifted; when that fails, or the arm has few links, they are
    planned on their own links.

    Args:
        task: arm, room, ends and limits.
        strategies: tried in turn, those that apply.

    Raises:
        MotionNotFound: every candidate failed; the diagnosis lists why.
        TimeLimitReached: the deadline passed first.
        UnreachableGoal: it is proved that there is none.
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
    """Return a motion optimised.

    One that follows its leader mostly lasts as long as its feed, and has its path's room.
    """
    plain = not task.user_limits and task.weights == Weights()
    if found.follows and plain:
        straight_line = found.through(found.unknowns[[0, -1]])
        if found.busiest <= _WORTH_SHORTENING * straight_line.busiest:
            return found
    ended = optimised_to_end_pose(straightened(found, task), task)
    if not task.arm.base_axes:
        return ended
    # A change of shape alone is optimised already; and in a guide tube a shorter motion may leave a smooth path no
    # room.
    gaps = [task.least_gap(each.configurations) for each in (found, ended)]
    no_worse = plain and found.busiest <= ended.busiest and gaps[0] >= gaps[1] - 1e-6 * task.arm.length
    return found if no_worse or smooth_path(ended, task) is None else ended


def _is_fed(run: SpaceRun) -> bool:
    return bool(run.task.arm.base_axes)


def _passes_places(run: SpaceRun) -> bool:
    """Return whether places on the way may be goals: the user's terms of a motion are written for the whole of it."""
    return bool(run.task.via) and run.task.user is None


def _passes_none(run: SpaceRun) -> bool:
    """Return whether there are no places on the way: what is not led by the tip passes none."""
    return not run.task.via


def _poses(*, whole: bool) -> Strategy[SpaceRun, SpaceMotion]:
    """Return a pose of the whole arm is known, and need not be drawn.

    Other ways of the tip mostly lead to other poses.
    """
    return Strategy(
        "poses at the goal",
        SpaceRun.to_poses,
        lambda run: _passes_none(run) and (run.task.goal_pose is not None) == whole,
        costly=True,
    )


def _drawing(number: int) -> Strategy[SpaceRun, SpaceMotion]:
    return Strategy(CONNECT, lambda run, failed: run.find_by_connecting(number, failed), _passes_none, costly=True)


def _sampling(number: int) -> Strategy[SpaceRun, SpaceMotion]:
    """Sampled trees, for arms on a fixed base: of a fed one joints come out one by one on no straight way."""
    return Strategy(
        f"sampled {CONNECT}",
        lambda run, failed: run.by_sampling(number, failed),
        lambda run: _passes_none(run) and not _is_fed(run) and run.task.user is None,
        costly=number > 0,
    )


def _by_stages(run: SpaceRun, failures: list[Failure]) -> SpaceMotion | None:
    return run.find_by_stages(find_by_ways, failures)


WAYS: tuple[Strategy[SpaceRun, SpaceMotion], ...] = (
    Strategy("first ways of the tip", SpaceRun.find_along_first_ways),
    Strategy("withdrawal", SpaceRun.find_by_withdrawing, _is_fed),
    _sampling(0),
    _poses(whole=True),
    Strategy("other ways of the tip", SpaceRun.find_along_other_ways, costly=True),
    _sampling(1),
    _poses(whole=False),
    _drawing(0),
    _drawing(1),
    Strategy("ways of the tip through the finest grid", SpaceRun.find_along_finest_ways, costly=True),
    _drawing(2),
    _drawing(3),
    Strategy("from place to place", _by_stages, _passes_places, costly=True),
)
"""What is tried in turn in space. How often trees begin with other draws was measured among 320 bodies."""


def find_by_ways(task: SpaceTask) -> SpaceMotion:
    """Find a certified motion in space: the first that a strategy finds.

    Raises:
        MotionNotFound: no strategy reached the goal; with how far the best came, and what was in its way.
        UnreachableGoal: it is proved that none could.
        TimeLimitReached: the deadline passed first.
    """
    run = SpaceRun.from_task(task)
    applicable = (strategy for strategy in WAYS if strategy.applies(run))
    return first_found(applicable, task, lambda strategy, failures: strategy.find(run, failures))
