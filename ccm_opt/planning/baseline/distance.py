"""Distance functions of the tip's position, the tip's heading and the base's rotation (section 3.1).

The paper names the three quantities and refers to a thesis for the functions. Here they are squared and summed,

    d² = (|p - p_goal| / R)² + w_h · 4 sin²((θ_tip - θ_goal)/2) + w_b · (θ_base - θ_ref)²,

with the reach R as the unit of length. The square keeps the level sets smooth, so that moves along one coordinate do
not get stuck on ridges as they do on a sum of absolute values; the sine makes headings that differ by whole turns
equal.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.baseline.operators import Shapes


@dataclass(frozen=True)
class TipPose:
    """Goal pose of a tip.

    Attributes:
        position: position of the tip, shape (2,) [m].
        heading: heading of the tip [rad]; None when any heading is allowed.
    """

    position: FloatArray
    heading: float | None = None


@dataclass(frozen=True)
class DistanceWeights:
    """Weights of heading and base rotation relative to position, whose weight is 1."""

    heading: float = 0.1
    base: float = 0.0


@dataclass(frozen=True)
class Precision:
    """Largest errors of a tip at the goal: position as a fraction of the reach, and heading [rad]."""

    position: float = 4e-4
    heading: float = 6e-3


@dataclass(frozen=True)
class Distance:
    """Squared distance of tips from a goal, weighted by position, heading and base rotation.

    Attributes:
        goal: goal of the tip.
        reach: R, the reach of the arm and unit of length [m].
        weights: weights of heading and base rotation.
        base_heading: reference θ_ref of the base heading [rad].
        precision: largest errors of a tip at the goal.
    """

    goal: TipPose
    reach: float
    weights: DistanceWeights = DistanceWeights()
    base_heading: float = 0.0
    precision: Precision = Precision()

    def of_tips(self, positions: FloatArray, headings: FloatArray, base_headings: FloatArray) -> FloatArray:
        """Return d² for tips (m, 2) [m], tip headings (m,) and base headings (m,) [rad]; shape (m,)."""
        distance: FloatArray = np.square((positions - self.goal.position) / self.reach).sum(axis=1)
        if self.goal.heading is not None:
            turn = np.sin(0.5 * (headings - self.goal.heading))
            distance = distance + self.weights.heading * 4.0 * turn**2
        if self.weights.base > 0.0:
            distance = distance + self.weights.base * (base_headings - self.base_heading) ** 2
        return distance

    def __call__(self, shapes: Shapes) -> FloatArray:
        """Return d² for the tips of whole configurations, shape (m,)."""
        positions, headings = shapes.tips
        return self.of_tips(positions, headings, shapes.heading)

    @property
    def threshold(self) -> float:
        """Threshold of d², below the value of every configuration outside the precision."""
        least = self.precision.position**2
        return least if self.goal.heading is None else min(least, self.weights.heading * self.precision.heading**2)
