"""Objective of trajectory optimisation over keyframes: a quadratic part, and a cost of closeness to walls.

With K intervals of equal parameter length the squared length of a joint path q(u) is ∫|q'|² ≈ K Σ|q_{k+1} − q_k|²,
whose minimum has evenly spaced keyframes, and ∫|q''|² ≈ K³ Σ|q_{k+1} − 2 q_k + q_{k−1}|². The q are bends, not
headings: the joints' speed and acceleration limits determine the duration.

For closeness to walls, every wall row g ≤ 0 of the motion (``interval_rows``) with −g < D adds (1 + g/D)² to a mean
over intervals and links; the Hessian of this mean is replaced by its convex Gauss-Newton approximation.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import points_at
from ccm_opt.planning.limits.limit import Quadratic
from ccm_opt.planning.optimisation.interval_rows import IntervalRows, Sweep
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.problem import Weights
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_RIDGE = 1e-8
"""Weight on changes of all unknowns, so that the weight matrix is positive definite. Heuristic."""

_SHAPE_CHANGE = 0.1
"""Weight on changes of the curvature from keyframe to keyframe, as a fraction of ``_SHAPE``. Heuristic."""
_SECOND_HEADING = 0.1
"""Weight of the rotations of the links in ``∫|q''|²``. Heuristic."""
_HEADING = 1e-3
"""Weight of the rotations of the links relative to those of the joints. Heuristic."""
_UNEVENNESS = 4e-3
"""Weight of ``∫|q''|²``, whose square root is the fraction of the motion over which corners are rounded. Heuristic."""
_SHAPE = 1e-3
"""Weight of the backbone curve's curvature and of its differences, in units of nominal links. Heuristic."""
_BLEND = 1e-3
"""Weight on changes of the unknown that blends the curve's pose into a goal for the whole arm. Heuristic."""
_FOLLOWING = 25.0
"""Weight on changes of the backbone curve of an arm with a feed axis, as bends of a nominal link.

An arm whose curve in space does not change follows its tip. Measured on jobs with disturbances: this weight costs a
hundredth of their duration and halves the greatest deviation from the tip path.
"""


@dataclass(frozen=True)
class JointSlowness:
    """Factors by which joints are slower than the mean joint, for a cost that represents the duration.

    Attributes:
        speed: ratio of the mean speed limit to that of each joint, shape (links,).
        acceleration: ratio of the mean acceleration limit to that of each joint, shape (links,).
    """

    speed: FloatArray
    acceleration: FloatArray

    @classmethod
    def from_limits(cls, speeds: FloatArray, accelerations: FloatArray) -> "JointSlowness":
        """Return the slowness of joints with given speed and acceleration limits, each of shape (links,)."""
        return cls(speeds.mean() / speeds, accelerations.mean() / accelerations)

    def resampled(self, links: int) -> "JointSlowness":
        """Return the factors interpolated along an arm with another number of links."""
        middles = (np.arange(len(self.speed)) + 0.5) / len(self.speed)
        wanted = (np.arange(links) + 0.5) / links
        return JointSlowness(np.interp(wanted, middles, self.speed), np.interp(wanted, middles, self.acceleration))


@dataclass(frozen=True)
class Objective:
    """Quadratic objective of a motion: length, smoothness and duration of the joint path, and bending of the curve.

    The objective is quadratic in the coordinates and unknowns of the keyframes, and convex if coordinates are
    linearised.

    Attributes:
        curve: map from p unknowns to c coordinates.
        intervals: number K of intervals between keyframes.
        weights: weights of the cost terms.
        slowness: relative slowness of the coordinates, for the weight of the duration; None if all are equally fast.
        scale: factor of each coordinate, shape (c,); None if all count alike.
    """

    curve: CurveUnknowns
    intervals: int
    weights: Weights = field(default_factory=Weights)
    slowness: JointSlowness | None = None
    scale: FloatArray | None = None

    # ------------------------------------------------------------ metrics of the unknowns
    @cached_property
    def first(self) -> FloatArray:
        """Weight matrix of the first differences of the unknowns between keyframes, shape (p, p)."""
        curve = self.curve
        curvature, unevenness = self._curvature_rows
        change = _SHAPE_CHANGE * _SHAPE
        shape = change * curvature.T @ curvature + _SHAPE * unevenness.T @ unevenness
        metric = self.weights.bending * shape + self._ridge
        metric += self.weights.path_length * _HEADING * self._share * curve.heading_metric
        following = self._unit * curve.following_rows
        if len(following):
            metric += _FOLLOWING * following.T @ following
        if curve.affine:
            metric += self._turns(self._first_weights)
        # K Σ |Δv|² approximates ∫ |v′|² du, since each of the K steps lasts 1/K.
        return np.asarray(self.intervals * metric)

    @cached_property
    def second(self) -> FloatArray:
        """Weight matrix of the second differences of the unknowns of keyframes, shape (p, p)."""
        curve = self.curve
        metric = _SHAPE_CHANGE * _SHAPE * np.eye(len(self._ridge))
        metric += self.weights.smoothness * _SECOND_HEADING * self._share * curve.heading_metric
        if curve.affine:
            metric += self._turns(self._second_weights)
        # K³ Σ |Δ²v|² approximates ∫ |v″|² du.
        return np.asarray(self._second_factor * metric)

    @cached_property
    def shape(self) -> FloatArray:
        """Weight matrix of the unknowns themselves, for the bending of the curve, shape (p, p)."""
        curvature, unevenness = self._curvature_rows
        bending = curvature.T @ curvature + unevenness.T @ unevenness
        return np.asarray(self.weights.bending * _SHAPE * bending / self.intervals)

    @property
    def _share(self) -> float:
        # Makes sums over links independent of the number of links.
        return NOMINAL_LINKS / self.curve.arm.links

    @property
    def _unit(self) -> float:
        """Length of a nominal link [m]."""
        return self.curve.arm.length / NOMINAL_LINKS

    @property
    def _second_factor(self) -> float:
        return _UNEVENNESS * self.intervals**3

    @cached_property
    def _first_weights(self) -> FloatArray:
        """Weights of squared first differences of coordinates between keyframes, shape (c,), or () if all are equal."""
        slowness = None if self.slowness is None else self.slowness.speed
        return self._weighed(self.weights.path_length, slowness)

    @cached_property
    def _second_weights(self) -> FloatArray:
        """Weights of squared second differences of coordinates between keyframes, (c,), or () if all are equal."""
        slowness = None if self.slowness is None else self.slowness.acceleration
        return self._weighed(self.weights.smoothness, slowness)

    def _weighed(self, way: float, slowness: FloatArray | None) -> FloatArray:
        time = self.weights.duration * (1.0 if slowness is None else slowness**2)
        return np.asarray(self._share * (way + time) * (1.0 if self.scale is None else self.scale**2))

    def _turns(self, weights: FloatArray) -> FloatArray:
        """Return the weight matrix of the unknowns, (p, p), that weights (c,) or () of squared coordinates imply."""
        rows = self.curve.drive_rows
        return np.asarray(rows.T @ (np.broadcast_to(weights, len(rows))[:, None] * rows))

    @cached_property
    def _ridge(self) -> FloatArray:
        # Unknowns after those of the curve blend in the goal; they have another unit and a weight of their own.
        return np.diag(np.where(self.curve.of_shape, _RIDGE, _BLEND))

    @cached_property
    def _curvature_rows(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives (p columns each) of curvature at the knots and of its differences, times nominal link length.

        They are with respect to the unknowns.
        """
        return self._unit * self.curve.curvature_rows, self._unit * self.curve.curvature_differences

    # ------------------------------------------------------------ value and derivatives for a motion
    def value(self, sweep: Sweep) -> float:
        """Return the value of the quadratic objective for a motion."""
        value = self._of_unknowns(sweep.unknowns)
        if not self.curve.affine:
            # Homogeneous of degree two: f = ½ x · ∇f (Euler).
            value += 0.5 * float(np.vdot(sweep.configurations, self._ties(sweep.configurations)))
        return value

    def predicted(self, sweep: Sweep, change: FloatArray) -> float:
        """Return the objective after a change of the unknowns (K + 1, p), predicted with linearised coordinates."""
        value = self._of_unknowns(sweep.unknowns + change)
        if not self.curve.affine:
            moved = sweep.configurations + np.einsum("kcp,kp->kc", sweep.slopes, change)
            value += 0.5 * float(np.vdot(moved, self._ties(moved)))
        return value

    def gradient(self, sweep: Sweep) -> FloatArray:
        """Return the gradient of the objective with respect to the unknowns of a motion, shape (K + 1, p)."""
        gradient = self._unknown_gradient(sweep.unknowns)
        if not self.curve.affine:
            gradient += np.einsum("kcp,kc->kp", sweep.slopes, self._ties(sweep.configurations))
        return gradient

    def blocks(self, sweep: Sweep, k: IntArray, m: IntArray) -> FloatArray:
        """Return b blocks of the convex Hessian of the objective with respect to the unknowns, shape (b, p, p).

        Args:
            sweep: the motion.
            k: keyframe of the row of each block, shape (b,).
            m: keyframe of the column of each block, shape (b,); the block is zero where |k − m| > 2.
        """
        blocks: FloatArray = (k == m)[:, None, None] * self.shape
        for order, metric in ((1, self.first), (2, self.second)):
            blocks = blocks + _normal(self.intervals, order)[k, m][:, None, None] * metric
        if not self.curve.affine:
            for order, weights in self._coordinate_weights:
                tied = _normal(self.intervals, order)[k, m][:, None, None]
                blocks += tied * (sweep.slopes[k].transpose(0, 2, 1) @ (weights[:, None] * sweep.slopes[m]))
        return blocks

    def _of_unknowns(self, unknowns: FloatArray) -> float:
        return 0.5 * float(np.vdot(unknowns, self._unknown_gradient(unknowns)))

    def _unknown_gradient(self, unknowns: FloatArray) -> FloatArray:
        # With D the matrix of differences and M a metric: f = ½ tr((D V)ᵀ D V M), so ∇f = Dᵀ D V M, and the block of
        # keyframes k and m is (Dᵀ D)_km M.
        gradient = unknowns @ self.shape
        for order, metric in ((1, self.first), (2, self.second)):
            gradient += _differences(self.intervals, order).T @ np.diff(unknowns, order, axis=0) @ metric
        return np.asarray(gradient)

    @property
    def _coordinate_weights(self) -> tuple[tuple[int, FloatArray], ...]:
        """Pairs of an order of differences between keyframes, 1 or 2, and the coordinate weights, shape (c,)."""
        return (1, self.intervals * self._first_weights), (2, self._second_factor * self._second_weights)

    def _ties(self, configurations: FloatArray) -> FloatArray:
        """Return the gradient, (K + 1, c), of the cost terms in configurations, at configurations (K + 1, c)."""
        return np.asarray(
            sum(
                _normal(self.intervals, order) @ configurations * weights for order, weights in self._coordinate_weights
            )
        )


def normalised(weights: Weights) -> Weights:
    """Return weights of a cost scaled so that the largest of those for path length, smoothness and duration is 1.

    The slack prices and the damping of the optimisation are tuned for this scale.
    """
    largest = max(weights.path_length, weights.smoothness, weights.duration)
    scale = largest if largest > 0.0 else 1.0
    return Weights(**{name: value / scale for name, value in asdict(weights).items()})


@lru_cache(maxsize=8)
def _differences(intervals: int, order: int) -> FloatArray:
    """Return the matrix of differences of a given order between K + 1 keyframes, (K + 1 − order, K + 1)."""
    return np.diff(np.eye(intervals + 1), order, axis=0)


@lru_cache(maxsize=8)
def _normal(intervals: int, order: int) -> FloatArray:
    differences = _differences(intervals, order)
    return differences.T @ differences


Failures = Callable[[FloatArray], IntArray]
"""Function from keyframes (K, p) of a piecewise-linear motion to the indices of its uncertified intervals."""
Restored = Callable[[FloatArray], FloatArray]
"""Function that moves the inner keyframes of a motion (K, p) so that they respect the limits; the ends stay."""


def decimated(coordinates: FloatArray, failures: Failures, first_stride: int) -> FloatArray:
    """Return a subset of the keyframes of a certified motion between which all intervals are certified.

    Every n-th keyframe is kept at first; then intervals that are not certified are halved.

    Args:
        coordinates: coordinates at the keyframes, shape (K, p).
        failures: function that returns the indices of intervals that are not certified.
        first_stride: initial stride n.

    Returns:
        Coordinates at the kept keyframes, both ends included, shape (k, p).
    """
    last = len(coordinates) - 1
    kept = np.unique(np.append(np.arange(0, last, first_stride), last))
    while True:
        legs = failures(coordinates[kept])
        # An interval between consecutive keyframes of the certified motion cannot be split; its certificate needs more
        # bisections than are allowed here.
        splittable = legs[np.diff(kept)[legs] > 1]
        if len(splittable) == 0:
            thinned: FloatArray = coordinates[kept]
            return thinned
        kept = np.union1d(kept, (kept[splittable] + kept[splittable + 1]) // 2)


def subdivided(coordinates: FloatArray, sizes: FloatArray, intervals: int) -> FloatArray:
    """Return a path (k, p) whose intervals are divided evenly so that the longest part is as short as possible.

    Args:
        coordinates: coordinates at the keyframes, shape (K, p).
        sizes: length of each interval, in any measure, shape (K - 1,).
        intervals: required number of intervals; a path that already has more is returned unchanged.
    """
    parts = np.ones(len(sizes), dtype=np.intp)
    while parts.sum() < intervals:
        # Greedy is optimal here: the longest part can only be shortened by dividing its own interval (as in the
        # apportionment of seats).
        parts[np.argmax(sizes / parts)] += 1
    pieces = [
        a + np.arange(count)[:, None] / count * (b - a)
        for a, b, count in zip(coordinates[:-1], coordinates[1:], parts, strict=True)
    ]
    return np.vstack((*pieces, coordinates[-1:]))


def resampled(
    coordinates: FloatArray, u: FloatArray, intervals: int, failures: Failures, restored: Restored, rounds: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return keyframes of a path at nearly even path parameters, moved onto the limits, with certified intervals.

    Args:
        coordinates: coordinates at the K keyframes of the path, shape (K, p).
        u: path parameters of these keyframes, increasing from 0 to 1, shape (K,).
        intervals: initial number of intervals; those that are not certified are halved.
        failures: function that returns the indices of intervals that are not certified.
        restored: function that moves keyframes onto the limits.
        rounds: maximum number of halvings.

    Returns:
        Coordinates, shape (k, p), and path parameters, shape (k,), or None if halving does not suffice.
    """
    places = np.linspace(0.0, 1.0, intervals + 1)
    for _ in range(rounds + 1):
        keyframes = restored(points_at(coordinates, u, places))
        legs = failures(keyframes)
        if len(legs) == 0:
            return keyframes, places
        places = np.insert(places, legs + 1, 0.5 * (places[legs] + places[legs + 1]))
    return None


@dataclass(frozen=True)
class WallNearness:
    """Cost of closeness to walls, a weighted mean of max(0, 1 + g/D)² over the wall rows g ≤ 0 of a motion.

    Attributes:
        rows: wall rows of one motion, fixed while a step is computed.
        weight: weight of the cost.
        distance: distance D from walls below which rows contribute to the cost [m].
        nominal_share: number of nominal links per link of the arm.
    """

    rows: IntervalRows
    weight: float
    distance: float
    nominal_share: float

    def value(self, sweep: Sweep) -> float:
        """Return the cost of closeness to walls for a motion."""
        return self._cost(self.rows.values(sweep), sweep)

    def predicted(self, sweep: Sweep, change: FloatArray) -> float:
        """Return the cost after a change of the unknowns (K + 1, p), predicted with linearised wall rows."""
        start, end = self.rows.slopes(sweep)
        k = self.rows.interval
        moved = np.einsum("mp,mp->m", start, change[k]) + np.einsum("mp,mp->m", end, change[k + 1])
        return self._cost(self.rows.values(sweep) + moved, sweep)

    def model(self, sweep: Sweep) -> Quadratic:
        """Return the quadratic model of the cost at a motion: gradient and Gauss-Newton Hessian."""
        intervals = sweep.intervals
        p = sweep.unknowns.shape[1]
        k = self.rows.interval
        model = Quadratic(np.zeros((intervals + 1, p)), np.zeros((intervals + 1, p, p)), np.zeros((intervals, p, p)))
        shortfall = np.maximum(1.0 + self.rows.values(sweep) / self.distance, 0.0)
        start, end = self.rows.slopes(sweep)
        scale = 2.0 * self.share(intervals) / self.distance
        # Cost c Σ (1 + g/D)₊²: gradient (2c/D) Σ lack · ∇g, and Hessian (2c/D²) Σ ∇g ∇gᵀ without the second derivatives
        # of g.
        for j in np.unique(k[shortfall > 0.0]):
            below = np.flatnonzero((k == j) & (shortfall > 0.0))
            a = start[below]
            b = end[below]
            c = scale / self.distance
            model.gradient[j] += scale * shortfall[below] @ a
            model.gradient[j + 1] += scale * shortfall[below] @ b
            model.diagonal[j] += a.T @ (c * a)
            model.diagonal[j + 1] += b.T @ (c * b)
            model.above[j] += a.T @ (c * b)
        return model

    def _cost(self, values: FloatArray, sweep: Sweep) -> float:
        return self.share(sweep.intervals) * float(np.sum(np.maximum(1.0 + values / self.distance, 0.0) ** 2))

    def share(self, intervals: int) -> float:
        """Return the factor of the sum of squares in the cost, which divides the sum by the number of intervals."""
        # A mean over intervals, and over links scaled to the nominal number of links, so that the weight has an equal
        # effect for any arm.
        return self.weight * self.nominal_share / intervals
