"""Where the tip shall end: errors of a pose, rows that draw it there, and Newton's method for the rest."""

import math
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.motion.space_pose import SpacePose, SpaceTerm
from ccm_opt.space.motion.space_step import SpaceStepper, least_change


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

    def errors(self, pose: SpacePose) -> tuple[float, float]:
        """Distance of the tip [m] and turn of its direction [rad]."""
        distance = float(np.linalg.norm(pose.tip - self.position))
        if self.direction is None:
            return distance, 0.0
        along, left, up = (float(part) for part in self.direction @ pose.chain.rotations[-1])
        return distance, math.atan2(math.hypot(left, up), along)

    def met(self, pose: SpacePose) -> bool:
        """Whether a pose is as near as counts."""
        distance, turn = self.errors(pose)
        return distance < self.tolerance and (self.direction is None or turn < self.direction_tolerance)

    def rows(self, pose: SpacePose, unit: float) -> tuple[FloatArray, FloatArray]:
        """Rows of what is missed and by how much, places in units of length: shapes (3 or 5, p) and (3 or 5,)."""
        slopes = [pose.chain.moving[-1] / unit]
        missing = [(self.position - pose.tip) / unit]
        if self.direction is not None:
            frame = pose.chain.rotations[-1]
            # The turn that brings the link's axis t onto d, about t × d by the angle between them, in parts about the
            # link's other axes; its part about t is free.
            along, left, up = (float(part) for part in self.direction @ frame)
            sine = math.hypot(left, up)
            axis = np.array([1.0, 0.0]) if sine < 1e-12 else np.array([-up, left]) / sine
            slopes.append(frame[:, 1:].T @ pose.chain.turning[-1])
            missing.append(math.atan2(sine, along) * axis)
        return np.concatenate(slopes), np.concatenate(missing)

    def term(self, pose: SpacePose, unit: float, weight: float) -> SpaceTerm:
        """What draws a pose onto the goal, at most by a nominal link and half a radian at a time."""
        rows, missing = self.rows(pose, unit)
        missing = missing.copy()
        for part, most in ((slice(0, 3), 1.0), (slice(3, None), 0.5)):
            size = float(np.linalg.norm(missing[part]))
            missing[part] *= min(1.0, most / max(size, 1e-12))
        return SpaceTerm(rows, missing, weight)


def polished(stepper: SpaceStepper, goal: SpaceTipPose, pose: SpacePose) -> SpacePose | None:
    """The pose moved onto the goal by Newton's method, or None where that fails or cannot be certified."""
    settings = stepper.settings.guide
    unit = stepper.unit
    distance, turn = goal.errors(pose)
    if distance > settings.polish * unit or turn > settings.polish_turn:
        return None
    now = onto_goal(stepper, goal, pose)
    if now is None or not stepper.within_limits(now.q) or not keeps_terms_at_goal(stepper, now):
        return None
    return now if stepper.certificate.safe(pose.q, now.q, stepper.settings.certificate.depth) else None


def keeps_terms_at_goal(stepper: SpaceStepper, pose: SpacePose) -> bool:
    """Whether a pose at the goal keeps the user's constraints there."""
    return stepper.user is None or stepper.user.placed_at_goal().miss(pose.q) <= 0.0


def terms_to_goal(stepper: SpaceStepper, goal: SpaceTipPose, pose: SpacePose, weight: float) -> list[SpaceTerm]:
    """What draws a pose onto the goal, and into what the user asks for there."""
    drawn = goal.term(pose, stepper.unit, weight)
    if stepper.user is None:
        return [drawn]
    return [drawn, stepper.user.placed_at_goal().mending(pose, stepper.settings.step.turn)]


def onto_goal(
    stepper: SpaceStepper, goal: SpaceTipPose, pose: SpacePose, largest_turn: float = np.inf
) -> SpacePose | None:
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
            of_user, by_user = stepper.user.placed_at_goal().missed(pose)
            rows = np.vstack((rows, of_user))
            missing = np.append(missing, by_user)
        if np.max(np.abs(missing)) < settings.exact:
            return pose
        change = least_change(pose, rows, missing, stepper.unit)
        if np.isfinite(largest_turn):
            size = float(np.max(np.linalg.norm(pose.chain.turning @ change, axis=1)))
            change = change * min(1.0, largest_turn / max(size, 1e-12))
        pose = stepper.pose(pose.v + change)
    return None
