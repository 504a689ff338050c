"""Squared distance of a planar arm from a goal in tip position, tip heading and base rotation (section 3.1).

The 1990 paper names the three quantities and refers to a thesis for the functions. Here they are squared and summed,

    d² = (|p - p_goal| / R)² + w_h · 4 sin²((θ_tip - θ_goal)/2) + w_b · (θ_base - θ_ref)²,

with the reach R of the arm as the unit of length. Squares have smooth level sets, so that coordinate-wise moves do not
get stuck on ridges as with a sum of absolute values; the sine makes headings equal that differ by multiples of 2π.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.baseline.operators import Shapes


@dataclass(frozen=True)
class TipPose:
    """Goal position of a tip in the plane, with a goal heading or any heading.

    Attributes:
        position: position of the tip, shape (2,) [m].
        heading: heading of the tip [rad]; None if any heading is allowed.
    """

    position: FloatArray
    heading: float | None = None


@dataclass(frozen=True)
class DistanceWeights:
    """Weights of tip heading w_h and base rotation w_b in a squared distance in which tip position has the weight 1."""

    heading: float = 0.1
    base: float = 0.0


@dataclass(frozen=True)
class Precision:
    """Tolerances within which a tip counts as at its goal: position as a fraction of the reach, and heading [rad]."""

    position: float = 4e-4
    heading: float = 6e-3


@dataclass(frozen=True)
class Distance:
    """Weighted squared distance d² of arms from a goal in tip position, tip heading and base rotation.

    Attributes:
        goal: goal of the tip.
        reach: reach R of the arm, the unit of length [m].
        weights: weights of heading and base rotation.
        base_heading: reference θ_ref of the base heading [rad].
        precision: tolerances of a tip at the goal.
    """

    goal: TipPose
    reach: float
    weights: DistanceWeights = DistanceWeights()
    base_heading: float = 0.0
    precision: Precision = Precision()

    def of_tips(self, positions: FloatArray, headings: FloatArray, base_headings: FloatArray) -> FloatArray:
        """Return the squared distance d² of m arms from the goal, shape (m,).

        Args:
            positions: positions of the tips, shape (m, 2) [m].
            headings: headings of the tips, shape (m,) [rad].
            base_headings: headings of the bases, shape (m,) [rad].
        """
        distance: FloatArray = np.square((positions - self.goal.position) / self.reach).sum(axis=1)
        if self.goal.heading is not None:
            turn = np.sin(0.5 * (headings - self.goal.heading))
            distance = distance + self.weights.heading * 4.0 * turn**2
        if self.weights.base > 0.0:
            distance = distance + self.weights.base * (base_headings - self.base_heading) ** 2
        return distance

    def __call__(self, shapes: Shapes) -> FloatArray:
        """Return the squared distance d² of m backbone curves from the goal, shape (m,)."""
        positions, headings = shapes.tips
        return self.of_tips(positions, headings, shapes.heading)

    @property
    def threshold(self) -> float:
        """Value of d² below which a configuration certainly meets the precision at the goal."""
        least = self.precision.position**2
        return least if self.goal.heading is None else min(least, self.weights.heading * self.precision.heading**2)
