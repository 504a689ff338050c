"""Planning backwards, from a pose at the goal to the start: it is easier to leave a narrow place than to enter it."""

from dataclasses import replace

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.continuation import Stalled, settle
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.link_space import fit_coordinates
from ccm_opt.motion.step import Pose, Stepper
from ccm_opt.motion.task import Motion, MotionTask
from ccm_opt.motion.tip_paths import tip_paths_in


def backward_task(task: MotionTask, stepper: Stepper, guess: FloatArray) -> MotionTask | None:
    """The task with its ends exchanged, or None when a guess cannot be brought exactly onto the goal, clear of all.

    Args:
        task: with a goal for the tip alone.
        stepper: of the task.
        guess: link headings of a pose near the goal, shape (links,) [rad].
    """
    goal = pose_at_goal(task, stepper, guess)
    if goal is None or not task.tip_paths:
        return None
    start_points = task.arm.joint_positions(task.start)
    first = task.tip_paths[0]
    return replace(
        task,
        start=goal.headings,
        goal=GoalPose(start_points[-1], float(task.start[-1])),
        goal_headings=task.start,
        guesses=(),
        tip_paths=tip_paths_in(first.free_space, goal.points, (start_points,), first.shrink),
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
    try:
        pose = settle(stepper, task.goal_in(space), near, task.deadline)[-1]
    except Stalled:
        return None
    return pose if stepper.finder.find(pose.points).gap.min(initial=1.0) > 0.0 else None


def reversed_motion(motion: Motion) -> Motion:
    """The motion run from its end to its start."""
    return replace(
        motion,
        coordinates=motion.coordinates[::-1].copy(),
        headings=motion.headings[::-1].copy(),
        candidate=f"{motion.candidate}, backwards",
    )
