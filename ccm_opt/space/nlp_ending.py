"""Where a motion ends: in the pose that the curve's NLP finds best, with room beside it, if the arm can move there.

The pose is taken as the motion's own curve shows it, and put onto the goal: so joints in a guide tube stay straight.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import SpaceGoalPoseRecord
from ccm_opt.space.motion.opened_end import opened
from ccm_opt.space.motion.pieces import edge_is_safe
from ccm_opt.space.motion.pose_led import PoseLed
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow
from ccm_opt.space.motion.space_goal import keeps_terms_at_goal, onto_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask
from ccm_opt.space.nlp.space_goal_pose import SpaceGoalPoses
from ccm_opt.space.nlp.space_pose_settings import SpacePoseSettings
from ccm_opt.space.nlp.space_pose_solver import SpaceArmPose
from ccm_opt.space.problem import SpaceProblem

IN_NLP_POSE = "ending in the pose of the NLP"
"""What is added to the name of a motion that does."""


@dataclass(frozen=True, eq=False)
class Ending:
    """Where a motion ends, and what the NLP said of it.

    Attributes:
        task: whose goal is the pose of the end where that is settled, or as it was.
        motion: to the goal.
        record: the NLP's answer; None where it was not asked.
    """

    task: SpaceTask
    motion: SpaceMotion
    record: SpaceGoalPoseRecord | None = None


def ended_by_nlp(problem: SpaceProblem, task: SpaceTask, motion: SpaceMotion) -> Ending:
    """The motion, moved on to the best pose at its goal; as it is where no better pose is found, or none is reached.

    Args:
        problem: what is asked.
        task: the same as the search is asked.
        motion: to the goal.
    """
    settings = SpacePoseSettings(iterations=task.settings.ending.iterations)
    if task.goal is None or task.deadline.passed():
        return Ending(task, motion)
    terms = None if task.user is None else task.user.terms
    asked = SpaceGoalPoses(problem, task.tree, terms=terms, settings=settings)
    opened_up = _opened_motion(asked, task, motion)
    # The optimisation, whose planes stand still too, would only move it back.
    otherwise = task if opened_up is motion else _settled(task, opened_up.configurations[-1])
    motion = opened_up
    answers = asked.improved(motion.configurations[-1], task.deadline)
    feasible = [pose for pose in answers if asked.feasible(pose)]
    if not feasible:
        worst = answers[-1]
        reason = f"the program found none; of its rows '{worst.answer.worst_row}' is missed most"
        return Ending(otherwise, motion, pose_record(problem.wanted_gap, worst, len(answers), reason))
    best = min(feasible, key=lambda pose: pose.answer.cost)
    refused = partial(pose_record, problem.wanted_gap, best, len(answers))
    stepper = task.stepper(motion.curve, 0.0)
    last = onto_goal(stepper, task.goal, stepper.pose(motion.curve.fitted(best.q)))
    if last is None or not keeps_terms_at_goal(stepper, last):
        return Ending(otherwise, motion, refused("the curve of the motion cannot take it at the goal"))
    enough = task.settings.ending.enough * task.wanted_gap
    room = asked.gap(last.q)
    if room < min(asked.gap(motion.configurations[-1]), enough):
        return Ending(otherwise, motion, refused("there is more room where the motion ends"))
    poses = _on_the_way(task, stepper, motion.unknowns[-1], last)
    if not edge_is_safe(stepper, poses[-1].v, last.v):
        return Ending(otherwise, motion, refused("the arm cannot be moved there from where the motion ends"))
    whole = _continued(motion, [*poses[1:], last], f"{motion.candidate}, {IN_NLP_POSE}")
    return Ending(_settled(task, last.q), whole, pose_record(problem.wanted_gap, best, len(answers)))


def _opened_motion(asked: SpaceGoalPoses, task: SpaceTask, motion: SpaceMotion) -> SpaceMotion:
    """The motion, moved on at its goal to where there is more room, if it ends with less than is wanted."""
    before = asked.gap(motion.configurations[-1])
    if before >= task.settings.ending.enough * task.wanted_gap:
        return motion
    poses = opened(task, motion)
    return motion if asked.gap(poses[-1].q) <= before else _continued(motion, poses[1:], motion.candidate)


def _settled(task: SpaceTask, end: FloatArray) -> SpaceTask:
    """The task with a pose of the whole arm as its goal."""
    return replace(task, goal=None, goal_pose=end)


def _continued(motion: SpaceMotion, poses: list[SpacePose], candidate: str) -> SpaceMotion:
    """The motion with further keyframes at its end, under a name."""
    return SpaceMotion(
        motion.curve,
        np.vstack((motion.unknowns, *(pose.v for pose in poses))),
        np.vstack((motion.configurations, *(pose.q for pose in poses))),
        candidate,
    )


def pose_record(wanted_gap: float, pose: SpaceArmPose, tried: int, reason: str = "") -> SpaceGoalPoseRecord:
    """What is kept of a pose of the NLP.

    Args:
        wanted_gap: room beyond radius and clearance that was asked for [m].
        pose: the pose.
        tried: how many poses were asked for, this one among them.
        reason: why the motion does not end in it; empty when it does, or when there is none.
    """
    return SpaceGoalPoseRecord(
        reached=not reason,
        reason=reason,
        configuration=pose.q,
        gap=pose.gap,
        wanted_gap=wanted_gap,
        costs=pose.answer.costs,
        multipliers=pose.answer.multipliers,
        iterations=pose.answer.iterations,
        size=pose.answer.size,
        status=pose.answer.status,
        tried=tried,
    )


def _on_the_way(task: SpaceTask, stepper: SpaceStepper, start: FloatArray, end: SpacePose) -> list[SpacePose]:
    """Poses from the end of a motion towards a better one, as far as there is a way; the first is where it ends."""
    first = stepper.pose(start)
    if edge_is_safe(stepper, start, end.v):
        return [first]
    guide = PoseLed(start, end.v, task.settings.guide.pose_step, task.settings.guide)
    try:
        return follow(stepper, guide, first, task.deadline)
    except SpaceStalled as stalled:
        return stalled.poses
