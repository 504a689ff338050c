"""Sweep regions: convex free surroundings of what each link sweeps in each interval, as half-planes.

The link at the start, half-way and at the end of the interval spans a convex hull Q. Walls are taken nearest first:
the half-plane across the shortest line from Q to the wall leaves Q inside and the wall outside; walls already behind
a chosen half-plane are skipped (the inflation of Deits and Tedrake 2014, with a polygon for the ellipsoid).
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.ground.native import NativeCall, element_type
from ccm_opt.ground.rounding import SHORTEST
from ccm_opt.motion.swept_motion import Sweep

BEHIND = 1e-9
"""By which a wall may stand out of a half-plane that it counts as behind [m]. Derived: rounding."""
_PLANES = 8
"""Half-planes about a sweep that there is room for at first."""


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

    q, normal, bound = free_half_planes(corners, walls, far)
    return HalfPlanes(interval[q], link[q], normal, bound)


def free_half_planes(corners: FloatArray, walls: WallSegments, far: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """The sweep, the unit normal and the bound of every half-plane, by sweep and distance.

    Args:
        corners: ends of each link at three times, shape (m, 6, 2) [m].
        walls: what to keep away from.
        far: segments farther away are left out [m].

    Returns:
        Shapes (k,), (k, 2) and (k,) [m]; n·x ≤ b is on the sweep's side.
    """
    call = NativeCall(
        "sweep_planes",
        sweeps=len(corners), corners=corners, halfway=corners[:, 2:4], tree=walls.boxes.for_c(), ends=walls.ends,
        rounding=walls.rounding, far=far, shortest=SHORTEST, behind=BEHIND,
        planes=np.empty(len(walls.ends), dtype=element_type("sweep_planes", "planes")),
    )  # fmt: skip
    capacity = _PLANES * len(corners)
    while True:
        sweep = np.empty(capacity, dtype=np.int64)
        normal = np.empty((capacity, 2))
        bound = np.empty(capacity)
        call.set(capacity=capacity, sweep=sweep, normal=normal, bound=bound)
        call()
        count = call.fields.count
        if count <= capacity:
            return sweep[:count], normal[:count], bound[:count]
        capacity = count


def _corners(sweep: Sweep, interval: IntArray, link: IntArray) -> FloatArray:
    """Ends of the links at the start, half-way and at the end of the intervals, shape (m, 6, 2) [m]."""
    corners = [
        positions[at, link + end]
        for positions, at in ((sweep.points, interval), (sweep.middles, interval), (sweep.points, interval + 1))
        for end in (0, 1)
    ]
    return np.stack(corners, axis=1)
