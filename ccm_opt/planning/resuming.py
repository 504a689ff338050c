"""Motions for changed problems, from motions for similar ones, without a search.

A known motion is deformed to reach the new goal. In the plane it is tracked by steps that avoid the walls if the
deformed one would touch them, and optimised like any other; in space it keeps the shape of the known motion, so that
replanning takes hardly longer than one smooth path.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.ending import led_to, optimised_to_end_pose
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import CurveMotion, Motion, SpaceMotion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tracking import Reference, follow_reference
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm

_Known = TypeVar("_Known", bound=CurveMotion[Any])

_KEYFRAMES = 60
"""Largest number of keyframes of a known motion that is given by its configurations. Heuristic: more than planned
motions have as a rule."""
_SAME = 1e-9
"""Maximum difference between coordinates of equal configurations [rad, m]."""


def known_motion(arm: Arm, configurations: FloatArray) -> CurveMotion[Any]:
    """Return a motion near configurations (K, c) as a known one, to be adapted; the arm has no planar feed."""
    few = np.unique(np.linspace(0, len(configurations) - 1, _KEYFRAMES).astype(np.intp))
    configurations = configurations[few]
    if arm.dimension == 2:
        space, start = LinkSpace.through(arm, configurations[0])
        return CurveMotion(space, np.repeat(start[None], len(configurations), axis=0), configurations, "given")
    curve, _ = unknowns_through(arm, configurations[0])
    curve, end = curve.blended_to(configurations[-1])
    fitted = np.stack([curve.fitted(q) for q in configurations])
    fitted[-1] = end
    return CurveMotion(curve, fitted, configurations, "given")


def nearest_known(known: Sequence[_Known], problem: Problem) -> _Known | None:
    """Return the known motion whose tip begins and ends nearest to that of a problem; None without any."""
    if not known:
        return None
    arm = problem.arm
    ends = np.stack((arm.joint_positions_at(problem.start.configuration(arm))[-1], problem.goal.tip(arm)))

    def distance(motion: _Known) -> float:
        return float(np.linalg.norm(arm.joint_positions_at(motion.configurations[[0, -1]])[:, -1] - ends))

    return min(known, key=distance)


def resumed(known: Motion, task: MotionTask) -> Motion | None:
    """Return a certified, optimised motion for a task, derived from a motion for a similar task, or None.

    Args:
        known: a motion from the same start to another goal or among other walls.
        task: the current arm, workspace, goal and limits.

    Returns:
        The motion; None for goals of the whole arm, for tasks with user limits, and if the known motion cannot be
        adapted, which does not prove that the task has no solution.
    """
    if task.goal_pose is not None or task.user_limits:
        return None
    # The space through the start that also contains the end of the known motion.
    space, start = task.space_through(task.start)
    space, _ = space.blended_to(known.configurations[-1])
    stepper = task.stepper(space, MARGINS[0])
    coordinates = space.closest(known.configurations)
    coordinates[0] = np.append(start, 0.0)
    moved = _bent(known, coordinates, stepper, task) or _tracked(known, coordinates[0], stepper, task)
    return None if moved is None else optimised_to_end_pose(moved, task)


def _bent(known: Motion, coordinates: FloatArray, stepper: Stepper, task: MotionTask) -> Motion | None:
    """Return a known motion deformed more and more along its length to end at the goal, or extended to the goal.

    The extended motion is returned if no deformed one is certified.

    Args:
        known: the known motion.
        coordinates: coordinates of its keyframes in the link space of the stepper, shape (K, p).
        stepper: solver of QP steps that move the last keyframe to the goal.
        task: the task with the goal.

    Returns:
        The certified motion, or None.
    """
    try:
        settled = settle(stepper, task.limited_goal, stepper.pose(coordinates[-1]), task.deadline)
    except Stalled:
        return None
    begun = replace(known, curve=stepper.space, unknowns=coordinates, u=None, end_pose=None)
    for bent in begun.bent_to(settled[-1].v):
        if len(task.failures(bent.curve, bent.unknowns)) == 0:
            return bent
    # Where the deformed motion would touch a wall, the motion is extended from its end.
    led_on = begun.through(np.vstack((coordinates, [pose.v for pose in settled[1:]])))
    return led_on if len(task.failures(led_on.curve, led_on.unknowns)) == 0 else None


def _tracked(known: Motion, start: FloatArray, stepper: Stepper, task: MotionTask) -> Motion | None:
    """Return a motion that tracks a known one by steps that avoid the current walls, and ends at the goal, or None.

    Args:
        known: the known motion.
        start: coordinates of the start, shape (p,).
        stepper: solver of QP steps.
        task: the task with the goal.
    """
    reference = Reference.from_motion(known, stepper.space)
    try:
        way = follow_reference(stepper, reference, task.limited_goal, stepper.pose(start), task.deadline)
    except Stalled:
        return None
    motion = Motion.from_poses(stepper.space, way.poses, known.candidate)
    return motion if len(task.failures(motion.curve, motion.unknowns)) == 0 else None


def moved_end(known: SpaceMotion, task: SpaceTask) -> tuple[SpaceMotion, FloatArray] | None:
    """Return a known motion in space from the start of a task, and the unknowns of a pose at the goal near its end.

    The tip is moved from the end of the known motion onto the goal. A motion from another start is deformed to begin at
    that of the task, more and more along its length, or continued to it.

    Args:
        known: a motion to another goal, from another start, or among other obstacles.
        task: the current obstacles, goal and limits.

    Returns:
        The motion and the unknowns, shape (p,); None for goals of the whole arm, for tasks with user limits or via
        points, and if the goal is not reached.
    """
    if task.goal_pose is not None or task.user_limits or task.via:
        return None
    known = replace(known, end_pose=None, instead=None)
    if np.max(np.abs(known.configurations[0] - task.start)) > _SAME:
        curve, start = known.curve.blended_to(task.start)
        moved = led_to(known.without_blending(curve).backwards(), start, task, (0.0,))
        if moved is None:
            return None
        known = moved.backwards()
    stepper = task.stepper(known.curve, 0.0)
    try:
        settled = settle(stepper, task.limited_goal, stepper.pose(known.unknowns[-1]), task.deadline)
    except Stalled:
        return None
    return known, settled[-1].v
