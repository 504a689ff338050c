"""Follows a guide step by step, then settles on the goal; every step is certified when it is taken."""

from typing import Protocol

import numpy as np

from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.motion.space_goal import SpaceTipPose, keeps_terms_at_goal, polished, terms_to_goal
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm
from ccm_opt.space.motion.space_step import SpaceStepper


class SpaceGuide(Protocol):
    """Says where the arm should go next, and when it has arrived."""

    def terms(self, pose: SpacePose) -> list[SpaceTerm]:
        """What draws the arm on from a pose."""
        ...

    def progress(self, pose: SpacePose) -> bool:
        """Move the guide's target on if the arm keeps up; whether it did."""
        ...

    def finished(self, pose: SpacePose) -> bool:
        """Whether the guide has led the arm as far as it can."""
        ...

    def describe(self, pose: SpacePose) -> str:
        """How far the guide has come, in words."""
        ...


class SpaceStalled(Exception):  # noqa: N818 - an outcome, not a defect
    """A guide made no progress; the message says how far it came, ``poses`` are the way there."""

    def __init__(self, message: str, poses: list[SpacePose]) -> None:
        super().__init__(message)
        self.poses = poses


def follow(stepper: SpaceStepper, guide: SpaceGuide, pose: SpacePose, deadline: Deadline) -> list[SpacePose]:
    """Poses from the given one to where the guide ends.

    Raises:
        SpaceStalled: when the guide makes no progress, or the deadline passes.
    """
    poses = [pose]
    waiting = 0
    while not guide.finished(pose):
        moved = guide.progress(pose)
        before = pose
        pose = stepper.step(pose, guide.terms(pose))
        if pose is not before:
            poses.append(pose)
        waiting = 0 if moved else waiting + 1
        fixed = pose is before and not moved  # the next step would be the same again
        if fixed or waiting > stepper.settings.guide.patience or deadline.passed():
            raise SpaceStalled(guide.describe(pose), poses)
    return poses


def settle(stepper: SpaceStepper, goal: SpaceTipPose, pose: SpacePose, deadline: Deadline) -> list[SpacePose]:
    """Poses from near the goal onto it.

    Raises:
        SpaceStalled: when a wall, the arm itself or a joint limit keeps the tip off the goal.
    """
    settings = stepper.settings.guide
    poses = [pose]
    for k in range(settings.settle_steps):
        final = polished(stepper, goal, pose)
        if final is not None:
            return [*poses, final]
        before = pose
        # The weight grows from step to step: standing still would otherwise hold the arm a little short of the goal.
        pose = stepper.step(pose, terms_to_goal(stepper, goal, pose, 1.0 + settings.settle_growth * k))
        if pose is not before:
            poses.append(pose)
        moved = float(np.max(np.linalg.norm(pose.chain.points - before.chain.points, axis=1)))
        if deadline.passed() or (k > 10 and moved < 1e-4 * stepper.unit):
            break
    if goal.met(pose) and keeps_terms_at_goal(stepper, pose):
        return poses
    distance, turn = goal.errors(pose)
    raise SpaceStalled(f"settling ended {1e3 * distance:.2f} mm and {np.rad2deg(turn):.1f}° off the goal", poses)
