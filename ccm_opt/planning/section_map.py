"""The map from drives that move several joints together to configurations: the unknowns of an arm of such drives.

Unknowns v: first the drives (of sections that bend evenly, all bends about z, then those about y), then the positions
of the axes that carry the base, scaled so that a unit of each has about the same effect on the bends of the joints.
Every configuration of the arm is in the range of the map, so that nothing is offset or blended.

On a feed axis a drive is at zero until all that it bends has left the guide tube. From there on its unknown moves it by
a fraction that grows from 0 to 1 with the distance from the tube.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.core.length_words import file_length, short_length
from ccm_opt.planning.curve_map import KNOTS, CurveMap
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.planning.sampled_motions import Emergence
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import FREE_AFTER, free_before, smooth_step
from ccm_opt.robot.couplings import DRIVES_MISFIT, DriveCoupling


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
        return space.blended_to(q)

    @cached_property
    def _columns(self) -> FloatArray:
        """Derivatives of the bends of the joints by the drives in the order of the unknowns, shape (2 links, m)."""
        return np.ascontiguousarray(self.coupled.coupling[:, self.coupled.drive_order])

    def configurations(self, v: FloatArray) -> FloatArray:
        """Return the configurations, shape (n, c) [rad, m], of several vectors of unknowns, shape (n, m + k)."""
        moved = self._columns.shape[1]
        feeds = self._feeds(v)
        drives = v[:, :moved] * self.scale[:moved]
        if not self.affine:
            drives = drives * self._shares(feeds)
        return np.concatenate((drives @ self._columns.T + 0.0, feeds), axis=1)

    def configurations_and_slopes(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return configurations, shape (n, c) [rad, m], and their derivatives by the unknowns, (n, c, m + k)."""
        slopes = np.repeat(self.drive_rows[None], len(v), axis=0)
        bends, moved = self._columns.shape
        if not self.affine:
            feeds = self._feeds(v)
            slopes[:, :bends, :moved] *= self._shares(feeds)[:, None]
            step = 1e-6 * self.arm.length
            grown = (self._shares(feeds + step) - self._shares(feeds - step)) / (2.0 * step)
            drives = v[:, :moved] * self.scale[:moved]
            slopes[:, :bends, self.feed_column] = (drives * grown * self.scale[self.feed_column]) @ self._columns.T
        return self.configurations(v), slopes

    # ------------------------------------------------------------ on a feed axis
    @cached_property
    def bending_places(self) -> FloatArray:
        """Arc length that has to be out of the guide tube for each drive to move, shape (m,) [m]."""
        return self.coupled.least_moved(self.arm.bending_places)[self.coupled.drive_order]

    def _shares(self, feeds: FloatArray) -> FloatArray:
        """Return the fraction by which its unknown moves each drive at feeds (n, 1) [m], shape (n, m)."""
        return smooth_step(feeds + self.bending_places - self.arm.hole, self.straight_before, self._whole_from)

    @property
    def _whole_from(self) -> float:
        """Distance from the tube from which on drives are at their unknowns [m]."""
        return min(FREE_AFTER * self.nominal_length, float(self._full_from[0]))

    @cached_property
    def emergence(self) -> Emergence | None:
        """How bends grow beyond the guide tube of a feed axis; None without one."""
        if self.affine:
            return None
        places = np.where(self._columns != 0.0, self.bending_places, np.inf).min(axis=1)
        return Emergence(places - self.arm.hole, self.straight_before, self._whole_from)

    @cached_property
    def drive_rows(self) -> FloatArray:
        """Derivatives of the configuration by the unknowns where all drives are out of the tube, shape (c, m + k)."""
        rows = np.zeros((len(self.arm.coordinates), self.dimension))
        bends, moved = self._columns.shape
        rows[:bends, :moved] = self._columns * self.scale[:moved]
        axes = np.arange(self.dimension)[self.axis_columns]
        rows[self.arm.coordinates.base, axes] = self.scale[axes]
        return rows

    def _straight_before(self, first: float) -> float:
        """Return the distance from the tube up to which drives are at zero if the nearest one moves at ``first`` [m].

        That drive has grown to its unknown by then, so that it has one whatever its distance.
        """
        return min(free_before(self.arm), 0.5 * first)

    def _first_out(self, q: FloatArray) -> float:
        """Return how far the first of the drives that are not at zero is out of the tube in a configuration (c,) [m].

        It is infinite if all are at zero.

        Raises:
            MotionNotFound: it is so near to the tube that no motion leads from there.
        """
        drives = self.coupled.drives(q[: 2 * self.arm.links])[self.coupled.drive_order]
        places = self.arm.coordinates.advance(q) + self.bending_places - self.arm.hole
        places = np.where(np.abs(drives) > DRIVES_MISFIT, places, np.inf)
        first = int(np.argmin(places))
        least = _LEAST_OUT * self.nominal_length
        if places[first] >= least:
            return float(places[first])
        name = self.coupled.drive_names[self.coupled.drive_order[first]]
        raise MotionNotFound(
            Diagnosis(
                f"{name} is bent {short_length(float(places[first]))} beyond the end of the guide tube, but drives "
                f"move only once all that they bend is {short_length(least)} beyond it",
                "motion",
                (f"arm.feed.hole less by {file_length(least)}", "straighten what is at the end of the guide tube"),
            )
        )

    def extended(self, unknowns: FloatArray, given_in: CurveUnknowns) -> FloatArray:
        """Return unknowns (n, m + k) in another map of the arm as those of the same configurations in this map."""
        if not isinstance(given_in, SectionMap) or np.array_equal(given_in._full_from, self._full_from):  # noqa: SLF001
            return unknowns
        return np.stack([self.fitted(q) for q in given_in.configurations(unknowns)])

    @property
    def following_rows(self) -> FloatArray:
        """Matrix without rows: evenly bent sections do not slide along their own shape, shape (0, m + k)."""
        return np.zeros((0, self.dimension))

    def fitted(self, q: FloatArray, smoothness: float = 0.0) -> FloatArray:
        """Return the unknowns, shape (m + k,), of a configuration, shape (c,).

        Args:
            q: configuration [rad, m].
            smoothness: without effect.
        """
        del smoothness
        if self.affine:
            return np.asarray(self._inverse @ q)
        bends = 2 * self.arm.links
        shares = self._shares(q[None, bends:])[0]
        drives = self.coupled.drives(q[:bends])[self.coupled.drive_order]
        return np.append(np.divide(drives, shares, np.zeros(len(drives)), where=shares > 0.0), q[bends:]) / self.scale

    @cached_property
    def _inverse(self) -> FloatArray:
        return np.asarray(np.linalg.pinv(self.drive_rows))

    def blended_to(self, q: FloatArray) -> tuple["SectionMap", FloatArray]:
        """Return the same map, and the unknowns of another configuration, shape (c,), in it, shape (m + k,).

        If the configuration bends nearer to the guide tube than the map does, it is another that bends so near.
        """
        if self.affine:
            return self, self.fitted(q)
        space = replace(self, full_from=np.minimum(self._full_from, self._first_out(q)))
        return space, space.fitted(q)

    def with_blends_of(
        self, other: CurveMap, own: FloatArray, others: FloatArray
    ) -> tuple["SectionMap", FloatArray, FloatArray]:
        """Return the map that bends as near to the guide tube as this and another, and unknowns of both in it.

        Args:
            other: map of the same arm.
            own: unknowns of this map, shape (n, m + k).
            others: unknowns of the other map, shape (l, m + k).
        """
        both = replace(self, full_from=np.minimum(self._full_from, other._full_from))  # noqa: SLF001
        return both, both.extended(own, self), both.extended(others, other)

    def drawn(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return the unknowns of random drives and axis positions within their limits, shape (count, m + k)."""
        bends = self._columns.shape[1]
        spread = rng.uniform(0.2, 1.0, (count, 1))
        shares = np.clip(spread * rng.normal(size=(count, bends)), -1.0, 1.0)
        bent = _MOST_DRAWN * shares * (self.coupled.drive_limits[self.coupled.drive_order] / self.scale[:bends])
        travel = np.abs(bent @ (self.coupled.travel_rows @ (self._columns * self.scale[:bends])).T)
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


_LEAST_OUT = 1e-3
"""Distance from the guide tube from which on drives may move at the start or the goal, in nominal links. Heuristic."""
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
