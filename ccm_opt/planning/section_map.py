"""The map from the bends of sections, which bend evenly, to configurations: the unknowns of an arm of such sections.

Unknowns v: first the bends of all sections about z, then those about y, then the positions of the axes that carry the
base, scaled so that a unit of each has about the same effect on the bends of the joints. Every configuration of the arm
is in the range of the map, so that nothing is offset or blended.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.curve_map import KNOTS, CurveMap
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm


@dataclass(frozen=True, eq=False)
class SectionMap(CurveMap):
    """The map from unknowns v, shape (2 s + k,), of an arm of s sections on k axes to its configurations q, shape (c,).

    The sections stand for the knots of a curve.

    Attributes:
        sections: the sections of the arm.
    """

    sections: ArcSections = field(kw_only=True)

    @classmethod
    def of_sections(cls, arm: Arm, sections: ArcSections, q: FloatArray) -> tuple["SectionMap", FloatArray]:
        """Return the map of an arm, and the unknowns of a configuration, shape (c,), in it, shape (2 s + k,)."""
        count = len(sections.counts)
        nothing = (np.zeros((2, 2)), np.array([0.0, arm.length]))
        plain = cls(arm, arm.length / count, count, np.zeros(0), *nothing, sections=sections)
        space = replace(plain, scale=np.concatenate((np.tile(np.sqrt(sections.counts), 2), plain.axis_scale)))
        return space, space.fitted(q)

    @property
    def affine(self) -> bool:
        """Whether configurations are affine functions of the unknowns: always."""
        return True

    def fitted(self, q: FloatArray, smoothness: float = 0.0) -> FloatArray:
        """Return the unknowns, shape (2 s + k,), of a configuration, shape (c,).

        Args:
            q: configuration [rad, m].
            smoothness: without effect.
        """
        del smoothness
        return np.asarray(self._inverse @ q)

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.slopes(np.zeros(self.dimension))))

    def blended_to(self, q: FloatArray) -> tuple["SectionMap", FloatArray]:
        """Return the same map, and the unknowns of another configuration, shape (c,), in it, shape (2 s + k,)."""
        return self, self.fitted(q)

    def drawn(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return the unknowns of random bends and axis positions within their limits, shape (count, 2 s + k)."""
        bends = 2 * self.knots
        spread = rng.uniform(0.2, 1.0, (count, 1))
        shares = np.clip(spread * rng.normal(size=(count, bends)), -1.0, 1.0)
        bent = _MOST_DRAWN * shares * (np.tile(self.sections.limits, 2) / self.scale[:bends])
        travel = np.abs(bent @ (self.sections.travel_rows @ self._bend_rows[:, :bends]).T)
        bent = bent / np.maximum(np.max(travel, axis=1, initial=0.0) / _MOST_DRAWN, 1.0)[:, None]
        return np.hstack((bent, self.drawn_axes(rng, count)))

    # ------------------------------------------------------------ bends, and travels of tendons in units of them
    @property
    def bend_limits(self) -> FloatArray:
        """Upper bound on every joint bend and, last, on the travel of every tendon that has a limit, shape (b,) [rad].

        A travel counts as the bend of a joint that has the same fraction of its limit.
        """
        travels = np.full(len(self.sections.travel_rows), self._travel_bend)
        return np.concatenate((self.arm.bend_limits, travels))

    def bends(self, q: FloatArray) -> FloatArray:
        """Return the joint bends and travels, shape (..., b) [rad], of configurations, shape (..., c)."""
        own = q[..., : 2 * self.arm.links]
        return np.concatenate((own, self._travel_bend * own @ self.sections.travel_rows.T), axis=-1)

    def bend_slopes(self, pose: Pose) -> FloatArray:
        """Return the derivatives of bends and travels with respect to the unknowns at a pose, shape (b, p)."""
        own = pose.slopes[: 2 * self.arm.links]
        return np.concatenate((own, self._travel_bend * self.sections.travel_rows @ own))

    @property
    def _travel_bend(self) -> float:
        return float(np.max(self.arm.bend_limits))

    @cached_property
    def _bend_rows(self) -> FloatArray:
        return np.asarray(self.slopes(np.zeros(self.dimension))[: 2 * self.arm.links])

    @property
    def curvature_rows(self) -> FloatArray:
        """Derivatives of the sections' curvatures by the unknowns, first axis first, (2 s, 2 s + k) [1/m]."""
        return np.eye(2 * self.knots, self.dimension) * self.scale / np.tile(self.sections.lengths, 2)[:, None]

    @property
    def of_shape(self) -> BoolArray:
        """Mask of the unknowns that shape the arm: all, shape (2 s + k,)."""
        return np.ones(self.dimension, dtype=np.bool_)

    @property
    def _base_turns(self) -> int:
        """Number of unknowns of the base's rotation: none."""
        return 0

    def _shapes(self, places: FloatArray) -> FloatArray:
        """Return the bend of every joint per unit of bend of each section, shape (..., links, s).

        Args:
            places: arc lengths of the joints, shape (..., links) [m]; only their number matters.
        """
        shares = self.sections.coupling[::2, ::2]
        return np.broadcast_to(shares, (*places.shape, self.knots))


_MOST_DRAWN = 0.98
"""Greatest share of the limits that random bends take."""


def unknowns_through(arm: Arm, q: FloatArray, knots: int = KNOTS) -> tuple[CurveMap, FloatArray]:
    """Return the map in whose unknowns motions of an arm in space are planned, and those of a configuration, (p,).

    Args:
        arm: the arm.
        q: the configuration, shape (c,) [rad, m].
        knots: number of knots of a curve, unless the arm has sections that bend evenly.
    """
    if arm.sections is not None:
        return SectionMap.of_sections(arm, arm.sections, q)
    return CurveMap.through(arm, q, knots)
