"""Continuation: leading an arm along a guide by QP steps, and settling the tip onto the goal."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Protocol

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import short_length
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import AnyUnknowns, StepperOf

_PATIENCE = 60
"""Number of steps without progress after which a guide is abandoned. Heuristic."""

_SETTLE_MOVED = 1e-5
"""Turn of a link below which settling counts as having stopped [rad]. Heuristic."""


class Guide(Protocol):
    """Interface of a guide, which chooses the targets of successive QP steps and says when the arm has arrived."""

    def terms(self, pose: Pose) -> list[Term]:
        """Return the least-squares terms of a QP step that pull the arm from a pose towards the guide's target."""
        ...

    def progress(self, pose: Pose) -> bool:
        """Advance the guide's target if the arm is near it, and return whether the target advanced."""
        ...

    def finished(self, pose: Pose) -> bool:
        """Return whether the guide's last target is reached."""
        ...

    def describe(self, pose: Pose) -> str:
        """Return a message that says how far the guide has led the arm."""
        ...


class Stalled(Exception):  # noqa: N818 - an outcome, not a defect
    """Exception raised if a motion along a guide or onto a goal makes no progress.

    The message says how far the guide led the arm; ``poses`` holds the motion up to that point.
    """

    def __init__(self, message: str, poses: list[Pose]) -> None:
        super().__init__(message)
        self.poses = poses


def follow(
    stepper: StepperOf[AnyUnknowns],
    guide: Guide,
    pose: Pose,
    deadline: Deadline,
    *,
    patience: int = _PATIENCE,
    into: GoalPose | None = None,
    steps: int | None = None,
) -> list[Pose]:
    """Return the poses of a motion, beginning with a given pose, that follows a guide to the end of the guide.

    Args:
        stepper: solver of QP steps.
        guide: guide to follow.
        pose: pose to begin at.
        deadline: time limit.
        patience: number of steps without progress after which the guide is abandoned.
        into: goal; if it is a set, the motion stops at the first member that the arm reaches. None to follow the guide
            to its end.
        steps: maximum number of steps; None for no bound.

    Raises:
        Stalled: the guide makes no progress, or the deadline has passed.
    """
    poses = [pose]
    waiting = 0
    goal_set = into if into is not None and into.is_set else None
    for _ in count() if steps is None else range(steps):
        if guide.finished(pose) or (goal_set is not None and goal_set.met(pose)):
            break
        before = pose
        pose = stepper.step(pose, guide.terms(pose))
        if pose is not before:
            poses.append(pose)
        moved = guide.progress(pose)
        waiting = 0 if moved else waiting + 1
        fixed = pose is before and not moved  # the next step would be identical
        if fixed or waiting > patience or deadline.passed():
            raise Stalled(guide.describe(pose), poses)
    return poses


def without_pauses(poses: list[Pose], least: float) -> list[Pose]:
    """Return the poses of a motion without those that hardly differ from the pose kept before them.

    A pose is kept if a link has turned by at least ``least`` [rad] since the last pose kept; an advance of the base by
    a link length counts as a turn of one radian. Both ends are kept.
    """
    kept = [poses[0]]
    for pose in poses[1:]:
        turns = pose.turning @ (pose.v - kept[-1].v)
        fed = float(np.linalg.norm(pose.points[0] - kept[-1].points[0])) * len(turns) / pose.length
        if max(float(np.max(np.abs(turns))), fed) >= least:
            kept.append(pose)
    # The end replaces the last pose kept, from which it hardly differs; the start is never replaced.
    if kept[-1] is not poses[-1]:
        kept[max(len(kept) - 1, 1) :] = [poses[-1]]
    return kept


def settle(stepper: StepperOf[AnyUnknowns], goal: GoalPose, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Return the poses of a motion from a pose near the goal to a pose exactly on the goal.

    If Newton's method does not bring the arm onto the goal, the last pose is only within the tolerance of the goal.

    Args:
        stepper: solver of QP steps.
        goal: goal of the tip, with further limits.
        pose: pose to begin at.
        deadline: time limit.

    Raises:
        Stalled: a wall, the arm itself or a joint limit keeps the tip off the goal.
    """
    poses = [pose]
    space = stepper.space
    settings = stepper.settings.continuation
    for k in range(settings.settle_steps):
        final = polished(stepper, goal, pose)
        if final is not None:
            return [*poses, final]
        before = pose
        turning = pose.turning.reshape(-1, space.dimension)
        still = Term(turning, np.zeros(len(turning)), settings.still_weight / space.arm.links)
        # The weight grows from step to step: the terms that keep the arm still and smooth would otherwise hold it
        # slightly short of the goal.
        pose = stepper.step(pose, [*goal.terms(space, pose, 1.0 + settings.settle_growth * k), still])
        if pose is not before:
            poses.append(pose)
        if deadline.passed():
            break
        moved = np.max(np.linalg.norm(before.turning @ (pose.v - before.v), axis=1))
        # Only after some steps: the weight of the goal has to outgrow the other terms first.
        if k > settings.settle_least and moved < _SETTLE_MOVED:
            break
    if goal.met(pose):
        return poses

    distance, turn = goal.errors(pose)
    raise Stalled(
        f"the corrections at the goal ended {short_length(distance)} and {np.rad2deg(turn):.1f}° away from it", poses
    )


def polished(stepper: StepperOf[AnyUnknowns], goal: GoalPose, pose: Pose) -> Pose | None:
    """Return a pose moved exactly onto the goal by Newton's method, or None if it is too far away or not safe."""
    space = stepper.space
    settings = stepper.settings.continuation
    distance, turn = goal.errors(pose)
    # Newton's method has no rows for walls: a long jump might pass through one, and the pose at its end would not show
    # it.
    if distance > settings.polish_distance * space.nominal_length or turn > settings.polish_turn:
        return None
    final = moved_onto(space, goal, pose)
    if not goal.on_goal(final) or not goal.limits_met(final):
        return None
    return final if stepper.leads_to(pose, final) else None


@dataclass(frozen=True)
class GuideCandidate:
    """Candidate of the search: a guide, with follow-up guides for when the first one ends or stalls.

    Attributes:
        name: name for messages.
        make_guide: function that makes the guide to follow.
        resume: functions that make follow-up guides, each from the first guide and a pose. The first function gets the
            pose where that guide ended or stalled, each of the others the pose where the previous guide stalled.
    """

    name: str
    make_guide: Callable[[], Guide]
    resume: tuple[Callable[[Guide, Pose], Guide], ...] = ()
