"""The map from drives that move several joints together to configurations: the unknowns of an arm of such drives.

Unknowns v: first the drives (of sections that bend evenly, all bends about z, then those about y), then the positions
of the axes that carry the base, scaled so that a unit of each has about the same effect on the bends of the joints.
Every configuration of the arm is in the range of the map, so that nothing is offset or blended.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.curve_map import KNOTS, CurveMap
from ccm_opt.planning.pose import Pose
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.couplings import DriveCoupling


@dataclass(frozen=True, eq=False)
class SectionMap(CurveMap):
    """The map from unknowns v, shape (m + k,), of an arm of m drives on k axes to its configurations q, shape (c,).

    The sections of an arm that bend evenly stand for the knots of a curve.

    Attributes:
        coupled: the drives of the arm.
    """

    coupled: DriveCoupling = field(kw_only=True)

    @classmethod
    def of_drives(cls, arm: Arm, drives: DriveCoupling, q: FloatArray) -> tuple["SectionMap", FloatArray]:
        """Return the map of an arm, and the unknowns of a configuration, shape (c,), in it, shape (m + k,)."""
        moved = len(drives.drive_names)
        count = moved if arm.sections is None else len(arm.sections.counts)
        nothing = (np.zeros((2, 2)), np.array([0.0, arm.length]))
        plain = cls(arm, arm.length / count, count, np.zeros(0), *nothing, coupled=drives)
        space = replace(plain, scale=np.concatenate((drives.drive_scales[drives.drive_order], plain.axis_scale)))
        return space, space.fitted(q)

    @cached_property
    def _columns(self) -> FloatArray:
        """Derivatives of the bends of the joints by the drives in the order of the unknowns, shape (2 links, m)."""
        return np.ascontiguousarray(self.coupled.coupling[:, self.coupled.drive_order])

    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations, shape (n, c) [rad, m], of several vectors of unknowns, shape (n, m + k)."""
        moved = self._columns.shape[1]
        bends = (v[:, :moved] * self.scale[:moved]) @ self._columns.T
        return np.concatenate((bends + 0.0, self._feeds(v)), axis=1)

    def configurations_and_slopes(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return configurations, shape (n, c) [rad, m], and their derivatives by the unknowns, (n, c, m + k)."""
        slopes = np.zeros((len(self.arm.coordinates), self.dimension))
        moved = self._columns.shape[1]
        slopes[: len(self._columns), :moved] = self._columns * self.scale[:moved]
        axes = np.arange(self.dimension)[self.axis_columns]
        slopes[self.arm.coordinates.base, axes] = self.scale[axes]
        return self.configurations(v), np.repeat(slopes[None], len(v), axis=0)

    @property
    def affine(self) -> bool:
        """Whether configurations are affine functions of the unknowns: always."""
        return True

    def fitted(self, q: FloatArray, smoothness: float = 0.0) -> FloatArray:
        """Return the unknowns, shape (m + k,), of a configuration, shape (c,).

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
        """Return the same map, and the unknowns of another configuration, shape (c,), in it, shape (m + k,)."""
        return self, self.fitted(q)

    def drawn(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return the unknowns of random drives and axis positions within their limits, shape (count, m + k)."""
        bends = self._columns.shape[1]
        spread = rng.uniform(0.2, 1.0, (count, 1))
        shares = np.clip(spread * rng.normal(size=(count, bends)), -1.0, 1.0)
        bent = _MOST_DRAWN * shares * (self.coupled.drive_limits[self.coupled.drive_order] / self.scale[:bends])
        travel = np.abs(bent @ (self.coupled.travel_rows @ self._bend_rows[:, :bends]).T)
        bent = bent / np.maximum(np.max(travel, axis=1, initial=0.0) / _MOST_DRAWN, 1.0)[:, None]
        return np.hstack((bent, self.drawn_axes(rng, count)))

    # ------------------------------------------------------------ bends, and travels of tendons in units of them
    @cached_property
    def bend_limits(self) -> FloatArray:
        """Upper bound on every joint bend and, last, on the travel of every tendon that has a limit, shape (b,) [rad].

        A travel counts as the bend of a joint that has the same fraction of its limit.
        """
        travels = np.full(len(self.coupled.travel_rows), self._travel_bend)
        return np.concatenate((self.arm.bend_limits, travels))

    def bends(self, q: FloatArray) -> FloatArray:
        """Return the joint bends and travels, shape (..., b) [rad], of configurations, shape (..., c)."""
        own = q[..., : 2 * self.arm.links]
        if not len(self.coupled.travel_rows):
            return own
        return np.concatenate((own, self._travel_bend * own @ self.coupled.travel_rows.T), axis=-1)

    def bend_slopes(self, pose: Pose) -> FloatArray:
        """Return the derivatives of bends and travels with respect to the unknowns at a pose, shape (b, p)."""
        own = pose.slopes[: 2 * self.arm.links]
        return np.concatenate((own, self._travel_bend * self.coupled.travel_rows @ own))

    @cached_property
    def _travel_bend(self) -> float:
        return float(np.max(self.arm.bend_limits))

    @cached_property
    def _bend_rows(self) -> FloatArray:
        return np.asarray(self.slopes(np.zeros(self.dimension))[: 2 * self.arm.links])

    @property
    def curvature_rows(self) -> FloatArray:
        """Greatest curvature that each drive gives the arm, by the unknowns, shape (m, m + k) [1/m]."""
        lengths = self.coupled.drive_lengths[self.coupled.drive_order]
        return np.eye(len(lengths), self.dimension) * self.scale / lengths[:, None]

    @property
    def of_shape(self) -> BoolArray:
        """Mask of the unknowns that shape the arm: all, shape (m + k,)."""
        return np.ones(self.dimension, dtype=np.bool_)

    @property
    def _base_turns(self) -> int:
        """Number of unknowns of the base's rotation: none."""
        return 0


_MOST_DRAWN = 0.98
"""Greatest share of the limits that random bends take."""


def unknowns_through(arm: Arm, q: FloatArray, knots: int = KNOTS) -> tuple[CurveMap, FloatArray]:
    """Return the map in whose unknowns motions of an arm in space are planned, and those of a configuration, (p,).

    Args:
        arm: the arm.
        q: the configuration, shape (c,) [rad, m].
        knots: number of knots of a curve, unless drives move several joints together.
    """
    if arm.drives is not None:
        return SectionMap.of_drives(arm, arm.drives, q)
    return CurveMap.through(arm, q, knots)
