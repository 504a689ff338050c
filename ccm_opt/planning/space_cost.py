"""What the optimisation makes small: the length of the joint path, its unevenness in time, and the curve's bending."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.space_settings import SpaceObjectiveSettings
from ccm_opt.planning.space_sweep import SpaceSweep


@dataclass(frozen=True, eq=False)
class SpaceMotionCost:
    """½ Σ over keyframes; quadratic in the configurations.

    With K intervals of equal length the squared length of a path q(u) is ∫|q'|² ≈ K Σ|Δq|², which is least for evenly
    spaced keyframes, and ∫|q''|² ≈ K³ Σ|Δ²q|².

    Attributes:
        slowness: how dear a unit of each coordinate is, by the speed that it allows, shape (c,).
        settings: weights of the parts.
    """

    slowness: FloatArray
    settings: SpaceObjectiveSettings

    def value(self, sweep: SpaceSweep) -> float:
        """Value of a motion."""
        scaled = sweep.configurations * self.slowness
        k = sweep.intervals
        first = k * float(np.sum(np.diff(scaled, axis=0) ** 2))
        second = self.settings.unevenness * k**3 * float(np.sum(np.diff(scaled, 2, axis=0) ** 2))
        shape = float(np.einsum("kp,pq,kq->", sweep.unknowns, self._shape(sweep), sweep.unknowns))
        changes = np.diff(sweep.unknowns, axis=0)
        following = k * float(np.einsum("kp,pq,kq->", changes, self._following(sweep), changes))
        return 0.5 * (first + second + shape + following)

    def model(self, sweep: SpaceSweep) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
        """The Gauss–Newton model about a motion.

        Returns:
            Gradient by the unknowns, shape (K + 1, p); blocks of the Hessian, shape (b, p, p); and their rows and
            columns among the keyframes, each of shape (b,).
        """
        k = sweep.intervals
        scaled = sweep.configurations * self.slowness
        slopes = sweep.slopes * self.slowness[:, None]
        coupling = _coupling(k, self.settings.unevenness)
        shape = self._shape(sweep)
        following = self._following(sweep)
        first = _coupling(k, 0.0)
        gradient = np.einsum("kcp,kc->kp", slopes, coupling @ scaled) + sweep.unknowns @ shape
        gradient += first @ sweep.unknowns @ following
        row, column = np.nonzero(np.abs(np.subtract.outer(np.arange(k + 1), np.arange(k + 1))) <= 2)
        blocks = coupling[row, column][:, None, None] * (slopes[row].transpose(0, 2, 1) @ slopes[column])
        blocks[row == column] += shape
        blocks += first[row, column][:, None, None] * following
        return gradient, blocks, row, column

    def _following(self, sweep: SpaceSweep) -> FloatArray:
        """Metric of how much a curve that lies still in space while the arm is fed along it changes, shape (p, p)."""
        curve = sweep.curve
        if not curve.arm.base_axes:
            return np.zeros((curve.dimension, curve.dimension))
        rows = sweep.stepper.unit * curve.change_rows
        return np.asarray(self.settings.following * rows.T @ rows)

    def _shape(self, sweep: SpaceSweep) -> FloatArray:
        """Metric of the curve's bending and of its unevenness, shape (p, p)."""
        rows = sweep.stepper.unit * sweep.curve.curvature_rows
        uneven = sweep.stepper.unit * sweep.curve.curvature_differences
        metric = rows.T @ rows + uneven.T @ uneven
        ridge = self.settings.ridge * np.eye(len(metric))
        return np.asarray(self.settings.shape * metric / (sweep.intervals + 1) + ridge)


@lru_cache(maxsize=16)
def _coupling(intervals: int, unevenness: float) -> FloatArray:
    """How keyframes are tied in the sums of squared differences, shape (K + 1, K + 1)."""
    first = np.diff(np.eye(intervals + 1), axis=0)
    second = np.diff(first, axis=0)
    return np.asarray(intervals * first.T @ first + unevenness * intervals**3 * second.T @ second)
