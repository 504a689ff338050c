"""A pose of the arm, its derivatives, and the map of a curve that makes it."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_RANK = 1e-10
"""Singular values below this share of the largest count as none, so that rows that follow from others are left out.
Taste."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Unknowns of the curve with everything derived from them that a step needs.

    An arm of n links in d dimensions has c coordinates, the curve p unknowns; links turn about t axes, one in the plane
    and three in space.

    Attributes:
        v: unknowns, shape (p,).
        q: the configuration, shape (c,) [rad, m].
        slopes: derivatives of it by the unknowns, shape (c, p).
        points: joint and tip positions, shape (n + 1, d) [m].
        moving: derivatives of the points, shape (n + 1, d, p) [m].
        turning: angular velocities of the links for a unit of each unknown, shape (n, t, p) [rad].
        frames: rotations of the links, shape (n, d, d); the first column is the direction of the link.
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
        """Length of the links together [m]."""
        return float(np.sum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))

    @property
    def swinging(self) -> FloatArray:
        """Derivatives of the links' directions along the other axes of their frames, shape (n, d − 1, p) [rad]."""
        lengths = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        across = self.frames[:, :, 1:] / lengths[:, None, None]
        return np.asarray(across.transpose(0, 2, 1) @ np.diff(self.moving, axis=0))

    @property
    def tip_turning(self) -> FloatArray:
        """Derivatives of the last link's direction along the other axes of its frame, shape (d − 1, p) [rad]."""
        length = float(np.linalg.norm(self.points[-1] - self.points[-2]))
        return np.asarray(self.frames[-1][:, 1:].T @ (self.moving[-1] - self.moving[-2]) / length)

    @property
    def tip_direction(self) -> FloatArray:
        """Direction of the last link, shape (d,)."""
        return np.asarray(self.frames[-1, :, 0])

    @property
    def directions(self) -> FloatArray:
        """Unit vectors along the links, shape (n, d)."""
        return np.asarray(self.frames[:, :, 0])


@dataclass(frozen=True, eq=False)
class CurveUnknowns(ABC):
    """The map from p unknowns of a curve to configurations of an arm, of c coordinates, in any dimension.

    Attributes:
        arm: the arm.
        nominal_links: how many of them there are to the arm's length; nominal links are the unit of lengths in steps.
    """

    arm: Arm
    nominal_links: float = field(default=float(NOMINAL_LINKS), kw_only=True)

    @property
    def nominal_length(self) -> float:
        """u, length of a nominal link [m]."""
        return self.arm.length / self.nominal_links

    @property
    def nominal_per_link(self) -> float:
        """Nominal links to a link; the weight of a term that is summed over all links."""
        return self.nominal_links / self.arm.links

    # ------------------------------------------------------------ configurations
    @property
    @abstractmethod
    def dimension(self) -> int:
        """Number p of unknowns."""

    @property
    @abstractmethod
    def of_shape(self) -> BoolArray:
        """Which unknowns shape the arm; the others blend a goal in. Shape (p,)."""

    @abstractmethod
    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations of unknowns, shape (K, p) to (K, c) [rad, m]."""

    @abstractmethod
    def pose(self, v: FloatArray) -> Pose:
        """Return the pose of unknowns, shape (p,)."""

    def poses(self, unknowns: FloatArray) -> tuple[Pose, ...]:
        """Return the poses of several unknowns, shape (m, p)."""
        return tuple(self.pose(v) for v in unknowns)

    def pieces(self, before: FloatArray, after: FloatArray) -> list[FloatArray]:
        """Return the unknowns along an edge between which configurations change evenly, its ends among them."""
        return [before, after]

    def along(self, spline: BSpline) -> BSpline:
        """Return the path of configurations along a spline in the unknowns."""
        return BSpline(spline.t, self.configurations(spline.c), spline.k)

    def in_pieces(self, unknowns: FloatArray) -> FloatArray:
        """Return a motion with more keyframes where what lies between two is not linear, shape (K, p) to (m, p)."""
        return unknowns

    @property
    def affine(self) -> bool:
        """Whether configurations are affine in the unknowns."""
        return True

    @property
    @abstractmethod
    def drive_rows(self) -> FloatArray:
        """Derivatives of what the drives move by the unknowns, where it is affine in these, shape (c, p)."""

    def drives(self, q: FloatArray) -> FloatArray:
        """Return what the drives have to move in configurations, shape (..., c): these themselves."""
        return q

    # ------------------------------------------------------------ bends
    @property
    def bend_limits(self) -> FloatArray:
        """Bound on the absolute value of every bend, shape (b,) [rad]."""
        return self.arm.bend_limits

    def bends(self, q: FloatArray) -> FloatArray:
        """Return the joint bends of configurations, shape (..., c) to (..., b) [rad]."""
        return q[..., : len(self.arm.bend_limits)]

    def bend_slopes(self, pose: Pose) -> FloatArray:
        """Return the derivatives of the bends by the unknowns, shape (b, p)."""
        return pose.slopes[: len(self.arm.bend_limits)]

    # ------------------------------------------------------------ shape of the curve
    @property
    @abstractmethod
    def curvature_rows(self) -> FloatArray:
        """The curve's curvature at its knots by the unknowns, shape (m, p) [1/m]."""

    @property
    def curvature_differences(self) -> FloatArray:
        """Differences of it from knot to knot, shape (m - 1, p) or less [1/m]."""
        return np.diff(self.curvature_rows, axis=0)

    @cached_property
    def knot_bends(self) -> FloatArray:
        """Bends of a nominal link by the curvature at the knots, shape (m, p) [rad]; weights on them suit any arm."""
        return self.nominal_length * self.curvature_rows

    @cached_property
    def knot_bend_differences(self) -> FloatArray:
        """Differences of these from knot to knot, shape (m - 1, p) or less [rad]."""
        return self.nominal_length * self.curvature_differences

    @property
    def following_rows(self) -> FloatArray:
        """How the curve changes on which a fed arm lies still, shape (m, p) [1/m]; none where it is carried along."""
        return np.zeros((0, self.dimension))

    # ------------------------------------------------------------ metrics
    @property
    def heading_metric(self) -> FloatArray:
        """Squared turns of the links by the unknowns, shape (p, p); 0 where they depend on the pose."""
        return np.zeros((self.dimension, self.dimension))

    @abstractmethod
    def metric(self, pose: Pose) -> FloatArray:
        """Return the m, how much the unknowns turn and move the links, squared, shape (p, p)."""

    def spread(self, pose: Pose, rows: FloatArray) -> FloatArray:
        """M⁻¹ Rᵀ, in whose span the least changes of the links lie that change rows R, shape (k, p) to (p, k)."""
        return np.asarray(np.linalg.solve(self.metric(pose), rows.T))


def turn_rows(arm: Arm, pose: Pose) -> FloatArray:
    """Return the turns of the links [rad], and ways of the base [link lengths], by the unknowns, shape (r, p)."""
    base = pose.slopes[arm.coordinates.base] / arm.link_length
    return np.vstack((pose.turning.reshape(-1, len(pose.v)), base))


def least_change(space: CurveUnknowns, pose: Pose, rows: FloatArray, change: FloatArray) -> FloatArray:
    """Return the change of the unknowns that moves the links least and changes rows by given amounts, shape (p,).

    Args:
        space: the map of the unknowns.
        pose: where it is taken.
        rows: shape (k, p).
        change: of them, shape (k,).
    """
    # min ½ δᵀ M δ subject to S δ = c: δ = M⁻¹ Sᵀ (S M⁻¹ Sᵀ)⁻¹ c. Least squares, because rows may say the same twice.
    spread = space.spread(pose, rows)
    matrix = rows @ spread
    # Metres, radians and units of the user stand side by side: a unit diagonal lets one threshold decide the rank.
    scale = np.sqrt(np.maximum(np.diag(matrix), TINY**2))
    least = np.linalg.lstsq(matrix / np.outer(scale, scale), change / scale, rcond=_RANK)[0]
    return np.asarray(spread @ (least / scale))


@dataclass(frozen=True)
class Term:
    """One least-squares term of the step: ``Σ weight (rows δ − target)²``.

    Attributes:
        rows: shape (k, p).
        target: shape (k,).
        weight: shape (k,) or scalar.
    """

    rows: FloatArray
    target: FloatArray
    weight: FloatArray | float


def normal_equations(terms: Sequence[Term], ridge: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return the Hessian and gradient of a sum of least-squares terms.

    Args:
        terms: at least one, each with rows of shape (k, p).
        ridge: added to the diagonal, so that the Hessian is definite where no term reaches, shape (p,) or scalar.
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
