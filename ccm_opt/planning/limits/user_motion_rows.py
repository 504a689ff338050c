"""User's costs of a whole motion, and checks of the start and goal against the user's constraints.

Equations between keyframes are not checked here: there, a motion violates them by the square of the distance between
keyframes, and the final path through the keyframes is brought back onto them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.ik.terms import Interval
from ccm_opt.planning.limits.limit import Quadratic

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms
    from ccm_opt.ik.functions import CompiledConstraint, CompiledCost
    from ccm_opt.planning.optimisation.interval_rows import Sweep


@dataclass(frozen=True, eq=False)
class UserCosts:
    """User's costs of a motion with K intervals, including soft constraints; satisfies ``MotionCost``.

    Attributes:
        terms: compiled constraints and costs.
        u: path parameter of every keyframe, shape (K + 1,).
    """

    terms: "UserTerms"
    u: FloatArray

    def value(self, sweep: "Sweep") -> float:
        """Return the sum of the user's weighted costs of a motion."""
        return sum(
            float(weights @ cost.values(sweep.configurations, self.u))
            for cost, weights in zip(*self._weights, strict=True)
        )

    def predicted(self, sweep: "Sweep", change: FloatArray) -> float:
        """Return the user's costs that the quadratic model predicts after a change of the unknowns (K + 1, p)."""
        model = self.model(sweep)
        bent = np.einsum("kp,kpq,kq->", change, model.diagonal, change)
        return self.value(sweep) + float(np.vdot(model.gradient, change)) + 0.5 * float(bent)

    def model(self, sweep: "Sweep") -> Quadratic:
        """Return the quadratic model of the user's costs at a motion: gradient and convex part of the Hessian."""
        frames, p = sweep.unknowns.shape
        model = Quadratic(np.zeros((frames, p)), np.zeros((frames, p, p)), np.zeros((frames - 1, p, p)))
        for cost, weights in zip(*self._weights, strict=True):
            # Keyframe 0 is the fixed start: its cost cannot be changed.
            for k in np.flatnonzero(weights[1:]) + 1:
                gradient, hessian = cost.second_order(sweep.configurations[k], float(self.u[k]))
                if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
                    continue  # no descent direction there; a motion at which the value itself is NaN is refused
                # The QP needs a convex model: dropping the negative eigenvalues gives the nearest positive semidefinite
                # matrix in the Frobenius norm.
                sizes, vectors = np.linalg.eigh(hessian)
                factor = sweep.slopes[k].T @ (vectors * np.sqrt(np.maximum(sizes, 0.0)))
                model.gradient[k] += weights[k] * gradient @ sweep.slopes[k]
                model.diagonal[k] += weights[k] * factor @ factor.T
        return model

    @cached_property
    def _weights(self) -> "tuple[tuple[CompiledCost, ...], list[FloatArray]]":
        """All costs, and for each the weights (K + 1,) at keyframes that turn a sum over these into a weighted mean."""
        costs = self.terms.all_costs
        weights = []
        for cost in costs:
            applies = cost.applies(self.u).astype(np.float64)
            # A mean, so that a cost weighs the same at any number of keyframes and on any part of the motion.
            weights.append(cost.cost.weight * applies / max(float(applies.sum()), 1.0))
        return costs, weights


def refuse_broken_start(terms: "UserTerms", start: "FloatArray", allowed: float) -> None:
    """Check that the start satisfies the user's hard constraints and that all constraints and costs are finite there.

    Args:
        terms: constraints and costs.
        start: configuration at the start, shape (c,) [rad, m].
        allowed: allowed violation of a hard constraint, in the unit of its expression.

    Raises:
        ProblemError: a constraint is violated, or a constraint or cost is not finite; the message names it.
    """
    for compiled in terms.all_costs:
        if not np.isfinite(compiled.values(start[None], np.zeros(1))).all():
            raise ProblemError(f"cost '{compiled.cost.name}' is not finite at the start; got NaN or infinity")
    for constraint in terms.constraints:
        _refuse_at_start(constraint, start, allowed)


def refuse_broken_goal(terms: "UserTerms", goal: "FloatArray", allowed: float) -> None:
    """Check that a goal for the whole arm satisfies the user's hard constraints.

    Args:
        terms: constraints and costs.
        goal: configuration at the goal, shape (c,) [rad, m].
        allowed: allowed violation of a hard constraint, in the unit of its expression.

    Raises:
        UnreachableGoal: a constraint is violated; the message names it.
    """
    for compiled in terms.hard:
        where = compiled.constraint.where
        applies = where.last == 1.0 if isinstance(where, Interval) else True
        miss = float(compiled.residuals(goal[None], np.ones(1))[0])
        # Not "miss > allowed": NaN has to be refused as well.
        if applies and not miss <= allowed:
            name = compiled.constraint.name
            reason = f"constraint '{name}' is violated by {miss:.6g} at the goal, of {allowed:g} allowed"
            advice = ("give the goal for the tip alone", "change the bounds, or make the constraint soft")
            raise UnreachableGoal(Diagnosis(reason, "goal", advice))


def _refuse_at_start(compiled: "CompiledConstraint", start: "FloatArray", allowed: float) -> None:
    where = compiled.constraint.where
    name = compiled.constraint.name
    miss = float(compiled.residuals(start[None], np.zeros(1))[0])
    slopes = np.asarray(compiled.slopes(start, 0.0))
    # A value may be finite where its derivative is not, as with the root of 0; the search would stall there without an
    # explanation.
    if not np.isfinite(miss) or not np.isfinite(slopes).all():
        what = "value" if not np.isfinite(miss) else "derivative"
        raise ProblemError(f"constraint '{name}' is not finite at the start; its {what} is NaN or infinity")
    applies = where.first == 0.0 if isinstance(where, Interval) else where != "goal"
    if applies and not compiled.constraint.soft and miss > allowed:
        raise ProblemError(
            f"constraint '{name}' contradicts the start: it is violated by {miss:.6g} there, of {allowed:g} allowed; "
            "change the start, the bounds, or where the constraint applies, or make it soft"
        )


def slope_norms(slopes: FloatArray) -> FloatArray:
    """Return the norms of m gradients with respect to link headings, (m, c), as an array (m,) of positive numbers."""
    norms: FloatArray = np.maximum(np.linalg.norm(slopes, axis=1), TINY)
    return norms
