"""A roadmap of poses: random poses of an arm with few links, joined by straight motions, certified where they are used.

Kavraki, Svestka, Latombe and Overmars, "Probabilistic roadmaps for path planning in high-dimensional configuration
spaces", IEEE Transactions on Robotics and Automation 1996. Where an arm has few joints, random poses fill the space of
its configurations well enough that most lie within reach of each other. Most motions between neighbours are never
needed, and a certificate is sought only for those that are: Bohlin and Kavraki, "Path planning using lazy PRM", ICRA
2000.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray

_NEIGHBOURS = 9
"""Number of nearest poses, itself among them, with which a pose is joined. Heuristic: in rooms with ten boxes, nine in
ten poses are then joined with the start."""
_OF_START = 60
"""Likewise of the start, which may be in a narrow place. Heuristic: in one of ten rooms, of the poses within a radian
and a half the twentieth is the first to be joined."""
_SAME = 1e-9
"""Largest difference of coordinates of the same pose [rad, m]."""


@dataclass(eq=False)
class PoseRoadmap:
    """Poses, the first of which is the start, and the straight motions between neighbours.

    Attributes:
        safe: returns whether the straight motion between two configurations (c,) has a certificate.
        pace: fastest rates of the coordinates, shape (c,) [rad/s, m/s].
        poses: the poses, shape (n, c) [rad, m].
        times: least durations of the motions that have a certificate [s], by the indices of their ends, the lower one
            first.
        untried: likewise of those for which none has been sought.
        tried: the others.
        joined: mask of the poses to which motions with a certificate lead from the start, shape (n,).
    """

    safe: Callable[[FloatArray, FloatArray], bool]
    pace: FloatArray
    poses: FloatArray
    times: dict[tuple[int, int], float] = field(default_factory=dict)
    untried: dict[tuple[int, int], float] = field(default_factory=dict)
    tried: set[tuple[int, int]] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.joined: BoolArray = np.arange(len(self.poses)) == 0

    def add(self, poses: FloatArray) -> None:
        """Add poses (k, c)."""
        self.poses = np.vstack((self.poses, poses))
        self.joined = np.append(self.joined, np.zeros(len(poses), dtype=bool))

    def add_motion(self, first: int, last: int, rows: FloatArray) -> None:
        """Add the poses (k ≥ 2, c) of a certified motion between two poses, which are its ends."""
        nodes = [first, *range(len(self.poses), len(self.poses) + len(rows) - 2), last]
        self.add(rows[1:-1])
        for (one, other), step in zip(pairwise(nodes), np.diff(rows, axis=0), strict=True):
            pair = min(one, other), max(one, other)
            self.tried.add(pair)
            self.times[pair] = max(float(np.max(np.abs(step) / self.pace)), TINY)

    def find_neighbours(self) -> None:
        """Find the nearest neighbours of all poses, to which straight motions may lead."""
        scaled = self.poses / self.pace
        tree = cKDTree(scaled)
        for k, q in enumerate(scaled):
            count = _NEIGHBOURS if k else _OF_START
            away, near = map(np.asarray, tree.query(q, k=np.arange(1, count + 1), p=np.inf))
            for other, time in zip(near[near < len(scaled)].tolist(), away.tolist(), strict=False):
                if other != k and (pair := (min(k, other), max(k, other))) not in self.tried:
                    self.untried[pair] = max(time, TINY)

    def join(self) -> None:
        """Join poses with the start, over the shortest motions first."""
        neighbours: dict[int, list[int]] = {}
        for one, other in (*self.untried, *self.times):
            neighbours.setdefault(one, []).append(other)
            neighbours.setdefault(other, []).append(one)
        leaving: list[tuple[float, int, int]] = []
        fresh = np.flatnonzero(self.joined).tolist()
        while True:
            for k in fresh:
                for other in neighbours.get(k, ()):
                    pair = min(k, other), max(k, other)
                    time = 0.0 if pair in self.times else self.untried.get(pair, np.inf)
                    if not self.joined[other] and np.isfinite(time):
                        heapq.heappush(leaving, (time, k, other))
            if not leaving:
                return
            _, k, other = heapq.heappop(leaving)
            fresh = [other] if not self.joined[other] and self._certified(k, other) else []
            self.joined[fresh] = True

    def _certified(self, one: int, other: int) -> bool:
        """Return whether the motion between two neighbours has a certificate, which is sought once."""
        pair = min(one, other), max(one, other)
        if pair in self.untried:
            time = self.untried.pop(pair)
            self.tried.add(pair)
            if self.safe(*self.poses[list(pair)]):
                self.times[pair] = time
        return pair in self.times

    def chain(self, first: FloatArray, last: FloatArray) -> FloatArray | None:
        """Return the poses of the fastest way between two poses (c,), shape (K, c); None if there is no way."""
        ends = []
        for q in (first, last):
            away = np.max(np.abs(self.poses - q), axis=1)
            ends.append(int(np.argmin(away)))
            if away[ends[-1]] > _SAME:
                return None
        while True:
            nodes = self._way(*ends)
            if nodes is None or all(self._certified(*pair) for pair in pairwise(nodes)):
                return None if nodes is None else np.asarray(self.poses[nodes])

    def estimates(self, count: int) -> FloatArray:
        """Return the durations of the fastest ways between the first poses, over motions that may lack a certificate.

        Args:
            count: the number of poses.

        Returns:
            Durations [s], infinite where there is no way, shape (count, count).
        """
        return np.asarray(shortest_path(self._graph, directed=False, indices=np.arange(count)))[:, :count]

    @property
    def _graph(self) -> csr_array:
        """Least durations of the motions that have a certificate or may have one, shape (n, n) [s]."""
        known = self.times | self.untried
        pairs = np.array(list(known), dtype=np.intp).reshape(-1, 2)
        shape = (len(self.poses), len(self.poses))
        return csr_array((list(known.values()), (pairs[:, 0], pairs[:, 1])), shape=shape)

    def _way(self, first: int, last: int) -> list[int] | None:
        """Return the poses on the fastest way between two poses, over motions that may lack a certificate, or None."""
        _, before = shortest_path(self._graph, directed=False, indices=[first], return_predecessors=True)
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[0, nodes[-1]]))
            if nodes[-1] < 0:
                return None
        return nodes[::-1]
