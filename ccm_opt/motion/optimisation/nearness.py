"""What nearness to walls costs: squares of what links lack to a distance at which walls no longer matter.

Every wall row g ≤ 0 of the motion (see ``rows``) with −g < D adds (1 + g/D)² to a mean over intervals and links. Its
Hessian is the Gauss–Newton one, which is convex.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.clearance_rows import IntervalRows
from ccm_opt.motion.limits.limit import Quadratic
from ccm_opt.motion.link_space import NOMINAL_LINKS
from ccm_opt.motion.swept_motion import Sweep


@dataclass(frozen=True)
class WallNearness:
    """The cost of some wall rows; satisfies ``MotionCost``.

    Attributes:
        rows: of one motion; they are held while its change is looked for.
        weight: of the cost.
        distance: D [m].
    """

    rows: IntervalRows
    weight: float
    distance: float

    def value(self, sweep: Sweep) -> float:
        """Cost of a motion."""
        return self._cost(self.rows.values(sweep), sweep)

    def foreseen(self, sweep: Sweep, change: FloatArray) -> float:
        """Cost after a change of the coordinates, shape (K + 1, p), the rows linearised."""
        start, end = self.rows.slopes(sweep)
        k = self.rows.interval
        moved = np.einsum("mp,mp->m", start, change[k]) + np.einsum("mp,mp->m", end, change[k + 1])
        return self._cost(self.rows.values(sweep) + moved, sweep)

    def model(self, sweep: Sweep) -> Quadratic:
        """Gradient and Gauss–Newton Hessian by the coordinates."""
        intervals = len(sweep.turns)
        p = sweep.space.dimension
        k = self.rows.interval
        model = Quadratic(np.zeros((intervals + 1, p)), np.zeros((intervals + 1, p, p)), np.zeros((intervals, p, p)))
        lack = np.maximum(1.0 + self.rows.values(sweep) / self.distance, 0.0)
        start, end = self.rows.slopes(sweep)
        scale = 2.0 * self.share(sweep.space.arm.links, intervals) / self.distance
        # Cost c Σ (1 + g/D)₊²: gradient (2c/D) Σ lack · ∇g, and Hessian (2c/D²) Σ ∇g ∇gᵀ without the second derivatives
        # of g.
        for j in np.unique(k[lack > 0.0]):
            lacking = np.flatnonzero((k == j) & (lack > 0.0))
            a = start[lacking]
            b = end[lacking]
            c = scale / self.distance
            model.gradient[j] += scale * lack[lacking] @ a
            model.gradient[j + 1] += scale * lack[lacking] @ b
            model.diagonal[j] += a.T @ (c * a)
            model.diagonal[j + 1] += b.T @ (c * b)
            model.above[j] += a.T @ (c * b)
        return model

    def _cost(self, values: FloatArray, sweep: Sweep) -> float:
        return self.share(sweep.space.arm.links, len(sweep.turns)) * float(
            np.sum(np.maximum(1.0 + values / self.distance, 0.0) ** 2)
        )

    def share(self, links: int, intervals: int) -> float:
        """Factor of the sum of squares."""
        # A mean over intervals, and over links as if there were the nominal number of them: the weight means the same
        # for any arm.
        return self.weight * NOMINAL_LINKS / (links * intervals)
