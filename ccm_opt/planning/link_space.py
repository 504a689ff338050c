"""Affine map q = B v + q₀ from the coordinates v of a curve, in which planar motions are planned, to configurations q.

The curve has ``SEGMENTS`` equal segments that share curvature values at their ends, so v = [θ(0), C_0, …, C_20]: 22
numbers for any number of links. θ(s) is linear in v; with A_j the mean over link j of ∂θ/∂v, A v is the mean heading of
the curve on each link, and the bend of joint j is (A_j − A_{j−1}) v: the rows of B. The offset q₀ = q_start − B v_start
reproduces the start exactly, however the start was computed. The curve does not reproduce a goal for the whole
arm exactly either; one more coordinate w, from 0 at the start to 1 at the goal, blends in what is missing.

A curve of few coordinates cannot be straight up to the end of a guide tube and bend beyond, wherever that end is along
the arm; so for an arm on a feed axis every bend is a coordinate of its own, v = [bends, feed in link lengths]. The
guide tube is a limit, as walls are (``limits.guide_tube``).
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
"""Weight on curvature differences in the fit of a curve, so that the smoothest of equally good curves is chosen."""
_METRIC_SHARE = 1e-6
"""Fraction of the diagonal of the metric that is added to it, so that it is positive definite."""
_METRIC_RIDGE = 1e-9
"""Multiple of the identity that is added to the metric."""


@dataclass(frozen=True, eq=False)
class LinkSpace(CurveUnknowns):
    """Affine map q = B v + q₀ from p coordinates v of a planar curve to configurations q of an arm.

    Attributes:
        slopes: matrix B, shape (c, p).
        offset: offset q₀, shape (c,) [rad, m].
        clamped: whether the first link keeps its heading; the heading of the curve at its base then has no effect.
    """

    slopes: FloatArray
    offset: FloatArray
    clamped: bool = False

    @classmethod
    def through(
        cls, arm: Arm, q: FloatArray, nominal_links: float = NOMINAL_LINKS, *, clamped: bool = False
    ) -> tuple["LinkSpace", FloatArray]:
        """Return a map whose offset makes a start configuration exact, and the coordinates of that configuration.

        Args:
            arm: the arm.
            q: configuration of the start, shape (c,) [rad].
            nominal_links: number of nominal links in the arm's length.
            clamped: whether the first link keeps its heading in all configurations.

        Returns:
            The map, and the coordinates of the start, shape (p,).
        """
        headings = mean_heading_matrix(arm)
        # The bend of the first joint is its link's heading: for a clamped one θ(0) has no effect, and the fit leaves it
        # at 0.
        slopes = np.diff(headings, axis=0, prepend=headings[:1] if clamped else 0.0)
        slopes[arm.locked_joints] = 0.0
        space = cls(arm, slopes, q, clamped, nominal_links=nominal_links)
        start = space.fitted(q)
        return replace(space, offset=q - slopes @ start), start

    def fitted(self, q: FloatArray) -> FloatArray:
        """Return the coordinates (..., p) of the curves with mean headings nearest to the link headings of q (..., c).

        For few links many curves have the same mean headings; the smoothest of these is taken. The offset q₀ is not
        subtracted from q.
        """
        arm = self.arm
        headings = arm.poses(q) - (self.offset[0] + arm.base_heading if self.clamped else 0.0)
        return np.asarray(fit_coordinates(self.turns, headings.T, arm.length).T)

    def nearest(self, q: FloatArray) -> FloatArray:
        """Return the coordinates (..., p) whose configurations, with the offset, are nearest to given ones (..., c).

        The coordinate w that blends into a goal of the whole arm, if there is one, is kept at 0.
        """
        headings = self.arm.poses(q) - self.arm.poses(self.offset)
        return np.asarray(fit_coordinates(self.turns, headings.T, self.arm.length).T)

    def closest(self, q: FloatArray) -> FloatArray:
        """Return the coordinates (K, p) whose link headings are nearest to those of given configurations (K, c).

        The result is a least-squares fit of the link headings, in which all coordinates are free, including the one
        that blends into a goal of the whole arm.
        """
        headings = self.arm.poses(q) - self.arm.poses(self.offset)
        return np.asarray(np.linalg.lstsq(self.turns, headings.T, rcond=None)[0].T)

    def blended_to(self, q: FloatArray) -> tuple["LinkSpace", FloatArray]:
        """Return the map extended by a coordinate w with which a goal configuration is reproduced exactly at w = 1.

        Args:
            q: goal configuration, shape (c,) [rad, m].

        Returns:
            The extended map, and the coordinates of the goal configuration, shape (p + 1,).
        """
        goal = self.fitted(q)
        # The part of the goal that the curve cannot reproduce; w from 0 to 1 trades the offset of the start for it.
        column = q - self.slopes @ goal - self.offset
        return replace(self, slopes=np.column_stack((self.slopes, column))), np.append(goal, 1.0)

    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations, shape (..., c) [rad, m], for coordinates of shape (..., p)."""
        return v @ self.slopes.T + self.offset

    @cached_property
    def turns(self) -> FloatArray:
        """Derivatives with respect to the coordinates of link headings and base travel in link lengths, (c, p)."""
        links = self.arm.links
        return np.vstack((np.cumsum(self.slopes[:links], axis=0), self.slopes[links:] / self.arm.link_length))

    def pose(self, v: FloatArray) -> Pose:
        """Return the pose, with its derivatives, for coordinates of shape (p,)."""
        return self.poses(v[None])[0]

    def poses(self, unknowns: FloatArray) -> tuple[Pose, ...]:
        """Return the poses, with their derivatives, for m vectors of coordinates, shape (m, p)."""
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
        """Derivatives of link headings with respect to the coordinates, (links, 1, p), about one rotation axis."""
        return self.turns[: self.arm.links, None]

    def jacobians(self, headings: FloatArray) -> FloatArray:
        """Return the derivatives of joint and tip positions with respect to the coordinates [m per unit].

        Args:
            headings: headings of the links, shape (..., links) [rad].

        Returns:
            Shape (..., links + 1, 2, p).
        """
        l = self.arm.lengths
        links = self.arm.links
        turns = self.turns[:links]
        jacobians = np.zeros((*headings.shape[:-1], links + 1, 2, self.dimension))
        # P_j = base + Σ_{i<j} l_i (cos φ_i, sin φ_i) and ∂φ/∂v = A, so ∂P_j/∂v = Σ_{i<j} l_i (−sin φ_i, cos φ_i) A_i.
        np.cumsum((-l * np.sin(headings))[..., None] * turns, axis=-2, out=jacobians[..., 1:, 0, :])
        np.cumsum((l * np.cos(headings))[..., None] * turns, axis=-2, out=jacobians[..., 1:, 1, :])
        if len(self.slopes) > links:
            # The feed moves all joints alike.
            jacobians += np.multiply.outer(self.arm.direction, self.slopes[links:].sum(axis=0))
        return jacobians

    @property
    def dimension(self) -> int:
        """Number p of coordinates of the curve."""
        return int(self.slopes.shape[1])

    @property
    def bend_rows(self) -> FloatArray:
        """Derivatives of the joint bends with respect to the coordinates, shape (links, p)."""
        return self.slopes[: self.arm.links]

    @property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the drive positions with respect to the coordinates, shape (c, p)."""
        return self.slopes

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivatives of the curvature at the knots with respect to the coordinates, shape (KNOTS, p) [1/m]."""
        rows = np.zeros((KNOTS, self.dimension))
        rows[:, 1 : KNOTS + 1] = np.eye(KNOTS)
        return rows

    @property
    def heading_metric(self) -> FloatArray:
        """Matrix M, shape (p, p), with δᵀ M δ = sum of squared link turns for a change δ of the coordinates."""
        return self.turns.T @ self.turns

    @cached_property
    def of_shape(self) -> BoolArray:
        """Mask of the coordinates that shape the curve, shape (p,); any other blends into a goal for the whole arm."""
        return np.arange(self.dimension) <= KNOTS

    def metric(self, pose: Pose) -> FloatArray:
        """Return the slightly regularised metric of squared link turns, the same for all poses, shape (p, p)."""
        del pose
        return self._metric

    @cached_property
    def _metric(self) -> FloatArray:
        metric = self.heading_metric
        metric += _METRIC_SHARE * np.diag(np.diag(metric)) + _METRIC_RIDGE * np.eye(len(metric))
        return metric

    @cached_property
    def inverse_metric(self) -> FloatArray:
        """Inverse of the regularised metric of squared link turns, shape (p, p)."""
        return np.asarray(np.linalg.inv(self._metric), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class FedSpace(LinkSpace):
    """Map from bends and base travel in link lengths to configurations, for a planar arm on a feed axis.

    Attributes:
        turn_per_link: turn of a joint that counts as much as a link length of base travel [rad]: the turn that a joint
            makes in the time that the base needs for a link length.
    """

    turn_per_link: float = 1.0

    @classmethod
    def of_arm(cls, arm: Arm, turn_per_link: float = 1.0) -> "FedSpace":
        """Return the map for an arm with axes that carry its base."""
        slopes = np.diag(np.concatenate((np.ones(arm.links), np.full(len(arm.base_axes), arm.link_length))))
        return cls(arm, slopes, np.zeros(len(slopes)), turn_per_link=turn_per_link)

    def fitted(self, q: FloatArray) -> FloatArray:
        """Return the exact coordinates of configurations, both of shape (..., c)."""
        return q / np.diag(self.slopes)

    def drives(self, q: FloatArray) -> FloatArray:
        """Return bends, and base travel converted to a turn of equal duration, for configurations (..., c) [rad]."""
        return self.fitted(q) * self._weights

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the values of ``drives`` with respect to the coordinates, shape (c, p)."""
        return np.diag(self._weights)

    @cached_property
    def _weights(self) -> FloatArray:
        axes = self.dimension - self.arm.links
        return np.concatenate((np.ones(self.arm.links), np.full(axes, self.turn_per_link)))

    def blended_to(self, q: FloatArray) -> tuple[LinkSpace, FloatArray]:
        """Return the map itself, which reproduces any configuration, and the coordinates (p,) of ``q``."""
        return self, self.fitted(q)

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivatives of bend over link length at every joint with respect to the coordinates, (links, p) [1/m]."""
        return self.bend_rows / self.arm.lengths[:, None]

    @cached_property
    def of_shape(self) -> BoolArray:
        """Mask of the coordinates that shape the arm, shape (p,): all, since none blends into a goal."""
        return np.ones(self.dimension, dtype=bool)

    def spread(self, pose: Pose, rows: FloatArray) -> FloatArray:
        """Return M⁻¹ Rᵀ, shape (p, k), for derivatives R of k quantities, shape (k, p), at a pose.

        M is the metric of squared link turns. Entries of the base and of joints in the tube are 0; these do not move.
        """
        free = np.zeros(self.dimension, dtype=bool)
        free[: self.arm.links] = ~self.arm.held(float(self.arm.coordinates.advance(pose.q)))
        spread = np.zeros((self.dimension, len(rows)))
        spread[free] = np.linalg.solve(self._metric[np.ix_(free, free)], rows[:, free].T)
        return spread


def fit_coordinates(matrix: FloatArray, headings: FloatArray, length: float) -> FloatArray:
    """Return the coordinates of the curve whose mean headings are nearest to given link headings in least squares.

    A small weight on curvature differences selects the smoothest of equally good curves.

    Args:
        matrix: derivatives of the mean headings with respect to the coordinates, shape (links, p).
        headings: link headings, shape (links,), or (links, k) for k poses [rad].
        length: length of the arm [m].

    Returns:
        Coordinates, shape (p,), or (p, k).
    """
    p = matrix.shape[1]
    # For few links many curves have equal mean headings; the smoothest is taken. Coordinates that blend into a goal are
    # held at 0.
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
    """Return the heading along a curve of length 1, relative to its start, per unit of the curvature at each knot."""
    width = 1.0 / (4 * SEGMENTS)
    # By falling powers, pieces and knots. Neighbouring segments share a knot: five knots and four pieces per segment.
    of_segment = piece_coefficients(np.full(4, width), np.eye(5)).transpose(1, 0, 2)[::-1]
    coefficients = np.zeros((4, 4 * SEGMENTS, KNOTS))
    for k in range(0, 4 * SEGMENTS, 4):
        coefficients[:, k : k + 4, k : k + 5] = of_segment
    return PPoly(coefficients, np.linspace(0.0, 1.0, 4 * SEGMENTS + 1)).antiderivative()


@lru_cache(maxsize=32)
def _unit_matrix(links: int) -> FloatArray:
    """Return each link's mean heading for a unit of each coordinate, for an arm of length 1, (links, KNOTS + 1)."""
    primitive = _turned().antiderivative()(np.arange(links + 1) / links)
    return np.column_stack((np.ones(links), links * np.diff(primitive, axis=0)))


def mean_heading_matrix(arm: Arm) -> FloatArray:
    """Return the matrix from curve coordinates to the mean headings of an arm's links, shape (links, KNOTS + 1).

    Coordinates are the heading at the base and the curvatures at the knots of a curve as long as the arm.
    """
    if arm.proportions is None:
        matrix = _unit_matrix(arm.links).copy()
    else:
        places = arm.place_shares / arm.place_shares[-1]
        primitive = _turned().antiderivative()(places)
        leads_on = arm.arc_shares > 0.0
        means = np.diff(primitive, axis=0)[leads_on] / np.diff(places)[leads_on, None]
        # What is fixed to a link beside the arm has its heading.
        matrix = np.column_stack((np.ones(arm.links), means[np.cumsum(leads_on) - 1]))
    # Curvature is per metre: on a curve of length L it turns the curve L times as far as on one of length 1.
    matrix[:, 1:] *= arm.length
    return matrix


def nearest_curves(arm: Arm, q: FloatArray) -> tuple[Configuration, ...]:
    """Return the continuous curves whose mean headings on the links are nearest to the link headings of configurations.

    Args:
        arm: planar arm.
        q: configurations, shape (k, c) [rad].
    """
    coordinates = fit_coordinates(mean_heading_matrix(arm), arm.headings(q).T, arm.length).T
    length = arm.length / SEGMENTS
    begin = coordinates[:, :1] + arm.length * coordinates[:, 1:] @ _turned()(np.arange(SEGMENTS) / SEGMENTS).T
    curvatures = [coordinates[:, 1 + 4 * k : 6 + 4 * k] for k in range(SEGMENTS)]
    return tuple(
        Configuration(
            arm.base, tuple(CurvatureSegment(length, float(begin[i, k]), curvatures[k][i]) for k in range(SEGMENTS))
        )
        for i in range(len(coordinates))
    )
