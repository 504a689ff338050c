"""Errors that a planar plan survives, cases of its walls, and the tube that the arm may sweep with them.

Where the room about a corner spans less than half a turn, as in the corners of a room seen from inside, a link whose
axis is nearest to the corner in its own middle is nearer still to one of the two edges that meet there: the one at
less than a right angle to the shortest line. The nearest points of that edge and the link involve another end of
either, so a first touch is never at such a corner alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.selfcollision import first_distant, segment_distances
from ccm_opt.verification.stretch_proof import Pairs
from ccm_opt.verification.tolerance.chain_cases import ChainCases, chain_support, joined_cases, worst_errors
from ccm_opt.verification.tolerance.error_model import (
    DEFAULT_TOLERANCE,
    MODELS,
    ErrorModel,
    ToleranceSettings,
    largest_error,
)
from ccm_opt.verification.tolerance.largest_error import LargestError, Limiting, LinkCases
from ccm_opt.verification.tolerance.levers import survived_by_levers
from ccm_opt.verification.tolerance.moving_chain import MovingChain
from ccm_opt.verification.wall_clearance import edges_of, exposed_starts

_STRIDE = 0.4
"""No point of the arm travels farther between the samples that are looked at first than this many link lengths.
Measured on the problems of the package: with a quarter of it fed arms take two to three times as long, and more gains
nothing."""
_PROBES = 64
"""Poses at which the nearest wall of every link, and all pairs of links, are looked up first. Taste."""


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
    def tree(self) -> shapely.STRtree:
        """Spatial index of the edges' boxes, each grown by its rounding."""
        grow = self.rounding[:, None]
        low = np.minimum(self.start, self.end) - grow
        high = np.maximum(self.start, self.end) + grow
        return shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))

    @cached_property
    def lines(self) -> shapely.STRtree:
        """Spatial index of the edges themselves."""
        return shapely.STRtree(np.asarray(shapely.linestrings(np.stack((self.start, self.end), axis=1))))


def wall_edges(workspace: Workspace) -> WallEdges:
    """The edges of everything the arm must keep away from."""
    edges, rounding, owner, names = edges_of(workspace)
    return WallEdges(edges[:, 0], edges[:, 1], rounding, owner, names)


@dataclass(frozen=True)
class WallCases:
    """Makes cases of an arm among walls.

    Attributes:
        chain: the arm.
        edges: of the walls.
        clearance: to keep from them [m].
        hidden: which ends of the edges are corners that no link can touch alone, shape (E, 2).
    """

    chain: MovingChain
    edges: WallEdges
    clearance: float
    hidden: BoolArray

    @cached_property
    def _exposed(self) -> FloatArray:
        return exposed_starts(self.chain.arm)

    @cached_property
    def _links(self) -> IntArray:
        return np.flatnonzero(self._exposed < 1.0)

    @cached_property
    def _apart(self) -> FloatArray:
        return self.edges.rounding + self.chain.arm.radius + self.clearance

    def nearest(self, probes: int) -> ChainCases:
        """Those of the nearest edge to every link at some poses spread over the motion, for whole intervals."""
        count = len(self.chain)
        chosen = np.unique(np.linspace(0, count - 1, min(probes, count)).astype(int))
        interval = np.repeat(chosen, len(self._links))
        link = np.tile(self._links, len(chosen))
        start, end = self._axes(interval, link)
        lines = shapely.linestrings(np.stack((start, end), axis=1))
        (found, edge), _ = self.edges.lines.query_nearest(lines, return_distance=True, all_matches=False)
        return self.cases(Pairs(interval[found], link[found], edge))

    def within(self, error: float) -> Pairs:
        """All that an error of some size might bring together; the others are proved apart by their distance alone."""
        count = len(self.chain)
        interval = np.repeat(np.arange(count), len(self._links))
        link = np.tile(self._links, count)
        look = self._look(error)[interval, link]
        start, end = self._axes(interval, link)
        grow = (look + self.chain.arm.radius + self.clearance)[:, None]
        low = np.minimum(start, end) - grow
        high = np.maximum(start, end) + grow
        found, edge = self.edges.tree.query(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
        # Boxes decide quickly, the distances of what they leave exactly.
        distance = segment_distances(start[found], end[found], self.edges.start[edge], self.edges.end[edge])
        near = distance - self._apart[edge] < look[found]
        return Pairs(interval[found[near]], link[found[near]], edge[near])

    def _look(self, error: float) -> FloatArray:
        """How far points of links may be from their places half-way, under errors, shape (N, links) [m].

        An error at one joint after the other, the first one first, moves a point on a circle about that joint by at
        most the error times the radius; the radii grow at most by what the arm travels.
        """
        points = self.chain.middles
        turns = self.chain.model.turns
        base = np.linalg.norm(points - self.chain.arm.base, axis=2) * turns[0]
        radii = np.linalg.norm(points[:, :, None] - points[:, None, :-1], axis=3)
        before = np.tri(points.shape[1], points.shape[1] - 1, -1)
        of_point = base + np.sum(radii * before * turns[1:], axis=2)
        farther = np.maximum(of_point[:, :-1], of_point[:, 1:])
        steady = self.chain.model.stretch * np.arange(1, len(turns)) + self.chain.model.moves_base
        travel = self.chain.travel[:, 1:]
        return np.asarray(travel * (1.0 + error * np.sum(turns)) + error * (farther + steady))

    def _axes(self, interval: IntArray, link: IntArray) -> tuple[FloatArray, FloatArray]:
        """Ends of the exposed part of links half-way through intervals, each of shape (m, 2) [m]."""
        start = self.chain.middles[interval, link]
        end = self.chain.middles[interval, link + 1]
        return start + self._exposed[link, None] * (end - start), end

    def cases(self, pairs: Pairs) -> ChainCases:
        """Both kinds of cases for links near edges, over whole intervals."""
        interval = pairs.stretch
        link = pairs.link
        edge = pairs.other
        first = link == self._links[0]
        start = ~self.hidden[edge, 0]
        end = ~self.hidden[edge, 1]
        return joined_cases(
            [
                self._joints(interval, link, edge, np.ones(len(link))),
                # The near end of a link is the far end of the one before it, but for the first that is exposed.
                self._joints(interval[first], link[first], edge[first], self._exposed[link[first]]),
                self._corners(interval[start], link[start], edge[start], self.edges.start),
                self._corners(interval[end], link[end], edge[end], self.edges.end),
            ]
        )

    def _joints(self, interval: IntArray, link: IntArray, edge: IntArray, share: FloatArray) -> ChainCases:
        """Points at a share of links against edges, seen from the room."""
        vector = link + 1
        columns = self.chain.forward(np.zeros_like(vector), vector)
        base = self.chain.arm.base
        target = np.stack((self.edges.start[edge] - base, self.edges.end[edge] - base), axis=1)
        cases = self.chain.cases(columns, interval, None, target, self._apart[edge], link, edge, with_link=False)
        cases.lengths[np.arange(len(link)), :, vector] *= share[:, None]
        return cases

    def _corners(self, interval: IntArray, link: IntArray, edge: IntArray, places: FloatArray) -> ChainCases:
        """Corners of edges against links, seen from the link: back along the arm to the base, and on to the corner."""
        vector = link + 1
        columns = self.chain.backward(vector, np.zeros_like(vector))
        length = self.chain.arm.link_length
        target = np.zeros((len(link), 2, 2))
        target[:, 0, 0] = length * self._exposed[link]
        target[:, 1, 0] = length
        cases = self.chain.cases(columns, interval, vector, target, self._apart[edge], link, edge, with_link=False)

        # The last vector leads from the base to the corner and has the room's heading.
        rows = np.arange(len(link))
        away = places[edge] - self.chain.arm.base
        heading = self.chain.angles[interval[:, None] + np.array([0, 1]), vector[:, None]]
        cases.lengths[rows, :, vector] = np.hypot(away[:, 0], away[:, 1])[:, None]
        cases.angles[rows, :, vector] = np.arctan2(away[:, 1], away[:, 0])[:, None] - heading
        cases.turns[rows, vector] = self.chain.model.turns[0]
        cases.joints[rows, vector] = 0
        return cases


def hidden_corners(workspace: Workspace) -> BoolArray:
    """Which ends of the walls' edges are such corners, in the order of ``wall_edges``, shape (E, 2)."""
    parts = [_of_part(part) for wall in workspace.obstacles for part in shapely.get_parts(wall.core)]
    parts.append(_of_ring(workspace.boundary.exterior, room_inside=True))
    return np.concatenate(parts)


def _of_part(part: shapely.Geometry) -> BoolArray:
    if isinstance(part, shapely.Polygon):
        holes = [_of_ring(ring, room_inside=True) for ring in part.interiors]
        return np.concatenate([_of_ring(part.exterior, room_inside=False), *holes])
    # The room is on both sides of a line, and all about a point.
    edges = max(len(shapely.get_coordinates(part)) - 1, 1)
    return np.zeros((edges, 2), dtype=bool)


def _of_ring(ring: shapely.LinearRing, *, room_inside: bool) -> BoolArray:
    points = shapely.get_coordinates(ring)
    after = np.diff(points, axis=0)
    before = np.roll(after, 1, axis=0)
    left = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    inwards = left if shapely.is_ccw(ring) else -left
    at_start = inwards > 0.0 if room_inside else inwards < 0.0
    return np.stack((at_start, np.roll(at_start, -1)), axis=1)


_CasesOf = Callable[[MovingChain], WallCases | LinkCases]
_TINY = 1e-300
_DIGITS = 3
"""Digits of the shares of the worst errors that are worth telling."""


def survived_errors(
    problem: Problem, trajectory: JointTrajectory, settings: ToleranceSettings = DEFAULT_TOLERANCE
) -> tuple[SurvivedError, ...]:
    """The largest errors of every kind, one kind at a time; arguments as for ``survived_error``."""
    return tuple(survived_error(problem, trajectory, make(problem.arm), settings) for make in MODELS)


def survived_error(
    problem: Problem,
    trajectory: JointTrajectory,
    model: ErrorModel,
    settings: ToleranceSettings = DEFAULT_TOLERANCE,
    most: float = np.inf,
) -> SurvivedError:
    """The largest error of one kind with which every motion keeps clear, certified at all times.

    Every motion whose coordinates are within the error of the planned ones at all times keeps the clearance from every
    wall, beyond the mount, and two radii between distant links where the arm has to. Joints that a guide tube holds
    straight have no error.

    Args:
        problem: with the arm, its room and the clearance.
        trajectory: the plan, linear between its samples.
        model: what may be wrong.
        settings: how closely the error is sought.
        most: larger errors are not looked at [unit]; what is survived is told as this.
    """
    if problem.dimension == 3:
        return survived_by_levers(problem, trajectory, model, settings, most)
    arm = problem.arm
    workspace = problem.workspace
    motion = ChainMotion(arm, trajectory.time, trajectory.positions)
    edges = wall_edges(workspace)
    search = LargestError(min(most, largest_error(arm, model, settings)), settings)
    coarse = MovingChain.in_strides(motion, model, _STRIDE * arm.link_length)
    fine = MovingChain.through_all(motion, model)

    kinds: list[_CasesOf] = []
    if np.any(exposed_starts(arm) < 1.0):
        hidden = hidden_corners(workspace)
        kinds.append(lambda chain: WallCases(chain, edges, workspace.clearance, hidden))
    if model.with_itself and arm.self_collision and first_distant(arm) < arm.links:
        kinds.append(LinkCases)
    # A good upper end first: it decides how far anything has to look.
    for kind in kinds:
        search.tighten(kind(fine).nearest(_PROBES))
    for kind in kinds:
        _prove(search, kind(coarse), kind(fine))
    return _named(model, search.certified, search.limiting, fine, edges)


def _prove(search: LargestError, coarse: WallCases | LinkCases, fine: WallCases | LinkCases) -> None:
    """Prove all cases over strides of the motion, and those that are left over at its samples."""
    pairs = coarse.within(search.upper)
    left = search.undecided(coarse.cases(pairs), of_motion=False)
    search.prove(fine.cases(_at_samples(left, coarse.chain.at)))


def _at_samples(cases: ChainCases, at: IntArray) -> Pairs:
    """The pairs of cases over strides, for every interval between samples in these strides."""
    pairs = np.unique(np.stack((cases.interval, cases.link, cases.other), axis=1), axis=0)
    first = at[pairs[:, 0]]
    counts = at[pairs[:, 0] + 1] - first
    row = np.repeat(np.arange(len(pairs)), counts)
    within = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    return Pairs(first[row] + within, pairs[row, 1], pairs[row, 2])


def _named(
    model: ErrorModel, size: float, limiting: Limiting | None, chain: MovingChain, edges: WallEdges
) -> SurvivedError:
    if limiting is None:
        return SurvivedError(model.name, size, model.unit, "nothing; larger errors are not looked at", limited=False)
    case = limiting.case
    time = chain.motion.time
    k = int(case.interval[0])
    when = float(time[k] + case.stretch[0, 0] * (time[k + 1] - time[k]))
    link = int(case.link[0])
    other = int(case.other[0])
    body = f"link {other + 1}" if case.with_link[0] else repr(edges.names[edges.owner[other]])
    where = f"link {link + 1} to {body} at t = {when:.4f} s"
    worst = _worst_shares(limiting, chain.arm.links) if np.any(model.turns[1:]) else ()
    place = _place(case, chain, edges)
    return SurvivedError(model.name, size, model.unit, where, when, link + 1, worst, place)


def _place(case: ChainCases, chain: MovingChain, edges: WallEdges) -> tuple[float, ...]:
    """Half-way between the link of a case and what is nearest to it, shape (2,) [m]."""
    points = chain.motion.poses(case.interval + case.stretch[:, 0])[0]
    link = int(case.link[0])
    other = int(case.other[0])
    ends = points[other : other + 2] if case.with_link[0] else np.stack((edges.start[other], edges.end[other]))
    line = shapely.shortest_line(shapely.LineString(points[link : link + 2]), shapely.LineString(ends))
    return tuple(float(value) for value in shapely.get_coordinates(line).mean(axis=0))


def _worst_shares(limiting: Limiting, links: int) -> tuple[float, ...]:
    """Errors of the joints, as shares of the largest, that bring the limiting link near, shape (links,)."""
    case = limiting.case
    widths = limiting.error * case.turns
    errors = worst_errors(case.lengths[:, 0], case.angles[:, 0], widths, np.array([limiting.direction]))[0]
    shares = np.zeros(links + 1)
    used = case.joints[0] > 0
    shares[case.joints[0, used]] = case.sense[0] * errors[used] / max(limiting.error, _TINY)
    # Nought has no sign.
    return tuple(float(share) + 0.0 for share in np.round(shares[1:], _DIGITS))


def worst_motion(trajectory: JointTrajectory, error: SurvivedError, size: float) -> FloatArray:
    """Bends of a motion whose joints are off all the time as leads to a touch soonest, shape (T, links) [rad].

    Args:
        trajectory: the plan.
        error: what its joints survive.
        size: of the error of every joint [rad].
    """
    return np.asarray(trajectory.bend_angles + size * np.array(error.worst))


_TUBE_DIRECTIONS = 24
"""Directions in which the places of every joint are bounded for the picture of the tube. Taste."""
_TUBE_POSES = 160
"""Poses of that picture. Taste."""
_THIN_SHARE = 1e-3
"""Radius that an arm of no width has in that picture, as a share of its length. Taste."""


@dataclass(frozen=True)
class Tube:
    """What the arm may sweep.

    Attributes:
        region: everything that it may sweep during the motion, its width included.
        planned: what it sweeps without errors.
    """

    region: shapely.Geometry
    planned: shapely.Geometry


def tube_of(
    arm: Arm,
    trajectory: JointTrajectory,
    model: ErrorModel,
    size: float,
) -> Tube:
    """The tube of a motion at poses spread over it, bounded in some directions by the support of its joints' places.

    Args:
        arm: the arm.
        trajectory: the plan.
        model: what may be wrong.
        size: of the error [unit].
    """
    motion = ChainMotion(arm, trajectory.time, trajectory.positions)
    chain = MovingChain.through_all(motion, model)
    chosen = np.unique(np.linspace(0, len(chain) - 1, min(_TUBE_POSES, len(chain))).astype(int))
    corners = np.stack([_corners(chain, chosen, k, size) for k in range(arm.links + 1)], axis=1)
    # A link lies in the hull of the places of its ends.
    pairs = np.concatenate((corners[:, :-1], corners[:, 1:]), axis=2).reshape(-1, 2 * corners.shape[2], 2)
    hulls = shapely.convex_hull(shapely.multipoints(pairs))
    axes = shapely.linestrings(chain.middles[chosen])
    # An arm without width is drawn as a thin line.
    radius = max(arm.radius, _THIN_SHARE * arm.length)
    return Tube(_grown(hulls, radius), _grown(axes, radius))


def _corners(chain: MovingChain, interval: IntArray, joint: int, size: float) -> FloatArray:
    """Corners of a polygon about the places of one joint at some poses, shape (m, directions, 2) [m]."""
    count = len(interval)
    columns = chain.forward(np.zeros(count, dtype=np.intp), np.full(count, joint))
    nowhere = np.zeros((count, 2, 2))
    cases = chain.cases(
        columns, interval, None, nowhere, np.zeros(count), interval, interval, with_link=False
    ).middles()
    angles = np.linspace(0.0, 2.0 * np.pi, _TUBE_DIRECTIONS, endpoint=False)
    directions = np.tile(angles, (count, 1))
    support = chain_support(
        cases.lengths[:, 0], cases.angles[:, 0], size * cases.turns, size * cases.stretches, directions
    )
    support = support + size * chain.model.moves_base
    # Neighbouring sides, at ν and ν + ω, meet at h n + (h' − h cos ω) / sin ω t, with t square to n.
    step = 2.0 * np.pi / _TUBE_DIRECTIONS
    along = (np.roll(support, -1, axis=1) - support * np.cos(step)) / np.sin(step)
    normal = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    square = np.stack((-np.sin(angles), np.cos(angles)), axis=1)
    return np.asarray(chain.arm.base + support[..., None] * normal + along[..., None] * square)


def _grown(shapes: Any, radius: float) -> shapely.Geometry:
    # Grown one by one: the union of thousands of lines that cross would be far dearer.
    union: shapely.Geometry = shapely.union_all(shapely.buffer(shapes, radius, quad_segs=8))
    return union
