"""Where a motion ends: in the pose that the curve's NLP finds best, with room beside it, if the arm can move there."""

from dataclasses import replace

import numpy as np

from ccm_opt.space.motion.pose_led import PoseLed
from ccm_opt.space.motion.space_continuation import SpaceStalled, follow
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask
from ccm_opt.space.nlp.space_goal_pose import goal_pose
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
    best = goal_pose(problem, motion.configurations[-1], task.tree, settings=settings, deadline=task.deadline)
    if best is None:
        return task, motion
    curve, end = motion.curve.blended_to(best.q)
    unknowns = np.column_stack((motion.unknowns, np.zeros(len(motion.unknowns))))
    stepper = task.stepper(curve, 0.0)
    last = stepper.pose(end)
    guide = PoseLed(unknowns[-1], end, task.settings.guide.pose_step, task.settings.guide)
    try:
        poses = follow(stepper, guide, stepper.pose(unknowns[-1]), task.deadline)
    except SpaceStalled:
        return task, motion
    if not task.certificate.safe(poses[-1].q, last.q):
        return task, motion
    ways = [*(pose.v for pose in poses[1:]), last.v]
    whole = SpaceMotion(
        curve,
        np.vstack((unknowns, *ways)),
        np.vstack((motion.configurations, *(pose.q for pose in poses[1:]), last.q)),
        f"{motion.candidate}, {IN_NLP_POSE}",
    )
    return replace(task, goal=None, goal_pose=last.q), whole
