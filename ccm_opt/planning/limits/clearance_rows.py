"""Linearised constraints (rows) that keep links of a planar arm clear of walls, from convex regions around their sweep.

A link at the start, halfway and at the end of an interval spans a convex hull Q. Walls are processed nearest first: the
half-plane across the shortest line from Q to the wall leaves Q inside and the wall outside; walls already behind a
chosen half-plane are skipped (the inflation of Deits and Tedrake 2014, with a polygon for the ellipsoid).

Rows are those of ``interval_rows`` at both ends of an interval. Their deviation is sag_hi − sag_lo, with the chord
deviation sag_j = ⅛ Σ_{i<j} l Δφ_i² of joint j over the interval (see ``certificate``): how far the joint may leave the
straight line between its positions at both ends. For a half-plane n·x ≤ b of a wall, P_b is the fixed point; a pair of
links i < j has a = j + t, b = i + s for the link ends s and t, and only the links in between count in its deviation.
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
"""Distance by which a wall may protrude through the boundary of a half-plane and still count as outside [m]. Derived:
rounding."""
_PLANES = 8
"""Number of half-planes per swept link for which memory is allocated at first."""


@dataclass(frozen=True)
class HalfPlanes:
    """Half-planes n·x ≤ b, in each of which one link has to stay over one interval of a motion.

    Attributes:
        interval: index of the interval, shape (m,).
        link: index of the link, shape (m,).
        normal: outward unit normal n, shape (m, 2).
        bound: bound b, for which the line n·x = b touches the surface of a wall, shape (m,) [m].
    """

    interval: IntArray
    link: IntArray
    normal: FloatArray
    bound: FloatArray

    def take(self, mask: BoolArray) -> "HalfPlanes":
        """Return the half-planes selected by a mask, shape (m,)."""
        return HalfPlanes(self.interval[mask], self.link[mask], self.normal[mask], self.bound[mask])


def sweep_regions(sweep: PlanarSweep, walls: WallSegments, first_link: int, reach: float) -> HalfPlanes:
    """Return the half-planes that separate the sweep of every link in every interval of a motion from walls.

    Args:
        sweep: the motion.
        walls: segments of the walls.
        first_link: index of the first link that may not touch walls.
        reach: distance beyond which walls are left out [m].
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
        walls: segments of the walls.
        far: distance beyond which wall segments are left out [m].

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
    """Return both ends of links at the start, halfway and at the end of intervals of a motion, shape (m, 6, 2) [m].

    ``interval`` and ``link`` are the indices of the m pairs, each of shape (m,).
    """
    corners = [
        positions[at, link + end]
        for positions, at in ((sweep.points, interval), (sweep.middles, interval), (sweep.points, interval + 1))
        for end in (0, 1)
    ]
    return np.stack(corners, axis=1)


def motion_rows(sweep: PlanarSweep, contact: ContactLimit, workspace: Workspace) -> IntervalRows:
    """Return linearised constraints (rows) that keep a planar arm clear of walls and of itself over a whole motion.

    Links stay in convex free regions around their own sweep. At the fixed start no margin is required.

    Args:
        sweep: the motion.
        contact: limit with the margin, the search distance beyond which pairs of bodies are left out, and the preferred
            gap of the smooth path.
        workspace: workspace with the walls.
    """
    arm = sweep.space.arm
    margin = contact.finder.margin
    reach = contact.finder.reach
    wanted = contact.wanted
    most = _most_in_gates(sweep, contact)
    planes = sweep_regions(sweep, workspace.wall_segments, sweep.space.arm.mount_end[0], reach)
    kept = margin if most is None else np.minimum(margin, most[planes.interval, planes.link])
    need = arm.radii[planes.link] + workspace.clearance + kept
    walls = wall_rows(planes, sweep, need)
    links = pair_rows(sweep, margin, reach)
    if wanted > margin:
        smooth = PlanarSweep(sweep.space, smoothing_matrix(len(sweep.unknowns)) @ sweep.unknowns)
        between = arm.link_margins(links.low, links.high - 1, wanted)
        between -= arm.link_margins(links.low, links.high - 1, margin)
        more = np.full(len(walls), wanted - margin)
        if most is not None:
            # A link that needs less than the margin needs nothing beyond contact.
            more[most[walls.interval, walls.high - 1] < margin] = -np.inf
        walls = clearance_reward(walls, more, sweep, smooth)
        links = clearance_reward(links, between, sweep, smooth)
    rows = joined_rows([walls, links])

    # The start is given and may be closer than the margin; a margin there could make rows infeasible for good.
    at_start = rows.interval + rows.share == 0.0
    return replace(rows, constant=rows.constant - margin * at_start)


def _most_in_gates(sweep: PlanarSweep, contact: ContactLimit) -> FloatArray | None:
    """Return upper bounds on the gap from walls that constraints require of links in intervals, (K, links) [m].

    The bound is ∞ except in narrow gates, where it is the certified gap: an interval has a single slack variable, and
    demanding more than a gate offers would relax all other rows of the interval too. The result is None without gates.
    """
    if contact.gates is None:
        return None
    arm = sweep.space.arm
    inside = contact.gates.holds_links(sweep.points[:, : arm.links + 1], arm.radii)
    return np.where(inside[:-1] | inside[1:], contact.certificate.spare, np.inf)


def clearance_reward(rows: IntervalRows, more: FloatArray, sweep: PlanarSweep, smooth: PlanarSweep) -> IntervalRows:
    """Return contact constraints (rows) tightened so that the smooth path through the keyframes has a larger gap too.

    A row against contact subtracts the chord deviation, which bounds the motion between two keyframes however the links
    turn. For the larger gap only the actual loss is subtracted: how much closer than the keyframes the smooth path
    comes, at the keyframe and halfway through the interval. The stricter of the two requirements is used. The loss
    changes little from one step to the next and is treated as constant.

    Args:
        rows: linearised constraints against contact.
        more: gap required beyond that of the rows, shape (m,) [m].
        sweep: motion through the keyframes.
        smooth: poses of the smooth path at the keyframes.
    """
    keyframe = rows.interval + rows.share.astype(np.intp)
    beside = smooth.points - sweep.points
    half_way = smooth.half_way - 0.5 * (sweep.points[:-1] + sweep.points[1:])
    at_keyframe = beside[keyframe, rows.plus] - beside[keyframe, rows.minus]
    between = half_way[rows.interval, rows.plus] - half_way[rows.interval, rows.minus]
    loss = np.maximum(np.einsum("md,md->m", rows.normal, at_keyframe), np.einsum("md,md->m", rows.normal, between))
    chord_deviation = sweep.chord_deviation[rows.interval, rows.high] - sweep.chord_deviation[rows.interval, rows.low]
    missing = np.maximum(more + np.maximum(loss, 0.0) - chord_deviation, 0.0)
    at_start = keyframe == 0
    return replace(rows, constant=rows.constant + np.where(at_start, 0.0, missing))


def wall_rows(planes: HalfPlanes, sweep: PlanarSweep, need: FloatArray) -> IntervalRows:
    """Return linearised constraints (rows) that keep both ends of links in half-planes at both ends of intervals.

    Args:
        planes: the half-planes, each for one link and interval.
        sweep: the motion.
        need: distance to keep from the boundary of each half-plane, shape (m,) [m].
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
