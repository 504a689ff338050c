"""Continuation of an arm in space, and steps onto its goal."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.pose import Pose, Term, least_change
from ccm_opt.planning.step import SpaceStepper

_PATIENCE = 60
"""Steps without progress before a guide is given up."""

_POLISH = 0.5
"""From how near Newton's method puts the arm onto the goal [u]."""


@dataclass(frozen=True)
class SpaceTipPose:
    """A place of the tip, and perhaps a direction of the last link.

    Attributes:
        position: shape (3,) [m].
        direction: unit vector, shape (3,), or None when any will do.
        tolerance: how near counts where limits keep the arm from the place itself [m].
        direction_tolerance: the same of the direction [rad].
    """

    position: FloatArray
    direction: FloatArray | None = None
    tolerance: float = 0.0
    direction_tolerance: float = 0.0

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Distance of the tip [m] and turn of its direction [rad]."""
        distance = float(np.linalg.norm(pose.tip - self.position))
        if self.direction is None:
            return distance, 0.0
        along, left, up = (float(part) for part in self.direction @ pose.frames[-1])
        return distance, math.atan2(math.hypot(left, up), along)

    def met(self, pose: Pose) -> bool:
        """Whether a pose is as near as counts."""
        distance, turn = self.errors(pose)
        return distance < self.tolerance and (self.direction is None or turn < self.direction_tolerance)

    def rows(self, pose: Pose, unit: float) -> tuple[FloatArray, FloatArray]:
        """Rows of what is missed and by how much, places in units of length: shapes (3 or 5, p) and (3 or 5,)."""
        slopes = [pose.moving[-1] / unit]
        missing = [(self.position - pose.tip) / unit]
        if self.direction is not None:
            frame = pose.frames[-1]
            # The turn that brings the link's axis t onto d, about t × d by the angle between them, in parts about the
            # link's other axes; its part about t is free.
            along, left, up = (float(part) for part in self.direction @ frame)
            sine = math.hypot(left, up)
            axis = np.array([1.0, 0.0]) if sine < 1e-12 else np.array([-up, left]) / sine
            slopes.append(frame[:, 1:].T @ pose.turning[-1])
            missing.append(math.atan2(sine, along) * axis)
        return np.concatenate(slopes), np.concatenate(missing)

    def term(self, pose: Pose, unit: float, weight: float) -> Term:
        """What draws a pose onto the goal, at most by a nominal link and half a radian at a time."""
        rows, missing = self.rows(pose, unit)
        missing = missing.copy()
        for part, most in ((slice(0, 3), 1.0), (slice(3, None), 0.5)):
            size = float(np.linalg.norm(missing[part]))
            missing[part] *= min(1.0, most / max(size, 1e-12))
        return Term(rows, missing, weight)


def polished(stepper: SpaceStepper, goal: SpaceTipPose, pose: Pose) -> Pose | None:
    """The pose moved onto the goal by Newton's method, or None where that fails or cannot be certified."""
    settings = stepper.settings.guide
    unit = stepper.unit
    distance, turn = goal.errors(pose)
    if distance > _POLISH * unit or turn > settings.polish_turn:
        return None
    now = onto_goal(stepper, goal, pose)
    if now is None or not stepper.within_limits(now.q) or not keeps_terms_at_goal(stepper, now):
        return None
    return now if stepper.certificate.safe(pose.q, now.q, stepper.settings.certificate.depth) else None


def keeps_terms_at_goal(stepper: SpaceStepper, pose: Pose) -> bool:
    """Whether a pose at the goal keeps the user's constraints there."""
    return stepper.user is None or stepper.user.placed_at_goal().miss(pose.q) <= 0.0


def terms_to_goal(stepper: SpaceStepper, goal: SpaceTipPose, pose: Pose, weight: float) -> list[Term]:
    """What draws a pose onto the goal, and into what the user asks for there."""
    drawn = goal.term(pose, stepper.unit, weight)
    if stepper.user is None:
        return [drawn]
    return [drawn, stepper.user.placed_at_goal().drawn_onto(pose.q, pose.slopes, stepper.settings.step.largest_turn)]


def onto_goal(stepper: SpaceStepper, goal: SpaceTipPose, pose: Pose, largest_turn: float = np.inf) -> Pose | None:
    """The pose moved exactly onto a goal by Newton's method, whatever is in the way; None where that fails.

    Args:
        stepper: makes poses.
        goal: where the tip has to be.
        pose: to begin at.
        largest_turn: of a link in one step of the method [rad].
    """
    settings = stepper.settings.guide
    for _ in range(settings.polish_steps):
        rows, missing = goal.rows(pose, stepper.unit)
        if stepper.user is not None:
            of_user, by_user = stepper.user.placed_at_goal().missed_turns(pose.q, pose.slopes)
            rows = np.vstack((rows, of_user))
            missing = np.append(missing, by_user)
        if np.max(np.abs(missing)) < settings.exact:
            return pose
        change = least_change(stepper.space, pose, rows, missing)
        if np.isfinite(largest_turn):
            size = float(np.max(np.linalg.norm(pose.turning @ change, axis=1)))
            change = change * min(1.0, largest_turn / max(size, 1e-12))
        pose = stepper.pose(pose.v + change)
    return None


class SpaceGuide(Protocol):
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


class SpaceStalled(Exception):  # noqa: N818 - an outcome, not a defect
    """A guide made no progress; the message says how far it came, ``poses`` are the way there."""

    def __init__(self, message: str, poses: list[Pose]) -> None:
        super().__init__(message)
        self.poses = poses


def follow(stepper: SpaceStepper, guide: SpaceGuide, pose: Pose, deadline: Deadline) -> list[Pose]:
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
        if fixed or waiting > _PATIENCE or deadline.passed():
            raise SpaceStalled(guide.describe(pose), poses)
    return poses


def settle(stepper: SpaceStepper, goal: SpaceTipPose, pose: Pose, deadline: Deadline) -> list[Pose]:
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
        moved = float(np.max(np.linalg.norm(pose.points - before.points, axis=1)))
        if deadline.passed() or (k > 10 and moved < 1e-4 * stepper.unit):
            break
    if goal.met(pose) and keeps_terms_at_goal(stepper, pose):
        return poses
    distance, turn = goal.errors(pose)
    raise SpaceStalled(f"settling ended {1e3 * distance:.2f} mm and {np.rad2deg(turn):.1f}° off the goal", poses)
