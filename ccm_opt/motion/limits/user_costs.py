"""The user's costs of a motion, soft constraints among them, with the convex part of their exact Hessian."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.limit import Quadratic
from ccm_opt.motion.link_space import LinkSpace

if TYPE_CHECKING:
    from ccm_opt.motion.swept_motion import Sweep
    from ccm_opt.user_terms.compiled_terms import UserTerms
    from ccm_opt.user_terms.functions import CompiledCost


@dataclass(frozen=True, eq=False)
class UserCosts:
    """The user's costs of a motion with K intervals; satisfies ``MotionCost``.

    Attributes:
        space: the link space; p coordinates.
        terms: constraints and costs.
        u: path parameter of every keyframe, shape (K + 1,).
    """

    space: LinkSpace
    terms: "UserTerms"
    u: FloatArray

    def value(self, sweep: "Sweep") -> float:
        """Cost of a motion."""
        return sum(
            float(weights @ cost.values(sweep.headings, self.u)) for cost, weights in zip(*self._weights, strict=True)
        )

    def foreseen(self, sweep: "Sweep", change: FloatArray) -> float:
        """Cost after a change of the coordinates, shape (K + 1, p), by the quadratic model."""
        model = self.model(sweep)
        bent = np.einsum("kp,kpq,kq->", change, model.diagonal, change)
        return self.value(sweep) + float(np.vdot(model.gradient, change)) + 0.5 * float(bent)

    def model(self, sweep: "Sweep") -> Quadratic:
        """Gradient and convex part of the Hessian by the coordinates."""
        frames, p = sweep.coordinates.shape
        matrix = self.space.matrix
        model = Quadratic(np.zeros((frames, p)), np.zeros((frames, p, p)), np.zeros((frames - 1, p, p)))
        for cost, weights in zip(*self._weights, strict=True):
            # Keyframe 0 is the fixed start: what it costs cannot be changed.
            for k in np.flatnonzero(weights[1:]) + 1:
                gradient, hessian = cost.second_order(sweep.headings[k], float(self.u[k]))
                if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
                    continue  # there it says nothing of where to go; a motion at which its value is NaN is refused
                # The nearest positive semidefinite matrix (in the Frobenius norm) drops the negative eigenvalues; the
                # QP needs a convex model.
                sizes, vectors = np.linalg.eigh(hessian)
                factor = matrix.T @ (vectors * np.sqrt(np.maximum(sizes, 0.0)))
                model.gradient[k] += weights[k] * gradient @ matrix
                model.diagonal[k] += weights[k] * factor @ factor.T
        return model

    @cached_property
    def _weights(self) -> "tuple[tuple[CompiledCost, ...], list[FloatArray]]":
        """All costs, and the weight of each at every keyframe: its mean over those it applies to."""
        costs = self.terms.all_costs
        weights = []
        for cost in costs:
            applies = cost.applies(self.u).astype(np.float64)
            # A mean, so that a cost weighs the same at any number of keyframes and on any part of the motion.
            weights.append(cost.cost.weight * applies / max(float(applies.sum()), 1.0))
        return costs, weights
