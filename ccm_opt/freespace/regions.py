"""Convex regions grown from convex cells until walls stop them, so that neighbouring regions overlap (section 4.1).

Each wall is shut out by one half-plane through its point nearest to the cell, nearest walls first, walls already
outside left aside: the first step of IRIS (Deits & Tedrake, 2015) with the cell in the place of the ellipse, so the
result holds the cell.
"""

import numpy as np

from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.polygons import (
    after_each,
    clip,
    half_planes,
    nearest_on_segments,
    signed_area,
    without_short_edges,
)
from ccm_opt.ground.rounding import ROUNDING, SHORTEST


def region_of(vertices: FloatArray) -> ConvexRegion:
    """A convex polygon, counter-clockwise vertices of shape (m, 2) [m], with its half-planes."""
    vertices = without_short_edges(vertices, ROUNDING)
    return ConvexRegion(vertices, *half_planes(vertices))


def grow(
    cell: FloatArray, walls: FloatArray, room: FloatArray, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
) -> ConvexRegion:
    """A convex free region that contains a convex free cell.

    Args:
        cell: counter-clockwise vertices, shape (m, 2) [m]; m = 2 for a segment.
        walls: the edges of free space, free space on their left, shape (w, 2, 2) [m].
        room: a convex polygon that holds free space, counter-clockwise, shape (r, 2) [m].
        settings: number of walls to begin with.

    Returns:
        The region; it contains the cell and meets no wall, both within 1e-9 m.
    """
    near = _nearest_first(cell, walls)[: settings.walls_first]
    region = _shut_out(cell, walls[near], room)
    normals, offsets = half_planes(without_short_edges(region, ROUNDING))
    left_over = ~np.any(np.all(walls @ normals.T >= offsets - ROUNDING, axis=1), axis=1)
    return region_of(_shut_out(cell, walls[left_over], region) if np.any(left_over) else region)


def _nearest_first(cell: FloatArray, walls: FloatArray) -> IntArray:
    """Walls in the order of a lower bound of their distance to the middle of the cell."""
    middles = walls.mean(axis=1)
    halves = 0.5 * np.linalg.norm(walls[:, 1] - walls[:, 0], axis=1)
    return np.argsort(np.linalg.norm(middles - cell.mean(axis=0), axis=1) - halves, kind="stable")


def _shut_out(cell: FloatArray, walls: FloatArray, region: FloatArray) -> FloatArray:
    """The part of a convex region around the cell that is left when each wall is shut out, nearest first."""
    gaps, on_cell, on_wall = nearest_points(cell, walls)
    inside = np.ones(len(walls), dtype=bool)
    for wall in np.argsort(gaps, kind="stable"):
        if not inside[wall]:
            continue
        # A nearer wall is shut out by an edge line: its nearest point gives no sharp direction.
        if gaps[wall] > SHORTEST:
            normal = (on_wall[wall] - on_cell[wall]) / gaps[wall]
            offset = float(normal @ on_wall[wall])
        else:
            normal, offset = _touching_half_plane(cell, walls[wall], region)
        region = clip(region, normal, offset)
        # Walls that this half-plane shuts out as well need none of their own.
        inside &= np.any(walls @ normal < offset - ROUNDING, axis=1)
        inside[wall] = False
    return region


def nearest_points(cell: FloatArray, walls: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The gap between a convex cell and each wall that does not cross it, and where it is.

    Args:
        cell: vertices, shape (m, 2) [m].
        walls: shape (w, 2, 2) [m].

    Returns:
        Gaps, shape (w,) [m], nearest points of the cell, shape (w, 2) [m], and of the walls, shape (w, 2) [m].
    """
    edges = np.stack((cell, after_each(cell)), axis=1)
    feet_on_walls = nearest_on_segments(cell[:, None], walls[None])  # (m, w, 2)
    feet_on_cell = nearest_on_segments(walls[None], edges[:, None, None])  # (m, w, 2 ends, 2)
    cell_side = np.concatenate(
        (np.broadcast_to(cell[:, None], feet_on_walls.shape), feet_on_cell[:, :, 0], feet_on_cell[:, :, 1])
    )
    wall_ends = np.broadcast_to(walls, (len(cell), *walls.shape))
    wall_side = np.concatenate((feet_on_walls, wall_ends[:, :, 0], wall_ends[:, :, 1]))
    gaps = np.linalg.norm(wall_side - cell_side, axis=2)
    best = np.argmin(gaps, axis=0)
    which = np.arange(len(walls))
    return gaps[best, which], cell_side[best, which], wall_side[best, which]


def _touching_half_plane(cell: FloatArray, wall: FloatArray, region: FloatArray) -> tuple[FloatArray, float]:
    """The half-plane between a cell and a wall that touch which leaves most of the region.

    Two convex sets that do not overlap are separated by the line of an edge of one of them (separating axis
    theorem); squares to the wall at its ends are tried as well. A line along a cell that is a segment would leave one
    side of it only: the last resort.
    """
    normals, offsets = _separators(cell, wall)
    overlap = np.maximum(
        np.max(normals @ cell.T - offsets[:, None], axis=1), np.max(offsets[:, None] - normals @ wall.T, axis=1)
    )
    valid = np.flatnonzero(overlap <= max(ROUNDING, 1.01 * float(overlap.min())))
    room_left = [_area(clip(region, normals[i], float(offsets[i]))) for i in valid]
    one_sided = [bool(np.all(cell @ normals[i] >= offsets[i] - ROUNDING)) for i in valid]
    best = valid[max(range(len(valid)), key=lambda k: (not one_sided[k], room_left[k]))]
    return normals[best], float(offsets[best])


def _separators(cell: FloatArray, wall: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Half-planes (k, 2), (k,) worth trying between a cell (m, 2) and a wall (2, 2)."""
    wall_normals, wall_offsets = half_planes(wall)
    cell_normals, cell_offsets = half_planes(cell)
    squares = wall_normals[:, ::-1] * (-1.0, 1.0)
    normals = np.concatenate((wall_normals, cell_normals, squares))
    return normals, np.concatenate((wall_offsets, cell_offsets, np.sum(squares * wall, axis=1)))


def _area(vertices: FloatArray) -> float:
    return signed_area(vertices) if len(vertices) > 2 else 0.0


def contains(region: ConvexRegion, points: FloatArray, tolerance: float = ROUNDING) -> BoolArray:
    """Which points (..., 2) lie in the region, within ``tolerance`` [m]; shape (...)."""
    return np.asarray(np.all(points @ region.normals.T <= region.offsets + tolerance, axis=-1), dtype=np.bool_)
