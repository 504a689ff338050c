"""A motion for a problem that differs a little from one whose motion is known: the goal or a wall has moved.

The known motion is bent to where the goal is now, or, where a wall is in its way, tracked by steps that keep off the
walls; then it is optimised like any other. There is no search, so this takes as long as an optimisation.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.continuation import Stalled, settle
from ccm_opt.motion.ending import optimised_to_end_pose
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.optimise import path_parameters
from ccm_opt.motion.passage_widths import nominal_links_asked
from ccm_opt.motion.search_run import pose_headings
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tracking import ReferenceMotion, follow_reference


def resumed(known: Motion, task: MotionTask) -> Motion | None:
    """A certified, optimised motion near a known one.

    Args:
        known: a motion to another goal or among other walls.
        task: the arm, the room, the goal and the limits as they are now.

    Returns:
        None where the known motion leads to none, or begins elsewhere; that says nothing of the task.
    """
    same_start = known.headings.shape[1] == len(task.start) and np.allclose(
        known.headings[0], task.start, rtol=0.0, atol=task.settings.certificate.rounding
    )
    if not same_start:
        return None
    if task.goal_headings is not None or any(limit.moves_keyframes for limit in task.user_limits):
        return None
    stepper = _stepper(known, task)
    moved = _bent(known, stepper, task) or _tracked(known, stepper, task)
    return None if moved is None else optimised_to_end_pose(moved, task)


def _stepper(known: Motion, task: MotionTask) -> Stepper:
    """Steps in the space through the start that holds the end of the known motion too."""
    space, _ = LinkSpace.through(task.arm, task.start, nominal_links_asked(task), clamped=task.clamped)
    space, _ = space.blended_to(known.headings[-1])
    margin = task.settings.search.margins[0] * space.nominal_length
    finder = task.planning_finder(margin, space.nominal_length)
    return Stepper(space, finder, task.limits(finder), task.settings)


def _bent(known: Motion, stepper: Stepper, task: MotionTask) -> Motion | None:
    """The known motion with the way of its end onto the goal added, more and more towards the end."""
    space = stepper.space
    coordinates = _coordinates(space, known, task.start)
    try:
        settled = settle(stepper, task.limited_goal, stepper.pose(coordinates[-1]), task.deadline)
    except Stalled:
        return None
    change = settled[-1].v - coordinates[-1]
    u = path_parameters(known)
    for beginning in task.settings.optimisation.bending_from:
        share = np.clip((u - beginning) / (1.0 - beginning), 0.0, 1.0)
        moved = _certified(space, coordinates + (share**2 * (3.0 - 2.0 * share))[:, None] * change, known, task)
        if moved is not None:
            return moved
    # Where bending it would meet a wall, the motion goes on from its end.
    return _certified(space, np.vstack((coordinates, [pose.v for pose in settled[1:]])), known, task)


def _tracked(known: Motion, stepper: Stepper, task: MotionTask) -> Motion | None:
    """The known motion tracked by steps that keep off the walls as they are now, then settled on the goal."""
    start = stepper.pose(_coordinates(stepper.space, known, task.start)[0])
    reference = ReferenceMotion.from_headings(known.headings)
    try:
        way = follow_reference(stepper, reference, task.limited_goal, start, task.deadline)
    except Stalled:
        return None
    headings = pose_headings(way.poses)
    if len(task.certificate.failures(headings)) or not task.within_joint_limits(headings):
        return None
    return Motion(stepper.space, np.array([pose.v for pose in way.poses]), headings, known.candidate)


def _coordinates(space: LinkSpace, known: Motion, start: FloatArray) -> FloatArray:
    """Coordinates nearest to the keyframes of the known motion, shape (K, p); those of the start are exact."""
    wanted = known.headings - space.offset
    coordinates = np.array(np.linalg.lstsq(space.matrix, wanted.T, rcond=None)[0].T, dtype=np.float64)
    exact = LinkSpace.through(space.arm, start, space.nominal_links, clamped=space.clamped)[1]
    coordinates[0] = np.append(exact, 0.0)
    return coordinates


def _certified(space: LinkSpace, coordinates: FloatArray, known: Motion, task: MotionTask) -> Motion | None:
    """The motion through keyframes, shape (K, p); None where it is not certified."""
    headings = space.headings(coordinates)
    if len(task.certificate.failures(headings)) or not task.within_joint_limits(headings):
        return None
    return replace(known, space=space, coordinates=coordinates, headings=headings, u=None, end_pose=None)
