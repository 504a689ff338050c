"""The goal as the continuation sees it: tip position, tip heading if any, or a whole-arm pose."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.angles import wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY
from ccm_opt.motion.limits.limit import Limit
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term, pose_in
from ccm_opt.motion.settings.step_settings import GoalSettings


@dataclass(frozen=True)
class GoalPose:
    """Where the tip, or the whole arm, has to be.

    Attributes:
        position: of the tip, shape (2,) [m].
        heading: of the tip [rad], or None.
        coordinates: of a whole-arm goal in the link space, or None.
        near_enough: distance [m] and turn [rad] that still count where no pose meets the goal exactly.
        limits: what else has to be met at the goal; usually nothing.
        settings: numbers.
    """

    position: FloatArray
    heading: float | None
    coordinates: FloatArray | None = None
    near_enough: tuple[float, float] = (0.0, 0.0)
    limits: tuple[Limit, ...] = ()
    settings: GoalSettings = field(default_factory=GoalSettings)

    def errors(self, pose: Pose) -> tuple[float, float]:
        """Distance [m] and turn [rad] still to go; for a whole-arm goal the largest turn of any link."""
        return float(np.hypot(*(self.position - pose.points[-1]))), abs(self.turn(pose))

    def met(self, pose: Pose) -> bool:
        """Whether a pose is near enough."""
        distance, turn = self.errors(pose)
        return distance <= self.near_enough[0] and turn <= self.near_enough[1] and self.limits_met(pose)

    def on_goal(self, pose: Pose) -> bool:
        """Whether a pose is on the goal but for rounding."""
        return max(self.errors(pose)) <= self.settings.on_goal

    def limits_met(self, pose: Pose) -> bool:
        """Whether a pose meets all that has to be met at the goal beside the tip."""
        return all(limit.miss(pose.headings) <= 0.0 for limit in self.limits)

    def describe_limits(self, pose: Pose) -> str:
        """What of the limits at the goal is missed or at its bound, in words; empty when nothing is."""
        return "; ".join(words for limit in self.limits if (words := limit.describe(pose.headings)))

    def turn(self, pose: Pose) -> float:
        """Signed turn of the tip to the goal heading, the short way [rad]; 0 without a goal heading."""
        if self.heading is None:
            return 0.0
        return float(wrap(self.heading - pose.headings[-1]))

    def terms(self, space: LinkSpace, pose: Pose, jacobians: FloatArray, weight: float) -> list[Term]:
        """What draws the tip onto the goal."""
        settings = self.settings
        unit = space.nominal_length
        error = self.position - pose.points[-1]
        # A far goal is asked for a stretch at a time: beyond that the linearised tip says nothing of use.
        error = error * min(1.0, settings.distance_step * unit / max(float(np.hypot(*error)), TINY))
        terms = [Term(jacobians[-1] / unit, error / unit, weight)]
        if self.heading is not None:
            step = np.clip(self.turn(pose), -settings.heading_step, settings.heading_step)
            terms.append(Term(space.matrix[-1:], np.array([step]), settings.heading_weight * weight))
        for limit in self.limits:
            rows, wanted = limit.mending(space, pose.headings, settings.heading_step)
            terms.append(Term(rows, wanted, settings.heading_weight * weight * space.arm.links))
        return terms

    def tip_equations(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Rows of the tip that the polish solves, shape (k, p), and by how much they have to change, shape (k,)."""
        error = np.append(self.position - pose.points[-1], self.turn(pose))
        rows = np.vstack((space.jacobians(pose.headings)[-1], space.matrix[-1:]))
        return (rows[:2], error[:2]) if self.heading is None else (rows, error)


def polish(space: LinkSpace, goal: GoalPose, v: FloatArray) -> FloatArray:
    """Newton's method of least change of the links onto the goal, shape (p,).

    Solves min ½ δᵀ(AᵀA + ε)δ subject to J δ = e until the error is below the tolerance; returns the last iterate,
    whose error the caller checks.
    """
    for _ in range(goal.settings.polish_steps):
        pose = pose_in(space, v)
        rows, error = goal.tip_equations(space, pose)
        of_tip = len(error)
        for limit in goal.limits:
            missed, change = limit.missed(space, pose.headings)
            rows = np.vstack((rows, missed))
            error = np.append(error, change)
        if np.max(np.abs(error)) < goal.settings.polish_tolerance:
            break
        # min ½ δᵀ M δ subject to J δ = e: δ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ e.
        spread = np.linalg.solve(space.metric, rows.T)
        independent = len(error) == of_tip  # what limits add may follow from the tip's equations
        v = v + spread @ _solved(rows @ spread, error, goal.settings.least_share, independent=independent)
    return v


def _solved(matrix: FloatArray, error: FloatArray, least_share: float, *, independent: bool) -> FloatArray:
    """The solution of the polish's equations, of least squares where they may depend on each other.

    At full stretch the tip cannot move along the arm: then, too, it is the solution of least squares.
    """
    if not independent:
        return _least_squares(matrix, error, least_share)
    try:
        return np.asarray(np.linalg.solve(matrix, error), dtype=np.float64)
    except np.linalg.LinAlgError:
        return _least_squares(matrix, error, least_share)


def _least_squares(matrix: FloatArray, error: FloatArray, least_share: float) -> FloatArray:
    """The solution of least squares of scaled equations, whose units differ."""
    # Metres, radians and units of the user stand side by side: a unit diagonal lets one threshold decide the rank.
    scale = np.sqrt(np.maximum(np.diag(matrix), TINY**2))
    scaled: FloatArray = np.linalg.lstsq(matrix / np.outer(scale, scale), error / scale, rcond=least_share)[0]
    return scaled / scale
