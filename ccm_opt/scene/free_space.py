"""Free space of a disc among walls in the plane, and routes through free space.

Walks through the junction graph of the triangulation that pass no triangle twice are enumerated best first (A*). Their
lengths are measured between sample points on triangle edges (see ``narrow_gates``). The estimate of the remaining
length is exact in this metric, except for turning on the spot, so walks come out in the order of their sampled length.

The homotopy classes thus come nearly in order of length; the shortest path of each class (its taut string) is computed,
and the classes are sorted by true length.

All approximations are on the safe side: the polygons are subsets of the true free set (the points farther than the
inflation from all walls). Sides are offset exactly; the arc at a convex corner is replaced by at most two tangents, a
circle by the tangents of a 12-gon.
"""

import bisect
import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse
import shapely
from scipy.sparse.csgraph import dijkstra

from ccm_opt.core.arrays import ROUNDING, TINY, BoolArray, FloatArray, IntArray
from ccm_opt.core.polygons import cross, mitred
from ccm_opt.core.polyline import path_length, unit_vector, vector_heading
from ccm_opt.scene import sleeve as sleeves
from ccm_opt.scene.corridor import Corridor, Route
from ccm_opt.scene.corridor_maker import CorridorMaker
from ccm_opt.scene.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.scene.narrow_gates import (
    Chain,
    EdgeMetric,
    GateRuns,
    chains_between,
    min_plus,
    straight_through_gates,
)
from ccm_opt.scene.sleeve import taut_string
from ccm_opt.scene.triangulation import Triangulation, triangulate
from ccm_opt.scene.workspace import Obstacle, Workspace

_MITRE_LIMIT = 1.02
"""Distance of the tangent at the corner of an inflated wall, as a multiple of the inflation.

Derived: with 1.02, turns below 22° need only one vertex, and only 2 % of the inflation is given away.
"""

_ROUTE_SURPLUS = 6
"""Largest number of homotopy classes per wanted route whose shortest path is computed. Heuristic."""
_LEAST_CLASSES = 20
"""Least number of homotopy classes whose shortest path is computed. Heuristic.

In near-empty rooms the sampled length, by which classes are ordered, is at its coarsest.
"""
_SAMPLED_EXCESS = 1.25
"""Largest ratio of sampled to true length of a homotopy class; mostly 1.01 in clutter. Heuristic: a wide margin."""
_WALKS_PER_ROUTE = 400
"""Largest number of partial walks examined per wanted route. Heuristic."""
_LEAST_ROUTES = 4
"""Least number of routes for which partial walks are examined, even if fewer are wanted. Heuristic."""


@dataclass(frozen=True, order=True)
class _Partial:
    """The beginning of a walk through the triangles of free space, ordered by the estimated length of the whole walk.

    Attributes:
        total: length walked plus the least remaining length [m].
        history: indices of the chains of triangles walked.
        walked: length walked to each of the m sample points of the last edge, shape (m,) [m].
    """

    total: float
    history: tuple[int, ...]
    walked: FloatArray = field(compare=False)


@dataclass(frozen=True)
class ClassGraph:
    """Graph of the directed chains of triangles between junctions, with lengths from chain to chain and to the goal.

    Attributes:
        chains: all directed chains.
        steps: for each chain, the chains that may follow, with the lengths from the m sample points of its last edge to
            those of their last edges, shape (m, m) [m].
        rest: least remaining length to the goal from the sample points of each chain's last edge, shape (chains, m)
            [m].
    """

    chains: list[Chain]
    steps: list[list[tuple[int, FloatArray]]]
    rest: FloatArray

    def partial(self, history: tuple[int, ...], walked: FloatArray) -> _Partial:
        """Return the beginning of a walk along given chains, with the estimated total length."""
        return _Partial(float((walked + self.rest[history[-1]]).min()), history, walked)


def homotopy_classes(
    metric: EdgeMetric, ends: IntArray, points: FloatArray, longest: float, effort: int
) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield the sampled length [m] and the triangle sequence of homotopy classes from start to goal, shortest first.

    Only walks that pass no triangle twice are considered.

    Args:
        metric: metric of the triangulation.
        ends: triangles of start and goal, shape (2,).
        points: start and goal, shape (2, 2) [m].
        longest: greatest sampled length [m]; longer walks are left out.
        effort: maximum number of partial walks examined.
    """
    start, goal = ends.tolist()
    if start == goal:
        yield float(np.linalg.norm(points[1] - points[0])), (start,)
    graph = class_graph(metric, ends, points[1])
    queue = [partial for partial in _first_steps(metric, graph, start, points[0]) if partial.total <= longest]
    heapq.heapify(queue)
    for _ in range(effort):
        if not queue:
            return
        best = heapq.heappop(queue)
        if graph.chains[best.history[-1]].head == goal:
            yield best.total, _joined([graph.chains[index] for index in best.history])
            continue
        for partial in _further_steps(graph, best, start, goal):
            if partial.total <= longest:
                heapq.heappush(queue, partial)


def _first_steps(metric: EdgeMetric, graph: ClassGraph, start: int, point: FloatArray) -> Iterator[_Partial]:
    """Yield the walks that consist of one chain of triangles, from the start point (2,) [m] to the next junction."""
    for index, chain in enumerate(graph.chains):
        if chain.triangles[0] == start:
            first = np.linalg.norm(metric.points[start, chain.exit] - point, axis=1)
            yield graph.partial((index,), np.asarray((first[:, None] + chain.lengths).min(axis=0)))


def _further_steps(graph: ClassGraph, before: _Partial, start: int, goal: int) -> Iterator[_Partial]:
    """Yield the extensions of a walk by one chain of triangles that pass no junction twice."""
    # The goal may be the start; a walk then returns to it.
    passed = {start, *(graph.chains[index].head for index in before.history)} - {goal}
    for index, lengths in graph.steps[before.history[-1]]:
        if graph.chains[index].head not in passed:
            yield graph.partial((*before.history, index), np.asarray((before.walked[:, None] + lengths).min(axis=0)))


def _joined(chains: list[Chain]) -> tuple[int, ...]:
    """Return the triangles of consecutive chains of triangles as one sequence."""
    return (*chains[0].triangles, *(t for chain in chains[1:] for t in chain.triangles[1:]))


def class_graph(metric: EdgeMetric, ends: IntArray, goal_point: FloatArray) -> ClassGraph:
    """Return the graph of chains of triangles and their successors, with remaining lengths to the goal.

    The remaining lengths come from one Dijkstra search from the goal.

    Args:
        metric: metric of the triangulation.
        ends: triangles of start and goal, shape (2,).
        goal_point: goal, shape (2,) [m].
    """
    start, goal = ends.tolist()
    chains = chains_between(metric, (start, goal))
    leaving: dict[int, list[int]] = {}
    for index, chain in enumerate(chains):
        leaving.setdefault(chain.triangles[0], []).append(index)
    pairs = np.array(
        [
            (index, after)
            for index, chain in enumerate(chains)
            if chain.head not in {start, goal}
            for after in leaving[chain.head]
            if chains[after].exit != chain.entry
        ],
        dtype=np.intp,
    ).reshape(-1, 2)
    lengths = _step_lengths(metric, chains, pairs)
    steps: list[list[tuple[int, FloatArray]]] = [[] for _ in chains]
    for (index, after), matrix in zip(pairs.tolist(), lengths, strict=True):
        steps[index].append((after, matrix))
    return ClassGraph(chains, steps, _remaining(metric, chains, pairs, lengths, goal, goal_point))


def _step_lengths(metric: EdgeMetric, chains: list[Chain], pairs: IntArray) -> FloatArray:
    """Return the lengths of the second chain of each pair if it follows the first, shape (pairs, m, m) [m].

    They lead from the m sample points of the first chain's last edge to those of the second chain's last edge.
    """
    if len(pairs) == 0:
        return np.empty((0, metric.samples, metric.samples))
    heads = np.array([chain.head for chain in chains])[pairs[:, 0]]
    entries = np.array([chain.entry for chain in chains])[pairs[:, 0]]
    exits = np.array([chain.exit for chain in chains])[pairs[:, 1]]
    along = np.stack([chain.lengths for chain in chains])[pairs[:, 1]]
    return min_plus(metric.across[heads, entries, exits], along)


def _remaining(
    metric: EdgeMetric, chains: list[Chain], pairs: IntArray, lengths: FloatArray, goal: int, point: FloatArray
) -> FloatArray:
    """Return the least lengths to the goal from the m sample points of each chain's last edge, (chains, m) [m]."""
    samples = metric.samples
    size = len(chains) * samples
    sample = np.arange(samples)
    tail = np.broadcast_to(samples * pairs[:, 0, None, None] + sample[:, None], lengths.shape).ravel()
    head = np.broadcast_to(samples * pairs[:, 1, None, None] + sample, lengths.shape).ravel()
    # In a sparse matrix zero means no edge, so edges of zero length need a tiny weight.
    weight = lengths.ravel() + TINY
    finite = np.isfinite(weight)
    last = [index for index, chain in enumerate(chains) if chain.head == goal]
    final = (samples * np.array(last, dtype=np.intp)[:, None] + sample).ravel()
    to_goal = [np.linalg.norm(metric.points[goal, chains[index].entry] - point, axis=1) + TINY for index in last]
    # An extra node represents the goal. All steps are reversed, so that one search from the goal finds all lengths.
    backwards = scipy.sparse.coo_array(
        (
            np.concatenate((weight[finite], *to_goal)),
            (np.concatenate((head[finite], np.full(len(final), size))), np.concatenate((tail[finite], final))),
        ),
        shape=(size + 1, size + 1),
    ).tocsr()
    return np.asarray(dijkstra(backwards, indices=[size])[0, :size].reshape(-1, samples), dtype=np.float64)


def shortest_routes(
    metric: EdgeMetric,
    ends: IntArray,
    points: FloatArray,
    count: int,
    longest: float = np.inf,
    shrink: float = 0.0,
) -> tuple[Route, ...]:
    """Return up to ``count`` routes in different homotopy classes, the shortest first.

    Args:
        metric: metric of the triangulation of free space.
        ends: triangles of start and goal, shape (2,).
        points: start and goal, which are free points, shape (2, 2) [m].
        count: maximum number of routes.
        longest: length above which routes are left out [m].
        shrink: distance to keep from corners where space allows [m].

    Returns:
        The routes; none if start and goal are in different components or all routes are too long.
    """
    mesh = metric.triangulation
    if mesh.components[ends[0]] != mesh.components[ends[1]]:
        return ()
    best: list[tuple[float, Route]] = []
    excess = _SAMPLED_EXCESS
    effort = _WALKS_PER_ROUTE * max(count, _LEAST_ROUTES)
    classes = homotopy_classes(metric, ends, points, excess * longest, effort)
    for sampled, sleeve in itertools.islice(classes, max(_ROUTE_SURPLUS * count, _LEAST_CLASSES)):
        # The classes come by sampled length: once it exceeds the worst length kept by more than sampling may add, no
        # further class can be better.
        if len(best) >= count and sampled > excess * best[count - 1][0]:
            break
        route = sleeve_route(mesh, sleeve, points[0], points[1], shrink)
        bisect.insort(best, (route.length, route), key=lambda pair: pair[0])
    return tuple(route for length, route in best[:count] if length <= longest)


def sleeve_route(
    mesh: Triangulation, sleeve: tuple[int, ...], start: FloatArray, goal: FloatArray, shrink: float
) -> Route:
    """Return the route along the shortest path through a sequence of neighbouring triangles.

    Args:
        mesh: triangulation of free space.
        sleeve: indices of the triangles.
        start: a point in the first triangle, shape (2,) [m].
        goal: a point in the last triangle, shape (2,) [m].
        shrink: distance to keep from corners where space allows [m].
    """
    taut = taut_string(mesh.portals(sleeve), start, goal, shrink)
    return Route(sleeve, taut, path_length(taut))


_CIRCLE_QUAD_SEGS = 3
"""Polygon sides per quarter circle; with 3, a circle becomes a 12-gon, 3.5 % wider at its vertices. Heuristic."""
_CORNER_SLACK = 0.9
"""Distance by which a shortest path may leave its corridor at corners, as a fraction of the inflation.

Derived: less than 1, so that no obstacle fits in between.
"""


def free_set(
    workspace: Workspace, inflation: float, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
) -> shapely.MultiPolygon:
    """Return the set of points farther than ``inflation`` from every wall, where the arm's axis may be.

    The returned set is a subset of the exact one: slightly smaller at rounded corners.

    Args:
        workspace: the room and its obstacles.
        inflation: the arm's radius plus clearance [m], positive; a tiny number for an arm of zero width.
        settings: settings of the approximation of corners and circles.

    Returns:
        The free set, possibly in several components; empty if nothing is free.

    Raises:
        ValueError: ``inflation`` is not positive.
    """
    if inflation <= 0.0:
        raise ValueError(f"got inflation = {inflation} m, expected a positive length: for an arm of no width pass 1e-6")
    room = mitred(workspace.boundary, -inflation, _MITRE_LIMIT)
    grown = shapely.union_all([grown_outline(obstacle, inflation, settings) for obstacle in workspace.obstacles])
    pieces = shapely.get_parts(shapely.difference(room, grown))
    dent = settings.dent * inflation
    # Smaller pieces of free space [m²] are artefacts of rounding.
    polygons = [_without_dents(_with_vertices_apart(piece), dent) for piece in pieces if shapely.area(piece) > TINY]
    return shapely.MultiPolygon([polygon for polygon in polygons if isinstance(polygon, shapely.Polygon)])


def grown_outline(
    obstacle: Obstacle, inflation: float, settings: FreeSpaceSettings = DEFAULT_FREE_SPACE
) -> shapely.Geometry:
    """Return a polygon with few vertices that contains all points within ``inflation`` [m] of an obstacle."""
    if settings.corner_quad_segs > 0:
        return obstacle.outline(inflation, settings.corner_quad_segs)
    radius = obstacle.rounding + inflation
    core = obstacle.core
    if isinstance(core, shapely.Point | shapely.MultiPoint):
        return obstacle.outline(inflation, _CIRCLE_QUAD_SEGS)
    if isinstance(core, shapely.LineString):
        points = shapely.get_coordinates(core)
        return shapely.union_all([_capsule(a, b, radius) for a, b in itertools.pairwise(points)])
    return mitred(core, radius, _MITRE_LIMIT)


def _capsule(a: FloatArray, b: FloatArray, radius: float) -> shapely.Polygon:
    """Return the octagon of tangents around all points within ``radius`` [m] of the segment from a to b, each (2,)."""
    heading = vector_heading(b - a)
    angles = heading + np.deg2rad([-67.5, -22.5, 22.5, 67.5])
    corners = radius / np.cos(np.pi / 8) * unit_vector(angles)
    return shapely.Polygon(np.concatenate((b + corners, a - corners)))


def _with_vertices_apart(polygon: shapely.Polygon) -> shapely.Polygon:
    """Return a polygon without vertices that differ from their neighbours by rounding, which break triangulations."""
    fewer = shapely.remove_repeated_points(polygon, ROUNDING)
    return fewer if fewer.is_valid and isinstance(fewer, shapely.Polygon) and not fewer.is_empty else polygon


def _without_dents(polygon: shapely.Polygon, depth: float) -> shapely.Polygon:
    """Return a subset of a polygon without convex corners that protrude by less than ``depth`` [m]."""
    oriented = shapely.orient_polygons(polygon)
    shell = _cut_corners(shapely.get_coordinates(oriented.exterior)[:-1], depth)
    holes = [_cut_corners(shapely.get_coordinates(ring)[:-1], depth) for ring in oriented.interiors]
    simpler = shapely.Polygon(shell, holes)
    return simpler if simpler.is_valid and polygon.covers(simpler) else oriented


def _cut_corners(ring: FloatArray, depth: float) -> FloatArray:
    """Return a ring (m, 2) without its flat and barely convex vertices; of two neighbours at most one is removed.

    Free space is on the left of the ring.

    Args:
        ring: vertices of the ring, shape (m, 2) [m].
        depth: height of a vertex over its neighbours' connection below which it is removed [m].
    """
    before = np.roll(ring, 1, axis=0)
    after = np.roll(ring, -1, axis=0)
    base = np.linalg.norm(after - before, axis=1)
    height = cross(ring - before, after - ring) / np.maximum(base, 1e-300)
    drop = (height >= 0.0) & (height < depth)
    # Heights hold for one vertex at a time: if its neighbour went too, the ring might leave free space.
    drop &= ~np.roll(drop, 1)
    return ring[~drop] if np.count_nonzero(~drop) >= 3 else ring


@dataclass(frozen=True)
class FreeSpace:
    """Free space of an arm's axis in the plane: positions farther than the inflation from all walls.

    All properties are computed on first use. Points a little outside, for example a base that stands on a wall, count
    as the nearest free points.

    Attributes:
        workspace: the room and its obstacles.
        inflation: the arm's radius plus clearance [m], positive; a tiny number such as 1e-6 for an arm of zero width.
        settings: settings of the approximation and of the routes.
        gate_runs: narrow gates through which taut paths run straight; None for paths that are taut throughout.

    Raises:
        ValueError: the inflation is not positive.
    """

    workspace: Workspace
    inflation: float
    settings: FreeSpaceSettings = field(default=DEFAULT_FREE_SPACE, kw_only=True)
    gate_runs: GateRuns | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if not self.inflation > 0.0:
            raise ValueError(
                f"got inflation = {self.inflation} m, expected a positive length: for an arm of no width pass 1e-6"
            )

    @cached_property
    def polygons(self) -> shapely.MultiPolygon:
        """Free space as polygons, a subset of the exact free set."""
        polygons = free_set(self.workspace, self.inflation, self.settings)
        shapely.prepare(polygons)
        return polygons

    @cached_property
    def triangulation(self) -> Triangulation:
        """Triangulation of free space."""
        return triangulate(self.polygons)

    @cached_property
    def corridor_maker(self) -> CorridorMaker:
        """Maker of corridors in free space, which caches convex cells and the regions grown from them."""
        return CorridorMaker(self.triangulation, _CORNER_SLACK * self.inflation)

    @cached_property
    def _metric(self) -> EdgeMetric:
        return EdgeMetric(self.triangulation, self.settings.edge_samples)

    def contains(self, points: FloatArray) -> BoolArray:
        """Return a mask of the points (m, 2) [m] that are free, shape (m,)."""
        points = np.asarray(points, dtype=np.float64)
        return np.asarray(shapely.intersects_xy(self.polygons, points[:, 0], points[:, 1]), dtype=np.bool_)

    def snapped(self, points: FloatArray) -> FloatArray:
        """Return the free points nearest to given points (m, 2) [m], shape (m, 2) [m]."""
        return self.triangulation.nearest(np.asarray(points, dtype=np.float64))[1]

    def component(self, point: FloatArray) -> int:
        """Return the index of the connected component of free space to which a point (2,) [m] belongs."""
        triangle = self.triangulation.nearest(np.asarray(point, dtype=np.float64)[None])[0][0]
        return int(self.triangulation.components[triangle])

    def sleeve_of(self, polyline: FloatArray) -> tuple[int, ...]:
        """Return the homotopy class of a polyline (m, 2) [m]: the triangles that it crosses, without returns.

        Raises:
            UnreachableGoal: the ends lie in different components.
        """
        return sleeves.sleeve_of(self.triangulation, np.asarray(polyline, dtype=np.float64), self.settings.bisections)

    def taut_path(self, polyline: FloatArray, shrink: float = 0.0) -> FloatArray:
        """Return the shortest path homotopic to a polyline, with the same ends.

        The path runs straight through narrow gates if ``gate_runs`` is set.

        Args:
            polyline: shape (m, 2) [m]; may leave free space slightly and double back.
            shrink: distance to keep from corners where space allows [m].

        Returns:
            Vertices, shape (k, 2) [m].

        Raises:
            UnreachableGoal: the ends lie in different components.
        """

        def taut(line: FloatArray) -> FloatArray:
            return self.sleeve_path(self.sleeve_of(line), line[0], line[-1], shrink)

        polyline = np.asarray(polyline, dtype=np.float64)
        sleeve = self.sleeve_of(polyline)
        path = self.sleeve_path(sleeve, polyline[0], polyline[-1], shrink)
        if self.gate_runs is None:
            return path
        return straight_through_gates(path, self.triangulation.portals(sleeve), self.gate_runs, taut, self.contains)

    def sleeve_path(
        self, sleeve: tuple[int, ...], start: FloatArray, goal: FloatArray, shrink: float = 0.0
    ) -> FloatArray:
        """Return the shortest path from start to goal, each (2,), through a sequence of triangles, shape (k, 2) [m]."""
        ends = np.array([start, goal], dtype=np.float64)
        free = self.snapped(ends)
        return _with_ends(taut_string(self.triangulation.portals(sleeve), free[0], free[1], shrink), ends)

    def routes(
        self, start: FloatArray, goal: FloatArray, count: int, longest: float = np.inf, shrink: float = 0.0
    ) -> tuple[Route, ...]:
        """Return routes in different homotopy classes, the shortest first.

        No route passes a triangle twice.

        Args:
            start: start point, shape (2,) [m].
            goal: goal point, shape (2,) [m].
            count: maximum number of routes.
            longest: length above which routes are left out [m].
            shrink: distance to keep from corners where space allows [m].

        Returns:
            At most ``count`` routes; none if start and goal are not connected or all routes are too long.
        """
        ends = np.array([start, goal], dtype=np.float64)
        triangles, free = self.triangulation.nearest(ends)
        # The pieces from the ends to their nearest free points belong to every route.
        allowed = longest - float(np.linalg.norm(ends - free, axis=1).sum())
        found = shortest_routes(self._metric, triangles, free, count, allowed, shrink)
        strings = [_with_ends(route.taut, ends) for route in found]
        return tuple(Route(r.sleeve, taut, path_length(taut)) for r, taut in zip(found, strings, strict=True))

    def corridor(self, route: Route) -> Corridor:
        """Return the corridor of overlapping convex regions along a route, between its first and last free points."""
        free = self.snapped(route.taut[[0, -1]])
        # Ends that are not free are not part of the corridor.
        moved = np.linalg.norm(free - route.taut[[0, -1]], axis=1) > ROUNDING
        path = route.taut[int(moved[0]) : len(route.taut) - int(moved[1])]
        return self.corridor_maker.corridor_along(route, path if len(path) > 1 else np.repeat(path, 2, axis=0))


def _with_ends(path: FloatArray, ends: FloatArray) -> FloatArray:
    """Return a path (k, 2) between free points, extended to the original end points (2, 2) outside free space."""
    first = ends[:1] if np.linalg.norm(ends[0] - path[0]) > ROUNDING else ends[:0]
    last = ends[1:] if np.linalg.norm(ends[1] - path[-1]) > ROUNDING else ends[:0]
    return np.concatenate((first, path, last))
