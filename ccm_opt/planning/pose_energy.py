"""What a pose costs but for room and torque: a quadratic form in the coordinates of the curve, walls left aside.

Bending and distance from a pose are the same parts as in the goal-pose NLP, with bends in the
place of the curvature. Without walls nothing but the goal bends the form: its normal distribution is where cheap poses
lie.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import LinkSpace

RIDGE = 1e-6
"""Share of its diagonal added to the form: coordinates that no link feels cost something too."""


@dataclass(frozen=True)
class EnergyWeights:
    """Weights of the parts, as in the NLP's objective.

    Attributes:
        bending: of ∫κ² ds over the unit arm.
        distance: of the squared turns of the joints from a pose [1/rad²].
    """

    bending: float
    distance: float


@dataclass(frozen=True, eq=False)
class PoseEnergy:
    """½ vᵀH v - gᵀv + c over coordinates v of the curve.

    Attributes:
        space: whose coordinates they are.
        hessian: H, shape (p, p).
        slope: g, shape (p,).
        constant: c.
    """

    space: LinkSpace
    hessian: FloatArray
    slope: FloatArray
    constant: float

    @classmethod
    def of(cls, space: LinkSpace, near: FloatArray, weights: EnergyWeights) -> "PoseEnergy":
        """The energy of poses of an arm.

        Args:
            space: of the arm.
            near: link headings that distance counts from, shape (links,) [rad].
            weights: of the parts.
        """
        links = space.arm.links
        # Every part is a weight times |q - wanted|², and q = B v + q₀; ∫κ² ds ≈ Σ (bend / l)² l, l = 1/links.
        parts = (
            (weights.bending * links, space.slopes[1:], -space.offset[1:]),
            (weights.distance, space.slopes, space.arm.bends(near) - space.offset),
        )
        size = space.dimension
        hessian = np.zeros((size, size))
        slope = np.zeros(size)
        constant = 0.0
        for weight, matrix, missing in parts:
            hessian += 2.0 * weight * matrix.T @ matrix
            slope += 2.0 * weight * matrix.T @ missing
            constant += weight * float(missing @ missing)
        hessian += RIDGE * np.diag(np.diag(hessian)) + RIDGE**2 * np.eye(size)
        return cls(space, hessian, slope, constant)

    def headings(self, v: FloatArray) -> FloatArray:
        """Link headings of coordinates, shape (..., p) to (..., links) [rad]."""
        return self.space.arm.headings(self.space.configurations(v))

    def cost(self, v: FloatArray) -> FloatArray:
        """The energy of coordinates, shape (..., p) to (...)."""
        value: FloatArray = 0.5 * np.einsum("...i,ij,...j->...", v, self.hessian, v) - v @ self.slope + self.constant
        return value

    def descent(self, v: FloatArray) -> FloatArray:
        """The step from coordinates to the least energy of all, shape (..., p)."""
        return self._least - v

    @cached_property
    def inverse(self) -> FloatArray:
        """H⁻¹: the covariance of the distribution exp(-energy), shape (p, p)."""
        return np.asarray(np.linalg.inv(self.hessian), dtype=np.float64)

    def drawn(self, rng: np.random.Generator, middle: FloatArray, costs: FloatArray) -> FloatArray:
        """Normal coordinates about a middle whose energy lies above it by so much in the mean, (m,) to (m, p)."""
        # With δ ~ N(0, T H⁻¹) the mean of ½ δᵀH δ is T p / 2.
        temperature = 2.0 * costs / len(middle)
        normal = rng.standard_normal((len(costs), len(middle)))
        drawn: FloatArray = middle + np.sqrt(temperature)[:, None] * (normal @ self._root.T)
        return drawn

    def least_with_heading(self, heading: float) -> float:
        """The least energy of all poses whose last link has a heading [rad], wherever their tips are."""
        row = self.space.turns[-1]
        short = heading - self.space.arm.headings(self.space.offset)[-1] - row @ self._least
        # min ½ δᵀH δ subject to row · δ = short.
        return float(self.cost(self._least) + 0.5 * short**2 / (row @ self.inverse @ row))

    @cached_property
    def _least(self) -> FloatArray:
        return self.inverse @ self.slope

    @cached_property
    def _root(self) -> FloatArray:
        return np.asarray(np.linalg.cholesky(0.5 * (self.inverse + self.inverse.T)), dtype=np.float64)
