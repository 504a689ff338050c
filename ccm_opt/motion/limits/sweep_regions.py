"""Sweep regions: convex free surroundings of what each link sweeps in each interval, as half-planes.

The link at the start, half-way and at the end of the interval spans a convex hull Q. Walls are taken nearest first:
the half-plane across the shortest line from Q to the wall leaves Q inside and the wall outside; walls already behind
a chosen half-plane are skipped (the inflation of Deits and Tedrake 2014, with a polygon for the ellipsoid).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.rounding import SHORTEST
from ccm_opt.motion.limits.compiled_planes import SweptLinks, compiled_planes
from ccm_opt.motion.swept_motion import Sweep

BEHIND = 1e-9
"""By which a wall may stand out of a half-plane that it counts as behind [m]. Derived: rounding."""


@dataclass(frozen=True)
class HalfPlanes:
    """Half-planes n·x ≤ b that one link has to keep within over one interval.

    Attributes:
        interval: shape (m,).
        link: shape (m,).
        normal: n, unit, shape (m, 2).
        bound: b, at the wall's surface, shape (m,) [m].
    """

    interval: IntArray
    link: IntArray
    normal: FloatArray
    bound: FloatArray

    def take(self, mask: BoolArray) -> "HalfPlanes":
        """Those selected by a mask."""
        return HalfPlanes(self.interval[mask], self.link[mask], self.normal[mask], self.bound[mask])


def sweep_regions(sweep: Sweep, walls: WallSegments, first_link: int, reach: float) -> HalfPlanes:
    """Half-planes round the sweep of every link in every interval.

    Args:
        sweep: the motion.
        walls: what to keep away from.
        first_link: links before this one may touch walls.
        reach: walls farther away than this are left out [m].
    """
    intervals = len(sweep.turns)
    links = sweep.space.arm.links
    free = np.arange(first_link, links)
    interval, link = (grid.ravel() for grid in np.meshgrid(np.arange(intervals), free, indexing="ij"))
    corners = _corners(sweep, interval, link)
    far = reach + float(walls.rounding.max())

    halfway = corners[:, 2:4]
    asked = SweptLinks(corners, halfway, walls.ends, walls.rounding, walls.boxes, far, SHORTEST, BEHIND)
    compiled = compiled_planes(asked)
    q, normal, bound = planes_by_numpy(corners, walls, far) if compiled is None else compiled
    return HalfPlanes(interval[q], link[q], normal, bound)


def planes_by_numpy(corners: FloatArray, walls: WallSegments, far: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Half-planes about sweeps, by sweep and distance, where there is no compiler; arguments as ``SweptLinks``."""
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


def _corners(sweep: Sweep, interval: IntArray, link: IntArray) -> FloatArray:
    """Ends of the links at the start, half-way and at the end of the intervals, shape (m, 6, 2) [m]."""
    corners = [
        positions[at, link + end]
        for positions, at in ((sweep.points, interval), (sweep.middles, interval), (sweep.points, interval + 1))
        for end in (0, 1)
    ]
    return np.stack(corners, axis=1)


def _directions(
    halfway: FloatArray, hulls: FloatArray, walls: WallSegments, q: IntArray, wall: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Unit directions from hulls to walls along their shortest lines, and their lengths less the rounding.

    A hull that meets a wall gives way to the link half-way through the interval.
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
    """Indices of the half-planes that are kept, all hulls at once; the pairs come sorted by hull and distance."""
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
