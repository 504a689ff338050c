"""A tree of poses, each reached from its parent by a certified motion."""

from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.settings.tree_settings import DEFAULT_TREES


@dataclass
class PoseTree:
    """Poses of the whole arm and how they are reached; several roots are allowed.

    Attributes:
        length: of the arm [m].
        heading_weight: of a radian of heading against the length of the arm in the distance of two poses.
        poses: of the nodes.
        parents: number of each node's parent, -1 for a root.
        edges: poses from the parent, without it, to the node.
        uses: how often each node was drawn.
    """

    length: float
    heading_weight: float = DEFAULT_TREES.heading_weight
    poses: list[Pose] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    edges: list[list[Pose]] = field(default_factory=list)
    uses: list[int] = field(default_factory=list)
    # The same in arrays with room to spare, so that distances to all nodes are one expression.
    _points: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 2)))
    _headings: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.poses)

    def add_root(self, pose: Pose) -> int:
        """Add a pose that no other leads to; its number."""
        return self.add(-1, [pose])

    def add(self, parent: int, edge: list[Pose]) -> int:
        """Add the last pose of an edge; its number.

        Args:
            parent: number of the node the edge begins at.
            edge: poses after the parent's.
        """
        count = len(self)
        pose = edge[-1]
        if count == len(self._points):
            self._double_capacity(pose)
        self._points[count] = pose.points
        self._headings[count] = pose.headings
        self.poses.append(pose)
        self.parents.append(parent)
        self.edges.append(edge)
        self.uses.append(0)
        return count

    def distances(self, pose: Pose) -> FloatArray:
        """Distance of every node to a pose: of the joints in arm lengths and of the headings; shape (nodes,).

        The headings tell poses apart that look the same but are wound round the base differently.
        """
        count = len(self)
        apart = np.linalg.norm(self._points[:count] - pose.points, axis=2).mean(axis=1) / self.length
        turn = np.sqrt(np.mean((self._headings[:count] - pose.headings) ** 2, axis=1))
        distances: FloatArray = apart + self.heading_weight * turn
        return distances

    def nearest(self, pose: Pose) -> int:
        """Number of the node nearest to a pose."""
        return int(np.argmin(self.distances(pose)))

    def tip_distances(self, place: FloatArray) -> FloatArray:
        """Distance of every node's tip to a place (2,), shape (nodes,) [m]."""
        distances: FloatArray = np.linalg.norm(self._points[: len(self), -1] - place, axis=1)
        return distances

    def least_used(self, choice: IntArray) -> int:
        """Of some nodes the one that was drawn least often, and count that it is drawn now."""
        node = min((int(k) for k in choice), key=lambda k: self.uses[k])
        self.uses[node] += 1
        return node

    def poses_to(self, node: int) -> list[Pose]:
        """All poses from the root to a node."""
        edges = []
        while node >= 0:
            edges.append(self.edges[node])
            node = self.parents[node]
        return [pose for edge in reversed(edges) for pose in edge]

    def _double_capacity(self, like: Pose) -> None:
        """Make room for twice as many nodes, so that adding one seldom copies all."""
        count = len(self)
        capacity = max(64, 2 * count)
        points = np.zeros((capacity, *like.points.shape))
        headings = np.zeros((capacity, *like.headings.shape))
        if count:
            points[:count] = self._points[:count]
            headings[:count] = self._headings[:count]
        self._points = points
        self._headings = headings
