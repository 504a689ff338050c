"""Pose of an arm with its derivatives, and the map from the unknowns of a curve to configurations."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray
from ccm_opt.core.polyline import leg_lengths, path_length
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_RANK = 1e-10
"""Fraction of the largest singular value below which singular values count as zero, so that linearly dependent rows of
a matrix have no effect. Heuristic."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Pose of an arm for given unknowns of its curve, with the derivatives that a QP step needs.

    An arm of n links in d dimensions has c coordinates, the curve p unknowns; links turn about t axes, one in the plane
    and three in space.

    Attributes:
        v: unknowns of the curve, shape (p,).
        q: configuration, shape (c,) [rad, m].
        slopes: derivatives of the configuration with respect to the unknowns, shape (c, p).
        points: joint and tip positions, shape (n + 1, d) [m].
        moving: derivatives of the points with respect to the unknowns, shape (n + 1, d, p) [m].
        turning: derivatives of the links' rotations with respect to the unknowns: the angular velocity for a unit rate
            of each unknown, shape (n, t, p) [rad].
        frames: rotation matrices from the frame of each link to the world, shape (n, d, d); the first column is the
            direction of the link.
    """

    v: FloatArray
    q: FloatArray
    slopes: FloatArray
    points: FloatArray
    moving: FloatArray
    turning: FloatArray
    frames: FloatArray

    @property
    def tip(self) -> FloatArray:
        """Position of the tip, shape (d,) [m]."""
        return np.asarray(self.points[-1])

    @property
    def length(self) -> float:
        """Total length of the links [m]."""
        return path_length(self.points)

    @property
    def swinging(self) -> FloatArray:
        """Derivatives of the link directions with respect to the unknowns, shape (n, d − 1, p) [rad].

        Components are along the axes of each link's frame that are perpendicular to the link.
        """
        across = self.frames[:, :, 1:] / leg_lengths(self.points)[:, None, None]
        return np.asarray(across.transpose(0, 2, 1) @ np.diff(self.moving, axis=0))

    @property
    def tip_turning(self) -> FloatArray:
        """Derivatives of the last link's direction with respect to the unknowns, shape (d − 1, p) [rad].

        Components are along the axes of the link's frame that are perpendicular to the link.
        """
        length = float(np.linalg.norm(self.points[-1] - self.points[-2]))
        return np.asarray(self.frames[-1][:, 1:].T @ (self.moving[-1] - self.moving[-2]) / length)

    @property
    def tip_direction(self) -> FloatArray:
        """Direction of the last link, a unit vector, shape (d,)."""
        return np.asarray(self.frames[-1, :, 0])

    @property
    def directions(self) -> FloatArray:
        """Unit vectors along the links, shape (n, d)."""
        return np.asarray(self.frames[:, :, 0])


@dataclass(frozen=True, eq=False)
class CurveUnknowns(ABC):
    """Map from p unknowns of a curve to the c coordinates of an arm's configuration, in the plane or in space.

    Motions are planned in the unknowns.

    Attributes:
        arm: the arm.
        nominal_links: number of nominal links in the arm's length; the nominal link is the unit of length of steps.
    """

    arm: Arm
    nominal_links: float = field(default=float(NOMINAL_LINKS), kw_only=True)

    @property
    def nominal_length(self) -> float:
        """Length of a nominal link [m]."""
        return self.arm.length / self.nominal_links

    @property
    def nominal_per_link(self) -> float:
        """Number of nominal links per link: weight of each link in sums over all links of the arm."""
        return self.nominal_links / self.arm.links

    # ------------------------------------------------------------ configurations
    @property
    @abstractmethod
    def dimension(self) -> int:
        """Number p of unknowns of the curve."""

    @property
    @abstractmethod
    def of_shape(self) -> BoolArray:
        """Mask of the unknowns that shape the curve, shape (p,); others blend the pose into a goal of the whole arm."""

    @abstractmethod
    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations, shape (K, c) [rad, m], for unknowns of shape (K, p)."""

    @abstractmethod
    def pose(self, v: FloatArray) -> Pose:
        """Return the pose, with its derivatives, for unknowns of shape (p,)."""

    def poses(self, unknowns: FloatArray) -> tuple[Pose, ...]:
        """Return m poses, one for each row of unknowns, shape (m, p)."""
        return tuple(self.pose(v) for v in unknowns)

    def pieces(self, before: FloatArray, after: FloatArray) -> list[FloatArray]:
        """Return unknowns from ``before`` to ``after``, both included, between which configurations are linear.

        Each has shape (p,).
        """
        return [before, after]

    def along(self, spline: BSpline) -> BSpline:
        """Return the spline of configurations that corresponds to a spline of the unknowns."""
        return BSpline(spline.t, self.configurations(spline.c), spline.k)

    def in_pieces(self, unknowns: FloatArray) -> FloatArray:
        """Return keyframes' unknowns (K, p) with others inserted so that configurations are linear between, (m, p)."""
        return unknowns

    def extended(self, unknowns: FloatArray, given_in: "CurveUnknowns") -> FloatArray:
        """Return unknowns (K, p) of the map from which this one was made by ``blended_to`` in this map, (K, p')."""
        return np.pad(unknowns, ((0, 0), (0, self.dimension - given_in.dimension)))

    @property
    def affine(self) -> bool:
        """Whether configurations are affine functions of the unknowns."""
        return True

    @property
    @abstractmethod
    def drive_rows(self) -> FloatArray:
        """Derivatives of drive positions with respect to the unknowns, shape (c, p); valid only for an affine map."""

    def drives(self, q: FloatArray) -> FloatArray:
        """Return the drive positions for configurations, both of shape (..., c); in this class they are the same."""
        return q

    # ------------------------------------------------------------ bends
    @property
    def bend_limits(self) -> FloatArray:
        """Upper bound on the absolute value of every joint bend, shape (b,) [rad]."""
        return self.arm.bend_limits

    def bends(self, q: FloatArray) -> FloatArray:
        """Return the joint bends, shape (..., b) [rad], of configurations, shape (..., c)."""
        return q[..., : len(self.arm.bend_limits)]

    def bend_slopes(self, pose: Pose) -> FloatArray:
        """Return the derivatives of the joint bends with respect to the unknowns at a pose, shape (b, p)."""
        return pose.slopes[: len(self.arm.bend_limits)]

    # ------------------------------------------------------------ shape of the curve
    @property
    @abstractmethod
    def curvature_rows(self) -> FloatArray:
        """Derivatives of the curve's curvature at its knots with respect to the unknowns, shape (m, p) [1/m]."""

    @property
    def curvature_differences(self) -> FloatArray:
        """Derivatives of differences of curvature between neighbouring knots, p columns, at most m − 1 rows [1/m]."""
        return np.diff(self.curvature_rows, axis=0)

    @cached_property
    def knot_bends(self) -> FloatArray:
        """Derivatives with respect to the unknowns of curvature times nominal link length at the knots, (m, p) [rad].

        The product is the bend of a nominal link, so that its weights suit arms of any size.
        """
        return self.nominal_length * self.curvature_rows

    @cached_property
    def knot_bend_differences(self) -> FloatArray:
        """Derivatives of the differences of curvature times nominal link length between neighbouring knots [rad].

        They are derivatives with respect to the p unknowns; there are at most m − 1 rows and p columns.
        """
        return self.nominal_length * self.curvature_differences

    @property
    def following_rows(self) -> FloatArray:
        """Derivatives of the curvature of the world-fixed curve on which a fed arm lies, at m knots, (m, p) [1/m].

        They are derivatives with respect to the unknowns; there are no rows if the curve moves with the base.
        """
        return np.zeros((0, self.dimension))

    # ------------------------------------------------------------ metrics
    @property
    def heading_metric(self) -> FloatArray:
        """Matrix M (p, p) with δᵀ M δ = sum of squared link turns for a change δ of unknowns; 0 if it varies."""
        return np.zeros((self.dimension, self.dimension))

    @abstractmethod
    def metric(self, pose: Pose) -> FloatArray:
        """Return M (p, p) with δᵀ M δ = squared link turns and base travel for a change δ of unknowns at a pose."""

    def spread(self, pose: Pose, rows: FloatArray) -> FloatArray:
        """Return M⁻¹ Rᵀ, shape (p, k), for derivatives R of k quantities, shape (k, p), and the metric M at a pose.

        The columns span the changes of the unknowns that change these quantities while moving the links least.
        """
        return np.asarray(np.linalg.solve(self.metric(pose), rows.T))


def turn_rows(arm: Arm, pose: Pose) -> FloatArray:
    """Return derivatives of link turns [rad] and base travel [link lengths] with respect to the unknowns, (r, p)."""
    base = pose.slopes[arm.coordinates.base] / arm.link_length
    return np.vstack((pose.turning.reshape(-1, len(pose.v)), base))


def least_change(space: CurveUnknowns, pose: Pose, rows: FloatArray, change: FloatArray) -> FloatArray:
    """Return the change of the unknowns that moves the links least and changes k quantities by given amounts, (p,).

    The change is M⁻¹ Sᵀ (S M⁻¹ Sᵀ)⁻¹ c for the metric M of link motion at the pose.

    Args:
        space: map from the unknowns to configurations.
        pose: pose at which the metric is evaluated.
        rows: derivatives S of the quantities with respect to the unknowns, shape (k, p).
        change: required changes c of the quantities, shape (k,).
    """
    # min ½ δᵀ M δ subject to S δ = c: δ = M⁻¹ Sᵀ (S M⁻¹ Sᵀ)⁻¹ c. Least squares, because rows may be dependent.
    spread = space.spread(pose, rows)
    matrix = rows @ spread
    # Rows mix metres, radians and the user's units: a unit diagonal lets one threshold decide the rank.
    scale = np.sqrt(np.maximum(np.diag(matrix), TINY**2))
    least = np.linalg.lstsq(matrix / np.outer(scale, scale), change / scale, rcond=_RANK)[0]
    return np.asarray(spread @ (least / scale))


@dataclass(frozen=True)
class Term:
    """Least-squares term of the objective of a QP step δ, ``½ Σ weight (rows δ − target)²`` over k equations.

    Attributes:
        rows: matrix of the equations, shape (k, p).
        target: target of each equation, shape (k,).
        weight: weight of each equation, shape (k,), or of all.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


def normal_equations(terms: Sequence[Term], ridge: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return the Hessian (p, p) and gradient (p,) of a sum of least-squares terms.

    Args:
        terms: at least one, each with rows of shape (k, p).
        ridge: value added to the diagonal of the Hessian, so that it is positive definite, shape (p,) or scalar.
    """
    rows = np.vstack([t.rows for t in terms])
    target = np.concatenate([t.target for t in terms])
    weight = np.empty(len(target))
    first = 0
    for term in terms:
        weight[first : first + len(term.target)] = term.weight
        first += len(term.target)

    # ½ Σ w |R δ − t|² has the Hessian Rᵀ W R and at δ = 0 the gradient −Rᵀ W t.
    weighted = rows * weight[:, None]
    hessian = rows.T @ weighted
    hessian.flat[:: len(hessian) + 1] += ridge
    return hessian, -weighted.T @ target
