"""Lifting: a motion planned at few links, taken over to an arm of many in the same coordinates of the curve."""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.contacts import ContactFinder
from ccm_opt.collision.walls import Walls
from ccm_opt.motion.goal import POLISH_TOLERANCE, polish
from ccm_opt.motion.link_space import LinkSpace, mean_heading_matrix
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.step import Stepper, Term, pose_in

REPAIRS = 6
MARGIN = 1.5e-3
"""Planning margin of a repair, as a share of the arm's length."""
REACH = 0.02


def lift(motion: Motion, task: MotionTask) -> Motion | None:
    """The motion on the task's own links, certified; None when repair does not mend it.

    The coordinates v stay; A and the offset are built anew, so that the task's start is met exactly; the last
    keyframe is polished onto the goal; keyframes of intervals that fail the certificate are projected by a step.
    """
    space = _lifted_space(motion, task)
    coordinates = motion.coordinates.copy()
    if task.goal_headings is None:
        coordinates[-1] = polish(space, task.goal, coordinates[-1])
        if max(task.goal.errors(pose_in(space, coordinates[-1]))) > 10.0 * POLISH_TOLERANCE:
            return None
    certificate = task.certificate
    failing = certificate.failures(space.headings(coordinates))
    stepper = _repair_stepper(space, task)
    for _ in range(REPAIRS):
        if len(failing) == 0:
            break
        coordinates = _mended(stepper, coordinates, np.unique(np.concatenate((failing, failing + 1))))
        failing = certificate.failures(space.headings(coordinates))
    headings = space.headings(coordinates)
    within = np.all(np.abs(task.arm.bends(headings)) <= task.arm.bend_limits)
    if len(failing) or not within:
        return None
    return Motion(space, coordinates, headings, f"{motion.candidate}, lifted")


def _lifted_space(motion: Motion, task: MotionTask) -> LinkSpace:
    """Link space of the task's arm in which the motion's first coordinates give the task's start.

    A motion with a blended end has one coordinate more, w: 1 at the end that is given for the whole arm (the goal, or
    for a motion planned backwards the start) and 0 at the other.
    """
    matrix = mean_heading_matrix(task.arm.links, task.arm.length)
    p = matrix.shape[1]
    first, last = motion.coordinates[0], motion.coordinates[-1]
    offset = task.start - matrix @ first[:p]
    if task.goal_headings is not None:
        one, other, end = first, last, task.goal_headings
        if first[p] > last[p]:  # planned backwards
            one, other, end = last, first, task.start
            offset = task.goal_headings - matrix @ one[:p]
        matrix = np.column_stack((matrix, end - offset - matrix @ other[:p]))
    elif len(first) > p:
        blended = offset
        offset = _resampled(motion.space.offset, task.arm.links)
        matrix = np.column_stack((matrix, blended - offset))
    return LinkSpace(task.arm, matrix, offset)


def _resampled(offset: FloatArray, links: int) -> FloatArray:
    """An offset of link headings at another number of links, shape (links,) [rad]."""
    middles, wanted = ((np.arange(count) + 0.5) / count for count in (len(offset), links))
    return np.interp(wanted, middles, offset)


def _repair_stepper(space: LinkSpace, task: MotionTask) -> Stepper:
    length = task.arm.length
    finder = ContactFinder(
        task.arm, Walls.of(task.workspace), task.workspace.clearance, MARGIN * length, REACH * length
    )
    return Stepper(space, finder, settings=task.settings)


def _mended(stepper: Stepper, coordinates: FloatArray, keyframes: FloatArray) -> FloatArray:
    """Coordinates with some inner keyframes pushed clear."""
    mended = coordinates.copy()
    for k in keyframes:
        if 0 < k < len(coordinates) - 1:
            pose = stepper.pose(coordinates[k])
            still = [
                Term(stepper.space.matrix, np.zeros(stepper.space.arm.links), stepper.space.share),
                Term(np.eye(len(pose.v)), np.zeros(len(pose.v)), 1e-4),
            ]
            mended[k] = stepper.step(pose, stepper.space.jacobians(pose.headings), still).v
    return mended
