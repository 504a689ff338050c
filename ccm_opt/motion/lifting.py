"""Lifting: a motion planned at few links, taken over to an arm of many in the same coordinates of the curve."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.goal import polish
from ccm_opt.motion.link_space import LinkSpace, mean_heading_matrix
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.pose import Term, pose_in
from ccm_opt.motion.step import Stepper


def lift(motion: Motion, task: MotionTask) -> Motion | None:
    """The motion on the task's own links, certified; None when repair does not mend it.

    The coordinates v stay; A and the offset are built anew, so that the task's start is met exactly; the last
    keyframe is polished onto the goal; keyframes of intervals that fail the certificate are projected by a step.
    """
    space = _lifted_space(motion, task)
    coordinates = motion.coordinates.copy()
    # On other links the same coordinates put the tip a little elsewhere; a goal of the whole arm is held by the space.
    if task.goal_headings is None:
        goal = task.limited_goal
        coordinates[-1] = polish(space, goal, coordinates[-1])
        if not goal.on_goal(pose_in(space, coordinates[-1])):
            return None

    certificate = task.certificate
    stepper = _repair_stepper(space, task)
    failing = certificate.failures(space.headings(coordinates))
    if _lies_across(stepper, coordinates, failing):
        return None
    for _ in range(task.settings.lifting.repairs):
        if len(failing) == 0:
            break
        # An interval has no position of its own: both its keyframes are moved.
        at_both_ends = np.unique(np.concatenate((failing, failing + 1)))
        coordinates = _pushed_clear(stepper, coordinates, at_both_ends)
        failing = certificate.failures(space.headings(coordinates))

    # The offset is not the one that the motion was planned with, so bends have to be looked at once more.
    headings = space.headings(coordinates)
    if len(failing) or not task.within_joint_limits(headings):
        return None
    return Motion(space, coordinates, headings, f"{motion.candidate}, lifted", end_pose=motion.end_pose)


def _resampled_columns(columns: FloatArray, links: int) -> FloatArray:
    """Columns (m, k) over the links of one arm, over those of another; shape (links, k)."""
    resampled = [_resampled(column, links) for column in columns.T]
    return np.column_stack(resampled) if resampled else np.zeros((links, 0))


def _lifted_space(motion: Motion, task: MotionTask) -> LinkSpace:
    """Link space of the task's arm in which the motion's first coordinates give the task's start.

    A motion with a blended end has one coordinate more, w: 1 at the end that is given for the whole arm (the goal, or
    for a motion planned backwards the start) and 0 at the other.
    """
    matrix = mean_heading_matrix(task.arm.links, task.arm.length)
    p = matrix.shape[1]
    first = motion.coordinates[0]
    last = motion.coordinates[-1]
    at_start = task.start - matrix @ first[:p]  # the offset that the first keyframe needs

    if task.goal_headings is not None:
        # A motion that was bent to its own end for more room has still more coordinates: their columns are taken over.
        extra = _resampled_columns(motion.space.matrix[:, p + 1 :], task.arm.links)
        before = at_start - extra @ first[p + 1 :]
        behind = task.goal_headings - matrix @ last[:p] - extra @ last[p + 1 :]
        planned_backwards = first[p] > last[p]
        offset = behind if planned_backwards else before
        blended = before if planned_backwards else behind
        return LinkSpace(task.arm, np.column_stack((matrix, blended - offset, extra)), offset)

    if len(first) > p and first[-1] == 0.0:
        # Blended to an end that the planner chose for the coarse arm: its column is taken over, the start stays exact.
        extra = _resampled_columns(motion.space.matrix[:, p:], task.arm.links)
        return LinkSpace(task.arm, np.column_stack((matrix, extra)), at_start - extra @ first[p:])

    if len(first) > p:
        offset = _resampled(motion.space.offset, task.arm.links)
        return LinkSpace(task.arm, np.column_stack((matrix, at_start - offset)), offset)

    return LinkSpace(task.arm, matrix, at_start)


def _resampled(offset: FloatArray, links: int) -> FloatArray:
    """An offset of link headings at another number of links, shape (links,) [rad]."""
    # An offset belongs to the middle of its link; beyond the outermost middles it is held constant.
    middles = (np.arange(len(offset)) + 0.5) / len(offset)
    wanted = (np.arange(links) + 0.5) / links
    return np.interp(wanted, middles, offset)


def _repair_stepper(space: LinkSpace, task: MotionTask) -> Stepper:
    """The stepper of repairs, which keeps a smaller margin than the search does."""
    length = task.arm.length
    lifting = task.settings.lifting
    finder = task.finder(lifting.margin * length, lifting.reach * length)
    return Stepper(space, finder, task.limits(finder), task.settings)


def _lies_across(stepper: Stepper, coordinates: FloatArray, failing: IntArray) -> bool:
    """Whether the arm lies across a wall, or itself, at the beginning of an interval: it would be pushed on through."""
    poses = (stepper.pose(coordinates[k]) for k in failing)
    return any(stepper.finder.crosses(pose.points) for pose in poses)


def _pushed_clear(stepper: Stepper, coordinates: FloatArray, keyframes: IntArray) -> FloatArray:
    """Coordinates with some inner keyframes moved by a step that asks for nothing but the planning margin."""
    space = stepper.space
    last = len(coordinates) - 1
    mended = coordinates.copy()
    for k in keyframes:
        if k in {0, last}:
            continue  # the ends are given
        pose = stepper.pose(coordinates[k])
        stay = [
            Term(space.matrix, np.zeros(space.arm.links), space.nominal_per_link),
            Term(np.eye(len(pose.v)), np.zeros(len(pose.v)), stepper.settings.lifting.coordinate_weight),
        ]
        mended[k] = stepper.step(pose, space.jacobians(pose.headings), stay).v
    return mended
