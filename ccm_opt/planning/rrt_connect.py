"""RRT-Connect: two trees of straight motions that grow towards each other (J. Kuffner and S. LaValle, 2000).

Where edges are rejected by samples, the motion from start to goal is certified when the trees meet, and the part that
cannot be proved is cut off.
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
"""Number of poses at the goal at which the tree accepts no more. Taste."""

_DOUBLINGS = 16
"""Bound on the doublings of a batch, never reached."""

FEW_LINKS = 10
"""Most links of an arm that is planned in all of its bends. Taste: with more, random shapes in the bends crumple,
and smooth ones are sampled."""
CONNECT = "RRT-Connect"
"""Name, among the names of candidates, of motions found by RRT-Connect."""

FreeShares = Callable[[FloatArray, FloatArray], FloatArray]
"""Returns the free shares of straight motions, shapes (m, n) each, before an obstruction, (m,)."""
Unproved = Callable[[FloatArray], IntArray]
"""Returns the sorted intervals of a motion through points, shape (K, n), that are not certified."""


@dataclass
class PointTree:
    """Points that are reached from a root by straight motions; several roots are allowed.

    Attributes:
        points: all nodes, with spare capacity, shape (capacity, n).
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
        """Add nodes, and return their numbers.

        Args:
            points: new nodes, shape (m, n).
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
        """Return the number of the node nearest to each target, (m, n) to (m,)."""
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
        """Remove a node and all its descendants; the others are renumbered."""
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
        """Double the capacity, so that adding nodes seldom copies all of them."""
        capacity = max(256, 2 * (self.count + least))
        points = np.zeros((capacity, self.points.shape[1]))
        parents = np.full(capacity, -1, dtype=np.intp)
        points[: self.count] = self.nodes
        parents[: self.count] = self.parents[: self.count]
        self.points = points
        self.parents = parents


class Draws(Protocol):
    """Samples targets, and measures motions to them."""

    @property
    def batch(self) -> tuple[int, int]:
        """Least and greatest number of targets sampled at once; the batch doubles from round to round."""
        ...

    @property
    def longest(self) -> float:
        """Longest extension, as measured by ``travel``."""
        ...

    def travel(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the lengths of straight motions, shapes (m, n) to (m,) [rad]."""
        ...

    def within_limits(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the shares of straight motions that lie within the limits of the joints, shape (m,)."""
        ...

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return targets for the extension of a tree, shape (count, n); some may be drawn towards the other tree."""
        ...


@dataclass
class ConnectSearch:
    """State of a search with two trees.

    Attributes:
        free_shares: free shares of motions, perhaps by samples.
        draws: sampler of targets.
        unproved: certificate of a whole motion.
        goals: poses at the goal, shape (m, n) at a time; may end.
        over: whether the time is up.
        rng: source of every random choice.
        trees: trees from the start, and from poses at the goal.
        ends_first: whether ends of extensions are checked before the motions to them: worth it where one pose costs far
            less than a motion, and most ends touch something.
        extensions: number of extensions so far.
        rounds: number of rounds of extensions.
        found: points of a certified motion, shape (K, n); None as long as there is none.
    """

    free_shares: FreeShares
    draws: Draws
    unproved: Unproved
    goals: Iterator[FloatArray]
    over: Callable[[], bool]
    rng: np.random.Generator
    trees: tuple[PointTree, PointTree]
    ends_first: bool = False
    extensions: int = 0
    rounds: int = 0
    found: FloatArray | None = None

    def run(self, budget: int) -> FloatArray | None:
        """Extend the trees in turn, and return the points of a certified motion, shape (K, n), or None.

        Args:
            budget: number of further extensions allowed.
        """
        last = self.extensions + budget
        while self.found is None and self.extensions < last and not self.over():
            if self.rounds % _GOAL_ROUNDS == 0:
                self._new_goals()
            side = self.rounds % 2
            # While there is no pose at the goal, only the start's tree can grow.
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

        # All or nothing: nodes where an extension was stopped would all lie in contact, where little can follow.
        free = self.draws.travel(start, end) > _LEAST
        if self.ends_first:
            free[free] = self.free_shares(end[free], end[free]) >= 1.0
        free[free] = self.free_shares(start[free], end[free]) >= 1.0
        added = tree.add(end[free], parents[free])
        if len(added) and len(self.trees[1 - side]):
            self._connect(side, added)

    def _connect(self, side: int, nodes: IntArray) -> None:
        """Extend the other tree as far as possible towards new nodes; certify the motion where it arrives."""
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
        # Take the shortest of the motions that join the trees.
        ways = [self._joined(side, int(nodes[k]), int(nearest[k]))[0] for k in arrived]
        best = arrived[int(np.argmin([self.draws.travel(way[:-1], way[1:]).sum() for way in ways]))]
        self._settle(side, int(nodes[best]), int(nearest[best]))

    def _add_steps(self, tree: PointTree, node: int, target: FloatArray, share: float) -> None:
        """Add nodes at whole steps towards a target, within the free share of the motion."""
        start = tree.nodes[node].copy()
        longest = self.draws.longest
        step = longest / max(float(self.draws.travel(start, target)), longest)
        for k in range(1, int(share / step) + 1):
            added = tree.add((start + k * step * (target - start))[None], np.array([node]))
            node = int(added[0])

    def _settle(self, side: int, node: int, meeting: int) -> None:
        """Certify the motion through a node and a node of the other tree; cut off the part that cannot be proved."""
        way, first, second = self._joined(side, node, meeting)
        failing = self.unproved(way)
        if len(failing) == 0:
            self.found = way
            return
        # Intervals of the motion: those of the start's tree, the one between the trees, those of the goal's tree.
        between = len(first) - 1
        at_start = failing[failing < between]
        at_goal = failing[failing > between]
        if len(at_start):
            self.trees[0].cut(first[int(at_start[0]) + 1])
        if len(at_goal):
            self.trees[1].cut(second[int(at_goal[-1]) - between - 1])

    def _joined(self, side: int, node: int, meeting: int) -> tuple[FloatArray, list[int], list[int]]:
        """Return the motion from start to goal, and the numbers of its nodes in either tree."""
        ends = (node, meeting) if side == 0 else (meeting, node)
        first = self.trees[0].way_to(int(ends[0]))
        second = self.trees[1].way_to(int(ends[1]))[::-1]
        way = np.vstack((self.trees[0].nodes[first], self.trees[1].nodes[second]))
        return way, first, second

    def _shortened(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the ends of straight motions, shortened to the longest extension and to the limits of the bends."""
        longest = self.draws.longest
        share = longest / np.maximum(self.draws.travel(start, end), longest)
        share = np.minimum(share, self.draws.within_limits(start, end))
        return start + share[:, None] * (end - start)
