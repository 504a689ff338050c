"""Routes from a start to a goal in different homotopy classes, shortest first (the connectivity graph of section 4.1).

Walks through the junction graph that pass no triangle twice are enumerated best first (A*). The estimate of the way that remains is
exact in the sampled metric of ``junctions``, turning on the spot excluded, so that they come out in the order of their
sampled length; then each gets its taut string and they are put in the order of their true length.
"""

import bisect
import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import dijkstra

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.funnel import taut_string
from ccm_opt.freespace.junctions import SAMPLES, Chain, EdgeMetric, chains_between, min_plus
from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.geometry.polygons import path_length

SURPLUS = 6  # at most so many classes are drawn taut for each one wanted
METRIC_EXCESS = 1.03  # the sampled length of a class is at most this multiple of its taut length (measured in clutter)
EFFORT = 400  # partial walks looked at for each class wanted
TINY = 1e-12  # keeps edges of no length in a sparse matrix [m]


def shortest_routes(
    metric: EdgeMetric, ends: IntArray, points: FloatArray, count: int, longest: float = np.inf, shrink: float = 0.0
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
    candidates = _sleeves(metric, ends, points, METRIC_EXCESS * longest, EFFORT * count)
    for sampled, sleeve in itertools.islice(candidates, SURPLUS * count):
        if len(best) >= count and sampled > METRIC_EXCESS * best[count - 1][0]:
            break
        route = route_of_sleeve(mesh, sleeve, points[0], points[1], shrink)
        bisect.insort(best, (route.length, route), key=lambda pair: pair[0])
    return tuple(route for length, route in best[:count] if length <= longest)


def route_of_sleeve(mesh: Triangulation, sleeve: tuple[int, ...], start: FloatArray, goal: FloatArray, shrink: float) -> Route:
    """The route with the taut string of a sleeve."""
    taut = taut_string(mesh.portals(sleeve), start, goal, shrink)
    return Route(sleeve, taut, path_length(taut))


@dataclass(frozen=True)
class _ClassGraph:
    """Directed chains as nodes, with the steps from chain to chain and the way that remains to the goal.

    Attributes:
        chains: all directed chains.
        steps: for each chain the chains that may follow it, with the lengths from last edge to last edge, (m, m) [m].
        rest: least length to the goal from the sample points of each chain's last edge, shape (chains, m) [m].
    """

    chains: list[Chain]
    steps: list[list[tuple[int, FloatArray]]]
    rest: FloatArray


def _sleeves(metric: EdgeMetric, ends: IntArray, points: FloatArray, longest: float, effort: int) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Sampled lengths and reduced sleeves that pass no triangle twice, by increasing sampled length."""
    start, goal = int(ends[0]), int(ends[1])
    if start == goal:
        yield float(np.linalg.norm(points[1] - points[0])), (start,)
    graph = _class_graph(metric, ends, points[1])
    queue: list[tuple[float, int, int, FloatArray, tuple[int, ...]]] = []
    ticket = itertools.count()

    def put(chain: int, walked: FloatArray, nodes: tuple[int, ...]) -> None:
        total = float((walked + graph.rest[chain]).min())
        if total <= longest:
            heapq.heappush(queue, (total, next(ticket), chain, walked, nodes))

    for index, chain in enumerate(graph.chains):
        if chain.triangles[0] == start:
            first = np.linalg.norm(metric.points[start, chain.exit] - points[0], axis=1)
            put(index, (first[:, None] + chain.lengths).min(axis=0), (index,))
    for _ in range(effort):
        if not queue:
            return
        total, _, last, walked, history = heapq.heappop(queue)
        if graph.chains[last].head == goal:
            yield total, _joined([graph.chains[index] for index in history])
            continue
        passed = {start, *(graph.chains[index].head for index in history)}
        for index, lengths in graph.steps[last]:
            if graph.chains[index].head not in passed or graph.chains[index].head == goal:
                put(index, (walked[:, None] + lengths).min(axis=0), (*history, index))


def _joined(chains: list[Chain]) -> tuple[int, ...]:
    """The triangles of chains one after the other."""
    return (*chains[0].triangles, *(t for chain in chains[1:] for t in chain.triangles[1:]))


def _class_graph(metric: EdgeMetric, ends: IntArray, goal_point: FloatArray) -> _ClassGraph:
    """Chains, the steps between them, and the least remaining lengths by one Dijkstra search from the goal."""
    start, goal = int(ends[0]), int(ends[1])
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
    return _ClassGraph(chains, steps, _remaining(metric, chains, pairs, lengths, goal, goal_point))


def _step_lengths(metric: EdgeMetric, chains: list[Chain], pairs: IntArray) -> FloatArray:
    """Lengths from each first chain's last edge through the node and along the second chain, shape (pairs, m, m) [m]."""
    if len(pairs) == 0:
        return np.empty((0, SAMPLES, SAMPLES))
    heads = np.array([chain.head for chain in chains])[pairs[:, 0]]
    entries = np.array([chain.entry for chain in chains])[pairs[:, 0]]
    exits = np.array([chain.exit for chain in chains])[pairs[:, 1]]
    along = np.stack([chain.lengths for chain in chains])[pairs[:, 1]]
    return min_plus(metric.across[heads, entries, exits], along)


def _remaining(
    metric: EdgeMetric, chains: list[Chain], pairs: IntArray, lengths: FloatArray, goal: int, point: FloatArray
) -> FloatArray:
    """Least lengths to the goal from the sample points of each chain's last edge, shape (chains, m) [m]."""
    size = len(chains) * SAMPLES
    sample = np.arange(SAMPLES)
    tail = np.broadcast_to(SAMPLES * pairs[:, 0, None, None] + sample[:, None], lengths.shape).ravel()
    head = np.broadcast_to(SAMPLES * pairs[:, 1, None, None] + sample, lengths.shape).ravel()
    weight = lengths.ravel() + TINY
    finite = np.isfinite(weight)
    last = [index for index, chain in enumerate(chains) if chain.head == goal]
    final = (SAMPLES * np.array(last, dtype=np.intp)[:, None] + sample).ravel()
    to_goal = [np.linalg.norm(metric.points[goal, chains[index].entry] - point, axis=1) + TINY for index in last]
    backwards = scipy.sparse.coo_array(
        (
            np.concatenate((weight[finite], *to_goal)),
            (np.concatenate((head[finite], np.full(len(final), size))), np.concatenate((tail[finite], final))),
        ),
        shape=(size + 1, size + 1),
    ).tocsr()
    return np.asarray(dijkstra(backwards, indices=size)[:size].reshape(-1, SAMPLES), dtype=np.float64)
