"""Rows that keep links clear of walls, and the convex regions about the links' sweeps.

A link at the start, halfway and at the end of an interval spans a convex hull Q. Walls are processed nearest first: the
half-plane across the shortest line from Q to the wall leaves Q inside and the wall outside; walls already behind a
chosen half-plane are skipped (the inflation of Deits and Tedrake 2014, with a polygon for the ellipsoid).

Rows are those of ``interval_rows`` at both ends of an interval. Their deviation is sag_hi − sag_lo, with the chord
deviation sag_j = ⅛ Σ_{i<j} l Δφ_i² over the interval (see ``certificate``). A wall's half-plane n·x ≤ b has P_b = base;
a pair of links i < j has a = j + t, b = i + s, and only the links between them in its chord deviation.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import SHORTEST, BoolArray, FloatArray, IntArray
from ccm_opt.core.native import NativeCall, element_type
from ccm_opt.planning.limits.limit_stack import ContactLimit
from ccm_opt.planning.optimisation.interval_rows import STILL, IntervalRows, joined_rows, pair_rows
from ccm_opt.planning.spline_path import smoothing_matrix
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.scene.walls import WallSegments
from ccm_opt.scene.workspace import Workspace

BEHIND = 1e-9
"""How far a wall may protrude from a half-plane that it counts as behind [m]. Derived: rounding."""
_PLANES = 8
"""Half-planes per sweep for which memory is allocated at first."""


@dataclass(frozen=True)
class HalfPlanes:
    """Half-planes n·x ≤ b, in each of which one link has to stay over one interval.

    Attributes:
        interval: index of the interval, shape (m,).
        link: index of the link, shape (m,).
        normal: n, unit, shape (m, 2).
        bound: b, so that the line n·x = b touches the wall's surface, shape (m,) [m].
    """

    interval: IntArray
    link: IntArray
    normal: FloatArray
    bound: FloatArray

    def take(self, mask: BoolArray) -> "HalfPlanes":
        """Return the half-planes selected by a mask, shape (m,)."""
        return HalfPlanes(self.interval[mask], self.link[mask], self.normal[mask], self.bound[mask])


def sweep_regions(sweep: PlanarSweep, walls: WallSegments, first_link: int, reach: float) -> HalfPlanes:
    """Return the half-planes around the sweep of every link in every interval.

    Args:
        sweep: the motion.
        walls: walls to stay clear of.
        first_link: first link that may not touch walls.
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
    """Return half-planes that separate sweeps of links from walls, sorted by sweep and distance.

    Args:
        corners: ends of each link at three times, shape (m, 6, 2) [m].
        walls: walls to stay clear of.
        far: wall segments farther away than this are left out [m].

    Returns:
        Index of the sweep, unit normal n and bound b of each half-plane, shapes (k,), (k, 2) and (k,) [m]; the sweep
        lies in n·x ≤ b.
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


def _corners(sweep: PlanarSweep, interval: IntArray, link: IntArray) -> FloatArray:
    """Return the ends of links at the start, halfway and at the end of intervals, shape (m, 6, 2) [m]."""
    corners = [
        positions[at, link + end]
        for positions, at in ((sweep.points, interval), (sweep.middles, interval), (sweep.points, interval + 1))
        for end in (0, 1)
    ]
    return np.stack(corners, axis=1)


def motion_rows(sweep: PlanarSweep, contact: ContactLimit, workspace: Workspace) -> IntervalRows:
    """Return the rows that keep a motion clear of walls and links, from free regions around its own sweep.

    Rows at the fixed start demand no margin.

    Args:
        sweep: the motion.
        contact: limit with the margin, the reach beyond which pairs get no rows, and the smooth path's preferred gap.
        workspace: the workspace.
    """
    arm = sweep.space.arm
    margin = contact.finder.margin
    reach = contact.finder.reach
    wanted = contact.wanted
    most = _most_in_gates(sweep, contact)
    planes = sweep_regions(sweep, workspace.wall_segments, sweep.space.arm.mount_end[0], reach)
    kept = margin if most is None else np.minimum(margin, most[planes.interval, planes.link])
    need = np.broadcast_to(arm.radius + workspace.clearance + kept, len(planes.link))
    walls = wall_rows(planes, sweep, need)
    links = pair_rows(sweep, margin, reach)
    if wanted > margin:
        smooth = PlanarSweep(sweep.space, smoothing_matrix(len(sweep.unknowns)) @ sweep.unknowns)
        between = arm.link_margins(links.low, links.high - 1, wanted)
        between -= arm.link_margins(links.low, links.high - 1, margin)
        more = np.full(len(walls), wanted - margin)
        if most is not None:
            # A link that is asked for less than the margin is asked for nothing beyond contact.
            more[most[walls.interval, walls.high - 1] < margin] = -np.inf
        walls = clearance_reward(walls, more, sweep, smooth)
        links = clearance_reward(links, between, sweep, smooth)
    rows = joined_rows([walls, links])

    # The start is given and may be closer than the margin; a margin there could make rows infeasible for good.
    at_start = rows.interval + rows.share == 0.0
    return replace(rows, constant=rows.constant - margin * at_start)


def _most_in_gates(sweep: PlanarSweep, contact: ContactLimit) -> FloatArray | None:
    """Return the maximum gap from walls that is demanded of each link in each interval, shape (K, links) [m].

    None if there are no gates. In gates this maximum is the certificate's spare: an interval has a single slack
    variable, and asking for more than a gate offers would relax all other rows of the interval with it.
    """
    if contact.gates is None:
        return None
    arm = sweep.space.arm
    inside = contact.gates.holds_links(sweep.points[:, : arm.links + 1], arm.radius)
    return np.where(inside[:-1] | inside[1:], contact.certificate.spare, np.inf)


def clearance_reward(rows: IntervalRows, more: FloatArray, sweep: PlanarSweep, smooth: PlanarSweep) -> IntervalRows:
    """Return rows that demand a larger gap of the smooth path rather than of its control polygon.

    A row for contact subtracts the chord deviation, which bounds the motion between two keyframes however the links
    turn. The preferred gap is compared with the actual loss instead: how much closer the smooth path comes than the
    keyframes, at the keyframe and halfway through the interval. The larger of the two demands counts. The loss changes
    little from one step to the next and is treated as constant.

    Args:
        rows: rows for contact.
        more: gap demanded beyond that of the rows, shape (m,) [m].
        sweep: the motion through the keyframes.
        smooth: poses of the smooth path at the keyframes.
    """
    keyframe = rows.interval + rows.share.astype(np.intp)
    beside = smooth.points - sweep.points
    half_way = smooth.half_way - 0.5 * (sweep.points[:-1] + sweep.points[1:])
    at_keyframe = beside[keyframe, rows.plus] - beside[keyframe, rows.minus]
    between = half_way[rows.interval, rows.plus] - half_way[rows.interval, rows.minus]
    loss = np.maximum(np.einsum("md,md->m", rows.normal, at_keyframe), np.einsum("md,md->m", rows.normal, between))
    sag = sweep.sag[rows.interval, rows.high] - sweep.sag[rows.interval, rows.low]
    missing = np.maximum(more + np.maximum(loss, 0.0) - sag, 0.0)
    at_start = keyframe == 0
    return replace(rows, constant=rows.constant + np.where(at_start, 0.0, missing))


def wall_rows(planes: HalfPlanes, sweep: PlanarSweep, need: FloatArray) -> IntervalRows:
    """Return the rows that keep both ends of each link inside its half-planes at both ends of an interval.

    Args:
        planes: the half-planes.
        sweep: the motion.
        need: distance to keep from each half-plane, shape (m,) [m].
    """
    arm = sweep.space.arm
    mounted, share = sweep.space.arm.mount_end
    m = len(planes.link)
    parts = []
    for end in (0, 1):
        # The link on which the mount ends is free only from there on: that point, stored after the joints in
        # ``PlanarSweep.points``, replaces the link's first joint.
        cut = (planes.link == mounted) & (end == 0) & (share > 0.0)
        point = np.where(cut, arm.links + 1, planes.link + end)
        # With a base that cannot move the row would be constant.
        moves = (point > 0) | bool(arm.base_axes)
        # Both ends of the link use the chord deviation of its far end, the larger one, as the certificate does.
        for side in (0, 1):
            rows = IntervalRows(
                planes.interval,
                np.full(m, float(side)),
                point,
                np.full(m, STILL),
                planes.link + 1,
                np.zeros(m, dtype=np.intp),
                planes.normal,
                need - planes.bound,
            )
            parts.append(rows.take(moves))
    return joined_rows(parts)
