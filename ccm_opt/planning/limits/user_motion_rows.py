"""Rows and costs of users' terms over a whole motion.

Equations are not looked at here: between keyframes a motion leaves them by the square of the step, and the path that
is laid through the keyframes in the end is brought back onto them.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray, IntArray
from ccm_opt.errors import Diagnosis, ProblemError, UnreachableGoal
from ccm_opt.ik.terms import Interval
from ccm_opt.planning.limits.limit import Quadratic
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.settings import UserLimitSettings

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms
    from ccm_opt.ik.functions import CompiledConstraint, CompiledCost
    from ccm_opt.ik.row_set import RowSet
    from ccm_opt.planning.swept_motion import Sweep

_NEAR_END = 0.1
"""Share of the intervals at either end at which a gap may be as narrow as at that end. Taste."""


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


def refuse_broken_start(terms: "UserTerms", start: "FloatArray", allowed: float) -> None:
    """Refuse constraints that the start breaks, and terms that are not finite there.

    Args:
        terms: constraints and costs.
        start: link headings, shape (links,) [rad].
        allowed: by which a hard constraint may be missed, in the unit of its expression.

    Raises:
        ProblemError: naming the constraint that the start breaks, or the term that is not finite there.
    """
    for compiled in terms.all_costs:
        if not np.isfinite(compiled.values(start[None], np.zeros(1))).all():
            raise ProblemError(f"cost '{compiled.cost.name}' is not finite at the start; got NaN or infinity")
    for constraint in terms.constraints:
        _refuse_at_start(constraint, start, allowed)


def refuse_broken_goal(terms: "UserTerms", goal: "FloatArray", allowed: float) -> None:
    """Refuse a whole-arm goal that breaks a hard constraint; arguments as for ``refuse_broken_start``.

    Raises:
        UnreachableGoal: naming the constraint.
    """
    for compiled in terms.hard:
        where = compiled.constraint.where
        applies = where.last == 1.0 if isinstance(where, Interval) else True
        miss = float(compiled.residuals(goal[None], np.ones(1))[0])
        # Not "miss > allowed": NaN has to be refused as well.
        if applies and not miss <= allowed:
            name = compiled.constraint.name
            reason = f"constraint '{name}' is missed by {miss:.6g} at the goal, allowed {allowed:g}"
            advice = ("give the goal for the tip alone", "change the bounds, or make the constraint soft")
            raise UnreachableGoal(Diagnosis(reason, "goal", advice))


def _refuse_at_start(compiled: "CompiledConstraint", start: "FloatArray", allowed: float) -> None:
    where = compiled.constraint.where
    name = compiled.constraint.name
    miss = float(compiled.residuals(start[None], np.zeros(1))[0])
    slopes = np.asarray(compiled.slopes(start, 0.0))
    # A value may be finite where its derivative is not, as with the root of 0; the search would stop there without a
    # word.
    if not np.isfinite(miss) or not np.isfinite(slopes).all():
        what = "value" if not np.isfinite(miss) else "derivative"
        raise ProblemError(f"constraint '{name}' is not finite at the start; its {what} is NaN or infinity")
    applies = where.first == 0.0 if isinstance(where, Interval) else where != "goal"
    if applies and not compiled.constraint.soft and miss > allowed:
        raise ProblemError(
            f"constraint '{name}' contradicts the start: it is missed by {miss:.6g} there, allowed {allowed:g}; "
            "change the start, the bounds, or where the constraint applies, or make it soft"
        )


def slope_norms(slopes: FloatArray) -> FloatArray:
    """Norm of every row's slope by the link headings, shape (m,); never 0."""
    norms: FloatArray = np.maximum(np.linalg.norm(slopes, axis=1), TINY)
    return norms


def intervals_with_broken_gaps(rows: "RowSet", headings: FloatArray, settings: UserLimitSettings) -> IntArray:
    """Intervals of a piecewise-linear motion in which a gap is less than its reserve, sorted.

    Args:
        rows: of the constraints that hold between keyframes.
        headings: link headings at the keyframes, shape (K, links) [rad].
        settings: samples and reserve.
    """
    lasting = _lasting(rows)
    if not lasting.any():
        return np.zeros(0, dtype=np.intp)
    intervals = len(headings) - 1

    # Places in units of intervals: place 2.25 is a quarter of the way through interval 2.
    place = np.arange(settings.samples * intervals + 1) / settings.samples
    k = np.minimum(place.astype(np.intp), intervals - 1)
    between = headings[k] + (place - k)[:, None] * (headings[k + 1] - headings[k])
    gaps = rows.table(between)[:, lasting]
    # Negated, so that NaN counts as short.
    short = ~(gaps >= _reserve(rows, lasting, gaps, headings[[0, -1]], settings)).all(axis=1)

    # A sample on a keyframe belongs to the intervals on both sides of it.
    before = np.maximum(np.ceil(place[short]).astype(np.intp) - 1, 0)
    return np.unique(np.concatenate((k[short], before)))


def _lasting(rows: "RowSet") -> BoolArray:
    """Which rows are gaps that hold over the whole motion, wherever keyframes are on it."""
    lasting: BoolArray = ~rows.equal & (rows.first <= 0.0) & (rows.last >= 1.0) & ~rows.parametric
    return lasting


def _reserve(
    rows: "RowSet", lasting: BoolArray, gaps: FloatArray, ends: FloatArray, settings: UserLimitSettings
) -> FloatArray:
    """Least gap at every sample, shape (N, rows): the reserve, but near an end no more than that end has."""
    # The reserve is an angle of the whole arm; a slope turns it into the unit of its gap.
    slopes = np.stack([slope_norms(np.asarray(rows.slopes(end, 0.0)[1])) for end in ends])[:, lasting]
    least = settings.reserve * settings.keep_share * settings.margin * slopes.max(axis=0)
    reserve = np.broadcast_to(least, gaps.shape).copy()

    # The start and the goal are given: a motion cannot have more room near them than they have.
    near = max(1, round(_NEAR_END * len(gaps)))
    reserve[:near] = np.minimum(reserve[:near], np.maximum(gaps[0], -settings.allowed))
    reserve[-near:] = np.minimum(reserve[-near:], np.maximum(gaps[-1], -settings.allowed))
    return reserve
