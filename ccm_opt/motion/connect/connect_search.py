"""RRT-Connect (Kuffner and LaValle, 2000) on link headings, with many extensions at once.

A straight motion in the coordinates of the curve is one in the link headings too. Extensions are rejected by samples;
a way from start to goal is certified when the trees meet, and what of it cannot be proved is cut off.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.motion.connect.heading_tree import HeadingTree
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.target_draws import TargetDraws
from ccm_opt.motion.settings.connect_settings import ConnectSettings

_DOUBLINGS = 16
"""More doublings of a batch than there ever are."""

Unproved = Callable[[FloatArray], IntArray]
"""Sorted intervals of a motion, link headings of shape (K, links) [rad], that are not certified."""


@dataclass
class ConnectSearch:
    """Two trees in the making.

    Attributes:
        check: the cheap one.
        draws: of targets.
        unproved: the certificate.
        goals: poses at the goal, link headings of shape (m, links) [rad] at a time; may end.
        over: whether the time is up.
        rng: source of every random choice.
        settings: numbers.
        trees: from the start, and from poses at the goal.
        extensions: taken so far.
        rounds: of extensions.
        found: link headings of a certified motion, shape (K, links) [rad]; None as long as there is none.
    """

    check: SampledCheck
    draws: TargetDraws
    unproved: Unproved
    goals: Iterator[FloatArray]
    over: Callable[[], bool]
    rng: np.random.Generator
    settings: ConnectSettings
    trees: tuple[HeadingTree, HeadingTree]
    extensions: int = 0
    rounds: int = 0
    found: FloatArray | None = None

    def run(self, budget: int) -> FloatArray | None:
        """Extend the trees in turn; link headings of a certified motion, shape (K, links) [rad], or None.

        Args:
            budget: extensions that may be taken from now on.
        """
        last = self.extensions + budget
        while self.found is None and self.extensions < last and not self.over():
            if self.rounds % self.settings.goal_rounds == 0:
                self._new_goals()
            side = self.rounds % 2
            # As long as there is no pose at the goal only the start's tree can grow.
            self._extend(side if len(self.trees[1]) else 0)
            self.rounds += 1
        return self.found

    def _new_goals(self) -> None:
        """Add poses at the goal, if there are more, and try to reach them at once."""
        tree = self.trees[1]
        if len(tree) and np.count_nonzero(tree.parents[: len(tree)] < 0) >= self.settings.most_goals:
            return
        poses = next(self.goals, None)
        if poses is None or len(poses) == 0:
            return
        self._connect(1, tree.add(poses, np.full(len(poses), -1)))

    def _extend(self, side: int) -> None:
        """Extend a tree towards random targets, and the other tree towards the new nodes."""
        low, high = self.settings.batch
        count = min(high, low << min(self.rounds, _DOUBLINGS))
        tree = self.trees[side]
        targets = self.draws.draw(self.rng, count, tree, self.trees[1 - side])
        parents = tree.nearest(targets)
        start = tree.nodes[parents]
        end = self._shortened(start, targets)
        self.extensions += count

        # All or nothing: nodes where an extension was stopped would all lie in contact, with little way on from there.
        free = self.check.free_shares(start, end) >= 1.0
        free &= self._travel(start, end) > self.settings.least
        added = tree.add(end[free], parents[free])
        if len(added) and len(self.trees[1 - side]):
            self._connect(side, added)

    def _connect(self, side: int, nodes: IntArray) -> None:
        """Extend the other tree as far as it goes towards new nodes; certify the way where it arrives."""
        other = self.trees[1 - side]
        targets = self.trees[side].nodes[nodes]
        nearest = other.nearest(targets)
        share = self.check.free_shares(other.nodes[nearest], targets)
        self.extensions += len(nodes)

        arrived = np.flatnonzero(share >= 1.0)
        for k in np.flatnonzero(share < 1.0):
            self._add_steps(other, int(nearest[k]), targets[k], float(share[k]))
        if len(arrived) == 0:
            return
        # The shortest of the ways that join the trees.
        ways = [self._joined(side, int(nodes[k]), int(nearest[k]))[0] for k in arrived]
        best = arrived[int(np.argmin([self._travel(way[:-1], way[1:]).sum() for way in ways]))]
        self._settle(side, int(nodes[best]), int(nearest[best]))

    def _add_steps(self, tree: HeadingTree, node: int, target: FloatArray, share: float) -> None:
        """Nodes at whole steps towards a target, as many as lie in the free share of the way."""
        start = tree.nodes[node].copy()
        longest = self.draws.longest
        step = longest / max(float(self._travel(start, target)), longest)
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
        """The way from start to goal, and the numbers of its nodes in either tree."""
        ends = (node, meeting) if side == 0 else (meeting, node)
        first = self.trees[0].way_to(int(ends[0]))
        second = self.trees[1].way_to(int(ends[1]))[::-1]
        way = np.vstack((self.trees[0].nodes[first], self.trees[1].nodes[second]))
        return way, first, second

    def _shortened(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Ends of straight motions, none of which is too long or leaves the limits of the bends."""
        longest = self.draws.longest
        share = longest / np.maximum(self._travel(start, end), longest)
        share = np.minimum(share, self.draws.within_limits(start, end))
        return start + share[:, None] * (end - start)

    def _travel(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Bound on how far the tip moves, in arm lengths, shape (m,)."""
        travel: FloatArray = np.abs(end - start).mean(axis=-1)
        return travel
