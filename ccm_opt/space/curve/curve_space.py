"""Configurations in the coordinates of a curve: q = B v + q₀, the space in which motions of long arms are planned.

The curve has one curvature for each of the two directions across it, κ1 to the left and κ2 upwards, in the frame that
does not turn about the curve (Bishop, "There is more than one way to frame a curve", 1975). Both are natural cubic
splines over the same knots. A bend is the mean turn of the curve about its joint, so q is linear in v at any number of
links, and the plane is κ2 = 0. The offset q₀ keeps a start exact, whatever curve comes nearest to it.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.curve.bend_matrix import bend_matrix
from ccm_opt.space.curve.chain_state import ChainEvaluator, ChainState

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

    arm: SpaceArm
    knots: int
    matrix: FloatArray
    offset: FloatArray
    scales: FloatArray

    @classmethod
    def of(cls, arm: SpaceArm, knots: int = KNOTS) -> "CurveSpace":
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
    def through(cls, arm: SpaceArm, q: FloatArray, knots: int = KNOTS) -> "CurveSpace":
        """The space that holds a configuration exactly, at ``nearest(q)``.

        Args:
            arm: the arm.
            q: the configuration, shape (c,) [rad, m].
            knots: curvature values of each direction.
        """
        plain = cls.of(arm, knots)
        return plain.moved(q - plain.configurations(plain.nearest(q)))

    @classmethod
    def of_every_bend(cls, arm: SpaceArm) -> "CurveSpace":
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

    @cached_property
    def chain(self) -> ChainEvaluator:
        """What evaluates the arm; not for use by two threads at once."""
        return ChainEvaluator(self.arm, self.matrix, self.offset)

    def coordinates_like(self, other: "CurveSpace", v: FloatArray) -> FloatArray:
        """Coordinates here of the same curve that v is in another space with as many knots, such as of fewer links.

        Args:
            other: a space with the same number of knots, with a feed if this one has it.
            v: coordinates there, shape (..., p).
        """
        return np.asarray(v * other.scales / self.scales)

    def __getstate__(self) -> dict[str, object]:
        """The fields alone: what else is kept may hold compiled code."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def chain_at(space: CurveSpace, v: FloatArray) -> ChainState:
    """Where the links of the arm are at coordinates of shape (p,), and how they move with them."""
    return space.chain.at(v)
