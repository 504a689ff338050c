"""A roadmap of poses: random poses of an arm with few links, joined by certified straight motions.

Kavraki, Svestka, Latombe and Overmars, "Probabilistic roadmaps for path planning in high-dimensional configuration
spaces", IEEE Transactions on Robotics and Automation 1996. Where an arm has few joints, random poses fill the space of
its configurations well enough that most lie within reach of each other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, shortest_path
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray

_NEIGHBOURS = 8
"""Number of nearest poses with which a pose is joined. Heuristic: in rooms with ten boxes, nine in ten poses are then
joined with the start."""
_SAME = 1e-9
"""Largest difference of coordinates of the same pose [rad, m]."""


@dataclass(eq=False)
class PoseRoadmap:
    """Poses, the first of which is the start, and the straight motions between them that have a certificate.

    Attributes:
        safe: returns whether the straight motion between two configurations (c,) has a certificate.
        pace: fastest rates of the coordinates, shape (c,) [rad/s, m/s].
        poses: the poses, shape (n, c) [rad, m].
        times: least durations of the motions [s], by the indices of their ends, the lower one first.
    """

    safe: Callable[[FloatArray, FloatArray], bool]
    pace: FloatArray
    poses: FloatArray
    times: dict[tuple[int, int], float] = field(default_factory=dict)

    @classmethod
    def of(
        cls, safe: Callable[[FloatArray, FloatArray], bool], pace: FloatArray, poses: Sequence[FloatArray]
    ) -> "PoseRoadmap":
        """Return the roadmap of poses, each of shape (c,), joined with their nearest ones; see the class."""
        roadmap = cls(safe, pace, np.array(poses))
        scaled = roadmap.poses / pace
        away, near = cKDTree(scaled).query(scaled, k=min(_NEIGHBOURS + 1, len(scaled)), p=np.inf)
        for k, row in enumerate(np.atleast_2d(near).tolist()):
            roadmap._join(k, dict(zip(row, np.atleast_2d(away)[k].tolist(), strict=True)))
        return roadmap

    def add(self, q: FloatArray) -> None:
        """Add a pose (c,), joined with its nearest ones."""
        away = np.max(np.abs(self.poses - q) / self.pace, axis=1)
        near = np.argsort(away, kind="stable")[:_NEIGHBOURS].tolist()
        self.poses = np.vstack((self.poses, q))
        self._join(len(self.poses) - 1, {k: float(away[k]) for k in near})

    def _join(self, k: int, near: dict[int, float]) -> None:
        """Join a pose with others by the motions that have a certificate.

        Args:
            k: index of the pose.
            near: least durations of the motions to other poses [s], by their indices.
        """
        for other, time in near.items():
            pair = min(k, other), max(k, other)
            if k != other and pair not in self.times and self.safe(*self.poses[list(pair)]):
                self.times[pair] = max(time, TINY)

    @property
    def _graph(self) -> csr_array:
        """Least durations of the motions, shape (n, n) [s]."""
        pairs = np.array(list(self.times), dtype=np.intp).reshape(-1, 2)
        shape = (len(self.poses), len(self.poses))
        return csr_array((list(self.times.values()), (pairs[:, 0], pairs[:, 1])), shape=shape)

    @property
    def joined(self) -> BoolArray:
        """Mask of the poses to which motions lead from the start, shape (n,)."""
        parts = connected_components(self._graph, directed=False)[1]
        return np.asarray(parts == parts[0])

    def chain(self, first: FloatArray, last: FloatArray) -> FloatArray | None:
        """Return the poses of the fastest way between two poses (c,), shape (K, c); None if there is no way."""
        ends = []
        for q in (first, last):
            away = np.max(np.abs(self.poses - q), axis=1)
            ends.append(int(np.argmin(away)))
            if away[ends[-1]] > _SAME:
                return None
        _, before = shortest_path(self._graph, directed=False, indices=[ends[0]], return_predecessors=True)
        if ends[0] != ends[1] and before[0, ends[1]] < 0:
            return None
        nodes = [ends[1]]
        while nodes[-1] != ends[0]:
            nodes.append(int(before[0, nodes[-1]]))
        return np.asarray(self.poses[nodes[::-1]])
