"""Planning backwards, from a pose at the goal to the start: it is easier to leave a narrow place than to enter it."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths, leg_headings, legs_at, unit_vector, whole_turns
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.gate_rails import GateRails
from ccm_opt.planning.link_space import fit_coordinates
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import tip_paths_in, turning_by


def backward_tasks(task: MotionTask, stepper: Stepper) -> Iterator[MotionTask | None]:
    """The task with its ends exchanged, for every known pose at the goal; None where a pose is of no use.

    Args:
        task: with a goal for the tip or for the whole arm.
        stepper: of the task.
    """
    if not task.tip_paths:
        return
    if task.goal_headings is not None:
        points = task.arm.joint_positions(task.goal_headings)
        # Headings count full turns, paths do not: the way back has to undo what the base has turned.
        turn = float(task.start[0] - task.goal_headings[0])
        turned = _exchanged(task, task.goal_headings, points)
        # A limit on keyframes is met at the start and at the goal by different rows: backwards it is another task.
        useful = not any(limit.moves_keyframes for limit in task.user_limits)
        yield replace(turned, tip_paths=turning_by(turned.tip_paths, turn)) if useful else None
        return
    for guess in chain(task.guesses, task.further_guesses()):
        goal = pose_at_goal(task, stepper, guess)
        yield None if goal is None else _exchanged(task, goal.q, goal.points)


def laid_backward_tasks(task: MotionTask, stepper: Stepper) -> Iterator[MotionTask]:
    """The same from poses that are laid through narrow gates; none where the goal is the whole arm's."""
    if task.goal_headings is None:
        for guess in _laid_through_gates(task):
            goal = pose_at_goal(task, stepper, guess)
            if goal is not None:
                yield _exchanged(task, goal.q, goal.points)


def _laid_through_gates(task: MotionTask) -> Iterator[FloatArray]:
    """Link headings (links,) [rad] of the arm laid along routes through narrow gates; none where there are no gates.

    No curve of the goal's program may pass a gate that the arm itself hardly passes.
    """
    arm = task.arm
    for path in task.tip_paths:
        if path.side < 0 or not path.rails:
            continue  # both sides have one route
        arcs = arc_lengths(path.route)
        along = leg_headings(path.route)
        along += whole_turns(arm.base_heading - along[0])
        # What the arm is longer than its route lies along the last leg, beyond the goal, until it is settled.
        middles = arm.link_length * (np.arange(arm.links) + 0.5)
        yield along[legs_at(arcs, np.minimum(middles, arcs[-1]))]


def _exchanged(task: MotionTask, headings: FloatArray, points: FloatArray) -> MotionTask:
    """From a pose at the goal, link headings and joints, to the start as a goal of the whole arm."""
    start_points = task.arm.joint_positions(task.start)
    first = task.tip_paths[0]
    return replace(
        task,
        start=headings,
        goal=GoalPose(start_points[-1], unit_vector(task.start[-1])),
        goal_headings=task.start,
        guesses=(),
        tip_paths=tip_paths_in(first.free_space, points, (start_points,), first.shrink),
    )


def ending_in(task: MotionTask, headings: FloatArray) -> MotionTask:
    """The same task, but for a pose at its goal, link headings (links,) [rad], as a goal of the whole arm."""
    points = task.arm.joint_positions(headings)
    first = task.tip_paths[0]
    return replace(
        task,
        goal=GoalPose(points[-1], unit_vector(headings[-1])),
        goal_headings=headings,
        guesses=(headings,),
        further_guesses=lambda: iter(()),
        tip_paths=tip_paths_in(first.free_space, task.arm.joint_positions(task.start), (points,), first.shrink),
    )


def pose_at_goal(task: MotionTask, stepper: Stepper, guess: FloatArray) -> Pose | None:
    """A guess brought onto the goal; None when that fails or it would touch something.

    Args:
        task: with a goal for the tip alone.
        stepper: of the task.
        guess: link headings of a pose near the goal, shape (links,) [rad].
    """
    space = stepper.space
    near = stepper.pose(fit_coordinates(space.matrix, guess - space.offset, task.arm.length))
    goal = task.limited_goal
    centred = _in_the_middle_of_gates(stepper, goal, near)
    if centred is not None:
        return centred
    try:
        pose = settle(stepper, goal, near, task.deadline)[-1]
    except Stalled:
        return None
    # Settling may have begun inside a wall; every pose after that was only asked to be no worse.
    if stepper.finder.find(pose.points).gap.min(initial=1.0) <= 0.0:
        return None
    return _in_the_middle_of_gates(stepper, goal, pose) or pose


def _in_the_middle_of_gates(stepper: Stepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """The pose at the goal, near another, whose axis is in the middle of the gates it lies in; None if there is none.

    From the very edge of a gate's play no step leads away.
    """
    rails = tuple(limit for limit in stepper.limits if isinstance(limit, GateRails))
    if not rails:
        return None
    centred = moved_onto(stepper.space, replace(goal, limits=(*goal.limits, *rails)), pose)
    clear = stepper.finder.find(centred.points).gap.min(initial=1.0) > 0.0 and not stepper.finder.crosses(
        centred.points
    )
    kept = goal.on_goal(centred) and goal.limits_met(centred) and all(rail.met(centred) for rail in rails)
    return centred if clear and kept and _within_limits(stepper, centred) else None


def _within_limits(stepper: Stepper, pose: Pose) -> bool:
    """Whether a pose bends no joint farther than steps do."""
    space = stepper.space
    share = stepper.settings.step.limit_share
    return bool(np.all(np.abs(space.bends(pose.q)) <= share * space.bend_limits))


def reversed_motion(motion: Motion) -> Motion:
    """The motion run from its end to its start."""
    return replace(
        motion,
        unknowns=motion.unknowns[::-1].copy(),
        configurations=motion.configurations[::-1].copy(),
        candidate=f"{motion.candidate}, backwards",
    )
