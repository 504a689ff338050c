"""Where a motion ends: in the pose that the curve's NLP finds best, with room beside it, if the arm can move there.

The pose is taken as the motion's own curve shows it, and put onto the goal: so joints in a guide tube stay straight.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.pieces import edge_is_safe
from ccm_opt.space.motion.pose_led import PoseLed
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow
from ccm_opt.space.motion.space_goal import onto_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.space_step import SpaceStepper
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask
from ccm_opt.space.nlp.space_goal_pose import SpaceGoalPoses
from ccm_opt.space.nlp.space_pose_settings import SpacePoseSettings
from ccm_opt.space.problem import SpaceProblem

IN_NLP_POSE = "ending in the pose of the NLP"
"""What is added to the name of a motion that does."""


def ended_by_nlp(problem: SpaceProblem, task: SpaceTask, motion: SpaceMotion) -> tuple[SpaceTask, SpaceMotion]:
    """The motion, moved on to the best pose at its goal; as it is where no better pose is found, or none is reached.

    Args:
        problem: what is asked.
        task: the same as the search is asked.
        motion: to the goal.

    Returns:
        The task whose goal is that pose, or as it was, and the motion.
    """
    settings = SpacePoseSettings(iterations=task.settings.ending.iterations)
    if task.goal is None or task.deadline.passed():
        return task, motion
    asked = SpaceGoalPoses(problem, task.tree, settings=settings)
    best = asked.best(motion.configurations[-1], task.deadline)
    if best is None:
        return task, motion
    stepper = task.stepper(motion.curve, 0.0)
    last = onto_goal(stepper, task.goal, stepper.pose(motion.curve.fitted(best.q)))
    if last is None:
        return task, motion
    enough = task.settings.ending.enough * task.wanted_gap
    room = asked.gap(last.q)
    if room < min(asked.gap(motion.configurations[-1]), enough):
        return task, motion
    poses = _on_the_way(task, stepper, motion.unknowns[-1], last)
    if not edge_is_safe(stepper, poses[-1].v, last.v):
        return task, motion
    ways = [*poses[1:], last]
    whole = SpaceMotion(
        motion.curve,
        np.vstack((motion.unknowns, *(pose.v for pose in ways))),
        np.vstack((motion.configurations, *(pose.q for pose in ways))),
        f"{motion.candidate}, {IN_NLP_POSE}",
    )
    # With room to spare the end is settled; else the optimisation may move it on.
    return (replace(task, goal=None, goal_pose=last.q) if room >= enough else task), whole


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
