"""Linearised contact constraints (rows) over the intervals between keyframes of a motion, in the plane and in space.

A row bounds the distance of a point P_a of the arm from a wall, or from a point P_b of another link, at one time of
interval k, along a fixed direction n:

    n·(P_a − P_b) + deviation + c ≤ 0.

For a wall, P_b is a fixed point. The deviation, computed from the motion, bounds the distance by which the points may
leave the straight line between their positions at both ends of the interval; it is 0 where there are rows at times in
between, too.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.planning.pose import CurveUnknowns, Pose
from ccm_opt.scene.distances.enclosures import segment_distances

STILL = -1
"""Index of a fixed point, the last of the points of a motion."""
_SECTORS = 12
"""Number of sectors into which the directions of a plane are divided; of similar rows, the tightest one per sector is
kept. Heuristic."""
_MOST_SECTORS = 24
"""Number of sectors in space, where there are more."""


@dataclass(frozen=True)
class RowCurvature:
    """Convex part of the Hessian of a weighted sum of constraints (rows), in the p unknowns of each keyframe.

    Attributes:
        diagonal: blocks of each keyframe, shape (K + 1, p, p).
        beside: blocks for the difference of the unknowns of keyframes k and k + 1, shape (K, p, p).
    """

    diagonal: FloatArray
    beside: FloatArray


@dataclass(frozen=True, eq=False)
class Sweep:
    """Motion with p unknowns per keyframe, linear over the K intervals, of an arm of n links in d dimensions.

    Attributes:
        space: map from the unknowns to configurations.
        unknowns: unknowns at the keyframes, shape (K + 1, p).
    """

    space: CurveUnknowns
    unknowns: FloatArray

    parts: ClassVar[int] = 4
    """Number m of equal parts of an interval; constraints hold at the ends of the parts, and each part has a slack."""

    @property
    def intervals(self) -> int:
        """Number K of intervals between keyframes."""
        return len(self.unknowns) - 1

    @cached_property
    def poses(self) -> tuple[Pose, ...]:
        """Poses at the keyframes, with their derivatives with respect to the unknowns."""
        return self.space.poses(self.unknowns)

    @cached_property
    def configurations(self) -> FloatArray:
        """Configurations at the keyframes, shape (K + 1, c) [rad, m]."""
        return np.stack([pose.q for pose in self.poses])

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives of the configurations with respect to the unknowns, shape (K + 1, c, p)."""
        return np.stack([pose.slopes for pose in self.poses])

    @cached_property
    def turn_metrics(self) -> FloatArray:
        """Matrices JᵀJ for the Jacobian J of link rotations with respect to the unknowns, shape (K + 1, p, p)."""
        turning = np.stack([pose.turning for pose in self.poses]).reshape(len(self.poses), -1, self.unknowns.shape[1])
        return np.asarray(turning.transpose(0, 2, 1) @ turning)

    @cached_property
    def joints(self) -> FloatArray:
        """Positions of joints and tip at the keyframes, shape (K + 1, n + 1, d) [m]."""
        return np.stack([pose.points for pose in self.poses])

    @cached_property
    def points(self) -> FloatArray:
        """Positions of joints, tip, end of the mount and a fixed point at the keyframes, shape (K + 1, n + 3, d) [m].

        The fixed point, last, is the origin.
        """
        return self._with_marks(self.joints)

    @cached_property
    def moving(self) -> FloatArray:
        """Derivatives of ``points`` with respect to the unknowns of their keyframe, shape (K + 1, n + 3, d, p) [m]."""
        return self._with_marks(np.stack([pose.moving for pose in self.poses]))

    def unknowns_at(self, share: float) -> FloatArray:
        """Return the unknowns at a given fraction of each interval between keyframes, shape (K, p)."""
        return np.asarray((1.0 - share) * self.unknowns[:-1] + share * self.unknowns[1:])

    @cached_property
    def middles(self) -> FloatArray:
        """Positions of joints and tip half-way through the intervals, shape (K, n + 1, d) [m]."""
        # From the mean bends, not the mean of the positions: links keep their length during the motion.
        return self.space.arm.joint_positions_at(self.space.configurations(self.unknowns_at(0.5)))

    # ------------------------------------------------------------ values at the times of rows
    @property
    def _between(self) -> FloatArray:
        """Unknowns at the ends of the parts that lie inside the intervals, shape (K (m − 1), p)."""
        shares = np.arange(1, self.parts) / self.parts
        return np.stack([self.unknowns_at(share) for share in shares], axis=1).reshape(-1, self.unknowns.shape[1])

    @cached_property
    def poses_between(self) -> tuple[Pose, ...]:
        """Poses at the ends of the parts that lie inside the intervals, K (m − 1) of them."""
        return self.space.poses(self._between)

    def _interleaved(self, at_keyframes: FloatArray, between: FloatArray) -> FloatArray:
        """Return values at keyframes and at the times between them as one array in order of time, shape (K m + 1, ...).

        Args:
            at_keyframes: values at the keyframes, shape (K + 1, ...).
            between: values at the times between keyframes, shape (K (m − 1), ...).
        """
        inner = between.reshape(self.intervals, self.parts - 1, *at_keyframes.shape[1:])
        parts = np.concatenate((at_keyframes[:-1, None], inner), axis=1)
        return np.concatenate((parts.reshape(-1, *at_keyframes.shape[1:]), at_keyframes[-1:]))

    @cached_property
    def timed_joints(self) -> FloatArray:
        """Positions of joints and tip at all times at which constraints may be imposed, (K m + 1, n + 1, d) [m]."""
        if self.parts == 1:
            return self.joints
        between = self.space.arm.joint_positions_at(self.space.configurations(self._between))
        return self._interleaved(self.joints, between)

    @cached_property
    def timed_points(self) -> FloatArray:
        """Positions of ``points`` at all times at which constraints may be imposed, (K m + 1, n + 3, d) [m]."""
        return self.points if self.parts == 1 else self._with_marks(self.timed_joints)

    @cached_property
    def timed_moving(self) -> FloatArray:
        """Derivatives of ``timed_points`` with respect to the unknowns at each time, (K m + 1, n + 3, d, p) [m]."""
        if self.parts == 1:
            return self.moving
        moving = np.stack([pose.moving for pose in self.poses_between])
        return self._interleaved(self.moving, self._with_marks(moving))

    @property
    def half_way(self) -> FloatArray:
        """Positions of joints, tip, end of the mount and fixed point half-way through intervals, (K, n + 3, d) [m]."""
        return self._with_marks(self.middles)

    @cached_property
    def halfway_off(self) -> FloatArray:
        """Positions half-way through the intervals minus the mean of those at the ends, shape (K, n + 3, d) [m]."""
        return np.asarray(self.half_way - 0.5 * (self.points[:-1] + self.points[1:]))

    def _with_marks(self, joints: FloatArray) -> FloatArray:
        """Return values at joints and tip, (..., n + 1, ...), extended by those at the mount's end and a fixed point.

        The joints are along the second axis. The value at the end of the mount is interpolated between the joints of
        its link, that at the fixed point is 0.
        """
        link, share = self.space.arm.mount_end
        at_mount = (1.0 - share) * joints[:, link : link + 1] + share * joints[:, link + 1 : link + 2]
        return np.concatenate((joints, at_mount, np.zeros_like(at_mount)), axis=1)

    def deviation(self, rows: "IntervalRows") -> FloatArray | float:
        """Return upper bounds on how far the points that m rows constrain deviate from straight lines, (m,) [m].

        A line joins a point's positions at both ends of the interval. The bound is 0 if there are rows at times in
        between, too.
        """
        del rows
        return 0.0

    def deviation_slopes(self, rows: "IntervalRows") -> FloatArray | float:
        """Return the derivatives of ``deviation`` with respect to the unknowns' change over an interval, (m, p)."""
        del rows
        return 0.0

    def lost(self, rows: "IntervalRows") -> FloatArray:
        """Return, for m rows, the excess of n·(P_a − P_b) half-way over the mean of its values at both ends, (m,) [m].

        The excess is at least 0; it is 0 if ``deviation`` covers it.
        """
        way = self.halfway_off[rows.interval, rows.plus] - self.halfway_off[rows.interval, rows.minus]
        return np.asarray(np.maximum(np.einsum("md,md->m", rows.normal, way), 0.0))

    def curvature(self, rows: "IntervalRows", multipliers: FloatArray, pull: FloatArray) -> RowCurvature | None:
        """Return the convex part of the Hessian of Σ λ g + pull · tip for constraints g; None in space.

        In space it is not computed, since it couples all links to each other.

        Args:
            rows: m rows.
            multipliers: multipliers λ of the rows, shape (m,).
            pull: multipliers of the tip's position at the goal, shape (d,).
        """
        del rows, multipliers, pull
        return None


@dataclass(frozen=True, eq=False)
class IntervalRows:
    """The m linearised contact constraints (rows) g = n·(P_a − P_b) + deviation + c ≤ 0 over a motion.

    Attributes:
        interval: index k of the interval of each row, shape (m,).
        share: time of each row as a fraction of its interval, from 0 to 1, shape (m,).
        plus: index a of the point with positive sign, shape (m,).
        minus: index b of the point with negative sign, shape (m,); ``STILL`` for a wall.
        high: index of the joint up to which the deviation counts, shape (m,).
        low: index of the joint from which on the deviation counts, shape (m,).
        normal: direction n, shape (m, d).
        constant: constant c, shape (m,) [m].
    """

    interval: IntArray
    share: FloatArray
    plus: IntArray
    minus: IntArray
    high: IntArray
    low: IntArray
    normal: FloatArray
    constant: FloatArray

    def __len__(self) -> int:
        return len(self.interval)

    def take(self, chosen: BoolArray | IntArray) -> "IntervalRows":
        """Return the constraint rows selected by a mask or by indices."""
        return IntervalRows(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def part(self, sweep: Sweep) -> IntArray:
        """Return the index of the part of the motion that ends at the time of each row, shape (m,).

        A row at the start of an interval belongs to the part that begins there.
        """
        return np.asarray(np.maximum(self._time(sweep) - 1, sweep.parts * self.interval))

    @property
    def against_walls(self) -> BoolArray:
        """Mask of the constraint rows against walls rather than between links, shape (m,)."""
        return np.asarray(self.minus == STILL)

    def values(self, sweep: Sweep) -> FloatArray:
        """Return the values g of all rows in a motion, shape (m,) [m]; positive if violated."""
        time = self._time(sweep)
        apart = sweep.timed_points[time, self.plus] - sweep.timed_points[time, self.minus]
        return np.asarray(np.einsum("md,md->m", self.normal, apart) + sweep.deviation(self) + self.constant)

    def _time(self, sweep: Sweep) -> IntArray:
        """Return the index of the time of each row among all row times of a motion, shape (m,)."""
        return np.asarray(sweep.parts * self.interval + np.rint(sweep.parts * self.share).astype(np.intp))

    def keys(self, sweep: Sweep) -> IntArray:
        """Return a number for the time, the points and the direction of each row, the same in similar motions, (m,)."""
        points = sweep.timed_points.shape[1] + 1
        places = (self._time(sweep) * points + self.plus) * points + self.minus - STILL
        return np.asarray(places * _MOST_SECTORS + _directions(self.normal))

    def slopes(self, sweep: Sweep) -> tuple[FloatArray, FloatArray]:
        """Return derivatives of m rows with respect to the unknowns at both ends of their intervals, (m, p) each."""
        # A change at either keyframe moves the points by a fraction of that change. It also alters the change over the
        # interval, and so the deviation, with opposite signs at start and end.
        time = self._time(sweep)
        apart = sweep.timed_moving[time, self.plus]
        pairs = np.flatnonzero(self.minus != STILL)
        apart[pairs] -= sweep.timed_moving[time[pairs], self.minus[pairs]]
        moved = np.einsum("md,mdp->mp", self.normal, apart)
        deviation = sweep.deviation_slopes(self)
        share = self.share[:, None]
        return np.asarray((1.0 - share) * moved - deviation), np.asarray(share * moved + deviation)


def joined_rows(parts: list[IntervalRows]) -> IntervalRows:
    """Return several sets of constraint rows as one set."""
    return IntervalRows(
        *(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(IntervalRows))
    )


def pair_rows(sweep: Sweep, margin: float, reach: float) -> IntervalRows:
    """Return linearised constraints (rows) that keep links of the arm clear of each other over a whole motion.

    Only links far enough apart along the arm to collide are considered.

    The direction of a row is that between the closest points half-way through the interval.

    Args:
        sweep: the motion.
        margin: gap to keep beyond the sum of the radii, if the links in between allow that gap [m].
        reach: gap above which pairs of links are left out [m].
    """
    arm = sweep.space.arm
    far = reach + 2.0 * arm.radius
    longest = float(np.max(arm.lengths))
    i, j = arm.self_pairs
    middles = sweep.middles

    # Broad phase: two links are at most a link length nearer to each other than their middles are.
    centres = 0.5 * (middles[:, :-1] + middles[:, 1:])
    interval, pair = np.nonzero(np.linalg.norm(centres[:, i] - centres[:, j], axis=2) < far + longest)
    i, j = i[pair], j[pair]

    # One direction for the whole interval: that of the closest points half-way, where both ends are equally near.
    ends = (middles[interval, i], middles[interval, i + 1], middles[interval, j], middles[interval, j + 1])
    _, _, distance, normal = segment_distances(*ends)
    close = distance < far
    interval, i, j, normal = interval[close], i[close], j[close], normal[close]
    need = arm.radii[i] + arm.radii[j] + arm.link_margins(i, j, margin)

    # Eight corner differences (two keyframes, two ends of each link) bound all points of the pair at all times. Only
    # the links from i to j turn relative to each other, so their part of the deviation is enough.
    rows = joined_rows(
        [
            IntervalRows(interval, np.full(len(i), float(side)), j + t, i + s, j + 1, i, normal, need)
            for side in (0, 1)
            for t in (0, 1)
            for s in (0, 1)
        ]
    )
    return replace(rows, constant=rows.constant + sweep.lost(rows))


def representatives(rows: IntervalRows, values: FloatArray, group: int) -> IntArray:
    """Return indices of the tightest constraints, one for each interval, time, group of joints and sector of normals.

    Args:
        rows: m rows.
        values: values of the rows, shape (m,).
        group: number of neighbouring joints in a group.
    """
    keys = (
        rows.share,
        rows.interval,
        rows.plus // group,
        rows.minus // group,
        rows.against_walls,
        _directions(rows.normal),
    )
    # lexsort sorts by its last key first, so −values only orders rows whose keys all agree: the tightest comes first.
    order = np.lexsort((-values, *keys))
    changes = [np.diff(key[order].astype(np.float64)) != 0.0 for key in keys]
    first = np.concatenate(([True], np.any(changes, axis=0)))[: len(order)]
    chosen: IntArray = order[first]
    return chosen


def _directions(normal: FloatArray) -> IntArray:
    """Return the index of the sector of directions to which each of m normals (m, d) belongs, shape (m,)."""
    if normal.shape[1] == 2:
        sector = np.floor(np.arctan2(normal[:, 1], normal[:, 0]) * _SECTORS / (2.0 * np.pi)).astype(np.intp)
        return np.asarray(sector % _SECTORS)
    # Twenty-four directions: the largest component with its sign, and halves of the other two.
    largest = np.argmax(np.abs(normal), axis=1)
    lines = np.arange(len(normal))
    signs = [normal[lines, (largest + step) % 3] > 0.0 for step in range(3)]
    return np.asarray(8 * largest + 4 * signs[0] + 2 * signs[1] + signs[2])
