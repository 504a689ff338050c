"""RRT-Connect: two trees of straight motions that grow towards each other (J. Kuffner and S. LaValle, 2000).

Where edges are rejected by samples, the motion from start to goal is certified when the trees meet, and the part that
cannot be proved is cut off.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall

_GOAL_ROUNDS = 10
"""Rounds between two searches for more poses at the goal. Taste."""
_MOST_GOALS = 40
"""Number of poses at the goal at which the tree accepts no more. Taste."""

_DOUBLINGS = 16
"""Bound on the doublings of a batch, never reached."""
_SPACE = 16
"""Nodes that there is space for, at least, for each target of a batch; a tree takes no more. Taste."""

FEW_LINKS = 10
"""Most links of an arm that is planned in all of its bends. Taste: with more, random shapes in the bends crumple,
and smooth ones are sampled."""
CONNECT = "RRT-Connect"
"""Name, among the names of candidates, of motions found by RRT-Connect."""

Connection = Callable[[Mapping[str, Any]], NativeCall]
"""Returns the call that grows two trees, given as the fields of ``Growth`` in rrt_connect.h, by checked motions."""
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

    def reserve(self, least: int) -> None:
        """Make space for at least ``least`` more nodes; the capacity doubles, so that nodes are seldom copied."""
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
    """Samples targets."""

    @property
    def batch(self) -> tuple[int, int]:
        """Least and greatest number of targets sampled at once; the batch doubles from round to round."""
        ...

    @property
    def longest(self) -> float:
        """Longest extension, as the norm of the change of a point."""
        ...

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return targets for the extension of a tree, shape (count, n); a few may be poses of the other tree."""
        ...


@dataclass
class ConnectSearch:
    """State of a search with two trees.

    Attributes:
        connection: makes the call that grows the trees by sampled motions.
        draws: sampler of targets.
        unproved: certificate of a whole motion, which returns the intervals that are not proved.
        goals: iterator over batches of poses at the goal, each of shape (m, n); may end.
        over: returns whether the time limit has passed.
        rng: source of every random choice.
        trees: trees from the start, and from poses at the goal.
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
            budget: number of further extensions allowed.
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
        """Add the next batch of poses at the goal, if any, and try to reach these poses at once."""
        tree = self.trees[1]
        if len(tree) and np.count_nonzero(tree.parents[: len(tree)] < 0) >= _MOST_GOALS:
            return
        poses = next(self.goals, None)
        if poses is None or len(poses) == 0:
            return
        first = len(tree)
        tree.add(poses, np.full(len(poses), -1))
        self._grow(1, self.trees[1].points[:0], first)

    def _extend(self, side: int) -> None:
        """Extend a tree towards random targets, and the other tree towards the new nodes."""
        low, high = self.draws.batch
        count = min(high, low << min(self.rounds, _DOUBLINGS))
        tree = self.trees[side]
        self._grow(side, self.draws.draw(self.rng, count, tree, self.trees[1 - side]), len(tree))
        self.extensions += count

    def _grow(self, side: int, targets: FloatArray, fresh: int) -> None:
        """Connect a tree's nodes from ``fresh`` on, extend it towards targets, and certify the motion where they meet.

        Args:
            side: number of the tree.
            targets: targets, shape (m, n).
            fresh: number of the first node that the other tree is extended towards.
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
