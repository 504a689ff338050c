"""Clearance from the walls, taken apart into edges, at all times."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.length_words import short_length
from ccm_opt.problem.solution import Check, NearPlace
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

from .gap_proof import Nearest, Pairs, Verdict, least_allowed_gap, prove_apart
from .link_motion import ChainMotion, Nodes, unit_rows
from .rounding import distance_rounding
from .selfcollision import segment_distances

_ALONG = 1e-6
"""Sine of the angle to the way of the base up to which a link lies along it. Heuristic: over the way between two
samples it goes aside by far less than any tolerance of contact."""

_MANY_EDGES = 64
"""Walls with as many edges are looked at in runs of them first. Heuristic."""
_EDGES_A_RUN = 16
"""Edges in a run. Heuristic: their chord is near all of them, and few runs are near the arm."""


@dataclass(frozen=True)
class Boxes:
    """Boxes with sides along the axes.

    Attributes:
        low: shape (B, 2) [m].
        high: shape (B, 2) [m].
    """

    low: FloatArray
    high: FloatArray

    @classmethod
    def around(cls, start: FloatArray, end: FloatArray, radius: FloatArray) -> "Boxes":
        """Boxes around segments swept by discs; start and end of shape (B, 2), radius of shape (B,) [m]."""
        grow = radius[:, None]
        return cls(np.minimum(start, end) - grow, np.maximum(start, end) + grow)

    def tree(self) -> shapely.STRtree:
        """Spatial index of the boxes."""
        return shapely.STRtree(shapely.box(self.low[:, 0], self.low[:, 1], self.high[:, 0], self.high[:, 1]))

    def in_groups(self, width: int, first: IntArray) -> "Boxes":
        """Boxes around several rows each, column by column.

        Args:
            width: boxes in a row.
            first: the first row of each group, shape (G,).

        Returns:
            One box for each group and column, G * width in all.
        """
        low, high = (bound.reshape(-1, width, 2) for bound in (self.low, self.high))
        grown = Boxes(np.minimum.reduceat(low, first), np.maximum.reduceat(high, first))
        return Boxes(grown.low.reshape(-1, 2), grown.high.reshape(-1, 2))


@dataclass(frozen=True)
class WallEdges:
    """The walls taken apart into straight edges; a circle's centre is an edge of no length.

    Attributes:
        start: shape (E, 2) [m].
        end: shape (E, 2) [m].
        rounding: radius of the disc that sweeps the edge, shape (E,) [m].
        owner: number of the wall an edge belongs to, shape (E,).
        names: of the walls.
    """

    start: FloatArray
    end: FloatArray
    rounding: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @cached_property
    def size(self) -> float:
        """What no coordinate of the walls exceeds [m]."""
        return float(max(np.max(np.abs(self.start), initial=0.0), np.max(np.abs(self.end), initial=0.0)))

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the edges' boxes, each grown by its rounding."""
        return Boxes.around(self.start, self.end, self.rounding).tree()

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the edges themselves."""
        return _line_tree(self.start, self.end)

    @cached_property
    def runs(self) -> "EdgeRuns":
        """Runs of edges that follow each other along a wall."""
        return edge_runs(self)


@dataclass(frozen=True)
class EdgeRuns:
    """Runs of edges of walls with very many, each as its chord swept by a disc that contains them; else single edges.

    Attributes:
        first: number of each run's first edge, shape (R + 1,), the number of edges at its end.
        start: of the chord, shape (R, 2) [m].
        end: of the chord, shape (R, 2) [m].
        radius: of the disc, roundings of the edges included, shape (R,) [m].
    """

    first: IntArray
    start: FloatArray
    end: FloatArray
    radius: FloatArray

    @cached_property
    def boxes(self) -> Boxes:
        """The runs' boxes, each grown by its radius."""
        return Boxes.around(self.start, self.end, self.radius)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the boxes."""
        return self.boxes.tree()

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the chords."""
        return _line_tree(self.start, self.end)

    def edges_of(self, runs: IntArray) -> tuple[IntArray, IntArray]:
        """All edges of some runs, shape (k,): each edge's place in ``runs``, and its number; each of shape (m,)."""
        place, within = _numbered(self.first[runs + 1] - self.first[runs])
        return place, self.first[runs][place] + within

    def meeting(self, boxes: Boxes, width: int, rows: int) -> tuple[IntArray, IntArray]:
        """Pairs of a box and a run whose boxes meet.

        Args:
            boxes: row after row; those of a column hardly move from one row to the next.
            width: boxes in a row.
            rows: how many the tree is asked for at once.

        Returns:
            Numbers of the boxes and of the runs, each of shape (m,).
        """
        count = len(boxes.low) // width
        first = np.arange(0, count, rows)
        groups = boxes.in_groups(width, first)
        # The tree asks for boxes alone, and a diagonal, which is made sooner, has the same box as its rectangle.
        found, run = self.tree.query(shapely.linestrings(np.stack((groups.low, groups.high), axis=1)))
        group, column = np.divmod(found, width)
        place, within = _numbered(np.minimum(rows, count - first[group]))
        box = (first[group][place] + within) * width + column[place]
        run = run[place]
        apart = (boxes.low[box] > self.boxes.high[run]) | (boxes.high[box] < self.boxes.low[run])
        meets = ~np.any(apart, axis=1)
        return box[meets], run[meets]


def _numbered(counts: IntArray) -> tuple[IntArray, IntArray]:
    """So many things of each of several kinds: each one's kind, and its number among its kind; each of shape (m,)."""
    kind = np.repeat(np.arange(len(counts)), counts)
    return kind, np.arange(len(kind)) - np.repeat(np.cumsum(counts) - counts, counts)


def _line_tree(start: FloatArray, end: FloatArray) -> shapely.STRtree:
    return shapely.STRtree(np.asarray(shapely.linestrings(np.stack((start, end), axis=1))))


def edge_runs(edges: WallEdges) -> EdgeRuns:
    """Walls with many edges in runs, all others edge by edge."""
    number = np.arange(len(edges.owner))
    begins = np.flatnonzero(np.diff(edges.owner, prepend=-1))
    count = np.diff([*begins, len(number)])
    place = number - np.repeat(begins, count)
    length = np.where(np.repeat(count, count) >= _MANY_EDGES, _EDGES_A_RUN, 1)
    # A ring's last edge and the next ring's first one need not meet: a run ends there.
    broken = np.concatenate(([True], np.any(edges.start[1:] != edges.end[:-1], axis=1)))
    first = np.flatnonzero((place % length == 0) | (broken & (length > 1)))
    last = np.append(first[1:], len(number)) - 1
    start = edges.start[first]
    end = edges.end[last]
    # Distance from a segment is convex, so that no point of an edge is farther from the chord than the edge's ends.
    run = np.repeat(np.arange(len(first)), last - first + 1)
    away = segment_distances(edges.end, edges.end, start[run], end[run]) * (number != last[run])
    sag = np.zeros(len(first))
    np.maximum.at(sag, run, away)
    spare = np.where(last > first, distance_rounding(edges.size), 0.0)
    return EdgeRuns(np.append(first, len(number)), start, end, sag + spare + edges.rounding[first])


def wall_edges(workspace: Workspace) -> WallEdges:
    """The edges of everything the arm must keep away from."""
    walls = workspace.walls
    pieces = [np.concatenate([_edges_of(part) for part in shapely.get_parts(wall.core)]) for wall in walls]
    counts = [len(piece) for piece in pieces]
    edges = np.concatenate(pieces)
    rounding = np.repeat([wall.rounding for wall in walls], counts)
    return WallEdges(
        edges[:, 0], edges[:, 1], rounding, np.repeat(np.arange(len(walls)), counts), tuple(wall.name for wall in walls)
    )


def _edges_of(part: shapely.Geometry) -> FloatArray:
    """Edges of a polygon, line or point, shape (E, 2, 2) [m]."""
    if isinstance(part, shapely.Polygon):
        return np.concatenate([_edges_of(ring) for ring in (part.exterior, *part.interiors)])
    points = shapely.get_coordinates(part)
    if len(points) == 1:  # the centre of a circle
        return np.repeat(points[None], 2, axis=1)
    return np.stack((points[:-1], points[1:]), axis=1)


_WALL_PROBES = 48
"""Poses at which the nearest wall is looked up first, to know how far the search must look. Heuristic."""
_ROWS_AT_ONCE = 16
"""Poses that follow each other whose links are looked for near walls together first. Measured: with 16 the search takes
half the time that it takes pose by pose, and hardly less with more."""

TOUCHING = 1e-4
"""Share of the radius by which a gap may differ from none that is told as a touch."""


def check_walls(
    motion: ChainMotion, workspace: Workspace, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> Check:
    """Check that the arm beyond its mount keeps the clearance from every wall at all times."""
    found = nearest_wall(motion, workspace, settings)
    if found is None:
        return Check(
            "wall clearance", np.inf, workspace.clearance, "m", "the whole arm counts as its mount", passed=True
        )
    verdict, wall = found
    near = verdict.nearest
    remark = verdict.remark or touch_beside_mount(motion.arm, near.link, near.gap)
    # What a flush mount touches hides all that comes near the links beyond.
    if not verdict.remark and remark and (beyond := nearest_wall(motion, workspace, settings, near.link + 1)):
        remark += gap_beyond(beyond[0].nearest.gap, beyond[1])
    where = f"link {near.link + 1} to {wall!r} at t = {near.time:.4f} s"
    return Check(
        "wall clearance",
        near.gap,
        workspace.clearance,
        "m",
        f"{where}: {remark}" if remark else where,
        passed=verdict.proved,
        place=NearPlace(near.gap - workspace.clearance, 0.0, near.time, near.link + 1, obstacle=wall),
    )


def nearest_wall(
    motion: ChainMotion,
    workspace: Workspace,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
    first: int = 0,
) -> tuple[Verdict, str] | None:
    """Whether the arm keeps the clearance from every wall, with the nearest approach and the name of its wall.

    None when the whole arm counts as its mount, so that there is nothing to keep away. Links before the first, counted
    from 0, are not looked at.
    """
    edges = wall_edges(workspace)
    exposed = exposed_starts(motion.arm)
    exposed[:first] = 1.0
    if not np.any(exposed < 1.0):
        return None
    least = least_allowed_gap(workspace.clearance, motion.arm.radius, settings)
    verdict = _prove(motion, edges, exposed, least, settings)
    return verdict, edges.names[edges.owner[verdict.nearest.other]]


def exposed_starts(arm: Arm) -> FloatArray:
    """Share of each link that belongs to the mount and may touch walls, shape (links,); 1 for a whole link.

    ``Arm.mount_end`` says where it ends; the verifier reckons for itself, on purpose.
    """
    return np.clip(arm.mount_length / arm.link_length - np.arange(arm.links), 0.0, 1.0)


def touch_beside_mount(arm: Arm, link: int, gap: float) -> str:
    """Say of a link that touches a wall [m] that it is the one that leaves the mount; empty where it is not."""
    leaves = link == int(arm.mount_length // arm.link_length)
    return "touches it where it leaves the mount" if leaves and abs(gap) <= TOUCHING * arm.radius else ""


def gap_beyond(gap: float, wall: str) -> str:
    """Say the least gap [m] of the links beyond the one that touches beside the mount."""
    return f"; links beyond it keep {short_length(gap)} from {wall!r}"


def _prove(
    motion: ChainMotion, edges: WallEdges, exposed: FloatArray, least: float, settings: VerificationSettings
) -> Verdict:
    arm = motion.arm
    links = np.flatnonzero(exposed < 1.0)
    lost = motion.rounding + distance_rounding(max(motion.size, edges.size))

    def evaluate(nodes: Nodes, pairs: Pairs, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        interval = nodes.interval[pairs.node]
        start, end = _axis(poses, pairs.node, pairs.link, exposed)
        # A point moves with all links up to its own, so their turns add up; the first entry is what carries the base.
        travel = nodes.half[pairs.node] * arm.link_length * motion.turned[interval, pairs.link + 1]
        # A link that slides along itself sweeps a longer one, and goes aside by next to nothing.
        aslant = motion.aslant[interval, pairs.link]
        carried = np.where(aslant <= _ALONG, nodes.half[pairs.node] * motion.carried_by[interval], 0.0)
        ahead = carried[:, None] * unit_rows(end - start)
        start = start - ahead
        end = end + ahead
        travel -= carried * (1.0 - aslant)
        distance = segment_distances(start, end, edges.start[pairs.other], edges.end[pairs.other])
        thick = edges.rounding[pairs.other] + arm.radius + motion.off[interval, pairs.link]
        return distance - thick - lost, travel

    nodes = motion.whole
    poses = motion.poses(nodes)
    nearest = _probe(motion, edges, exposed, links, poses, _WALL_PROBES)
    # Walls that are farther away than this at the middle of an interval come no nearer than the nearest known one.
    travel = 0.5 * arm.link_length * motion.turned[:, links + 1] + motion.off[:, links]
    look = arm.radius + travel + max(least, min(nearest.gap, max(least, 0.0) + arm.link_length)) + 2.0 * lost
    pairs = _candidates(poses, edges, exposed, links, look)
    return prove_apart(motion, pairs, evaluate, least, nearest, settings)


def _axis(poses: FloatArray, node: IntArray, link: IntArray, exposed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of the exposed part of the links' axes, each shape (P, 2) [m]."""
    start = poses[node, link]
    end = poses[node, link + 1]
    return start + exposed[link, None] * (end - start), end


def _candidates(
    poses: FloatArray,
    edges: WallEdges,
    exposed: FloatArray,
    links: IntArray,
    look: FloatArray,
) -> Pairs:
    """Pairs whose boxes come within ``look``, shape (N, exposed links) [m], at the middle of an interval."""
    node, link = (index.ravel() for index in np.indices(look.shape))
    start, end = _axis(poses, node, links[link], exposed)
    grow = look.reshape(-1, 1)
    boxes = Boxes(np.minimum(start, end) - grow, np.maximum(start, end) + grow)
    # Boxes decide quickly and err on the safe side: a pair too many costs time, a missing one would break the proof.
    runs = edges.runs
    found, run = runs.meeting(boxes, look.shape[1], _ROWS_AT_ONCE)
    # Where runs are long their chords decide again, before all of their edges are looked at.
    long = runs.first[run + 1] - runs.first[run] > 1
    gap = segment_distances(start[found[long]], end[found[long]], runs.start[run[long]], runs.end[run[long]])
    near = np.ones(len(run), dtype=bool)
    near[long] = gap - runs.radius[run[long]] <= grow[found[long], 0]
    found = found[near]
    place, other = runs.edges_of(run[near])
    item = found[place]
    return Pairs(node[item], links[link[item]], other)


def _probe(
    motion: ChainMotion, edges: WallEdges, exposed: FloatArray, links: IntArray, poses: FloatArray, probes: int
) -> Nearest:
    """The nearest wall at a few poses spread over the motion: no proof, but a bound on the least gap."""
    count = len(poses)
    chosen = np.unique(np.linspace(0, count - 1, min(probes, count)).astype(int))
    node = np.repeat(chosen, len(links))
    link = np.tile(links, len(chosen))
    start, end = _axis(poses, node, link, exposed)
    # Roundings differ from wall to wall, so the nearest chord need not be the nearest wall: a bound is all it gives.
    runs = edges.runs
    near, run = runs.lines.query_nearest(shapely.linestrings(np.stack((start, end), axis=1)), all_matches=False)
    place, other = runs.edges_of(run)
    found = near[place]
    distance = segment_distances(start[found], end[found], edges.start[other], edges.end[other])
    gap = distance - edges.rounding[other] - motion.arm.radius
    best = int(np.argmin(gap))
    item = found[best]
    when = motion.when(motion.whole, int(node[item]))
    return Nearest(float(gap[best]), int(link[item]), int(other[best]), when)


def check_free_side(motion: ChainMotion, workspace: Workspace) -> Check:
    """Check that the arm lies inside the room and outside the obstacles.

    One point decides: an arm that never meets an edge cannot change sides, neither along itself nor over time.

    Returns:
        The check, its worst value the depth of that point in forbidden space, negated [m].
    """
    arm = motion.arm
    joints = motion.poses(Nodes(np.array([0]), np.zeros(1), np.zeros(1)))[0]
    # The point where the mount ends: what lies before it may be inside a wall.
    k = min(int(arm.mount_length // arm.link_length), arm.links - 1)
    share = min(arm.mount_length / arm.link_length - k, 1.0)
    point = shapely.points(joints[k] + share * (joints[k + 1] - joints[k]))
    walls = workspace.walls
    depths = [*(_depth(wall.core, point) for wall in workspace.obstacles), _depth_outside(workspace.boundary, point)]
    worst = int(np.argmax(depths))
    side = f", on the wrong side of {walls[worst].name!r}" if depths[worst] > 0.0 else ""
    return Check(
        "free side", 0.0 - depths[worst], 0.0, "m", f"link {k + 1} at t = 0{side}", passed=depths[worst] <= 0.0
    )


def _depth(core: shapely.Geometry, point: shapely.Point) -> float:
    # On the boundary itself the depth is 0, which is allowed: the clearance is checked elsewhere.
    inside = bool(shapely.contains_properly(core, point))
    return float(shapely.distance(shapely.boundary(core), point)) if inside else 0.0


def _depth_outside(room: shapely.Polygon, point: shapely.Point) -> float:
    return float(shapely.distance(room, point))
