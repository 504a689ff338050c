"""Moves an arm whose tip is at its goal off what is near it, by certified steps.

The goal-pose NLP and the optimisation keep every link on its side of planes that stand still while they are solved. A
link that ends at the goal and lies along a wall has before such a plane only the room of its tip, which cannot move:
no change of the pose makes the gap wider, as long as the plane does not turn. A step sees the nearest place of the
link instead, which does move away when the link turns about the goal.
"""

import numpy as np

from ccm_opt.space.motion.space_goal import onto_goal, terms_to_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask


def opened(task: SpaceTask, motion: SpaceMotion) -> list[SpacePose]:
    """Poses from the end of a motion to one at the goal with as much of the wanted gap as steps find.

    Args:
        task: with a goal for the tip.
        motion: to the goal.

    Returns:
        The first is the motion's end; there are no others where steps do not lead back onto the goal.
    """
    settings = task.settings.ending
    stepper = task.stepper(motion.curve, settings.opening * task.wanted_gap / task.margin)
    pose = stepper.pose(motion.unknowns[-1])
    poses = [pose]
    if task.goal is None:
        return poses
    for _ in range(settings.opening_steps):
        before = pose
        pose = stepper.step(pose, terms_to_goal(stepper, task.goal, pose, settings.opening_weight))
        if pose is before or task.deadline.passed():
            break
        poses.append(pose)
        moved = np.linalg.norm(pose.chain.points - before.chain.points, axis=1)
        if float(np.max(moved)) < settings.opened * task.unit:
            break
    last = onto_goal(stepper, task.goal, pose)
    if last is None or not stepper.within_limits(last.q) or not stepper.certificate.safe(pose.q, last.q):
        return poses[:1]
    return [*poses, last]
