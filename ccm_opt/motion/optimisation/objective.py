"""What the optimisation makes small: the joint path's length, its unevenness in time, and the curve's bending.

Nearness to walls, which is not quadratic, is in ``nearness``.

With K intervals of equal parameter length the squared length of a path q(u) is ∫|q'|² ≈ K Σ|q_{k+1} − q_k|², whose
least value has evenly spaced keyframes, and ∫|q''|² ≈ K³ Σ|q_{k+1} − 2 q_k + q_{k−1}|². Bends q count, not headings:
the joints' speed and acceleration limits decide the duration.
"""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.link_space import NOMINAL_LINKS, LinkSpace
from ccm_opt.motion.motion_task import JointSlowness
from ccm_opt.motion.settings.optimisation_settings import ObjectiveSettings
from ccm_opt.problem import Weights


@dataclass(frozen=True)
class Objective:
    """½ Σ over coordinates of all keyframes; quadratic and convex.

    Attributes:
        space: the link space; p coordinates.
        intervals: K.
        weights: how much each part counts.
        slowness: of the joints, for the weight of the duration; None when all are alike.
        settings: weights inside the parts.
    """

    space: LinkSpace
    intervals: int
    weights: Weights = field(default_factory=Weights)
    slowness: JointSlowness | None = None
    settings: ObjectiveSettings = field(default_factory=ObjectiveSettings)

    @cached_property
    def first(self) -> FloatArray:
        """Metric of first differences between keyframes, shape (p, p)."""
        settings = self.settings
        headings = settings.heading * self._share * self.space.matrix.T @ self.space.matrix
        curvature, unevenness = self._curvature_rows
        change = settings.shape_change * settings.shape
        shape = change * curvature.T @ curvature + settings.shape * unevenness.T @ unevenness

        way = self.weights.path_length * (self._bends + headings)
        time = self.weights.duration * self._slowed(None if self.slowness is None else self.slowness.speed)
        # K Σ |Δv|² approximates ∫ |v′|² du, since each of the K steps lasts 1/K.
        return self.intervals * (way + time + self.weights.bending * shape + self._ridge)

    @cached_property
    def second(self) -> FloatArray:
        """Metric of second differences, shape (p, p)."""
        settings = self.settings
        headings = settings.second_heading * self._share * self.space.matrix.T @ self.space.matrix
        turns = self.weights.smoothness * (self._bends + headings)
        time = self.weights.duration * self._slowed(None if self.slowness is None else self.slowness.acceleration)
        shape = settings.shape_change * settings.shape * np.eye(self.space.dimension)
        # K³ Σ |Δ²v|² approximates ∫ |v″|² du.
        return settings.unevenness * self.intervals**3 * (turns + time + shape)

    @cached_property
    def shape(self) -> FloatArray:
        """Metric of the coordinates themselves, shape (p, p)."""
        curvature, unevenness = self._curvature_rows
        bending = curvature.T @ curvature + unevenness.T @ unevenness
        return self.weights.bending * self.settings.shape * bending / self.intervals

    @cached_property
    def _share(self) -> float:
        # Sums over links become independent of how many there are.
        return NOMINAL_LINKS / self.space.arm.links

    @cached_property
    def _bends(self) -> FloatArray:
        return self._share * self.space.drive_rows.T @ self.space.drive_rows

    def _slowed(self, slowness: FloatArray | None) -> FloatArray:
        """The metric of the bends, each measured by what its joint can do."""
        if slowness is None:
            return self._bends
        rows = slowness[:, None] * self.space.drive_rows
        return self._share * rows.T @ rows

    @cached_property
    def _ridge(self) -> FloatArray:
        # Coordinates after those of the curve blend the goal in; they have another unit and a weight of their own.
        return np.diag(np.where(self.space.of_shape, self.settings.ridge, self.settings.blend))

    @cached_property
    def _curvature_rows(self) -> tuple[FloatArray, FloatArray]:
        """Curvature values of the curve and their differences, in nominal links."""
        curvature = self.space.arm.length / NOMINAL_LINKS * self.space.curvature_rows
        return curvature, np.diff(curvature, axis=0)

    def value(self, coordinates: FloatArray) -> float:
        """Value at coordinates, shape (K + 1, p)."""
        # Homogeneous of degree two: f = ½ x · ∇f (Euler).
        return 0.5 * float(np.vdot(coordinates, self.gradient(coordinates)))

    def gradient(self, coordinates: FloatArray) -> FloatArray:
        """Gradient by the coordinates, shape (K + 1, p)."""
        # With D the matrix of differences and M a metric: f = ½ tr((D V)ᵀ D V M), so ∇f = Dᵀ D V M, and the block of
        # keyframes k and m is (Dᵀ D)_km M.
        gradient = coordinates @ self.shape
        for order, metric in ((1, self.first), (2, self.second)):
            gradient += _differences(self.intervals, order).T @ np.diff(coordinates, order, axis=0) @ metric
        return gradient

    def blocks(self, k: IntArray, m: IntArray) -> FloatArray:
        """Second derivatives by the coordinates of keyframes k and m, shape (b, p, p); zero where |k − m| > 2."""
        blocks: FloatArray = (k == m)[:, None, None] * self.shape
        for order, metric in ((1, self.first), (2, self.second)):
            blocks = blocks + _normal(self.intervals, order)[k, m][:, None, None] * metric
        return blocks


@lru_cache(maxsize=8)
def _differences(intervals: int, order: int) -> FloatArray:
    """Matrix of differences between keyframes, shape (K + 1 − order, K + 1)."""
    return np.diff(np.eye(intervals + 1), order, axis=0)


@lru_cache(maxsize=8)
def _normal(intervals: int, order: int) -> FloatArray:
    differences = _differences(intervals, order)
    return differences.T @ differences
