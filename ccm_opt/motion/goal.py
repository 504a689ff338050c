"""The goal as the continuation sees it: tip position, tip heading if any, or a whole-arm pose."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import RIDGE, Pose, Term, pose_in

POLISH_TOLERANCE = 1e-9
"""Tip error [m] and heading error [rad] that the polish stops at."""
_POLISH_STEPS = 12
_HEADING_STEP = 0.3


@dataclass(frozen=True)
class GoalPose:
    """Where the tip, or the whole arm, has to be.

    Attributes:
        position: of the tip, shape (2,) [m].
        heading: of the tip [rad], or None.
        coordinates: of a whole-arm goal in the link space, or None.
        near_enough: distance [m] and turn [rad] that still count where no pose meets the goal exactly.
    """

    position: FloatArray
    heading: float | None
    coordinates: FloatArray | None = None
    near_enough: tuple[float, float] = (0.0, 0.0)

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Distance [m] and turn [rad] still to go; for a whole-arm goal the largest turn of any link."""
        return float(np.hypot(*(self.position - pose.points[-1]))), abs(self.turn(pose))

    def met(self, pose: Pose) -> bool:
        """Whether a pose is near enough."""
        distance, turn = self.errors(pose)
        return distance <= self.near_enough[0] and turn <= self.near_enough[1]

    def turn(self, pose: Pose) -> float:
        """Signed turn of the tip to the goal heading, the short way [rad]; 0 without a goal heading."""
        if self.heading is None:
            return 0.0
        return float((self.heading - pose.headings[-1] + np.pi) % (2.0 * np.pi) - np.pi)

    def terms(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, weight: float) -> list[Term]:
        """What draws the tip onto the goal."""
        unit = space.unit
        error = self.position - pose.points[-1]
        error = error * min(1.0, 1.5 * unit / max(float(np.hypot(*error)), 1e-12))
        terms = [Term(jacobians[-1] / unit, error / unit, weight)]
        if self.heading is not None:
            step = np.clip(self.turn(pose), -_HEADING_STEP, _HEADING_STEP)
            terms.append(Term(space.matrix[-1:], np.array([step]), 0.3 * weight))
        return terms


def polish(space: LinkSpace, goal: GoalPose, v: FloatArray) -> FloatArray:
    """Newton's method of least change of the links onto the goal, shape (p,).

    Solves min ½ δᵀ(AᵀA + ε)δ subject to J δ = e until the error is below ``POLISH_TOLERANCE``; returns the last
    iterate, whose error the caller checks.
    """
    metric = space.matrix.T @ space.matrix
    metric += 1e-6 * np.diag(np.diag(metric)) + RIDGE * np.eye(len(v))
    for _ in range(_POLISH_STEPS):
        pose = pose_in(space, v)
        error = np.append(goal.position - pose.points[-1], goal.turn(pose))
        if np.max(np.abs(error)) < POLISH_TOLERANCE:
            break
        rows = np.vstack((space.jacobians(pose.headings)[-1], space.matrix[-1:]))
        if goal.heading is None:
            rows, error = rows[:2], error[:2]
        spread = np.linalg.solve(metric, rows.T)
        v = v + spread @ np.linalg.solve(rows @ spread, error)
    return v
