"""Motions of arms of many links, planned with few links in the same coordinates and lifted."""

from itertools import chain
from math import ceil

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.ending import optimised_to_end_pose
from ccm_opt.planning.goal import moved_onto
from ccm_opt.planning.link_space import LinkSpace, mean_heading_matrix
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask, coarsened
from ccm_opt.planning.optimisation.optimise import optimise
from ccm_opt.planning.passage_widths import fitting_margins
from ccm_opt.planning.pose import Term
from ccm_opt.planning.search import Failure
from ccm_opt.planning.search_run import SearchRun
from ccm_opt.planning.shortcuts import straightened
from ccm_opt.planning.step import Stepper

_REACH = 0.02
"""Contacts nearer than this make rows of a repair, as a share of the arm's length. Taste."""
_COORDINATE_WEIGHT = 1e-4
"""Of the coordinates themselves against link headings, which ties down what no link heading shows. Taste."""

_REPAIRS = 6
"""Rounds in which keyframes of intervals that fail the certificate are pushed clear. Taste; what six do not mend is
planned on the task's own links."""
_DESIGN_LINKS = 24
"""Arms with more links are planned with this many, or as many as narrow passages ask for, and lifted. Measured: of 38
motions found in clutter with this many, 34 held on finer arms as they were."""
_MANY_LINKS = 1.5
"""Times that number of links from which lifting pays. Taste."""
LIFT_MARGIN = 3e-3
"""Gap that an optimised motion keeps when it is to be lifted, as a share of the arm's length. Taste: about what an arm
of 24 links leaves the curve by."""
_REPAIR_MARGIN = 1.5e-3
"""Planning margin of the repair of a lifted motion, as a share of the arm's length. Taste."""


def lift(motion: Motion, task: MotionTask) -> Motion | None:
    """The motion on the task's own links, certified; None when repair does not mend it.

    The coordinates v stay; A and the offset are built anew, so that the task's start is met exactly; the last
    keyframe is polished onto the goal; keyframes of intervals that fail the certificate are projected by a step.
    """
    space = _lifted_space(motion, task)
    coordinates = motion.unknowns.copy()
    # On other links the same coordinates put the tip a little elsewhere; a goal of the whole arm is held by the space.
    if task.goal_headings is None:
        goal = task.limited_goal
        end = moved_onto(space, goal, space.pose(coordinates[-1]))
        if not goal.on_goal(end):
            return None
        coordinates[-1] = end.v

    certificate = task.certificate
    stepper = _repair_stepper(space, task)
    failing = certificate.failures(space.configurations(coordinates))
    if _lies_across(stepper, coordinates, failing):
        return None
    for _ in range(_REPAIRS):
        if len(failing) == 0:
            break
        # An interval has no position of its own: both its keyframes are moved.
        at_both_ends = np.unique(np.concatenate((failing, failing + 1)))
        coordinates = _pushed_clear(stepper, coordinates, at_both_ends)
        failing = certificate.failures(space.configurations(coordinates))

    # The offset is not the one that the motion was planned with, so bends have to be looked at once more.
    headings = space.configurations(coordinates)
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
    first = motion.unknowns[0]
    last = motion.unknowns[-1]
    at_start = task.start - matrix @ first[:p]  # the offset that the first keyframe needs

    if task.goal_headings is not None:
        # A motion that was bent to its own end for more room has still more coordinates: their columns are taken over.
        extra = _resampled_columns(motion.curve.matrix[:, p + 1 :], task.arm.links)
        before = at_start - extra @ first[p + 1 :]
        behind = task.goal_headings - matrix @ last[:p] - extra @ last[p + 1 :]
        planned_backwards = first[p] > last[p]
        offset = behind if planned_backwards else before
        blended = before if planned_backwards else behind
        return LinkSpace(task.arm, np.column_stack((matrix, blended - offset, extra)), offset)

    if len(first) > p and first[-1] == 0.0:
        # Blended to an end that the planner chose for the coarse arm: its column is taken over, the start stays exact.
        extra = _resampled_columns(motion.curve.matrix[:, p:], task.arm.links)
        return LinkSpace(task.arm, np.column_stack((matrix, extra)), at_start - extra @ first[p:])

    if len(first) > p:
        offset = _resampled(motion.curve.offset, task.arm.links)
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
    finder = task.finder(_REPAIR_MARGIN * length, _REACH * length)
    return Stepper(space, task.limits(finder), task.settings, finder=finder)


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
            Term(np.eye(len(pose.v)), np.zeros(len(pose.v)), _COORDINATE_WEIGHT),
        ]
        mended[k] = stepper.step(pose, stay).v
    return mended


def coarse_task(task: MotionTask) -> MotionTask | None:
    """The task with as few links as its passages let through; None where that does not pay, or is not possible."""
    # Narrow passages need short links.
    links = max(_DESIGN_LINKS, 2 * ceil(0.5 * task.nominal_links))
    resamples = all(limit.resamples for limit in task.user_limits)
    if task.arm.links <= _MANY_LINKS * links or not resamples or task.clamped:
        return None
    # What lies in the middle of a gate with few links lies beside it with many.
    if task.gates is not None:
        return None
    return coarsened(task, links)


def taken_over(found: Motion, coarse: MotionTask, task: MotionTask, failures: list[Failure]) -> Motion | None:
    """The coarse motion on the task's links, optimised: lifted, or else found again; None where neither can be."""
    lifted = _lifted(found, coarse, task)
    if lifted is not None:
        return lifted
    again = _found_again(found, task, failures)
    return optimised_to_end_pose(straightened(again, task), task) if again is not None else None


def _lifted(found: Motion, coarse: MotionTask, task: MotionTask) -> Motion | None:
    """A coarse motion on the task's links: optimised and lifted, or else lifted as it was found and then optimised."""
    # An optimised motion hugs the walls, and the links of the finer arm lie elsewhere; hence the wider margin. Where it
    # still cannot be lifted, the motion as it was found has more room.
    optimised = optimised_to_end_pose(straightened(found, coarse), coarse, LIFT_MARGIN)
    lifted = lift(optimised, task)
    if lifted is not None or optimised is found:
        return lifted
    lifted = lift(found, task)
    return optimise(lifted, task) if lifted is not None else None


def _found_again(found: Motion, task: MotionTask, failures: list[Failure]) -> Motion | None:
    """The motion of the candidate that arrived with few links, tried with the task's own; None where it does not.

    In narrow places the finer arm swings out beside the chords of the coarse one, and no repair brings a thin link
    back through a wall; but what leads the one mostly leads the other.
    """
    run = SearchRun.from_task(task, fitting_margins(task)[0])
    return run.run((each for each in chain(run.first(), run.further()) if each.name == found.candidate), failures)
