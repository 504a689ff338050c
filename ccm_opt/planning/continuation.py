"""Continuation of an arm along a guide."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import short_length
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import GoalPose, Stepper, polish

_PATIENCE = 60
"""Steps without progress before a guide is given up. Taste."""
_SETTLE_GROWTH = 0.2
"""Growth of the goal's weight from step to step. Taste."""
_STILL_WEIGHT = 0.5
"""Weight on standing still while settling, for all links together. Taste."""

_SETTLE_LEAST = 20
"""Settling steps that are taken even if the arm hardly moves. Taste."""
_SETTLE_MOVED = 1e-5
"""Turn of a link below which the arm hardly moves [rad]. Taste."""
_POLISH_DISTANCE = 0.1
"""Distance from the goal at which polishing is tried, in nominal links. Taste."""


class Guide(Protocol):
    """Says where the arm should go next, and when it has arrived."""

    def terms(self, pose: Pose) -> list[Term]:
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


def follow(stepper: Stepper, guide: Guide, pose: Pose, deadline: Deadline, patience: int | None = None) -> list[Pose]:
    """Poses from the given one to where the guide ends.

    Args:
        stepper: takes the steps.
        guide: says where to.
        pose: to begin at.
        deadline: when to stop.
        patience: steps without progress before the guide is given up; that of the settings when None.

    Raises:
        Stalled: when the guide makes no progress, or the deadline passes.
    """
    patience = _PATIENCE if patience is None else patience
    poses = [pose]
    waiting = 0
    while not guide.finished(pose):
        before = pose
        pose = stepper.step(pose, guide.terms(pose))
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
        if np.max(np.abs(pose.q - kept[-1].q)) >= least:
            kept.append(pose)
    # The end replaces the last pose kept, which is nearly the same; the start is never replaced.
    if kept[-1] is not poses[-1]:
        kept[max(len(kept) - 1, 1) :] = [poses[-1]]
    return kept


def settle(stepper: Stepper, goal: GoalPose, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Poses from near the goal onto it, polished; as near as the goal allows where polishing fails.

    Raises:
        Stalled: when an obstacle, the arm itself or a joint limit keeps the tip off the goal.
    """
    poses = [pose]
    space = stepper.space
    settings = stepper.settings.continuation
    still = Term(space.matrix, np.zeros(len(space.matrix)), _STILL_WEIGHT / space.arm.links)
    for k in range(settings.settle_steps):
        final = polished(stepper, goal, pose)
        if final is not None:
            return [*poses, final]
        before = pose
        # The weight grows from step to step: standing still and smoothness would otherwise hold the arm a little short
        # of the goal.
        onto_goal = goal.terms(space, pose, 1.0 + _SETTLE_GROWTH * k)
        pose = stepper.step(pose, [*onto_goal, still])
        poses.append(pose)
        if deadline.passed():
            break
        moved = np.max(np.abs(pose.q - before.q))
        # Not before some steps: the weight of the goal has to outgrow the rest first.
        if k > _SETTLE_LEAST and moved < _SETTLE_MOVED:
            break
    if goal.met(pose):
        return poses

    distance, turn = goal.errors(pose)
    raise Stalled(f"settling ended {short_length(distance)} and {np.rad2deg(turn):.1f}° off the goal", poses)


def polished(stepper: Stepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """The pose moved exactly onto the goal, or None when it is too far away or would touch something."""
    space = stepper.space
    settings = stepper.settings.continuation
    distance, turn = goal.errors(pose)
    # Newton's method has no rows for walls: a long jump might pass through one, and the pose at its end show nothing of
    # it.
    if distance > _POLISH_DISTANCE * space.nominal_length or turn > settings.polish_turn:
        return None
    final = stepper.pose(polish(space, goal, pose.v))
    if not goal.on_goal(final) or not goal.limits_met(final):
        return None
    # Backwards, as after a step: the check of contact costs most.
    kept = all(limit.keeps_at_goal(space, pose, final) for limit in reversed(stepper.limits))
    return final if kept else None


@dataclass(frozen=True)
class GuideCandidate:
    """A guide to try.

    Attributes:
        name: for messages.
        make_guide: makes the guide to follow.
        resume: each makes a guide that takes over from the first guide and a pose: the first of them where that guide
            ended or stalled, each of the others where the one before has stalled.
    """

    name: str
    make_guide: Callable[[], Guide]
    resume: tuple[Callable[[Guide, Pose], Guide], ...] = ()


@dataclass(frozen=True)
class GuideIntoSet:
    """Another guide, followed no farther than to the goal.

    Attributes:
        guide: to follow.
        goal: a set, of which the guide is led to one member.
    """

    guide: Guide
    goal: GoalPose

    def terms(self, pose: Pose) -> list[Term]:
        """What draws the arm on from a pose."""
        return self.guide.terms(pose)

    def progress(self, pose: Pose) -> bool:
        """Move the guide's target on if the arm keeps up; whether it did."""
        return self.guide.progress(pose)

    def finished(self, pose: Pose) -> bool:
        """Whether the goal is met, or the guide has ended."""
        return self.goal.met(pose) or self.guide.finished(pose)

    def describe(self, pose: Pose) -> str:
        """How far the guide has come."""
        return self.guide.describe(pose)
