"""The end of a motion: from where the search arrived, on to the pose at the goal that the planner would rather have."""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.continuation import Stalled, follow
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.step import Stepper


def led_to_end_pose(motion: Motion, task: MotionTask) -> tuple[Motion, MotionTask]:
    """A motion led on to the better end that the task offers, and the task with that end for a goal.

    The search takes whatever pose its guide brings to the goal; that pose is the starting point from which a better
    one is asked for. The way from one to the other is certified like the rest, and the optimisation of the whole
    motion shortens both together.

    Args:
        motion: certified, with the tip at the goal.
        task: it was found for.

    Returns:
        Motion and task as they were when the task offers no other end, or that end cannot be reached by interpolation.
    """
    wanted = task.end_pose(task.arm, motion.headings[0], motion.headings[-1])
    if wanted is None or task.goal_headings is not None:
        return motion, task
    space, end = motion.space.blended_to(wanted)
    settings = task.settings.search
    for links in settings.margins:
        margin = links * space.nominal_length
        finder = task.finder(margin, max(settings.reach * space.nominal_length, settings.reach_margins * margin))
        stepper = Stepper(space, finder, task.limits(finder), task.settings)
        added = _certified_way(stepper, task, np.append(motion.coordinates[-1], 0.0), end)
        if added is not None:
            coordinates = np.vstack((np.column_stack((motion.coordinates, np.zeros(len(motion.coordinates)))), added))
            longer = Motion(space, coordinates, space.headings(coordinates), motion.candidate)
            return longer, replace(task, goal=replace(task.goal, coordinates=end), goal_headings=wanted)
    return motion, task


def _certified_way(stepper: Stepper, task: MotionTask, start: FloatArray, end: FloatArray) -> FloatArray | None:
    """Coordinates behind the start, up to and with the end, of a certified way between them; None without one."""
    first = stepper.pose(start)
    guide = Interpolation(stepper.space, start, end)
    try:
        poses = follow(stepper, guide, first, task.deadline)
    except Stalled:
        return None
    coordinates = np.array([*(pose.v for pose in poses), end])
    if len(task.certificate.failures(stepper.space.headings(coordinates))):
        return None
    return coordinates[1:]
