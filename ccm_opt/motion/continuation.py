"""The continuation: follow a guide step by step, then settle on the goal and polish."""

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.goal import OWN_MET, POLISH_TOLERANCE, GoalPose, polish
from ccm_opt.motion.step import LIMIT_SHARE, Pose, Stepper, Term, allowed_shortfall, keeps_clear, smoothness_terms

BENDING, JERK = 1e-4, 1e-4
PATIENCE = 60
"""Steps without progress before a guide is given up."""
SETTLE_STEPS = 150
PAUSES = (0.02, 1e-3)
"""Poses nearer than this [rad] to the one before are dropped, the first that leaves the motion certified.

A path that almost stands still in places cannot be timed well."""


class Guide(Protocol):
    """Says where the arm should go next, and when it has arrived."""

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm on from a pose."""
        ...

    def progress(self, pose: Pose) -> bool:
        """Move the guide's target on if the arm keeps up; whether it did."""
        ...

    def finished(self, pose: Pose) -> bool:
        """Whether the guide has led the arm as far as it can."""
        ...

    def describe(self, pose: Pose) -> str:
        """How far the guide has come, in words."""
        ...


class Stalled(Exception):  # noqa: N818 - an outcome, not a defect
    """A guide made no progress; the message says how far it came, ``poses`` are the way there."""

    def __init__(self, message: str, poses: list[Pose]) -> None:
        super().__init__(message)
        self.poses = poses


@dataclass(frozen=True)
class Deadline:
    """A moment on the monotonic clock [s]."""

    at: float

    def passed(self) -> bool:
        """Whether it is over."""
        return time.monotonic() > self.at


def follow(stepper: Stepper, guide: Guide, pose: Pose, deadline: Deadline, patience: int = PATIENCE) -> list[Pose]:
    """Poses from the given one to where the guide ends.

    Raises:
        Stalled: when the guide makes no progress, or the deadline passes.
    """
    poses, waiting = [pose], 0
    while not guide.finished(pose):
        jacobians = stepper.space.jacobians(pose.headings)
        smooth = smoothness_terms(stepper.space, pose.v, BENDING, JERK)
        before, pose = pose, stepper.step(pose, jacobians, guide.terms(pose, jacobians) + smooth)
        poses.append(pose)
        moved = guide.progress(pose)
        waiting = 0 if moved else waiting + 1
        fixed = pose is before and not moved  # the next step would be the same again
        if fixed or waiting > patience or deadline.passed():
            raise Stalled(guide.describe(pose), poses)
    return poses


def without_pauses(poses: list[Pose], least: float) -> list[Pose]:
    """The way without poses in which no link has turned by ``least`` [rad] since the one before; both ends stay."""
    kept = [poses[0]]
    for pose in poses[1:]:
        if np.max(np.abs(pose.headings - kept[-1].headings)) >= least:
            kept.append(pose)
    if kept[-1] is not poses[-1]:
        kept[max(len(kept) - 1, 1) :] = [poses[-1]]
    return kept


def settle(stepper: Stepper, goal: GoalPose, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Poses from near the goal onto it, polished; as near as the goal allows where polishing fails.

    Raises:
        Stalled: when an obstacle, the arm itself or a joint limit keeps the tip off the goal.
    """
    poses, space = [pose], stepper.space
    for k in range(SETTLE_STEPS):
        final = polished(stepper, goal, pose)
        if final is not None:
            return [*poses, final]
        jacobians = space.jacobians(pose.headings)
        still = Term(space.matrix, np.zeros(space.arm.links), 0.5 / space.arm.links)
        smooth = smoothness_terms(space, pose.v, BENDING, JERK)
        before, pose = (
            pose,
            stepper.step(pose, jacobians, [*goal.terms(space, pose, jacobians, 1.0 + 0.2 * k), still, *smooth]),
        )
        poses.append(pose)
        if deadline.passed() or (k > 20 and np.max(np.abs(pose.headings - before.headings)) < 1e-5):
            break
    if goal.met(pose):
        return poses
    distance, turn = goal.errors(pose)
    raise Stalled(f"settling ended {1e3 * distance:.1f} mm and {np.rad2deg(turn):.1f}° off the goal", poses)


def polished(stepper: Stepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """The pose moved exactly onto the goal, or None when it is too far away or would touch something."""
    unit = stepper.space.unit
    distance, turn = goal.errors(pose)
    if distance > 0.1 * unit or turn > 0.1:
        return None
    final = stepper.pose(polish(stepper.space, goal, pose.v))
    arm = stepper.space.arm
    within = np.all(np.abs(arm.bends(final.headings)) <= 0.5 * (1.0 + LIMIT_SHARE) * arm.bend_limits)
    if max(goal.errors(final)) > 10.0 * POLISH_TOLERANCE or goal.own_miss(final) > OWN_MET or not within:
        return None
    allowed = allowed_shortfall(stepper.finder.find(pose.points))
    clear = keeps_clear(stepper.finder.find(final.points), allowed) and not stepper.finder.crosses(final.points)
    return final if clear else None
