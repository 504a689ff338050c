"""The space in which motions in the plane are planned: configurations q = B v + q₀ by coordinates v of the curve.

The curve has ``SEGMENTS`` equal segments that share curvature values at their ends, so v = [θ(0), C_0, …, C_20]: 22
numbers at any number of links. θ(s) is linear in v; with A_j the mean over link j of ∂θ/∂v, A v is the mean heading of
the curve on each link, and the bend of joint j is (A_j − A_{j−1}) v: the rows of B. The offset q₀ = q_start − B v_start
reproduces the start exactly, however the start was computed. A whole-arm goal adds one more coordinate, which adds the
goal's offset gradually.

A curve of few coordinates cannot be straight up to a hole and bend behind it, wherever the hole is along the arm; so
for an arm on a feed axis every bend is a coordinate of its own, v = [bends, feed in link lengths]. The guide tube is a
limit, as walls are (``limits.guide_tube``).
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import PPoly

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.robot.segment import CurvatureSegment, piece_coefficients

SEGMENTS = 5
KNOTS = 4 * SEGMENTS + 1
_FIT_WEIGHT = 1e-6
"""Weight on curvature differences, which break ties of the fit."""
_METRIC_SHARE = 1e-6
"""Share of its diagonal that is added to the metric to make it definite."""
_METRIC_RIDGE = 1e-9
"""Multiple of the identity that is added to the metric."""


@dataclass(frozen=True, eq=False)
class LinkSpace(CurveUnknowns):
    """An affine map from curve coordinates to configurations.

    Attributes:
        slopes: B, shape (c, p).
        offset: q₀, shape (c,) [rad, m].
        clamped: whether the first link keeps its heading; θ(0) then follows from the curvature.
    """

    slopes: FloatArray
    offset: FloatArray
    clamped: bool = False

    @classmethod
    def through(
        cls, arm: Arm, q: FloatArray, nominal_links: float = NOMINAL_LINKS, *, clamped: bool = False
    ) -> tuple["LinkSpace", FloatArray]:
        """Return the space that reproduces a configuration exactly, and the coordinates of that configuration.

        Args:
            arm: the arm.
            q: configuration of the start, shape (c,) [rad].
            nominal_links: number of nominal links in the arm's length.
            clamped: whether the first link keeps its heading in all of the space.

        Returns:
            The space and v_start, shape (p,).
        """
        headings = mean_heading_matrix(arm.links, arm.length)
        # The bend of the first joint is its link's heading: for a clamped one θ(0) has no effect, and the fit leaves it
        # at 0.
        slopes = np.diff(headings, axis=0, prepend=headings[:1] if clamped else 0.0)
        space = cls(arm, slopes, q, clamped, nominal_links=nominal_links)
        start = space.fitted(q)
        return replace(space, offset=q - slopes @ start), start

    def fitted(self, q: FloatArray) -> FloatArray:
        """Return the coordinates of the curve whose mean headings come nearest to the headings of the links.

        Shape (..., c) to (..., p). Few links leave many curves with the same mean headings; the smoothest of them is
        taken.
        """
        arm = self.arm
        headings = arm.poses(q) - (self.offset[0] + arm.base_heading if self.clamped else 0.0)
        return np.asarray(fit_coordinates(self.turns, headings.T, arm.length).T)

    def nearest(self, q: FloatArray) -> FloatArray:
        """Return the coordinates whose configuration comes nearest to a given one, shape (..., c) to (..., p).

        The offset is taken into account; a coordinate that blends a goal in stays 0.
        """
        headings = self.arm.poses(q) - self.arm.poses(self.offset)
        return np.asarray(fit_coordinates(self.turns, headings.T, self.arm.length).T)

    def closest(self, q: FloatArray) -> FloatArray:
        """Return the coordinates whose links are turned least from given configurations, shape (K, c) to (K, p).

        The result is a least-squares fit over the links, in which coordinates that blend a goal in are free too.
        """
        headings = self.arm.poses(q) - self.arm.poses(self.offset)
        return np.asarray(np.linalg.lstsq(self.turns, headings.T, rcond=None)[0].T)

    def blended_to(self, q: FloatArray) -> tuple["LinkSpace", FloatArray]:
        """Return the space with one more coordinate w, which at w = 1 reproduces another configuration exactly.

        Args:
            q: the other configuration, shape (c,) [rad, m].

        Returns:
            The larger space and the coordinates of ``q`` in it, shape (p + 1,).
        """
        goal = self.fitted(q)
        # The part of the goal that the curve cannot reproduce; w from 0 to 1 trades the offset of the start for it.
        column = q - self.slopes @ goal - self.offset
        return replace(self, slopes=np.column_stack((self.slopes, column))), np.append(goal, 1.0)

    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations of coordinates, shape (..., p) to (..., c) [rad, m]."""
        return v @ self.slopes.T + self.offset

    @cached_property
    def turns(self) -> FloatArray:
        """Derivatives of link headings, and of the base's travel in link lengths, with respect to v, shape (c, p)."""
        links = self.arm.links
        return np.vstack((np.cumsum(self.slopes[:links], axis=0), self.slopes[links:] / self.arm.link_length))

    def pose(self, v: FloatArray) -> Pose:
        """Return the pose at coordinates v, shape (p,)."""
        return self.poses(v[None])[0]

    def poses(self, unknowns: FloatArray) -> tuple[Pose, ...]:
        """Return the poses of several vectors of coordinates, shape (m, p)."""
        q = self.configurations(unknowns)
        headings = self.arm.headings(q)
        cos = np.cos(headings)
        sin = np.sin(headings)
        frames = np.stack((cos, -sin, sin, cos), axis=-1).reshape(*headings.shape, 2, 2)
        made = (unknowns, q, self.arm.joint_positions_at(q), self.jacobians(headings), frames)
        return tuple(
            Pose(v, at, self.slopes, points, moving, self._turning, turned)
            for v, at, points, moving, turned in zip(*made, strict=True)
        )

    @cached_property
    def _turning(self) -> FloatArray:
        """Derivatives of the link headings (about the plane's one axis) with respect to v, shape (links, 1, p)."""
        return self.turns[: self.arm.links, None]

    def jacobians(self, headings: FloatArray) -> FloatArray:
        """Return the derivatives of joint and tip positions with respect to v [m per unit].

        Args:
            headings: headings of the links, shape (..., links) [rad].

        Returns:
            Shape (..., links + 1, 2, p).
        """
        l = self.arm.link_length
        links = self.arm.links
        turns = self.turns[:links]
        jacobians = np.zeros((*headings.shape[:-1], links + 1, 2, self.dimension))
        # P_j = base + l Σ_{i<j} (cos φ_i, sin φ_i) and ∂φ/∂v = A, so ∂P_j/∂v = l Σ_{i<j} (−sin φ_i, cos φ_i) A_i.
        np.cumsum((-l * np.sin(headings))[..., None] * turns, axis=-2, out=jacobians[..., 1:, 0, :])
        np.cumsum((l * np.cos(headings))[..., None] * turns, axis=-2, out=jacobians[..., 1:, 1, :])
        if len(self.slopes) > links:
            # The feed moves all joints alike.
            jacobians += np.multiply.outer(self.arm.direction, self.slopes[links:].sum(axis=0))
        return jacobians

    @property
    def dimension(self) -> int:
        """Number of coordinates p."""
        return int(self.slopes.shape[1])

    @property
    def bend_rows(self) -> FloatArray:
        """Derivatives of the joint bends with respect to v, shape (links, p)."""
        return self.slopes[: self.arm.links]

    @property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the drives' positions with respect to v, shape (c, p)."""
        return self.slopes

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivatives of the curve's curvature at its knots with respect to v, shape (KNOTS, p) [1/m]."""
        rows = np.zeros((KNOTS, self.dimension))
        rows[:, 1 : KNOTS + 1] = np.eye(KNOTS)
        return rows

    @property
    def heading_metric(self) -> FloatArray:
        """Metric of the squared turns of the links in terms of v, shape (p, p)."""
        return self.turns.T @ self.turns

    @cached_property
    def of_shape(self) -> BoolArray:
        """Mask of the coordinates that shape the arm, shape (p,); the others blend a goal in."""
        return np.arange(self.dimension) <= KNOTS

    def metric(self, pose: Pose) -> FloatArray:
        """Return the metric of the links' squared turns, slightly regularised and equal for all poses, shape (p, p)."""
        del pose
        return self._metric

    @cached_property
    def _metric(self) -> FloatArray:
        metric = self.heading_metric
        metric += _METRIC_SHARE * np.diag(np.diag(metric)) + _METRIC_RIDGE * np.eye(len(metric))
        return metric

    @cached_property
    def inverse_metric(self) -> FloatArray:
        """Inverse of the metric, shape (p, p)."""
        return np.asarray(np.linalg.inv(self._metric), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class FedSpace(LinkSpace):
    """The space of all configurations of an arm, by its bends and the base's travel in link lengths.

    Attributes:
        turn_per_link: turn of a joint that counts as much as a link length of the base's travel [rad]: the turn that a
            joint makes in the time that the base needs for it.
    """

    turn_per_link: float = 1.0

    @classmethod
    def of_arm(cls, arm: Arm, turn_per_link: float = 1.0) -> "FedSpace":
        """Return the space of an arm with axes that carry its base."""
        slopes = np.diag(np.concatenate((np.ones(arm.links), np.full(len(arm.base_axes), arm.link_length))))
        return cls(arm, slopes, np.zeros(len(slopes)), turn_per_link=turn_per_link)

    def fitted(self, q: FloatArray) -> FloatArray:
        """Return the coordinates of configurations, all of which the space reproduces exactly, shape (..., c)."""
        return q / np.diag(self.slopes)

    def drives(self, q: FloatArray) -> FloatArray:
        """Return the joint bends, and the base's travel converted to a turn of equal duration, shape (..., c) [rad]."""
        return self.fitted(q) * self._weights

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the drives' positions, in the unit of ``drives``, with respect to v, shape (c, p)."""
        return np.diag(self._weights)

    @cached_property
    def _weights(self) -> FloatArray:
        axes = self.dimension - self.arm.links
        return np.concatenate((np.ones(self.arm.links), np.full(axes, self.turn_per_link)))

    def blended_to(self, q: FloatArray) -> tuple[LinkSpace, FloatArray]:
        """Return the space itself, which reproduces any configuration, and the coordinates of ``q``, shape (p,)."""
        return self, self.fitted(q)

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivatives of every joint's curvature (bend over link length) with respect to v, shape (links, p) [1/m]."""
        return self.bend_rows / self.arm.link_length

    @cached_property
    def of_shape(self) -> BoolArray:
        """Mask of the coordinates that shape the arm, shape (p,); all are set, since none blends a goal in."""
        return np.ones(self.dimension, dtype=bool)

    def spread(self, pose: Pose, rows: FloatArray) -> FloatArray:
        """Return M⁻¹ Rᵀ for rows R, shape (p, k), with entries 0 for the base and the joints in the guide tube.

        The base and these joints do not move.
        """
        free = np.zeros(self.dimension, dtype=bool)
        free[: self.arm.links] = ~self.arm.held(float(self.arm.coordinates.advance(pose.q)))
        spread = np.zeros((self.dimension, len(rows)))
        spread[free] = np.linalg.solve(self._metric[np.ix_(free, free)], rows[:, free].T)
        return spread


def fit_coordinates(matrix: FloatArray, headings: FloatArray, length: float) -> FloatArray:
    """Return the coordinates whose mean headings come nearest to given ones; curvature differences break ties.

    Args:
        matrix: A, shape (links, p).
        headings: headings, shape (links,), or (links, k) for k poses [rad].
        length: length of the arm [m].

    Returns:
        Shape (p,), or (p, k).
    """
    p = matrix.shape[1]
    # Few links leave many curves with the same mean headings; the smoothest of them is taken. Coordinates that blend a
    # goal in are held at 0.
    scale = length / KNOTS
    roughness = np.zeros((KNOTS - 1, p))
    roughness[:, 1 : KNOTS + 1] = scale * (np.eye(KNOTS)[1:] - np.eye(KNOTS)[:-1])
    pinned = np.zeros((max(0, p - KNOTS - 1), p))
    pinned[:, KNOTS + 1 :] = np.eye(p - KNOTS - 1)

    weight = np.sqrt(_FIT_WEIGHT)
    system = np.vstack((matrix, weight * roughness, pinned))
    target = np.concatenate((headings, np.zeros((len(system) - len(headings), *headings.shape[1:]))))
    coordinates: FloatArray = np.linalg.lstsq(system, target, rcond=None)[0]
    return coordinates


@lru_cache(maxsize=1)
def _turned() -> PPoly:
    """Return the heading along a curve of length 1, relative to its start, per unit of each of the KNOTS values."""
    width = 1.0 / (4 * SEGMENTS)
    # By falling powers, pieces and knots. Neighbouring segments share a knot: five knots and four pieces per segment.
    of_segment = piece_coefficients(np.full(4, width), np.eye(5)).transpose(1, 0, 2)[::-1]
    coefficients = np.zeros((4, 4 * SEGMENTS, KNOTS))
    for k in range(0, 4 * SEGMENTS, 4):
        coefficients[:, k : k + 4, k : k + 5] = of_segment
    return PPoly(coefficients, np.linspace(0.0, 1.0, 4 * SEGMENTS + 1)).antiderivative()


@lru_cache(maxsize=32)
def _unit_matrix(links: int) -> FloatArray:
    """Return the mean-heading matrix for a curve of length 1, shape (links, KNOTS + 1)."""
    primitive = _turned().antiderivative()(np.arange(links + 1) / links)
    return np.column_stack((np.ones(links), links * np.diff(primitive, axis=0)))


def mean_heading_matrix(links: int, length: float) -> FloatArray:
    """Return the matrix A whose row j is the mean over link j of ∂θ/∂v, shape (links, KNOTS + 1)."""
    matrix = _unit_matrix(links).copy()
    # Curvature is per metre: on a curve of length L it turns the curve L times as far as on one of length 1.
    matrix[:, 1:] *= length
    return matrix


def nearest_curves(arm: Arm, q: FloatArray) -> tuple[Configuration, ...]:
    """Return the continuous curves whose mean headings on the links come nearest to those of configurations.

    Args:
        arm: the arm.
        q: configurations, shape (k, c).
    """
    coordinates = fit_coordinates(mean_heading_matrix(arm.links, arm.length), arm.headings(q).T, arm.length).T
    length = arm.length / SEGMENTS
    begin = coordinates[:, :1] + arm.length * coordinates[:, 1:] @ _turned()(np.arange(SEGMENTS) / SEGMENTS).T
    curvatures = [coordinates[:, 1 + 4 * k : 6 + 4 * k] for k in range(SEGMENTS)]
    return tuple(
        Configuration(
            arm.base, tuple(CurvatureSegment(length, float(begin[i, k]), curvatures[k][i]) for k in range(SEGMENTS))
        )
        for i in range(len(coordinates))
    )
