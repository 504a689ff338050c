"""The objective of trajectory optimisation over keyframes.

Nearness to walls, which is not quadratic, is in ``nearness``.

With K intervals of equal parameter length the squared length of a path q(u) is ∫|q'|² ≈ K Σ|q_{k+1} − q_k|², whose
least value has evenly spaced keyframes, and ∫|q''|² ≈ K³ Σ|q_{k+1} − 2 q_k + q_{k−1}|². Bends q count, not headings:
the joints' speed and acceleration limits decide the duration.

Every wall row g ≤ 0 of the motion (see ``rows``) with −g < D adds (1 + g/D)² to a mean over intervals and links. Its
Hessian is the Gauss–Newton one, which is convex.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.clearance_rows import IntervalRows
from ccm_opt.planning.limits.limit import Quadratic
from ccm_opt.planning.link_space import NOMINAL_LINKS, LinkSpace
from ccm_opt.planning.motion_task import JointSlowness
from ccm_opt.planning.settings import ObjectiveSettings
from ccm_opt.planning.swept_motion import Sweep
from ccm_opt.problem import Weights

_RIDGE = 1e-8
"""Weight on changes of all coordinates, so that the metric is definite. Taste."""

_SHAPE_CHANGE = 0.1
"""Share of that weight on changes of the curvature from keyframe to keyframe. Taste."""
_SECOND_HEADING = 0.1
"""Weight of the turns of the links in ``∫|q''|²``. Taste."""


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
        change = _SHAPE_CHANGE * settings.shape
        shape = change * curvature.T @ curvature + settings.shape * unevenness.T @ unevenness

        way = self.weights.path_length * (self._bends + headings)
        time = self.weights.duration * self._slowed(None if self.slowness is None else self.slowness.speed)
        # K Σ |Δv|² approximates ∫ |v′|² du, since each of the K steps lasts 1/K.
        return self.intervals * (way + time + self.weights.bending * shape + self._ridge)

    @cached_property
    def second(self) -> FloatArray:
        """Metric of second differences, shape (p, p)."""
        settings = self.settings
        headings = _SECOND_HEADING * self._share * self.space.matrix.T @ self.space.matrix
        turns = self.weights.smoothness * (self._bends + headings)
        time = self.weights.duration * self._slowed(None if self.slowness is None else self.slowness.acceleration)
        shape = _SHAPE_CHANGE * settings.shape * np.eye(self.space.dimension)
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
        return np.diag(np.where(self.space.of_shape, _RIDGE, self.settings.blend))

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


Failures = Callable[[FloatArray], IntArray]
"""Intervals of a piecewise-linear motion in coordinates, shape (K, p), that are not certified."""
Restored = Callable[[FloatArray], FloatArray]
"""Puts keyframes, coordinates of shape (K, p), where limits want them; both ends stay."""


def decimated(coordinates: FloatArray, failures: Failures, first_stride: int) -> FloatArray:
    """Fewer keyframes of a certified motion, every leg between them certified: legs that fail are halved.

    Args:
        coordinates: at the keyframes, shape (K, p).
        failures: judges the legs.
        first_stride: keyframes that a leg skips at first.

    Returns:
        A subset of the rows, both ends included; no leg cuts a corner, since every one is certified.
    """
    last = len(coordinates) - 1
    kept = np.unique(np.append(np.arange(0, last, first_stride), last))
    while True:
        legs = failures(coordinates[kept])
        # A leg between neighbours of the certified motion cannot be split: it is certified, if with more bisections
        # than were allowed here.
        splittable = legs[np.diff(kept)[legs] > 1]
        if len(splittable) == 0:
            thinned: FloatArray = coordinates[kept]
            return thinned
        kept = np.union1d(kept, (kept[splittable] + kept[splittable + 1]) // 2)


def subdivided(coordinates: FloatArray, sizes: FloatArray, intervals: int) -> FloatArray:
    """The same path with more keyframes: legs are cut into equal parts so that the longest part is shortest.

    Args:
        coordinates: at the keyframes, shape (K, p).
        sizes: how long each leg is, in any measure, shape (K - 1,).
        intervals: number of intervals wanted; a path that has more already stays as it is.
    """
    parts = np.ones(len(sizes), dtype=np.intp)
    while parts.sum() < intervals:
        # Greedy is optimal here: the longest part can only be shortened by cutting its own leg (the apportionment of
        # seats has the same form).
        parts[np.argmax(sizes / parts)] += 1
    pieces = [
        a + np.arange(count)[:, None] / count * (b - a)
        for a, b, count in zip(coordinates[:-1], coordinates[1:], parts, strict=True)
    ]
    return np.vstack((*pieces, coordinates[-1:]))


def resampled(
    coordinates: FloatArray, u: FloatArray, intervals: int, failures: Failures, restored: Restored, rounds: int
) -> tuple[FloatArray, FloatArray] | None:
    """Few keyframes of a path at nearly even steps of its parameter, put onto what limits want, legs certified.

    Args:
        coordinates: at the path's keyframes, shape (K, p).
        u: their path parameters, increasing from 0 to 1, shape (K,).
        intervals: number of steps at first; legs that fail are halved.
        failures: judges the legs.
        restored: puts keyframes where limits want them.
        rounds: times that legs may be halved.

    Returns:
        Coordinates and path parameters, or None when halving does not help.
    """
    places = np.linspace(0.0, 1.0, intervals + 1)
    for _ in range(rounds + 1):
        keyframes = restored(np.column_stack([np.interp(places, u, column) for column in coordinates.T]))
        legs = failures(keyframes)
        if len(legs) == 0:
            return keyframes, places
        places = np.insert(places, legs + 1, 0.5 * (places[legs] + places[legs + 1]))
    return None


def even_parameters(least: int, breaks: FloatArray) -> FloatArray:
    """Path parameters of keyframes, as even as may be, some of them at given places.

    Args:
        least: number of intervals; there may be up to half as many more when the places are met better so.
        breaks: places that a keyframe has to be at, shape (m,).
    """
    counts = np.arange(least, 3 * least // 2)[:, None]
    # Of all counts K the one on whose grid i/K the breaks lie best; rounding lets the smallest count win a tie.
    misses = np.max(np.abs(breaks - np.round(breaks * counts) / counts), axis=1, initial=0.0)
    count = least + int(np.argmin(np.round(misses, 9)))
    u = np.linspace(0.0, 1.0, count + 1)
    u[np.round(breaks * count).astype(np.intp)] = breaks
    return u


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
