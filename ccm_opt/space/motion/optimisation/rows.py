"""Rows over whole intervals of a motion: what keeps links off walls and off each other.

A row has the form need − n·(P_a − P_b) ≤ 0 with points at one end of an interval. Of a wall P_b stands still, and the
plane through it bounds a half-space free of walls about where the link is halfway; of a pair of links both points move.
Between the keyframes a point leaves its chord by at most an eighth of the bound on its second derivative.
"""

from dataclasses import dataclass, fields

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.motion.optimisation.sweep import SpaceSweep
from ccm_opt.space.motion.settings import OptimisationSettings


@dataclass(frozen=True, eq=False)
class SpaceRows:
    """Rows g ≤ 0; all arrays have length m.

    Attributes:
        interval: k.
        side: 0 at the start of the interval, 1 at its end.
        plus: number a of the point counted positively.
        minus: number b of the point counted negatively; −1 where nothing moves.
        normal: n, shape (m, 3).
        need: what n·(P_a − P_b) has to be at least [m].
    """

    interval: IntArray
    side: IntArray
    plus: IntArray
    minus: IntArray
    normal: FloatArray
    need: FloatArray

    def __len__(self) -> int:
        return len(self.interval)

    def take(self, chosen: IntArray) -> "SpaceRows":
        """Some of the rows."""
        return SpaceRows(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def values(self, sweep: SpaceSweep) -> FloatArray:
        """Values of every row, shape (m,) [m]."""
        keyframe = self.interval + self.side
        apart = sweep.points[keyframe, self.plus] - np.where(
            (self.minus >= 0)[:, None], sweep.points[keyframe, self.minus], 0.0
        )
        return np.asarray(self.need - np.einsum("md,md->m", self.normal, apart))

    def slopes(self, sweep: SpaceSweep) -> FloatArray:
        """Derivatives by the unknowns of the row's own keyframe, shape (m, p)."""
        keyframe = self.interval + self.side
        slopes = -np.einsum("md,mdp->mp", self.normal, sweep.moving[keyframe, self.plus])
        both = np.flatnonzero(self.minus >= 0)
        slopes[both] += np.einsum("md,mdp->mp", self.normal[both], sweep.moving[keyframe[both], self.minus[both]])
        return np.asarray(slopes)


def motion_rows(sweep: SpaceSweep, wanted: float, margin: float, settings: OptimisationSettings) -> SpaceRows:
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
    return SpaceRows(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(SpaceRows)))


def _wall_rows(sweep: SpaceSweep, room: float, settings: OptimisationSettings) -> SpaceRows:
    """Rows of half-spaces about the links halfway through every interval."""
    arm = sweep.curve.arm
    links = arm.links
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    beyond = links - first
    middles = sweep.middle_points[:, first:]
    segments = np.stack((middles[:, :-1], middles[:, 1:]), axis=2).reshape(-1, 2, 3)
    chords = np.linalg.norm(np.diff(sweep.points, axis=0), axis=2)
    travel = 0.5 * float(np.max(chords)) if len(chords) else 0.0
    kept = sweep.stepper.kept + room
    reach = kept + min(travel, settings.most_travel * sweep.stepper.unit) + settings.active * sweep.stepper.unit
    planes = sweep.stepper.tree.planes(segments, reach, settings.planes)
    interval = planes.link // beyond
    link = planes.link % beyond + first
    foot = np.einsum("md,md->m", planes.normal, planes.point)
    parts = []
    for side in (0, 1):
        for end in (0, 1):
            point = link + end
            need = foot + kept + sweep.bows[interval, link + 1] / 8.0
            # The first joint cannot be moved unless it is fed.
            free = np.flatnonzero((point > 0) | bool(arm.base_axes))
            rows = SpaceRows(interval, np.full(len(link), side), point, np.full(len(link), -1), planes.normal, need)
            parts.append(rows.take(free))
    return SpaceRows(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(SpaceRows)))


def _pair_rows(sweep: SpaceSweep, room: float, settings: OptimisationSettings) -> SpaceRows:
    """Rows that keep distant links apart, along the direction in which they are nearest halfway."""
    arm = sweep.curve.arm
    motion = sweep.stepper.certificate.motion
    reach = 2.0 * arm.radius + room + settings.active * sweep.stepper.unit
    columns: list[tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]] = []
    for k, points in enumerate(sweep.middle_points):
        near = motion.near_pairs(points, reach)
        if len(near.first) == 0:
            continue
        kept = 2.0 * arm.radius + np.minimum(
            room, settings.pair_share * _slack_between(sweep, near.second - near.first)
        )
        bow = (sweep.bows[k, near.second + 1] - sweep.bows[k, near.first]) / 8.0
        columns.append((np.full(len(near.first), k), near.first, near.second, near.normal, kept + bow))
    if not columns:
        none = np.zeros(0, dtype=np.intp)
        return SpaceRows(none, none, none, none, np.zeros((0, 3)), np.zeros(0))
    interval, first, second, normal, need = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    parts = [
        SpaceRows(interval, np.full(len(first), side), first + s, second + t, normal, need)
        for side in (0, 1)
        for s in (0, 1)
        for t in (0, 1)
    ]
    return SpaceRows(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(SpaceRows)))


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
    keys = (rows.interval, rows.side, rows.plus // group, (rows.minus + 1) // group, largest, sign, *others)
    order = np.lexsort((-values, *keys))
    changes = [np.diff(key[order].astype(np.intp)) != 0 for key in keys]
    first = np.concatenate(([True], np.any(changes, axis=0)))[: len(order)]
    return np.asarray(order[first])
