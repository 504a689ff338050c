"""Coordinates of curves in space: curvature about two axes, and the bends of the joints on them.

The curve has one curvature for each of the two directions across it, κ1 to the left and κ2 upwards, in the frame that
does not turn about the curve (Bishop, "There is more than one way to frame a curve", 1975). Both are natural cubic
splines over the same knots. A bend is the mean turn of the curve about its joint, so q is linear in v at any number of
links, and the plane is κ2 = 0. The offset q₀ keeps a start exact, whatever curve comes nearest to it.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Gauss points: three integrate a quintic exactly, and a cubic times a line is a quartic."""


def bend_matrix(links: int, length: float, knots: int) -> FloatArray:
    """Bends about one axis by the turn at the base and the curvature at evenly spread knots, shape (links, knots + 1).

    Between the knots the curvature is the natural cubic spline. The bend of a joint is ∫ κ(s) w(s) ds with the
    triangle w that is 1 at the joint and 0 at its neighbours: in the plane that is the difference of the curve's mean
    headings on both links. Headings do not add in space; bends do.

    Args:
        links: number of links.
        length: of the arm [m].
        knots: number of curvature values, at least 2.

    Returns:
        Columns: the turn at the base, then the curvature at each knot [rad/(1/m)].
    """
    matrix = _unit_bend_matrix(links, knots).copy()
    matrix[:, 1:] *= length  # curvature counts per metre: a curve of length L turns L times as far as one of length 1
    return matrix


@lru_cache(maxsize=32)
def _unit_bend_matrix(links: int, knots: int) -> FloatArray:
    """The same for a curve of length 1."""
    joints = np.arange(links + 1) / links
    # Between joints and knots the integrand is one polynomial; rounding merges a joint with a knot at the same place.
    edges = np.unique(np.round(np.concatenate((joints, np.linspace(0.0, 1.0, knots))), 14))
    half = 0.5 * np.diff(edges)
    s = (edges[:-1, None] + half[:, None] * (_NODES + 1.0)).ravel()
    turned = (half[:, None] * _WEIGHTS).ravel()[:, None] * natural_spline_basis(s, knots)
    link = np.minimum((s * links).astype(np.intp), links - 1)
    share = (s * links - link)[:, None]

    # A turn at a share t of a link counts (1 − t) at the joint before it and t at the joint behind; behind the last
    # link there is no joint.
    bends = np.zeros((links + 1, knots))
    np.add.at(bends, link, (1.0 - share) * turned)
    np.add.at(bends, link + 1, share * turned)
    matrix = np.zeros((links, knots + 1))
    matrix[0, 0] = 1.0
    matrix[:, 1:] = bends[:links]
    return matrix


def natural_spline_basis(s: FloatArray, knots: int) -> FloatArray:
    """Values at s of the natural cubic splines that are 1 at one of evenly spread knots and 0 at the others.

    Args:
        s: shape (m,), in [0, 1].
        knots: how many, the first at 0 and the last at 1.

    Returns:
        Shape (m, knots).
    """
    width = 1.0 / (knots - 1)
    values = np.eye(knots)
    moments = natural_spline_moments(knots)
    piece = np.clip((s / width).astype(np.intp), 0, knots - 2)
    right = (s / width - piece)[:, None]
    left = 1.0 - right
    straight = left * values[piece] + right * values[piece + 1]
    bent = (left**3 - left) * moments[piece] + (right**3 - right) * moments[piece + 1]
    return np.asarray(straight + width**2 / 6.0 * bent)


@lru_cache(maxsize=32)
def natural_spline_moments(knots: int) -> FloatArray:
    """Second derivatives at evenly spread knots in [0, 1] by the values there, shape (knots, knots)."""
    width = 1.0 / (knots - 1)
    moments = np.zeros((knots, knots))
    if knots == 2:
        return moments
    inner = knots - 2
    system = 4.0 * np.eye(inner) + np.eye(inner, k=1) + np.eye(inner, k=-1)
    differences = np.eye(inner, knots) - 2.0 * np.eye(inner, knots, k=1) + np.eye(inner, knots, k=2)
    moments[1:-1] = np.linalg.solve(system, 6.0 / width**2 * differences)
    return moments


class ChainState(NamedTuple):
    """An arm at coordinates v, of which there are p.

    Attributes:
        q: the configuration, shape (c,) [rad, m].
        positions: of the joints and the tip, shape (links + 1, 3) [m].
        rotations: of the links, shape (links, 3, 3).
        omega: Ω, by which the links turn with v, shape (links, 3, p) [rad].
        jacobian: dP, by which joints and tip move with v, shape (links + 1, 3, p) [m].
    """

    q: FloatArray
    positions: FloatArray
    rotations: FloatArray
    omega: FloatArray
    jacobian: FloatArray


KNOTS = 11
"""Curvature values of each of the two directions unless said otherwise."""
_RANK = 1e-9
"""Share of the largest singular value of B below which a combination of coordinates is taken to change nothing."""


@dataclass(frozen=True)
class CurveSpace:
    """An affine map from the coordinates of a curve to configurations of an arm.

    The coordinates v are, in this order: for κ1 the turn at the base and the values at the knots, the same for κ2, and
    the feed where there is one. Each is scaled so that its column of B has the norm 1.

    Attributes:
        arm: the arm whose bends they are.
        knots: number of curvature values of each direction; 0 where every bend is a coordinate.
        matrix: B, shape (c, p).
        offset: q₀, shape (c,) [rad, m].
        scales: what a unit of each coordinate is: of the turns [rad], the curvatures [1/m] and the feed [m], (p,).
    """

    arm: Arm
    knots: int
    matrix: FloatArray
    offset: FloatArray
    scales: FloatArray

    @classmethod
    def of(cls, arm: Arm, knots: int = KNOTS) -> "CurveSpace":
        """The space of an arm that holds the straight arm at v = 0."""
        turns = bend_matrix(arm.links, arm.length, knots)
        each = knots + 1
        fed = len(arm.base_axes)
        matrix = np.zeros((len(arm.coordinates), 2 * each + fed))
        matrix[0 : 2 * arm.links : 2, :each] = turns
        # A turn upwards, from x to z, is one about −y.
        matrix[1 : 2 * arm.links : 2, each : 2 * each] = -turns
        matrix[2 * arm.links :, 2 * each :] = np.eye(fed)
        norms = np.linalg.norm(matrix, axis=0)
        return cls(arm, knots, matrix / norms, np.zeros(len(arm.coordinates)), 1.0 / norms)

    @classmethod
    def through(cls, arm: Arm, q: FloatArray, knots: int = KNOTS) -> "CurveSpace":
        """The space that holds a configuration exactly, at ``nearest(q)``.

        Args:
            arm: the arm.
            q: the configuration, shape (c,) [rad, m].
            knots: curvature values of each direction.
        """
        plain = cls.of(arm, knots)
        return plain.moved(q - plain.configurations(plain.nearest(q)))

    @classmethod
    def of_every_bend(cls, arm: Arm) -> "CurveSpace":
        """The space of all configurations: every coordinate of the arm is one of its own, and there is no curve.

        No curve of few coordinates is straight up to a hole and bends behind it, wherever the hole is along the arm.
        """
        size = len(arm.coordinates)
        return cls(arm, 0, np.eye(size), np.zeros(size), np.ones(size))

    def moved(self, offset: FloatArray) -> "CurveSpace":
        """The same coordinates with another offset, shape (c,) [rad, m]."""
        return CurveSpace(self.arm, self.knots, self.matrix, offset, self.scales)

    @property
    def dimension(self) -> int:
        """Number of coordinates p."""
        return int(self.matrix.shape[1])

    def configurations(self, v: FloatArray) -> FloatArray:
        """Configurations of coordinates, shape (..., p) to (..., c) [rad, m]."""
        return v @ self.matrix.T + self.offset

    def nearest(self, q: FloatArray) -> FloatArray:
        """Coordinates of the configurations nearest to given ones, the shortest such, shape (..., c) to (..., p)."""
        return (q - self.offset) @ self.inverse.T

    @cached_property
    def inverse(self) -> FloatArray:
        """Pseudo-inverse of B, shape (p, c)."""
        return np.asarray(np.linalg.pinv(self.matrix, rcond=_RANK))

    @cached_property
    def curvature_rows(self) -> FloatArray:
        """Derivatives by v of the curvatures at the knots, of κ1 and then of κ2, shape (2 knots, p) [1/m].

        Where every bend is a coordinate they are bends over the length of a link.
        """
        if self.knots == 0:
            return self.matrix[: 2 * self.arm.links] / self.arm.link_length
        each = self.knots + 1
        rows = np.diag(self.scales)[: 2 * each]
        return np.delete(rows, [0, each], axis=0)

    def coordinates_like(self, other: "CurveSpace", v: FloatArray) -> FloatArray:
        """Coordinates here of the same curve that v is in another space with as many knots, such as of fewer links.

        Args:
            other: a space with the same number of knots, with a feed if this one has it.
            v: coordinates there, shape (..., p).
        """
        return np.asarray(v * other.scales / self.scales)


def chain_at(space: CurveSpace, v: FloatArray) -> ChainState:
    """Where the links of the arm are at coordinates of shape (p,), and how they move with them."""
    arm = space.arm
    n, p = arm.links, space.dimension
    q = space.configurations(v)
    state = ChainState(q, np.empty((n + 1, 3)), np.empty((n, 3, 3)), np.empty((n, 3, p)), np.empty((n + 1, 3, p)))
    NativeCall(
        "chain",
        links=n, unknowns=p, fed=len(arm.base_axes), length=arm.link_length, start=arm.base, base=arm.base_rotation,
        q=q, slopes=space.matrix, points=state.positions, rotations=state.rotations, turning=state.omega,
        moving=state.jacobian,
    )()  # fmt: skip
    return state
