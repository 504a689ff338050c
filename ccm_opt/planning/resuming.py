"""Motions for changed problems, from motions for similar ones, without a search.

A known motion is deformed to reach the new goal. In the plane it is tracked by steps that avoid the walls if the
deformed one would touch them, and optimised like any other; in space it keeps the shape of the known motion, so that
replanning takes hardly longer than one smooth path, and is tracked only where no deformed motion is certified.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths, points_at
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.ending import led_to, optimised_to_end_pose
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import CurveMotion, Motion, SpaceMotion, bending_shares
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import thinned
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.plane_in_space import arm_in_space, needs_space, rows_in_space
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import AnyUnknowns, StepperOf
from ccm_opt.planning.tool_problem import with_bodies
from ccm_opt.planning.tracking import Reference, follow_reference
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.tool_links import with_tool_links

_Known = TypeVar("_Known", bound=CurveMotion[Any])

_KEYFRAMES = 60
"""Largest number of keyframes of a known motion that is given by its configurations. Heuristic: more than planned
motions have as a rule."""
_RETREATS = ((1.0, 1.0), (1.0, 0.0), (0.95, 1.0), (0.85, 0.0), (0.7, 1.0))
"""Fractions of the keyframes of a known motion from which the tip is led onto the new goal, and margins of the steps as
multiples of the planning margin, tried in turn. Measured in drags: of eight ends in an elbow and a wing box from which
no step leads onto a goal half a link away, five are left by drawing back; an end with a margin can follow its tip more
often, and the next goal is reached from it."""
_SETTLE_STEPS = 20
"""Maximum number of steps from each of them onto the goal. Measured: those that succeed take 3 to 20 as a rule, the
others up to 60."""
_STAGES = 31
"""Number of places at which the shapes between two motions are looked at. Heuristic."""
_SAME = 1e-9
"""Maximum difference between coordinates of equal configurations [rad, m]."""


def known_motion(arm: Arm, configurations: FloatArray) -> CurveMotion[Any]:
    """Return a motion near configurations (K, c) of an arm as a known one, to be adapted where it is planned.

    Those of fed arms and of sections in the plane are adapted in space; bodies of the arm are links there.
    """
    if arm.dimension == 2 and (arm.base_axes or needs_space(arm)):
        arm, configurations = arm_in_space(arm), rows_in_space(configurations, arm.links)
    if arm.rigid_bodies:
        arm = with_tool_links(arm)
        configurations = with_bodies(configurations, arm, 0.0)
    few = np.unique(np.linspace(0, len(configurations) - 1, _KEYFRAMES).astype(np.intp))
    if arm.carrier:
        # Where axes come to rest, the arm may begin to move.
        moves = np.abs(np.diff(configurations[:, arm.coordinates.base], axis=0)) > _SAME
        few = np.union1d(few, np.flatnonzero(np.any(moves[:-1] & ~moves[1:], axis=1)) + 1)
    configurations = configurations[few]
    if arm.dimension == 2:
        space, start = LinkSpace.through(arm, configurations[0])
        return CurveMotion(space, np.repeat(start[None], len(configurations), axis=0), configurations, "given")
    first, start = unknowns_through(arm, configurations[0])
    curve, end = first.blended_to(configurations[-1])
    fitted = np.stack([curve.fitted(q) for q in configurations])
    fitted[0], fitted[-1] = curve.extended(start[None], first)[0], end
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
    begun = replace(known, curve=stepper.space, unknowns=coordinates, u=None, end_pose=None)
    settled = _settled(begun, stepper, task)
    moved = None if settled is None else bent_onto(begun, settled, task)
    if moved is None:
        moved = _tracked(Reference.from_motion(known, space), coordinates[0], stepper, task, known.candidate)
    return None if moved is None else optimised_to_end_pose(moved, task)


def _settled(known: CurveMotion[AnyUnknowns], stepper: StepperOf[AnyUnknowns], task: SearchTask) -> list[Pose] | None:
    """Return poses from the end of a known motion onto the goal of a task, or None if they do not reach it.

    Args:
        known: the known motion, in the unknowns of the stepper.
        stepper: solver of QP steps.
        task: the task with the goal.
    """
    try:
        return settle(stepper, task.limited_goal, stepper.pose(known.unknowns[-1]), task.deadline)
    except Stalled:
        return None


def bent_onto(
    known: CurveMotion[AnyUnknowns], poses: Sequence[Pose], task: SearchTask
) -> CurveMotion[AnyUnknowns] | None:
    """Return a known motion deformed more and more along its length to end at the goal, or extended to the goal.

    The extended motion is returned if no deformed one is certified.

    Args:
        known: the known motion.
        poses: poses from its end onto the goal.
        task: the task with the goal.

    Returns:
        The certified motion, or None.
    """
    for bent in known.bent_to(poses[-1].v):
        if len(task.failures(bent.curve, bent.unknowns)) == 0:
            return bent
    # Where the deformed motion would touch a wall, the motion is extended from its end.
    led_on = known.through(np.vstack((known.unknowns, *(pose.v for pose in poses[1:]))))
    return led_on if len(task.failures(led_on.curve, led_on.unknowns)) == 0 else None


def bent_keyframes(rows: FloatArray, poses: Sequence[Pose], task: SpaceTask) -> Iterator[FloatArray]:
    """Yield certified keyframes (K, c) to a new end: given ones deformed along their length, or extended to it.

    A curve does not reproduce all motions of an arm on a feed axis: here the bends themselves are changed. Those that
    are straight, as in the guide tube, stay so.

    Args:
        rows: the keyframes, shape (M, c) [rad, m].
        poses: poses from the last keyframe to the new end.
        task: the current obstacles and limits.
    """
    fractions = _fractions(rows, task)
    change = np.where(rows != 0.0, poses[-1].q - rows[-1], 0.0)
    change[:, task.arm.coordinates.base] = (poses[-1].q - rows[-1])[task.arm.coordinates.base]
    for share in () if fractions is None else bending_shares(fractions):
        bent = np.clip(rows + share[:, None] * change, task.arm.lower_limits, task.arm.upper_limits)
        bent[-1] = poses[-1].q
        if len(task.certificate.failures(bent)) == 0:
            yield bent
    extended = np.vstack((rows, *(pose.q for pose in poses[1:])))
    if len(task.certificate.failures(extended)) == 0:
        yield extended


def _tracked(
    reference: Reference, start: FloatArray, stepper: StepperOf[AnyUnknowns], task: SearchTask, candidate: str
) -> CurveMotion[AnyUnknowns] | None:
    """Return a motion that tracks a reference by steps that avoid the current walls, and ends at the goal, or None.

    Args:
        reference: the reference.
        start: unknowns at the start, shape (p,).
        stepper: solver of QP steps.
        task: the task with the goal.
        candidate: name of the motion.
    """
    try:
        way = follow_reference(stepper, reference, task.limited_goal, stepper.pose(start), task.deadline)
    except Stalled:
        return None
    motion = CurveMotion.from_poses(stepper.space, way.poses, candidate)
    return motion if len(task.failures(motion.curve, motion.unknowns)) == 0 else None


def same_route(one: FloatArray, other: FloatArray, task: SpaceTask) -> bool:
    """Return whether two motions take the same way round obstacles, as all shapes between them are free.

    Shapes are interpolated at some equal fractions of both motions. Where one touches an obstacle, the ways may be the
    same all the same.

    Args:
        one: configurations of a motion, shape (K, c) [rad, m].
        other: configurations of the other, shape (M, c) [rad, m].
        task: the current obstacles.
    """
    at = np.linspace(0.0, 1.0, _STAGES)
    stages = [points_at(rows, shares, at) for rows in (one, other) if (shares := _fractions(rows, task)) is not None]
    return len(stages) == 2 and all(map(task.contact_certificate.safe, *stages))


def _fractions(rows: FloatArray, task: SpaceTask) -> FloatArray | None:
    """Return the fractions of a motion (K, c) up to its configurations, shape (K,), or None if nothing moves."""
    arcs = arc_lengths(rows * task.slowness)
    return arcs / arcs[-1] if arcs[-1] > 0.0 else None


def moved_end(known: SpaceMotion, task: SpaceTask) -> tuple[SpaceMotion, list[Pose]] | None:
    """Return a known motion in space from the start of a task, and the poses from its end onto the goal.

    The tip is moved from the end of the known motion onto the goal or, where that fails, from an earlier keyframe, and
    the motion ends there. A motion from another start is deformed to begin at that of the task, more and more along its
    length, or continued to it.

    Args:
        known: a motion to another goal, from another start, or among other obstacles.
        task: the current obstacles, goal and limits.

    Returns:
        The motion, which need not be certified, and the poses; None for goals of the whole arm, for tasks with user
        limits or via points, and if the goal is not reached.
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
    continuation = replace(task.settings.continuation, settle_steps=_SETTLE_STEPS)
    for fraction, margin in _RETREATS:
        begun = known.through(known.unknowns[: 1 + round(fraction * (len(known.unknowns) - 1))])
        stepper = task.stepper(known.curve, margin)
        stepper = replace(stepper, settings=replace(stepper.settings, continuation=continuation))
        settled = _settled(begun, stepper, task)
        if settled is not None:
            return (known if fraction == 1.0 else begun), settled
    return None


def tracked_to(known: SpaceMotion, end: FloatArray, task: SpaceTask) -> SpaceMotion | None:
    """Return a certified motion in space that tracks a known one by steps that avoid obstacles; None in vain.

    Args:
        known: the motion, which begins at the start of the task and need not be certified.
        end: unknowns of a pose at the goal, to which it is deformed, shape (p,).
        task: the current obstacles, goal and limits.
    """
    bent = next(known.bent_to(end))
    reference = Reference(bent.path_parameters, bent.unknowns)
    motion = _tracked(reference, known.unknowns[0], task.stepper(known.curve, 0.0), task, known.candidate)
    # Steps leave many more keyframes than the smooth path needs.
    return None if motion is None else motion.through(thinned(motion, task)[0])
