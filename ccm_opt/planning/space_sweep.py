"""Motions in space between their keyframes, and the rows of their optimisation.

Rows are those of ``interval_rows``, their normals towards what has to be kept off: of a wall a plane bounds a
half-space free of walls about where the link is at some time. What a point is nearer halfway than the mean of the ends
is asked for beside, and so is how far it is off that mean at a time in between.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.optimisation.interval_rows import STILL, IntervalRows, Sweep, joined_rows
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.room_lacking import distance_lacking
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.scene.distances.surface_tree import SurfaceTree


@dataclass(frozen=True, eq=False)
class SpaceSweep(Sweep):
    """A motion whose unknowns are linear between K + 1 keyframes.

    Attributes:
        space: the map of the unknowns.
        unknowns: at the keyframes, shape (K + 1, p).
    """

    space: CurveMap
    unknowns: FloatArray

    @cached_property
    def poses(self) -> tuple[Pose, ...]:
        """At the keyframes."""
        return self.space.poses(self.unknowns)

    @cached_property
    def configurations(self) -> FloatArray:
        """At the keyframes, shape (K + 1, c) [rad, m]."""
        return np.stack([pose.q for pose in self.poses])

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives of the configurations by the unknowns, shape (K + 1, c, p)."""
        return np.stack([pose.slopes for pose in self.poses])

    @cached_property
    def joints(self) -> FloatArray:
        """Joints and tip at the keyframes, shape (K + 1, links + 1, 3) [m]."""
        return np.stack([pose.points for pose in self.poses])

    @cached_property
    def points(self) -> FloatArray:
        """The same, and last the origin, which stands still, shape (K + 1, links + 2, 3) [m]."""
        return np.pad(self.joints, ((0, 0), (0, 1), (0, 0)))

    @cached_property
    def moving(self) -> FloatArray:
        """Derivatives of the points by the unknowns, shape (K + 1, links + 2, 3, p) [m]."""
        return np.pad(np.stack([pose.moving for pose in self.poses]), ((0, 0), (0, 1), (0, 0), (0, 0)))

    @cached_property
    def turn_metrics(self) -> FloatArray:
        """Squared turns of the links by the unknowns, shape (K + 1, p, p)."""
        turning = np.stack([pose.turning for pose in self.poses]).reshape(len(self.poses), -1, self.moving.shape[3])
        return np.asarray(turning.transpose(0, 2, 1) @ turning)

    @cached_property
    def halfway_off(self) -> FloatArray:
        """How far the points are off the mean of the interval's ends halfway, shape (K, links + 1, 3) [m]."""
        return np.asarray(self.middle_points - 0.5 * (self.joints[:-1] + self.joints[1:]))

    @cached_property
    def middle_points(self) -> FloatArray:
        """Joints and tip halfway through the intervals, shape (K, links + 1, 3) [m]."""
        return self.points_at(0.5)

    def points_at(self, share: float) -> FloatArray:
        """Joints and tip when a share of each interval has passed, shape (K, links + 1, 3) [m]."""
        if share == 1.0:
            return self.joints[1:]
        between = (1.0 - share) * self.unknowns[:-1] + share * self.unknowns[1:]
        return self.space.arm.joint_positions_at(self.space.configurations(between))


_BEHIND = 0.06
"""By how much surfaces may stand out from one of them without getting one of their own [u]."""

_MOST_TRAVEL = 0.75
"""Of the way of a joint over an interval that rows reach for [u]."""
_PAIR_SHARE = 0.25
"""Of what links between two leave at full stretch that these are asked to keep apart."""
BETWEEN = (0.25, 0.75)
"""Shares of an interval at which links that lack room have rows too."""
_PLANES = 6
"""Most half-spaces about a link."""


def motion_rows(sweep: SpaceSweep, proof: SpaceCertificate, room: float, seen: float) -> IntervalRows:
    """All rows of a motion.

    Args:
        sweep: the motion.
        proof: of contact.
        room: that is asked for beyond what it proves [m].
        seen: what is farther beyond that makes no rows [m].
    """
    parts = [_wall_rows(sweep, proof, room, seen)]
    if sweep.space.arm.self_collision:
        parts.append(_pair_rows(sweep, proof, room, seen))
    rows = joined_rows(parts)
    # Rows at the given start can never be mended.
    return rows.take(rows.interval + rows.share > 0.0)


def _wall_rows(sweep: SpaceSweep, proof: SpaceCertificate, room: float, seen: float) -> IntervalRows:
    """Rows of half-spaces about the links halfway through every interval, at every keyframe, and at times in between.

    A link that passes an edge within an interval lies on both sides of some plane about its middle. Such a plane says
    nothing of the way past the edge, and is left to the planes at the keyframes and in between.
    """
    chords = np.linalg.norm(np.diff(sweep.joints, axis=0), axis=2)
    travel = min(0.5 * float(np.max(chords, initial=0.0)), _MOST_TRAVEL * sweep.space.nominal_length)
    kept = proof.kept + room
    reach = kept + seen
    interval, link, normal, foot = _half_spaces(sweep, proof.tree, sweep.middle_points, reach + travel)
    parts = []
    for side in (0, 1):
        for end in (0, 1):
            beyond = np.einsum("md,md->m", normal, sweep.joints[interval + side, link + end]) - foot
            fits = np.flatnonzero(beyond > 0.0)
            bow = _lost(normal, sweep.halfway_off[interval, link + end])
            rows = _of_points(interval, float(side), link + end, normal, foot + kept + bow)
            parts.append(rows.take(np.intersect1d(fits, _free_points(sweep, link + end))))
    parts.append(_rows_at(sweep, proof.tree, 1.0, reach, kept))
    # In between only what lacks room is asked for.
    near = kept + 0.1 * sweep.space.nominal_length
    parts.extend(_rows_at(sweep, proof.tree, share, near, kept) for share in BETWEEN)
    return joined_rows(parts)


def _rows_at(sweep: SpaceSweep, tree: SurfaceTree, share: float, reach: float, kept: float) -> IntervalRows:
    """Rows of half-spaces about the links at one time of every interval.

    Args:
        sweep: the motion.
        tree: of the surfaces.
        share: of the interval that has passed.
        reach: surfaces farther away are left out [m].
        kept: distance that the links' axes shall keep [m].
    """
    points = sweep.points_at(share)
    off = points - ((1.0 - share) * sweep.joints[:-1] + share * sweep.joints[1:])
    interval, link, normal, foot = _half_spaces(sweep, tree, points, reach)
    parts = []
    for end in (0, 1):
        beside = np.einsum("md,md->m", normal, off[interval, link + end])
        rows = _of_points(interval, share, link + end, normal, foot + kept - beside)
        parts.append(rows.take(_free_points(sweep, link + end)))
    return joined_rows(parts)


def _half_spaces(
    sweep: SpaceSweep, tree: SurfaceTree, points: FloatArray, reach: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Half-spaces n·x ≥ b about the links of several poses.

    Args:
        sweep: the motion.
        tree: of the surfaces.
        points: joints and tip of the poses, shape (k, links + 1, 3) [m].
        reach: surfaces farther away are left out [m].

    Returns:
        Numbers of the poses and of the links, each of shape (m,), n, shape (m, 3), and b, shape (m,) [m].
    """
    arm = sweep.space.arm
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    beyond = arm.links - first
    looked_at = points[:, first:]
    segments = np.stack((looked_at[:, :-1], looked_at[:, 1:]), axis=2).reshape(-1, 2, 3)
    planes = tree.planes(segments, reach, _PLANES, _BEHIND * sweep.space.nominal_length)
    foot = np.einsum("md,md->m", planes.normal, planes.point)
    return planes.link // beyond, planes.link % beyond + first, planes.normal, foot


def room_lacking(sweep: SpaceSweep, proof: SpaceCertificate, wanted: float) -> FloatArray:
    """By how much the least gap from surfaces lacks the wanted one in every interval, at least 0, shape (K,) [m].

    Args:
        sweep: the motion.
        proof: of contact.
        wanted: room beyond contact that is asked for [m].
    """
    lacking = np.zeros(sweep.intervals)
    for share in (*BETWEEN, 0.5, 1.0):
        points = sweep.middle_points if share == 0.5 else sweep.points_at(share)
        lacking = np.maximum(lacking, _lacking_at(sweep, proof, points, wanted))
    return lacking


def room_lacking_on_the_way(sweep: SpaceSweep, proof: SpaceCertificate, wanted: float) -> float:
    """By how much the least gap from surfaces lacks more of the wanted one than where a motion starts and ends [m].

    Args:
        sweep: the motion.
        proof: of contact.
        wanted: room beyond contact that is asked for [m].
    """
    at_ends = _lacking_at(sweep, proof, sweep.joints[[0, -1]], wanted)
    return float(np.max(room_lacking(sweep, proof, wanted)) - np.max(at_ends))


def _lacking_at(sweep: SpaceSweep, proof: SpaceCertificate, points: FloatArray, wanted: float) -> FloatArray:
    """By how much the least gap of poses, points of shape (k, links + 1, 3), lacks the wanted one, shape (k,) [m]."""
    return distance_lacking(sweep.space.arm, proof.tree, points, proof.kept + wanted)


def _of_points(interval: IntArray, share: float, point: IntArray, normal: FloatArray, need: FloatArray) -> IntervalRows:
    """Rows of points that have to be so far along normals out of half-spaces' sides [m]."""
    none = np.zeros(len(point), dtype=np.intp)
    return IntervalRows(interval, np.full(len(point), share), point, none + STILL, none, none, -normal, need)


def _free_points(sweep: SpaceSweep, point: IntArray) -> IntArray:
    """Which points can be moved: not the first joint unless it is fed."""
    return np.flatnonzero((point > 0) | bool(sweep.space.arm.base_axes))


def _pair_rows(sweep: SpaceSweep, proof: SpaceCertificate, room: float, seen: float) -> IntervalRows:
    """Rows that keep distant links apart, along the direction in which they are nearest halfway."""
    arm = sweep.space.arm
    reach = 2.0 * arm.radius + room + seen
    columns: list[tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]] = []
    for k, points in enumerate(sweep.middle_points):
        near = proof.motion.near_pairs(points, reach)
        if len(near.first) == 0:
            continue
        kept = 2.0 * arm.radius + np.minimum(room, _PAIR_SHARE * _slack_between(sweep, near.second - near.first))
        off = sweep.halfway_off[k]
        bows = [_lost(near.normal, off[near.first + s] - off[near.second + t]) for s in (0, 1) for t in (0, 1)]
        columns.append((np.full(len(near.first), k), near.first, near.second, near.normal, kept + np.max(bows, axis=0)))
    if not columns:
        none = np.zeros(0, dtype=np.intp)
        return IntervalRows(none, np.zeros(0), none, none, none, none, np.zeros((0, 3)), np.zeros(0))
    interval, first, second, normal, need = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    none = np.zeros(len(first), dtype=np.intp)
    parts = [
        IntervalRows(interval, np.full(len(first), float(side)), first + s, second + t, none, none, -normal, need)
        for side in (0, 1)
        for s in (0, 1)
        for t in (0, 1)
    ]
    return joined_rows(parts)


def _lost(normal: FloatArray, off: FloatArray) -> FloatArray:
    """By how much points come nearer halfway than at the mean of the ends, shape (m,) [m]."""
    return np.asarray(np.maximum(-np.einsum("md,md->m", normal, off), 0.0))


def _slack_between(sweep: SpaceSweep, apart: IntArray) -> FloatArray:
    """How far links so many apart can be from each other beyond two radii at full stretch, at least 0 [m]."""
    arm = sweep.space.arm
    return np.asarray(np.maximum((apart - 1) * arm.link_length - 2.0 * arm.radius, 0.0))
