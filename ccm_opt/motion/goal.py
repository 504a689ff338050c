"""The goal as the continuation sees it: tip position, tip heading if any, or a whole-arm pose."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.angles import wrap
from ccm_opt.motion.constrained.rows import OwnRows
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import RIDGE, Pose, Term, pose_in

POLISH_TOLERANCE = 1e-9
"""Tip error [m] and heading error [rad] that the polish stops at."""
OWN_MET = 1e-8
"""By how much a user's constraints may be missed at the goal, in their units."""
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
        own: rows of the user's constraints at the goal, or None.
    """

    position: FloatArray
    heading: float | None
    coordinates: FloatArray | None = None
    near_enough: tuple[float, float] = (0.0, 0.0)
    own: OwnRows | None = None

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Distance [m] and turn [rad] still to go; for a whole-arm goal the largest turn of any link."""
        return float(np.hypot(*(self.position - pose.points[-1]))), abs(self.turn(pose))

    def met(self, pose: Pose) -> bool:
        """Whether a pose is near enough."""
        distance, turn = self.errors(pose)
        return distance <= self.near_enough[0] and turn <= self.near_enough[1] and self.own_miss(pose) <= OWN_MET

    def own_miss(self, pose: Pose) -> float:
        """By how much the user's constraints at the goal are missed, in their units."""
        return 0.0 if self.own is None else self.own.values(pose.headings).violation

    def turn(self, pose: Pose) -> float:
        """Signed turn of the tip to the goal heading, the short way [rad]; 0 without a goal heading."""
        if self.heading is None:
            return 0.0
        return float(wrap(self.heading - pose.headings[-1]))

    def terms(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, weight: float) -> list[Term]:
        """What draws the tip onto the goal."""
        unit = space.unit
        error = self.position - pose.points[-1]
        error = error * min(1.0, 1.5 * unit / max(float(np.hypot(*error)), 1e-12))
        terms = [Term(jacobians[-1] / unit, error / unit, weight)]
        if self.heading is not None:
            step = np.clip(self.turn(pose), -_HEADING_STEP, _HEADING_STEP)
            terms.append(Term(space.matrix[-1:], np.array([step]), 0.3 * weight))
        if self.own is not None:
            terms.append(Term(*self.own.mending(pose.headings, _HEADING_STEP), 0.3 * weight * space.arm.links))
        return terms

    def equations(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Rows that the polish solves, shape (k, p), and by how much they have to change, shape (k,)."""
        error = np.append(self.position - pose.points[-1], self.turn(pose))
        rows = np.vstack((space.jacobians(pose.headings)[-1], space.matrix[-1:]))
        if self.heading is None:
            rows, error = rows[:2], error[:2]
        if self.own is not None:
            slopes, change = self.own.missed(pose.headings)
            rows, error = np.vstack((rows, slopes)), np.append(error, change)
        return rows, error


def polish(space: LinkSpace, goal: GoalPose, v: FloatArray) -> FloatArray:
    """Newton's method of least change of the links onto the goal, shape (p,).

    Solves min ½ δᵀ(AᵀA + ε)δ subject to J δ = e until the error is below ``POLISH_TOLERANCE``; returns the last
    iterate, whose error the caller checks.
    """
    metric = space.matrix.T @ space.matrix
    metric += 1e-6 * np.diag(np.diag(metric)) + RIDGE * np.eye(len(v))
    for _ in range(_POLISH_STEPS):
        rows, error = goal.equations(space, pose_in(space, v))
        if np.max(np.abs(error)) < POLISH_TOLERANCE:
            break
        spread = np.linalg.solve(metric, rows.T)
        v = v + spread @ _solved(rows @ spread, error, goal)
    return v


def _solved(matrix: FloatArray, error: FloatArray, goal: GoalPose) -> FloatArray:
    """The solution of the polish's equations; those that a user adds may follow from the others.

    At full stretch the tip cannot move along the arm: then, too, it is the solution of least squares.
    """
    if goal.own is None:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.solve(matrix, error), dtype=np.float64)
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-24))
    scaled: FloatArray = np.linalg.lstsq(matrix / np.outer(scale, scale), error / scale, rcond=1e-10)[0]
    return scaled / scale
