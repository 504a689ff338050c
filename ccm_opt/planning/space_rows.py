"""Rows of trajectory optimisation in space.

A row has the form need − n·(P_a − P_b) ≤ 0 with points at one time of an interval: at an end of it, or in between,
where a point is the mean of where it is at the ends, weighed by the time, and off that by a given distance. Of a wall
P_b stands still, and the plane through it bounds a half-space free of walls about where the link is at some time; of a
pair of links both points move. What a point is nearer halfway than the mean of the ends is asked for beside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.room_lacking import distance_lacking
from ccm_opt.planning.space_settings import SpaceOptimisationSettings
from ccm_opt.planning.space_sweep import SpaceSweep

_BEHIND = 0.06
"""By how much surfaces may stand out from one of them without getting one of their own [u]."""

_MOST_TRAVEL = 0.75
"""Of the way of a joint over an interval that rows reach for [u]."""
_PAIR_SHARE = 0.25
"""Of what links between two leave at full stretch that these are asked to keep apart."""


@dataclass(frozen=True, eq=False)
class SpaceRows:
    """Rows g ≤ 0; all arrays have length m.

    Attributes:
        interval: k.
        share: of the interval that has passed: 0 at its start, 1 at its end.
        plus: number a of the point counted positively.
        minus: number b of the point counted negatively; −1 where nothing moves.
        normal: n, shape (m, 3).
        need: what n·(P_a − P_b) has to be at least [m].
    """

    interval: IntArray
    share: FloatArray
    plus: IntArray
    minus: IntArray
    normal: FloatArray
    need: FloatArray

    def __len__(self) -> int:
        return len(self.interval)

    def take(self, chosen: IntArray) -> "SpaceRows":
        """Some of the rows."""
        return SpaceRows(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @property
    def free(self) -> IntArray:
        """Rows that can be changed at all: not those at the given start."""
        return np.flatnonzero(self.interval + self.share > 0.0)

    def values(self, sweep: SpaceSweep) -> FloatArray:
        """Values of every row, shape (m,) [m]."""
        places = (1.0 - self.share) * self._apart(sweep, 0) + self.share * self._apart(sweep, 1)
        return np.asarray(self.need - places)

    def slopes(self, sweep: SpaceSweep, side: int) -> FloatArray:
        """Derivatives by the unknowns of the keyframe at the start (0) or end (1) of the interval, shape (m, p)."""
        keyframe = self.interval + side
        slopes = -np.einsum("md,mdp->mp", self.normal, sweep.moving[keyframe, self.plus])
        both = np.flatnonzero(self.minus >= 0)
        slopes[both] += np.einsum("md,mdp->mp", self.normal[both], sweep.moving[keyframe[both], self.minus[both]])
        return np.asarray(slopes * self.weight(side)[:, None])

    def weight(self, side: int) -> FloatArray:
        """How much the keyframe at the start (0) or end (1) of the interval counts, shape (m,)."""
        return self.share if side else 1.0 - self.share

    def _apart(self, sweep: SpaceSweep, side: int) -> FloatArray:
        """n·(P_a − P_b) at the start (0) or end (1) of the interval, shape (m,) [m]."""
        points = sweep.points[self.interval + side]
        rows = np.arange(len(self))
        apart = points[rows, self.plus] - np.where((self.minus >= 0)[:, None], points[rows, self.minus], 0.0)
        return np.asarray(np.einsum("md,md->m", self.normal, apart))


def motion_rows(sweep: SpaceSweep, wanted: float, margin: float, settings: SpaceOptimisationSettings) -> SpaceRows:
    """All rows of a motion.

    Args:
        sweep: the motion.
        wanted: room beyond contact that is asked for [m].
        margin: gap beyond contact that rows keep in any case [m].
        settings: of the optimisation.
    """
    parts = [_wall_rows(sweep, wanted + margin, settings)]
    if sweep.curve.arm.self_collision:
        parts.append(_pair_rows(sweep, wanted + margin, settings))
    return _joined(parts)


def _wall_rows(sweep: SpaceSweep, room: float, settings: SpaceOptimisationSettings) -> SpaceRows:
    """Rows of half-spaces about the links halfway through every interval, at every keyframe, and at times in between.

    A link that passes an edge within an interval lies on both sides of some plane about its middle. Such a plane says
    nothing of the way past the edge, and is left to the planes at the keyframes and in between.
    """
    chords = np.linalg.norm(np.diff(sweep.points, axis=0), axis=2)
    travel = min(0.5 * float(np.max(chords, initial=0.0)), _MOST_TRAVEL * sweep.stepper.unit)
    kept = sweep.stepper.kept + room
    reach = kept + settings.active * sweep.stepper.unit
    interval, link, normal, foot = _half_spaces(sweep, sweep.middle_points, reach + travel, settings)
    parts = []
    for side in (0, 1):
        for end in (0, 1):
            beyond = np.einsum("md,md->m", normal, sweep.points[interval + side, link + end]) - foot
            fits = np.flatnonzero(beyond > 0.0)
            bow = _lost(normal, sweep.halfway_off[interval, link + end])
            rows = _of_points(interval, float(side), link + end, normal, foot + kept + bow)
            parts.append(rows.take(np.intersect1d(fits, _free_points(sweep, link + end))))
    parts.append(_rows_at(sweep, 1.0, reach, kept, settings))
    # In between only what lacks room is asked for.
    parts.extend(_rows_at(sweep, share, kept + 0.1 * sweep.stepper.unit, kept, settings) for share in settings.between)
    return _joined(parts)


def _rows_at(
    sweep: SpaceSweep, share: float, reach: float, kept: float, settings: SpaceOptimisationSettings
) -> SpaceRows:
    """Rows of half-spaces about the links at one time of every interval.

    Args:
        sweep: the motion.
        share: of the interval that has passed.
        reach: surfaces farther away are left out [m].
        kept: distance that the links' axes shall keep [m].
        settings: of the optimisation.
    """
    points = sweep.points_at(share)
    off = points - ((1.0 - share) * sweep.points[:-1] + share * sweep.points[1:])
    interval, link, normal, foot = _half_spaces(sweep, points, reach, settings)
    parts = []
    for end in (0, 1):
        beside = np.einsum("md,md->m", normal, off[interval, link + end])
        rows = _of_points(interval, share, link + end, normal, foot + kept - beside)
        parts.append(rows.take(_free_points(sweep, link + end)))
    return _joined(parts)


def _joined(parts: Sequence[SpaceRows]) -> SpaceRows:
    return SpaceRows(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(SpaceRows)))


def _half_spaces(
    sweep: SpaceSweep, points: FloatArray, reach: float, settings: SpaceOptimisationSettings
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Half-spaces n·x ≥ b about the links of several poses.

    Args:
        sweep: the motion.
        points: joints and tip of the poses, shape (k, links + 1, 3) [m].
        reach: surfaces farther away are left out [m].
        settings: of the optimisation.

    Returns:
        Numbers of the poses and of the links, each of shape (m,), n, shape (m, 3), and b, shape (m,) [m].
    """
    arm = sweep.curve.arm
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    beyond = arm.links - first
    looked_at = points[:, first:]
    segments = np.stack((looked_at[:, :-1], looked_at[:, 1:]), axis=2).reshape(-1, 2, 3)
    planes = sweep.stepper.tree.planes(segments, reach, settings.planes, _BEHIND * sweep.stepper.unit)
    foot = np.einsum("md,md->m", planes.normal, planes.point)
    return planes.link // beyond, planes.link % beyond + first, planes.normal, foot


def room_lacking(sweep: SpaceSweep, wanted: float, settings: SpaceOptimisationSettings) -> FloatArray:
    """By how much the least gap from surfaces lacks the wanted one in every interval, at least 0, shape (K,) [m].

    Args:
        sweep: the motion.
        wanted: room beyond contact that is asked for [m].
        settings: whose times in between are looked at.
    """
    lacking = np.zeros(sweep.intervals)
    for share in (*settings.between, 0.5, 1.0):
        points = sweep.middle_points if share == 0.5 else sweep.points_at(share)
        lacking = np.maximum(lacking, _lacking_at(sweep, points, wanted))
    return lacking


def room_lacking_on_the_way(sweep: SpaceSweep, wanted: float, settings: SpaceOptimisationSettings) -> float:
    """By how much the least gap from surfaces lacks more of the wanted one than where a motion starts and ends [m].

    Args:
        sweep: the motion.
        wanted: room beyond contact that is asked for [m].
        settings: whose times in between are looked at.
    """
    at_ends = _lacking_at(sweep, sweep.points[[0, -1]], wanted)
    return float(np.max(room_lacking(sweep, wanted, settings)) - np.max(at_ends))


def _lacking_at(sweep: SpaceSweep, points: FloatArray, wanted: float) -> FloatArray:
    """By how much the least gap of poses, points of shape (k, links + 1, 3), lacks the wanted one, shape (k,) [m]."""
    return distance_lacking(sweep.curve.arm, sweep.stepper.tree, points, sweep.stepper.kept + wanted)


def _of_points(interval: IntArray, share: float, point: IntArray, normal: FloatArray, need: FloatArray) -> SpaceRows:
    """Rows of points that have to keep off planes."""
    return SpaceRows(interval, np.full(len(point), share), point, np.full(len(point), -1), normal, need)


def _free_points(sweep: SpaceSweep, point: IntArray) -> IntArray:
    """Which points can be moved: not the first joint unless it is fed."""
    return np.flatnonzero((point > 0) | bool(sweep.curve.arm.base_axes))


def _pair_rows(sweep: SpaceSweep, room: float, settings: SpaceOptimisationSettings) -> SpaceRows:
    """Rows that keep distant links apart, along the direction in which they are nearest halfway."""
    arm = sweep.curve.arm
    motion = sweep.stepper.certificate.motion
    reach = 2.0 * arm.radius + room + settings.active * sweep.stepper.unit
    columns: list[tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]] = []
    for k, points in enumerate(sweep.middle_points):
        near = motion.near_pairs(points, reach)
        if len(near.first) == 0:
            continue
        kept = 2.0 * arm.radius + np.minimum(room, _PAIR_SHARE * _slack_between(sweep, near.second - near.first))
        off = sweep.halfway_off[k]
        bows = [_lost(near.normal, off[near.first + s] - off[near.second + t]) for s in (0, 1) for t in (0, 1)]
        columns.append((np.full(len(near.first), k), near.first, near.second, near.normal, kept + np.max(bows, axis=0)))
    if not columns:
        none = np.zeros(0, dtype=np.intp)
        return SpaceRows(none, np.zeros(0), none, none, np.zeros((0, 3)), np.zeros(0))
    interval, first, second, normal, need = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    parts = [
        SpaceRows(interval, np.full(len(first), float(side)), first + s, second + t, normal, need)
        for side in (0, 1)
        for s in (0, 1)
        for t in (0, 1)
    ]
    return _joined(parts)


def _lost(normal: FloatArray, off: FloatArray) -> FloatArray:
    """By how much points come nearer halfway than at the mean of the ends, shape (m,) [m]."""
    return np.asarray(np.maximum(-np.einsum("md,md->m", normal, off), 0.0))


def _slack_between(sweep: SpaceSweep, apart: IntArray) -> FloatArray:
    """How far links so many apart can be from each other beyond two radii at full stretch, at least 0 [m]."""
    arm = sweep.curve.arm
    return np.asarray(np.maximum((apart - 1) * arm.link_length - 2.0 * arm.radius, 0.0))


def tightest(rows: SpaceRows, values: FloatArray, group: int) -> IntArray:
    """Numbers of the tightest rows for each keyframe, group of neighbouring points and direction.

    Args:
        rows: the rows.
        values: of them, shape (m,).
        group: number of points in a group.
    """
    # Twenty-four directions: the largest component with its sign, and halves of the other two.
    largest = np.argmax(np.abs(rows.normal), axis=1)
    lines = np.arange(len(rows))
    sign = rows.normal[lines, largest] > 0.0
    others = [rows.normal[lines, (largest + step) % 3] > 0.0 for step in (1, 2)]
    keys = (rows.interval, rows.share, rows.plus // group, (rows.minus + 1) // group, largest, sign, *others)
    order = np.lexsort((-values, *keys))
    changes = [np.diff(key[order].astype(float)) != 0.0 for key in keys]
    first = np.concatenate(([True], np.any(changes, axis=0)))[: len(order)]
    return np.asarray(order[first])


@dataclass(frozen=True, eq=False)
class KeyframeRows:
    """Rows on keyframes that have to hold, without slack.

    Attributes:
        keyframe: of each row, at least 1, shape (m,).
        rows: by the unknowns of that keyframe, shape (m, p).
        lower: what they have to gain at least, shape (m,).
        equal: how many of them, the first ones, may gain no more either.
    """

    keyframe: IntArray
    rows: FloatArray
    lower: FloatArray
    equal: int

    @classmethod
    def joined(cls, parts: "Sequence[KeyframeRows]") -> "KeyframeRows | None":
        """All rows of some parts, equations first; None of no parts."""
        if not parts:
            return None
        equations = [(part, slice(None, part.equal)) for part in parts]
        ordered = [*equations, *((part, slice(part.equal, None)) for part in parts)]
        return cls(
            np.concatenate([part.keyframe[some] for part, some in ordered]),
            np.vstack([part.rows[some] for part, some in ordered]),
            np.concatenate([part.lower[some] for part, some in ordered]),
            sum(part.equal for part in parts),
        )
