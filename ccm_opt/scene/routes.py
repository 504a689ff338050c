"""Routes through free space, one a homotopy class.

Walks through the junction graph that pass no triangle twice are enumerated best first (A*). The estimate of the way
that remains is exact in the sampled metric of ``junctions``, turning on the spot excluded, so that they come out in
the order of their sampled length.

The classes come nearly in order of length; each gets its taut string, and these are put in the order of true length.
"""

import bisect
import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import dijkstra

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.polyline import path_length
from ccm_opt.scene.corridor import Route
from ccm_opt.scene.narrow_gates import Chain, EdgeMetric, chains_between, min_plus
from ccm_opt.scene.sleeve import taut_string
from ccm_opt.scene.triangulation import Triangulation

_ROUTE_SURPLUS = 6
"""Classes that are drawn taut for each route wanted, at most. Taste."""
_LEAST_CLASSES = 20
"""But so many in any case: in near-empty rooms the sampled length is at its coarsest. Taste."""
_SAMPLED_EXCESS = 1.25
"""The sampled length of a class is at most this multiple of its taut length; mostly 1.01 in clutter. Taste, with room
to spare."""
_WALKS_PER_ROUTE = 400
"""Partial walks looked at for each route wanted. Taste."""
_LEAST_ROUTES = 4
"""Routes for which that effort is spent even if fewer are wanted. Taste."""


@dataclass(frozen=True, order=True)
class _Partial:
    """The beginning of a walk.

    Attributes:
        total: its length with the least way that remains [m].
        history: the chains walked.
        walked: length to each sample point of the last edge, shape (m,) [m].
    """

    total: float
    history: tuple[int, ...]
    walked: FloatArray = field(compare=False)


@dataclass(frozen=True)
class ClassGraph:
    """Directed chains as nodes, with the steps from chain to chain and the way that remains to the goal.

    Attributes:
        chains: all directed chains.
        steps: for each chain the chains that may follow it, with the lengths from last edge to last edge, (m, m) [m].
        rest: least length to the goal from the sample points of each chain's last edge, shape (chains, m) [m].
    """

    chains: list[Chain]
    steps: list[list[tuple[int, FloatArray]]]
    rest: FloatArray

    def partial(self, history: tuple[int, ...], walked: FloatArray) -> _Partial:
        """A walk along chains, with the estimate of its whole length."""
        return _Partial(float((walked + self.rest[history[-1]]).min()), history, walked)


def homotopy_classes(
    metric: EdgeMetric, ends: IntArray, points: FloatArray, longest: float, effort: int
) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Sampled lengths and reduced sleeves that pass no triangle twice, by increasing sampled length.

    Args:
        metric: of the triangulation.
        ends: the triangles of start and goal, shape (2,).
        points: start and goal, shape (2, 2) [m].
        longest: sampled length beyond which no sleeve is looked for [m].
        effort: number of partial walks looked at.
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
    """The walks along one chain from the start."""
    for index, chain in enumerate(graph.chains):
        if chain.triangles[0] == start:
            first = np.linalg.norm(metric.points[start, chain.exit] - point, axis=1)
            yield graph.partial((index,), np.asarray((first[:, None] + chain.lengths).min(axis=0)))


def _further_steps(graph: ClassGraph, before: _Partial, start: int, goal: int) -> Iterator[_Partial]:
    """The walks one chain longer that pass no node twice; the goal may be the start."""
    # The goal may be the start; then a walk comes back to it.
    passed = {start, *(graph.chains[index].head for index in before.history)} - {goal}
    for index, lengths in graph.steps[before.history[-1]]:
        if graph.chains[index].head not in passed:
            yield graph.partial((*before.history, index), np.asarray((before.walked[:, None] + lengths).min(axis=0)))


def _joined(chains: list[Chain]) -> tuple[int, ...]:
    """The triangles of chains one after the other."""
    return (*chains[0].triangles, *(t for chain in chains[1:] for t in chain.triangles[1:]))


def class_graph(metric: EdgeMetric, ends: IntArray, goal_point: FloatArray) -> ClassGraph:
    """Chains, the steps between them, and the least remaining lengths by one Dijkstra search from the goal."""
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
    """Lengths from the end of each pair's first chain along the second one, shape (pairs, m, m) [m]."""
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
    """Least lengths to the goal from the sample points of each chain's last edge, shape (chains, m) [m]."""
    samples = metric.samples
    size = len(chains) * samples
    sample = np.arange(samples)
    tail = np.broadcast_to(samples * pairs[:, 0, None, None] + sample[:, None], lengths.shape).ravel()
    head = np.broadcast_to(samples * pairs[:, 1, None, None] + sample, lengths.shape).ravel()
    # In a sparse matrix zero means no edge, so that edges of no length need a little.
    weight = lengths.ravel() + TINY
    finite = np.isfinite(weight)
    last = [index for index, chain in enumerate(chains) if chain.head == goal]
    final = (samples * np.array(last, dtype=np.intp)[:, None] + sample).ravel()
    to_goal = [np.linalg.norm(metric.points[goal, chains[index].entry] - point, axis=1) + TINY for index in last]
    # One node more stands for the goal. All steps run backwards, so that one search from it finds all lengths.
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
    """Up to ``count`` routes in different homotopy classes by increasing taut length.

    Args:
        metric: of the triangulation of free space.
        ends: the triangles of start and goal, shape (2,).
        points: start and goal, free points, shape (2, 2) [m].
        count: number of routes wanted.
        longest: routes with a longer taut string are left out [m].
        shrink: distance kept from corners where there is room [m].

    Returns:
        The routes; none when start and goal are in different components or all routes are too long.
    """
    mesh = metric.triangulation
    if mesh.components[ends[0]] != mesh.components[ends[1]]:
        return ()
    best: list[tuple[float, Route]] = []
    excess = _SAMPLED_EXCESS
    effort = _WALKS_PER_ROUTE * max(count, _LEAST_ROUTES)
    classes = homotopy_classes(metric, ends, points, excess * longest, effort)
    for sampled, sleeve in itertools.islice(classes, max(_ROUTE_SURPLUS * count, _LEAST_CLASSES)):
        # The classes come by sampled length: once it exceeds the worst kept by all that sampling may add, none is left.
        if len(best) >= count and sampled > excess * best[count - 1][0]:
            break
        route = route_of_sleeve(mesh, sleeve, points[0], points[1], shrink)
        bisect.insort(best, (route.length, route), key=lambda pair: pair[0])
    return tuple(route for length, route in best[:count] if length <= longest)


def route_of_sleeve(
    mesh: Triangulation, sleeve: tuple[int, ...], start: FloatArray, goal: FloatArray, shrink: float
) -> Route:
    """The route with the taut string of a sleeve."""
    taut = taut_string(mesh.portals(sleeve), start, goal, shrink)
    return Route(sleeve, taut, path_length(taut))
