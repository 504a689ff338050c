"""Separating half-planes between swept links and walls, by NumPy and shapely."""

from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import SHORTEST, FloatArray, IntArray
from ccm_opt.planning.limits.clearance_rows import BEHIND
from ccm_opt.scene.walls import WallSegments


def planes_by_numpy(corners: FloatArray, walls: WallSegments, far: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return half-planes between sweeps and walls, sorted by sweep and distance; arguments as ``free_half_planes``."""
    # A disc about each sweep first: hulls are costly to build, and many links are far from every wall.
    centres = corners.mean(axis=1)
    extents = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    near = np.unique(walls.tree.query(shapely.points(centres), predicate="dwithin", distance=far + extents)[0])

    # All walls within reach of the hulls, and for each the half-plane across the shortest line to it.
    hulls: Any = shapely.convex_hull(shapely.multipoints(corners[near]))
    q, wall = walls.tree.query(hulls, predicate="dwithin", distance=far)
    normal, gap = _directions(corners[near, 2:4], hulls, walls, q, wall)
    # b = min n·x over the wall, less its rounding: the half-plane touches the wall, and none of the wall is inside.
    least = np.einsum("mid,md->mi", walls.ends[wall], normal).min(axis=1) - walls.rounding[wall]

    # lexsort sorts by its last key first: by hull, and within a hull by distance; walls that it touches by number.
    order = np.lexsort((wall, gap, q))
    chosen = _nearest_first(q[order], normal[order], walls.ends[wall[order]], walls.rounding[wall[order]], least[order])
    kept = order[np.sort(chosen)]
    return near[q[kept]], normal[kept], least[kept]


def _directions(
    halfway: FloatArray, hulls: FloatArray, walls: WallSegments, q: IntArray, wall: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors along the shortest lines from hulls to walls, and the lines' lengths minus the rounding.

    For a hull that intersects a wall, the link at the middle of the interval is used instead.
    """
    lines: Any = shapely.shortest_line(hulls[q], walls.tree.geometries[wall])
    # The hull of the three poses is wider than the sweep at a bend and may touch a wall that the link clears; the
    # shortest line then has no direction.
    touching = shapely.length(lines) < SHORTEST
    lines[touching] = shapely.shortest_line(
        shapely.linestrings(halfway[q[touching]]), walls.tree.geometries[wall[touching]]
    )

    ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    gap = np.where(touching, 0.0, length) - walls.rounding[wall]
    return along / np.maximum(length, 1e-12)[:, None], gap


def _nearest_first(
    q: IntArray, normal: FloatArray, ends: FloatArray, rounding: FloatArray, bound: FloatArray
) -> IntArray:
    """Return indices of the half-planes that are kept, for pairs of hull and wall sorted by hull and distance."""
    waiting = np.arange(len(q))
    kept: list[IntArray] = []
    # Each pass keeps the nearest waiting wall of every hull and drops the walls that lie wholly beyond its half-plane;
    # the number of passes is the largest number of half-planes about one hull, not the number of hulls.
    while len(waiting):
        _, first, group = np.unique(q[waiting], return_index=True, return_inverse=True)
        kept.append(waiting[first])
        chosen = waiting[first][group]
        beyond = np.einsum("mid,md->mi", ends[waiting], normal[chosen]).min(axis=1) - rounding[waiting]
        waiting = waiting[(beyond < bound[chosen] - BEHIND) & (waiting != chosen)]
    return np.concatenate(kept) if kept else np.zeros(0, dtype=np.intp)
