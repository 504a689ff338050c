"""Rows that keep links clear of surfaces in space.

Rows are those of ``interval_rows``. The normals point towards the obstacle: a plane next to a wall bounds a half-space
that is free of walls about where the link is at some time.
"""

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
"""Most of a joint's travel between two times by which the reach of rows is extended [u]."""
_PLANES = 6
"""Most half-spaces per link."""


def motion_rows(sweep: Sweep, contact: ContactLimit, finder: SurfaceFinder) -> IntervalRows:
    """Return the rows that keep a motion in space clear of surfaces and of its own links.

    Args:
        sweep: the motion.
        contact: limit with the preferred gap beyond the margin.
        finder: finder of the contacts.
    """
    room = finder.margin + contact.wanted
    rows = joined_rows([_wall_rows(sweep, finder, room), pair_rows(sweep, room, room + finder.reach)])
    # Rows at the given start could never be repaired.
    return rows.take(rows.interval + rows.share > 0.0)


def _wall_rows(sweep: Sweep, finder: SurfaceFinder, room: float) -> IntervalRows:
    """Return the rows of free half-spaces around the links at all times of rows except the start."""
    kept = finder.kept + room
    chords = np.linalg.norm(np.diff(sweep.timed_joints, axis=0), axis=2)
    travel = min(float(np.max(chords, initial=0.0)), _MOST_TRAVEL * sweep.space.nominal_length)
    place, link, normal, foot = _half_spaces(sweep, finder.tree, sweep.timed_joints[1:], kept + finder.reach + travel)
    interval = place // sweep.parts
    share = (place % sweep.parts + 1) / sweep.parts
    rows = [
        _rows_of_points(interval, share, link + end, normal, foot + kept).take(_free_points(sweep, link + end))
        for end in (0, 1)
    ]
    return joined_rows(rows)


def _half_spaces(
    sweep: Sweep, tree: SurfaceTree, points: FloatArray, reach: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return free half-spaces n·x ≥ b around the links of several poses.

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
    """Return shortfalls ≥ 0 of the gap from surfaces at all times of rows except the first, shape (K m,) [m].

    Args:
        sweep: the motion.
        finder: finder of the contacts.
        wanted: preferred gap beyond contact [m].
    """
    return distance_lacking(sweep.space.arm, finder.tree, sweep.timed_joints[1:], finder.kept + wanted)


def _rows_of_points(
    interval: IntArray, share: FloatArray, point: IntArray, normal: FloatArray, need: FloatArray
) -> IntervalRows:
    """Return the rows normal · point ≥ ``need`` [m], with which half-spaces bound points of the arm."""
    none = np.zeros(len(point), dtype=np.intp)
    return IntervalRows(interval, share, point, none + STILL, none, none, -normal, need)


def _free_points(sweep: Sweep, point: IntArray) -> IntArray:
    """Return the indices of the entries of ``point`` that can move.

    The first joint moves only where the base is fed.
    """
    return np.flatnonzero((point > 0) | bool(sweep.space.arm.base_axes))


def distance_lacking(arm: Arm, tree: SurfaceTree, points: FloatArray, kept: float) -> FloatArray:
    """Return by how much the axes of links beyond the mount are closer to surfaces than required.

    Args:
        arm: the arm.
        tree: tree of the surfaces.
        points: joints and tips of several poses, shape (k, links + 1, 3) [m].
        kept: required distance between axes and surfaces [m].

    Returns:
        Shortfall of every pose, at least 0, shape (k,) [m].
    """
    first = int(np.ceil(arm.mount_length / arm.link_length - 1e-9))
    segments = np.stack((points[:, first:-1], points[:, first + 1 :]), axis=2)
    distances = tree.distances(segments.reshape(-1, 2, 3), kept)
    return np.asarray(kept - np.min(distances.reshape(len(points), -1), axis=1, initial=kept))
