"""A user's constraints and costs at the keyframes of a motion that is optimised.

Equations and gaps of every keyframe are linearised rows of the step; after a step the keyframes are brought back onto
the equations. Costs, soft constraints among them, enter with the convex part of their exact Hessian.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.motion.constrained.rows import MARGIN, OwnRows, slope_norms
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.optimisation.nearness import Quadratic, SweepCost
from ccm_opt.motion.optimisation.swept_motion import Sweep

if TYPE_CHECKING:
    from ccm_opt.user_terms.compiled_terms import UserTerms
    from ccm_opt.user_terms.functions import CompiledCost

MET = 1e-8
"""By which equations may be missed at a keyframe, in the user's unit."""
FAR = 2.0
"""Gaps that the whole arm has to turn by more than this to close make no rows [rad]."""
MOST_TURN = 0.5
"""A keyframe that needs a larger turn of a link to meet its equations does not meet them [rad]."""


@dataclass(frozen=True, eq=False)
class KeyframeTerms:
    """The user's terms of one motion with K intervals.

    Attributes:
        space: the link space; p coordinates.
        terms: constraints and costs.
        u: path parameter of every keyframe, shape (K + 1,).
    """

    space: LinkSpace
    terms: "UserTerms"
    u: FloatArray

    def _rows(self, k: int) -> OwnRows:
        """Rows at a keyframe."""
        if k == len(self.u) - 1:
            return self._at_goal
        return self._on_the_way.at(float(self.u[k]))

    @cached_property
    def _on_the_way(self) -> OwnRows:
        return OwnRows(self.space, self.terms.motion_rows)

    @cached_property
    def _at_goal(self) -> OwnRows:
        return OwnRows(self.space, self.terms.goal_rows, 1.0)

    def equations(self, sweep: Sweep) -> tuple[IntArray, FloatArray]:
        """Keyframe of every equation, shape (m,), and its slope by the coordinates, of norm 1, shape (m, p)."""
        keyframes, rows = [], [np.zeros((0, sweep.coordinates.shape[1]))]
        for k in range(1, len(self.u)):
            slopes = self._rows(k).values(sweep.headings[k]).equation_slopes @ self.space.matrix
            rows.append(slopes / slope_norms(slopes)[:, None])
            keyframes += [k] * len(slopes)
        return np.array(keyframes, dtype=np.intp), np.vstack(rows)

    def gaps(self, sweep: Sweep) -> tuple[IntArray, FloatArray, FloatArray]:
        """Keyframe of every gap, its slope per radian, shape (m, p), and its least change [rad]."""
        keyframes, rows, least = [], [np.zeros((0, sweep.coordinates.shape[1]))], []
        for k in range(1, len(self.u)):
            values = self._rows(k).values(sweep.headings[k])
            scale = slope_norms(values.gap_slopes)
            near = values.gaps < FAR * scale
            scale = scale[near]
            rows.append(values.gap_slopes[near] @ self.space.matrix / scale[:, None])
            least.append(np.minimum(MARGIN - values.gaps[near] / scale, 0.0))
            keyframes += [k] * len(scale)
        return np.array(keyframes, dtype=np.intp), np.vstack(rows), np.concatenate(least)

    def met(self, sweep: Sweep) -> bool:
        """Whether all equations are met, and no gap is broken."""
        values = (self._rows(k).values(sweep.headings[k]) for k in range(1, len(self.u)))
        return all(each.violation <= MET for each in values)

    def returned(self, coordinates: FloatArray) -> FloatArray:
        """The keyframes put on their equations and out of broken gaps; where that fails they stay as they are."""
        for k in range(1, len(self.u) - 1):
            back = self._rows(k).returned(coordinates[k], MOST_TURN, gaps=True)
            if back is not None:
                coordinates[k] = back
        return coordinates

    def value(self, sweep: Sweep) -> float:
        """Cost of a motion."""
        return sum(
            float(share @ cost.values(sweep.headings, self.u)) for cost, share in zip(*self._shares, strict=True)
        )

    def foreseen(self, sweep: Sweep, change: FloatArray) -> float:
        """Cost after a change of the coordinates, shape (K + 1, p), by the quadratic model."""
        model = self.model(sweep)
        bent = np.einsum("kp,kpq,kq->", change, model.diagonal, change)
        return self.value(sweep) + float(np.vdot(model.gradient, change)) + 0.5 * float(bent)

    def model(self, sweep: Sweep) -> Quadratic:
        """Gradient and convex part of the Hessian by the coordinates."""
        (frames, p), matrix = sweep.coordinates.shape, self.space.matrix
        model = Quadratic(np.zeros((frames, p)), np.zeros((frames, p, p)), np.zeros((frames - 1, p, p)))
        for cost, share in zip(*self._shares, strict=True):
            for k in np.flatnonzero(share[1:]) + 1:
                gradient, hessian = cost.second_order(sweep.headings[k], float(self.u[k]))
                sizes, vectors = np.linalg.eigh(hessian)
                factor = matrix.T @ (vectors * np.sqrt(np.maximum(sizes, 0.0)))
                model.gradient[k] += share[k] * gradient @ matrix
                model.diagonal[k] += share[k] * factor @ factor.T
        return model

    @cached_property
    def _shares(self) -> "tuple[tuple[CompiledCost, ...], list[FloatArray]]":
        """All costs, and the weight of each at every keyframe: its mean over those it applies to."""
        costs = self.terms.all_costs
        shares = []
        for cost in costs:
            applies = cost.applies(self.u).astype(np.float64)
            shares.append(cost.cost.weight * applies / max(float(applies.sum()), 1.0))
        return costs, shares


@dataclass(frozen=True)
class CostSum:
    """Several costs of a motion as one.

    Attributes:
        parts: the costs.
    """

    parts: tuple[SweepCost, ...]

    def value(self, sweep: Sweep) -> float:
        """Cost of a motion."""
        return sum(part.value(sweep) for part in self.parts)

    def foreseen(self, sweep: Sweep, change: FloatArray) -> float:
        """Cost after a change of the coordinates, shape (K + 1, p)."""
        return sum(part.foreseen(sweep, change) for part in self.parts)

    def model(self, sweep: Sweep) -> Quadratic:
        """Gradient and Hessian by the coordinates."""
        first, *others = (part.model(sweep) for part in self.parts)
        for other in others:
            first = Quadratic(
                first.gradient + other.gradient, first.diagonal + other.diagonal, first.above + other.above
            )
        return first
