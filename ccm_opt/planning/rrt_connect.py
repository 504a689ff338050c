"""RRT-Connect: two trees of straight motions that grow towards each other (J. Kuffner and S. LaValle, 2000).

Where edges are rejected by samples, the way from start to goal is certified when the trees meet, and what of it cannot
be proved is cut off.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

_LEAST = 0.01
"""Shortest extension that makes a node [rad]. Taste."""
_GOAL_ROUNDS = 10
"""Rounds between two searches for more poses at the goal. Taste."""
_MOST_GOALS = 40
"""Poses at the goal that the tree may begin with. Taste."""

_DOUBLINGS = 16
"""More doublings of a batch than there ever are."""

FEW_LINKS = 10
"""Arms with at most so many links are planned in all of their bends. Taste: beyond, shapes drawn at random in the bends
crumple, and smooth ones are drawn."""
CONNECT = "RRT-Connect"
"""Name of what is found, among the names of candidates."""

FreeShares = Callable[[FloatArray, FloatArray], FloatArray]
"""How far straight motions, shapes (m, n) each, come before something is in the way, as shares of the whole, (m,)."""
Unproved = Callable[[FloatArray], IntArray]
"""Sorted intervals of a motion through points, shape (K, n), that are not certified."""


@dataclass
class PointTree:
    """Points that are reached from a root by straight motions; several roots are allowed.

    Attributes:
        points: all nodes, with room to spare, shape (capacity, n).
        parents: number of each node's parent, -1 for a root, shape (capacity,).
        count: number of nodes.
    """

    points: FloatArray
    parents: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    count: int = 0

    @classmethod
    def empty(cls, dimension: int) -> "PointTree":
        """Return a tree without nodes."""
        return cls(np.zeros((0, dimension)))

    def __len__(self) -> int:
        return self.count

    @property
    def nodes(self) -> FloatArray:
        """The nodes, shape (nodes, n)."""
        return self.points[: self.count]

    def add(self, points: FloatArray, parents: IntArray) -> IntArray:
        """Add nodes; their numbers.

        Args:
            points: shape (m, n).
            parents: number of each one's parent or -1, shape (m,).
        """
        numbers = np.arange(self.count, self.count + len(points))
        if self.count + len(points) > len(self.points):
            self._grow(len(points))
        self.points[numbers] = points
        self.parents[numbers] = parents
        self.count += len(points)
        return numbers

    def nearest(self, targets: FloatArray) -> IntArray:
        """Number of the node nearest to each target, (m, n) to (m,)."""
        # |a − b|² without the part that is the same for all nodes.
        nodes = self.nodes
        squares = np.einsum("kn,kn->k", nodes, nodes)
        return np.asarray(np.argmin(squares - 2.0 * (targets @ nodes.T), axis=1))

    def way_to(self, node: int) -> list[int]:
        """Return the numbers of the nodes from the root to a node."""
        way = []
        while node >= 0:
            way.append(node)
            node = int(self.parents[node])
        return way[::-1]

    def cut(self, node: int) -> None:
        """Take out a node and all that hang on it; the others are numbered anew."""
        gone = np.zeros(self.count + 1, dtype=bool)
        gone[node] = True
        # A parent stands before its children; the last place stands for the parent of roots, number -1.
        for k in range(node + 1, self.count):
            gone[k] = gone[self.parents[k]]
        kept = np.flatnonzero(~gone[:-1])
        number = np.full(self.count + 1, -1)
        number[kept] = np.arange(len(kept))
        self.points[: len(kept)] = self.points[kept]
        self.parents[: len(kept)] = number[self.parents[kept]]
        self.count = len(kept)

    def _grow(self, least: int) -> None:
        """Room for twice as many nodes, so that adding some seldom copies all."""
        capacity = max(256, 2 * (self.count + least))
        points = np.zeros((capacity, self.points.shape[1]))
        parents = np.full(capacity, -1, dtype=np.intp)
        points[: self.count] = self.nodes
        parents[: self.count] = self.parents[: self.count]
        self.points = points
        self.parents = parents


class Draws(Protocol):
    """Draws targets, and knows how far motions to them lead."""

    @property
    def batch(self) -> tuple[int, int]:
        """Targets that are drawn at once, at least and at most; the batch doubles from round to round."""
        ...

    @property
    def longest(self) -> float:
        """Longest extension, by ``travel``."""
        ...

    def travel(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return how far straight motions lead, shapes (m, n) to (m,) [rad]."""
        ...

    def within_limits(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return how far straight motions stay within the limits of the joints, as shares of the whole, shape (m,)."""
        ...

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return the targets for the extension of a tree, shape (count, n); the other may attract."""
        ...


@dataclass
class ConnectSearch:
    """Two trees in the making.

    Attributes:
        free_shares: how far motions are free; perhaps by samples.
        draws: of targets.
        unproved: the certificate of a whole way.
        goals: poses at the goal, shape (m, n) at a time; may end.
        over: whether the time is up.
        rng: source of every random choice.
        trees: from the start, and from poses at the goal.
        extensions: taken so far.
        rounds: of extensions.
        found: points of a certified motion, shape (K, n); None as long as there is none.
    """

    free_shares: FreeShares
    draws: Draws
    unproved: Unproved
    goals: Iterator[FloatArray]
    over: Callable[[], bool]
    rng: np.random.Generator
    trees: tuple[PointTree, PointTree]
    extensions: int = 0
    rounds: int = 0
    found: FloatArray | None = None

    def run(self, budget: int) -> FloatArray | None:
        """Extend the trees in turn; points of a certified motion, shape (K, n), or None.

        Args:
            budget: extensions that may be taken from now on.
        """
        last = self.extensions + budget
        while self.found is None and self.extensions < last and not self.over():
            if self.rounds % _GOAL_ROUNDS == 0:
                self._new_goals()
            side = self.rounds % 2
            # As long as there is no pose at the goal only the start's tree can grow.
            self._extend(side if len(self.trees[1]) else 0)
            self.rounds += 1
        return self.found

    def _new_goals(self) -> None:
        """Add poses at the goal, if there are more, and try to reach them at once."""
        tree = self.trees[1]
        if len(tree) and np.count_nonzero(tree.parents[: len(tree)] < 0) >= _MOST_GOALS:
            return
        poses = next(self.goals, None)
        if poses is None or len(poses) == 0:
            return
        self._connect(1, tree.add(poses, np.full(len(poses), -1)))

    def _extend(self, side: int) -> None:
        """Extend a tree towards random targets, and the other tree towards the new nodes."""
        low, high = self.draws.batch
        count = min(high, low << min(self.rounds, _DOUBLINGS))
        tree = self.trees[side]
        targets = self.draws.draw(self.rng, count, tree, self.trees[1 - side])
        parents = tree.nearest(targets)
        start = tree.nodes[parents]
        end = self._shortened(start, targets)
        self.extensions += count

        # All or nothing: nodes where an extension was stopped would all lie in contact, with little way on from there.
        free = self.draws.travel(start, end) > _LEAST
        # Where it is narrow most ends touch something, and one pose is soon looked at.
        free[free] = self.free_shares(end[free], end[free]) >= 1.0
        free[free] = self.free_shares(start[free], end[free]) >= 1.0
        added = tree.add(end[free], parents[free])
        if len(added) and len(self.trees[1 - side]):
            self._connect(side, added)

    def _connect(self, side: int, nodes: IntArray) -> None:
        """Extend the other tree as far as it goes towards new nodes; certify the way where it arrives."""
        other = self.trees[1 - side]
        targets = self.trees[side].nodes[nodes]
        nearest = other.nearest(targets)
        share = self.free_shares(other.nodes[nearest], targets)
        self.extensions += len(nodes)

        arrived = np.flatnonzero(share >= 1.0)
        for k in np.flatnonzero(share < 1.0):
            self._add_steps(other, int(nearest[k]), targets[k], float(share[k]))
        if len(arrived) == 0:
            return
        # The shortest of the ways that join the trees.
        ways = [self._joined(side, int(nodes[k]), int(nearest[k]))[0] for k in arrived]
        best = arrived[int(np.argmin([self.draws.travel(way[:-1], way[1:]).sum() for way in ways]))]
        self._settle(side, int(nodes[best]), int(nearest[best]))

    def _add_steps(self, tree: PointTree, node: int, target: FloatArray, share: float) -> None:
        """Nodes at whole steps towards a target, as many as lie in the free share of the way."""
        start = tree.nodes[node].copy()
        longest = self.draws.longest
        step = longest / max(float(self.draws.travel(start, target)), longest)
        for k in range(1, int(share / step) + 1):
            added = tree.add((start + k * step * (target - start))[None], np.array([node]))
            node = int(added[0])

    def _settle(self, side: int, node: int, meeting: int) -> None:
        """Certify the way through a node and a node of the other tree; cut off what cannot be proved."""
        way, first, second = self._joined(side, node, meeting)
        failing = self.unproved(way)
        if len(failing) == 0:
            self.found = way
            return
        # Intervals of the way: those of the start's tree, the one between the trees, those of the goal's tree.
        between = len(first) - 1
        at_start = failing[failing < between]
        at_goal = failing[failing > between]
        if len(at_start):
            self.trees[0].cut(first[int(at_start[0]) + 1])
        if len(at_goal):
            self.trees[1].cut(second[int(at_goal[-1]) - between - 1])

    def _joined(self, side: int, node: int, meeting: int) -> tuple[FloatArray, list[int], list[int]]:
        """Return the way from start to goal, and the numbers of its nodes in either tree."""
        ends = (node, meeting) if side == 0 else (meeting, node)
        first = self.trees[0].way_to(int(ends[0]))
        second = self.trees[1].way_to(int(ends[1]))[::-1]
        way = np.vstack((self.trees[0].nodes[first], self.trees[1].nodes[second]))
        return way, first, second

    def _shortened(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the ends of straight motions, none of which is too long or leaves the limits of the bends."""
        longest = self.draws.longest
        share = longest / np.maximum(self.draws.travel(start, end), longest)
        share = np.minimum(share, self.draws.within_limits(start, end))
        return start + share[:, None] * (end - start)
