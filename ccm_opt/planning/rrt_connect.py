"""RRT-Connect: two trees that grow towards each other (J. Kuffner and S. LaValle, 2000).

Their edges are straight lines in the space of the search, and are checked only at samples. When the trees meet, the
motion from start to goal is certified, and nodes beyond an edge that cannot be certified are removed.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall

_GOAL_ROUNDS = 10
"""Number of rounds of extensions between two requests for further poses at the goal. Heuristic."""
MOST_GOALS = 40
"""Number of poses at the goal from which on no more are requested. Heuristic."""

_DOUBLINGS = 16
"""Maximum number of times that the size of a batch of targets is doubled; the largest batch is reached before that."""
_SPACE = 16
"""Minimum number of nodes, per target of a batch, for which memory is reserved before an extension. Heuristic."""

FEW_LINKS = 10
"""Maximum number of links of an arm that is planned in the space of its bends. Heuristic: with more, random bends give
crumpled shapes, so smooth shapes are sampled instead."""
CONNECT = "RRT-Connect"
"""Candidate name of motions found by RRT-Connect."""

Connection = Callable[[Mapping[str, Any]], NativeCall]
"""Function that returns, from the fields of ``Growth`` in rrt_connect.h, the call of the C function that grows two
trees whose edges are checked by samples."""
Unproved = Callable[[FloatArray], IntArray]
"""Function that returns the sorted indices of the intervals of a motion through points (K, n) that are not
certified."""


@dataclass
class PointTree:
    """Tree, or forest, of points connected by straight lines in the space of the search.

    Attributes:
        points: the nodes, followed by unused rows, shape (capacity, n).
        parents: index of each node's parent, -1 for a root, shape (capacity,).
        count: number of nodes.
    """

    points: FloatArray
    parents: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    count: int = 0

    @classmethod
    def empty(cls, dimension: int) -> "PointTree":
        """Return a tree without nodes, for points of the given dimension."""
        return cls(np.zeros((0, dimension)))

    def __len__(self) -> int:
        return self.count

    @property
    def nodes(self) -> FloatArray:
        """The nodes, shape (nodes, n)."""
        return self.points[: self.count]

    def add(self, points: FloatArray, parents: IntArray) -> IntArray:
        """Add nodes, and return their indices, shape (m,).

        Args:
            points: new nodes, shape (m, n).
            parents: index of each new node's parent, -1 for a root, shape (m,).
        """
        numbers = np.arange(self.count, self.count + len(points))
        self.reserve(len(points))
        self.points[numbers] = points
        self.parents[numbers] = parents
        self.count += len(points)
        return numbers

    @property
    def for_c(self) -> Mapping[str, Any]:
        """The tree as the fields of ``Tree`` in rrt_connect.h."""
        return {"count": self.count, "capacity": len(self.points), "points": self.points, "parents": self.parents}

    def way_to(self, node: int) -> list[int]:
        """Return the indices of the nodes on the path from the root to a node, both included."""
        way = []
        while node >= 0:
            way.append(node)
            node = int(self.parents[node])
        return way[::-1]

    def cut(self, node: int) -> None:
        """Remove a node and all its descendants; the indices of other nodes change."""
        gone = np.zeros(self.count + 1, dtype=bool)
        gone[node] = True
        # Parents precede their children; the last entry is that of the parent of roots, index -1.
        for k in range(node + 1, self.count):
            gone[k] = gone[self.parents[k]]
        kept = np.flatnonzero(~gone[:-1])
        number = np.full(self.count + 1, -1)
        number[kept] = np.arange(len(kept))
        self.points[: len(kept)] = self.points[kept]
        self.parents[: len(kept)] = number[self.parents[kept]]
        self.count = len(kept)

    def reserve(self, least: int) -> None:
        """Ensure capacity for at least ``least`` more nodes; it grows by doubling, so that nodes are seldom copied."""
        if self.count + least <= len(self.points):
            return
        capacity = max(256, 2 * (self.count + least))
        points = np.zeros((capacity, self.points.shape[1]))
        parents = np.full(capacity, -1, dtype=np.intp)
        points[: self.count] = self.nodes
        parents[: self.count] = self.parents[: self.count]
        self.points = points
        self.parents = parents


class Draws(Protocol):
    """Sampler of the targets of a tree's extensions."""

    @property
    def batch(self) -> tuple[int, int]:
        """Minimum and maximum number of targets sampled together; the number doubles with every round of extensions."""
        ...

    @property
    def longest(self) -> float:
        """Maximum length of an extension: the norm of the difference of its end points, in their unit."""
        ...

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return targets of a tree's extensions, shape (count, n).

        Args:
            rng: random generator.
            count: number of targets.
            tree: the tree.
            other: the other tree, whose nodes may be targets.
        """
        ...


@dataclass
class ConnectSearch:
    """State of an RRT-Connect search with two trees, from the start and from points at the goal.

    Attributes:
        connection: returns the call of the C function that grows the trees.
        draws: sampler of targets.
        unproved: returns the indices of intervals of a motion that are not certified.
        goals: iterator over batches of points at the goal, each of shape (m, n); may end.
        over: returns whether the deadline has passed.
        rng: random generator.
        trees: tree from the start, and tree from points at the goal.
        extensions: number of extensions so far.
        rounds: number of rounds of extensions.
        found: points of a certified motion, shape (K, n); None until one is found.
    """

    connection: Connection
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
        """Extend the trees in turn, and return the points of a certified motion, shape (K, n), or None.

        Args:
            budget: maximum number of further extensions.
        """
        last = self.extensions + budget
        while self.found is None and self.extensions < last and not self.over():
            if self.rounds % _GOAL_ROUNDS == 0:
                self._new_goals()
            if self.found is None:
                # While there is no pose at the goal, only the start's tree can grow.
                self._extend(self.rounds % 2 if len(self.trees[1]) else 0)
            self.rounds += 1
        return self.found

    def _new_goals(self) -> None:
        """Add the next batch of points at the goal, if any, and extend the start's tree towards them."""
        tree = self.trees[1]
        if len(tree) and np.count_nonzero(tree.parents[: len(tree)] < 0) >= MOST_GOALS:
            return
        poses = next(self.goals, None)
        if poses is None or len(poses) == 0:
            return
        first = len(tree)
        # The first that is joined ends the search: a near one needs less motion.
        away = np.linalg.norm(poses - self.trees[0].points[0], axis=1)
        tree.add(poses[np.argsort(away)], np.full(len(poses), -1))
        self._grow(1, self.trees[1].points[:0], first)

    def _extend(self, side: int) -> None:
        """Extend tree ``side`` (0: start, 1: goal) towards random targets, and the other tree towards its new nodes."""
        low, high = self.draws.batch
        count = min(high, low << min(self.rounds, _DOUBLINGS))
        tree = self.trees[side]
        self._grow(side, self.draws.draw(self.rng, count, tree, self.trees[1 - side]), len(tree))
        self.extensions += count

    def _grow(self, side: int, targets: FloatArray, fresh: int) -> None:
        """Extend a tree towards targets and the other one towards its new nodes; certify the motion if they meet.

        Args:
            side: index of the tree, 0 or 1.
            targets: targets, shape (m, n).
            fresh: index of the first of this tree's nodes towards which the other tree is extended.
        """
        own, other = self.trees[side], self.trees[1 - side]
        for tree in (own, other):
            tree.reserve(_SPACE * (len(targets) + 1))
        call = self._call
        growth = call.fields.growth
        call.set(
            growth={
                **self._fixed,
                "own": own.for_c,
                "other": other.for_c,
                "targets": len(targets),
                "target": targets,
                "fresh": fresh,
            }
        )
        call()
        own.count, other.count = growth.own.count, growth.other.count
        if growth.met[0] >= 0:
            self._settle(side, growth.met[0], growth.met[1])

    @cached_property
    def _call(self) -> NativeCall:
        return self.connection(self._fixed)

    @cached_property
    def _fixed(self) -> Mapping[str, Any]:
        """Fields of ``Growth`` that do not change between extensions."""
        size = self.trees[0].points.shape[1]
        return {"size": size, "longest": self.draws.longest, "end": np.empty(size)}

    def _settle(self, side: int, node: int, meeting: int) -> None:
        """Certify the motion through the nodes where two trees meet; remove nodes beyond edges that are not certified.

        Args:
            side: index of the first node's tree, 0 or 1.
            node: index of the first node.
            meeting: index of the node of the other tree that is joined to it.
        """
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
        """Return the motion from start to goal through two nodes.

        Args:
            side: index of the first node's tree, 0 or 1.
            node: index of the first node.
            meeting: index of the node of the other tree.

        Returns:
            The points, shape (K, n), and the indices of its nodes in the start's and in the goal's tree.
        """
        ends = (node, meeting) if side == 0 else (meeting, node)
        first = self.trees[0].way_to(int(ends[0]))
        second = self.trees[1].way_to(int(ends[1]))[::-1]
        way = np.vstack((self.trees[0].nodes[first], self.trees[1].nodes[second]))
        return way, first, second
