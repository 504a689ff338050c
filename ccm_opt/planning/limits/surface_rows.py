"""Rows that keep links clear of surfaces in space.

Rows are those of ``interval_rows``. The normals point towards the obstacle: a plane next to a wall bounds a half-space
that is free of walls about where the link is at some time. A point that is nearer to the wall halfway than the mean of
the interval's ends has that loss added to its demand, and so has its deviation from that mean at times in between.
"""

from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit_stack import ContactLimit
from ccm_opt.planning.optimisation.interval_rows import STILL, IntervalRows, Sweep, joined_rows, pair_rows
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import SurfaceFinder
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_BEHIND = 0.06
"""How far surfaces may protrude through another surface's plane without a plane of their own [u]."""

_MOST_TRAVEL = 0.75
"""Most of a joint's travel over an interval by which the reach of rows is extended [u]."""
BETWEEN = (0.25, 0.75)
"""Shares of an interval at which links that lack clearance have rows too."""
_PLANES = 6
"""Most half-spaces per link."""


def motion_rows(sweep: Sweep, contact: ContactLimit, finder: SurfaceFinder) -> IntervalRows:
    """Return all rows of a motion.

    Args:
        sweep: the motion.
        contact: limit with the gap wanted beyond the margin.
        finder: finder of the contacts.
    """
    room = finder.margin + contact.wanted
    rows = joined_rows([_wall_rows(sweep, finder, room), pair_rows(sweep, room, room + finder.reach)])
    # Rows at the given start could never be repaired.
    return rows.take(rows.interval + rows.share > 0.0)


def _wall_rows(sweep: Sweep, finder: SurfaceFinder, room: float) -> IntervalRows:
    """Return the rows of half-spaces about the links.

    Half-spaces are taken halfway through every interval, at every keyframe, and at the times ``BETWEEN``. A link that
    passes an edge within an interval lies on both sides of some plane about its middle; such a plane does not describe
    the way past the edge, and is left to the planes at the keyframes and in between.
    """
    chords = np.linalg.norm(np.diff(sweep.joints, axis=0), axis=2)
    travel = min(0.5 * float(np.max(chords, initial=0.0)), _MOST_TRAVEL * sweep.space.nominal_length)
    kept = finder.kept + room
    reach = kept + finder.reach
    interval, link, normal, foot = _half_spaces(sweep, finder.tree, sweep.middles, reach + travel)
    parts = []
    for side in (0, 1):
        for end in (0, 1):
            beyond = np.einsum("md,md->m", normal, sweep.joints[interval + side, link + end]) - foot
            fits = np.flatnonzero(beyond > 0.0)
            rows = _rows_of_points(interval, float(side), link + end, normal, foot + kept)
            rows = replace(rows, constant=rows.constant + sweep.lost(rows))
            parts.append(rows.take(np.intersect1d(fits, _free_points(sweep, link + end))))
    parts.append(_half_space_rows(sweep, finder.tree, 1.0, reach, kept))
    # In between, only links that lack clearance get rows.
    near = kept + 0.1 * sweep.space.nominal_length
    parts.extend(_half_space_rows(sweep, finder.tree, share, near, kept) for share in BETWEEN)
    return joined_rows(parts)


def _half_space_rows(sweep: Sweep, tree: SurfaceTree, share: float, reach: float, kept: float) -> IntervalRows:
    """Return the rows of half-spaces about the links at one time of every interval.

    Args:
        sweep: the motion.
        tree: tree of the surfaces.
        share: share of the interval that has passed.
        reach: surfaces farther away are left out [m].
        kept: distance that the links' axes have to keep [m].
    """
    points = sweep.points_at(share)
    off = points - ((1.0 - share) * sweep.joints[:-1] + share * sweep.joints[1:])
    interval, link, normal, foot = _half_spaces(sweep, tree, points, reach)
    parts = []
    for end in (0, 1):
        beside = np.einsum("md,md->m", normal, off[interval, link + end])
        rows = _rows_of_points(interval, share, link + end, normal, foot + kept - beside)
        parts.append(rows.take(_free_points(sweep, link + end)))
    return joined_rows(parts)


def _half_spaces(
    sweep: Sweep, tree: SurfaceTree, points: FloatArray, reach: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the half-spaces n·x ≥ b about the links of several poses.

    Args:
        sweep: the motion.
        tree: tree of the surfaces.
        points: joints and tip of the poses, shape (k, links + 1, 3) [m].
        reach: surfaces farther away are left out [m].

    Returns:
        Indices of the poses and of the links, each of shape (m,), n, shape (m, 3), and b, shape (m,) [m].
    """
    arm = sweep.space.arm
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    beyond = arm.links - first
    looked_at = points[:, first:]
    segments = np.stack((looked_at[:, :-1], looked_at[:, 1:]), axis=2).reshape(-1, 2, 3)
    planes = tree.planes(segments, reach, _PLANES, _BEHIND * sweep.space.nominal_length)
    foot = np.einsum("md,md->m", planes.normal, planes.point)
    return planes.link // beyond, planes.link % beyond + first, planes.normal, foot


def room_lacking(sweep: Sweep, finder: SurfaceFinder, wanted: float) -> FloatArray:
    """Return the shortfall of the least gap from surfaces in every interval, at least 0, shape (K,) [m].

    Args:
        sweep: the motion.
        finder: finder of the contacts.
        wanted: gap that is asked for beyond contact [m].
    """
    poses = (sweep.middles, *(sweep.points_at(share) for share in (*BETWEEN, 1.0)))
    lacking = [distance_lacking(sweep.space.arm, finder.tree, points, finder.kept + wanted) for points in poses]
    return np.asarray(np.max(lacking, axis=0))


def _rows_of_points(
    interval: IntArray, share: float, point: IntArray, normal: FloatArray, need: FloatArray
) -> IntervalRows:
    """Return rows that keep points at least ``need`` [m] along their normals from the origin, as half-spaces demand."""
    none = np.zeros(len(point), dtype=np.intp)
    return IntervalRows(interval, np.full(len(point), share), point, none + STILL, none, none, -normal, need)


def _free_points(sweep: Sweep, point: IntArray) -> IntArray:
    """Return the indices of the entries of ``point`` that can move.

    The first joint moves only where the base is fed.
    """
    return np.flatnonzero((point > 0) | bool(sweep.space.arm.base_axes))


def distance_lacking(arm: Arm, tree: SurfaceTree, points: FloatArray, kept: float) -> FloatArray:
    """Return how far the axes of the links beyond the mount are closer to surfaces than required.

    Args:
        arm: the arm.
        tree: tree of the surfaces.
        points: joints and tip of some poses, shape (k, links + 1, 3) [m].
        kept: required distance between axes and surfaces [m].

    Returns:
        Shortfall of every pose, at least 0, shape (k,) [m].
    """
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    segments = np.stack((points[:, first:-1], points[:, first + 1 :]), axis=2)
    distances = tree.distances(segments.reshape(-1, 2, 3), kept)
    return np.asarray(kept - np.min(distances.reshape(len(points), -1), axis=1, initial=kept))
