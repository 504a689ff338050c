"""Linearised constraints (rows) that keep links clear of surfaces in space.

Rows are those of ``interval_rows``, with normals towards the obstacle. A plane next to a surface bounds a half-space
that is free of obstacles near the position of a link at one time of the motion.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.limits.limit_stack import ContactLimit
from ccm_opt.planning.optimisation.interval_rows import STILL, IntervalRows, Sweep, joined_rows, pair_rows
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import SurfaceFinder
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_BEHIND = 0.06
"""Distance by which surfaces may protrude through the plane of another surface without a plane of their own, in nominal
links."""
_MOST_TRAVEL = 0.75
"""Upper bound on the travel of a joint between two times by which the search distance for surfaces is extended, in
nominal links."""
_PLANES = 6
"""Maximum number of half-spaces per link."""


def motion_rows(sweep: Sweep, contact: ContactLimit, finder: SurfaceFinder) -> IntervalRows:
    """Return linearised constraints (rows) that keep an arm in space clear of surfaces and of itself over a motion.

    There are none at the fixed start.

    Args:
        sweep: the motion.
        contact: limit with the preferred gap beyond the margin.
        finder: finder of near pairs of links and surfaces, with the margin and the search distance.
    """
    room = finder.margin + contact.wanted
    rows = joined_rows([_wall_rows(sweep, finder, room), pair_rows(sweep, room, room + finder.reach)])
    # Rows at the given start could never be repaired.
    return rows.take(rows.interval + rows.share > 0.0)


def _wall_rows(sweep: Sweep, finder: SurfaceFinder, room: float) -> IntervalRows:
    """Return linearised constraints that keep links in free half-spaces, at all times of the sweep but the start.

    Args:
        sweep: the motion, with the times at the ends of the parts of its intervals.
        finder: finder of near surfaces.
        room: gap that the constraints require [m].
    """
    reach = float(np.max(finder.kept)) + room + finder.reach
    chords = np.linalg.norm(np.diff(sweep.timed_joints, axis=0), axis=2)
    travel = min(float(np.max(chords, initial=0.0)), _MOST_TRAVEL * sweep.space.nominal_length)
    place, link, normal, foot = _half_spaces(sweep, finder.tree, sweep.timed_joints[1:], reach + travel)
    interval = place // sweep.parts
    share = (place % sweep.parts + 1) / sweep.parts
    arm = sweep.space.arm
    mounted, part = arm.mount_end
    # A link that belongs to the mount in part begins at the end of the mount.
    begins = np.where((link == mounted) & (part > 0.0), arm.links + 1, link)
    rows = [
        _rows_of_points(interval, share, point, normal, foot + finder.kept[link] + room).take(
            _free_points(sweep, point)
        )
        for point in (begins, link + 1)
    ]
    return joined_rows(rows)


def _half_spaces(
    sweep: Sweep, tree: SurfaceTree, points: FloatArray, reach: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return half-spaces n·x ≥ b free of surfaces around the links of several poses.

    Args:
        sweep: the motion, for its arm.
        tree: distance tree of the surfaces.
        points: joints and tip of the poses, shape (k, links + 1, 3) [m].
        reach: distance from a link beyond which surfaces are left out [m].

    Returns:
        Index of the pose and of the link of each half-space, shape (m,), normal n, shape (m, 3), and offset b, shape
        (m,) [m].
    """
    first, axes = sweep.space.arm.exposed_links(points)
    beyond = axes.shape[1]
    behind = _BEHIND * sweep.space.nominal_length
    planes = tree.planes(axes.reshape(-1, 2, 3), reach, _PLANES, behind, poses=len(points))
    foot = np.einsum("md,md->m", planes.normal, planes.point)
    return planes.link // beyond, planes.link % beyond + first, planes.normal, foot


def clearance_shortfall(sweep: Sweep, finder: SurfaceFinder, wanted: float) -> FloatArray:
    """Return how much of the preferred clearance a motion lacks at the end of each part of its intervals, (K m,) [m].

    Args:
        sweep: the motion, of K intervals with m parts.
        finder: finder of contacts, with the distance tree of the surfaces.
        wanted: preferred gap beyond contact [m].

    Returns:
        Shortfalls, at least 0, shape (K m,) [m].
    """
    return distance_shortfall(sweep.space.arm, finder.tree, sweep.timed_joints[1:], finder.kept + wanted)


def _rows_of_points(
    interval: IntArray, share: FloatArray, point: IntArray, normal: FloatArray, need: FloatArray
) -> IntervalRows:
    """Return the rows n · P ≥ need, which keep points P of the arm in half-spaces, one row each.

    Args:
        interval: index of the interval, shape (m,).
        share: time of the row as a fraction of the interval, shape (m,).
        point: index of the point, shape (m,).
        normal: unit normal n, shape (m, 3).
        need: bound of the row, shape (m,) [m].
    """
    none = np.zeros(len(point), dtype=np.intp)
    return IntervalRows(interval, share, point, none + STILL, none, none, -normal, need)


def _free_points(sweep: Sweep, point: IntArray) -> IntArray:
    """Return the positions in ``point``, shape (m,), of indices of points that can move.

    All can but the first joint of an arm without a feed axis.
    """
    return np.flatnonzero((point > 0) | bool(sweep.space.arm.base_axes))


def distance_shortfall(arm: Arm, tree: SurfaceTree, points: FloatArray, kept: FloatArray) -> FloatArray:
    """Return by how much any link beyond the mount is closer to a surface than required, in each of several poses.

    Args:
        arm: the arm.
        tree: distance tree of the surfaces.
        points: joints and tips of several poses, shape (k, links + 1, 3) [m].
        kept: required distance between the centre line of each link and surfaces, shape (links,) [m].

    Returns:
        Shortfall of every pose, at least 0, shape (k,) [m].
    """
    first, axes = arm.exposed_links(points)
    distances = tree.distances(axes.reshape(-1, 2, 3), float(np.max(kept)), poses=len(points)).reshape(len(points), -1)
    return np.asarray(np.max(kept[first:] - distances, axis=1, initial=0.0))
