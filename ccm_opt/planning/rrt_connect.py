"""RRT-Connect in the joints.

A straight motion in the coordinates of the curve is one in the link headings too. Extensions are rejected by samples;
a way from start to goal is certified when the trees meet, and what of it cannot be proved is cut off.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.draws import GoalDraws, HeadingTree, TargetDraws
from ccm_opt.planning.link_space import KNOTS, LinkSpace, fit_coordinates
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.settings import ConnectSettings
from ccm_opt.planning.shortcuts import Shortcuts, dense
from ccm_opt.planning.step import GoalPose, polish

_LEAST = 0.01
"""Shortest extension that makes a node [rad]. Taste."""
_TURN = 0.15
"""Most that a link turns between two keyframes [rad]. Derived: that of a step of the continuation."""

_BATCH = (4, 32)
"""Targets that are drawn at once, at least and at most; the batch doubles from round to round. Taste: a plain scene is
solved by a few extensions, a hard one by tens of thousands, which NumPy does together."""
_GOAL_ROUNDS = 10
"""Rounds between two searches for more poses at the goal. Taste."""
_MOST_GOALS = 40
"""Poses at the goal that the tree may begin with. Taste."""

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
        low, high = _BATCH
        count = min(high, low << min(self.rounds, _DOUBLINGS))
        tree = self.trees[side]
        targets = self.draws.draw(self.rng, count, tree, self.trees[1 - side])
        parents = tree.nearest(targets)
        start = tree.nodes[parents]
        end = self._shortened(start, targets)
        self.extensions += count

        # All or nothing: nodes where an extension was stopped would all lie in contact, with little way on from there.
        free = self.check.free_shares(start, end) >= 1.0
        free &= self._travel(start, end) > _LEAST
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


CONNECT = "RRT-Connect"
"""Name of what is found, among the names of candidates."""


@dataclass(frozen=True)
class Connecting:
    """What one search by RRT-Connect is given.

    Attributes:
        task: what is looked for.
        space: link space of the motion.
        start: pose at the start.
        goal: with the coordinates of a goal for the whole arm.
        known_goals: makes poses at a goal for the tip that are known otherwise, each when it is asked for.
    """

    task: MotionTask
    space: LinkSpace
    start: Pose
    goal: GoalPose
    known_goals: Callable[[], Iterator[Pose]]

    @property
    def settings(self) -> ConnectSettings:
        """Numbers of RRT-Connect."""
        return self.task.settings.connect

    def find(self, budgets: tuple[int, ...], seed: tuple[int, ...]) -> Motion | None:
        """A certified motion; None when several searches, or the time, do not suffice.

        Args:
            budgets: extensions that one search after the other may take.
            seed: of every random choice.
        """
        task = self.task
        check = SampledCheck.of(task.arm, task.workspace)
        # Most searches end soon or never: each begins anew.
        for number, budget in enumerate(budgets):
            rng = np.random.default_rng((*seed, number))
            way = self._search(check, rng).run(budget)
            if way is not None:
                shortcuts = Shortcuts(check, task.certificate.failures, self.settings.shortcuts)
                return self._motion(shortcuts.shortened(way, rng))
            if task.deadline.passed():
                break
        return None

    def _motion(self, way: FloatArray) -> Motion | None:
        """A way in the coordinates of the curve, certified once more; None when that fails."""
        coordinates = self._coordinates(dense(way, _TURN))
        headings = self.space.configurations(coordinates)
        # The same motion but for rounding, and for the last bit of the way onto the goal.
        if not self._on_goal(coordinates[-1]) or len(self.task.certificate.failures(headings)):
            return None
        return Motion(self.space, coordinates, headings, CONNECT)

    def _search(self, check: SampledCheck, rng: np.random.Generator) -> ConnectSearch:
        """Trees with nothing but the start."""
        task = self.task
        ends = [self.start.q]
        if self.goal.coordinates is not None:
            ends.append(self.space.configurations(self.goal.coordinates))
        share = task.settings.step.limit_share
        draws = TargetDraws.within(self.space, ends, KNOTS + 1, share, self.settings)
        trees = (HeadingTree.empty(task.arm.links), HeadingTree.empty(task.arm.links))
        trees[0].add(self.start.q[None], np.array([-1]))
        goals = self._goals(draws, check, rng)
        unproved = task.certificate.failures
        return ConnectSearch(check, draws, unproved, goals, task.deadline.passed, rng, self.settings, trees)

    def _goals(self, draws: TargetDraws, check: SampledCheck, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Poses at the goal: that of the whole arm, or some that have the tip there."""
        if self.goal.coordinates is not None:
            yield self.space.configurations(self.goal.coordinates)[None]
            return
        drawn = GoalDraws(draws, self.goal, check).poses(rng)
        yield next(drawn)
        # Poses drawn at random seldom fit where it is narrow; those of the NLP are costlier.
        for pose in self.known_goals():
            yield pose.q[None]
            yield next(drawn)
        yield from drawn

    def _coordinates(self, way: FloatArray) -> FloatArray:
        """Coordinates of link headings of the space, the ends exact, shape (K, links) to (K, p)."""
        space = self.space
        start = self.start.v
        end = self.goal.coordinates
        if end is None:
            end = polish(space, self.goal, self._fitted(way[-1], start))
        arcs = arc_lengths(way)
        line = start + (arcs / arcs[-1])[:, None] * (end - start)
        return np.vstack((start, [self._fitted(*pair) for pair in zip(way[1:-1], line[1:-1], strict=True)], end))

    def _fitted(self, headings: FloatArray, near: FloatArray) -> FloatArray:
        """Coordinates near given ones with given link headings."""
        space = self.space
        missed = headings - space.configurations(near)
        # Few links leave many curves with the same headings: the smoothest, and then what it misses.
        change = fit_coordinates(space.matrix, missed, space.arm.length)
        rest = missed - space.matrix @ change
        return near + change + np.linalg.lstsq(space.matrix, rest, rcond=None)[0]

    def _on_goal(self, v: FloatArray) -> bool:
        if self.goal.coordinates is not None:
            return True
        final = self.space.pose(v)
        within = np.all(np.abs(self.task.arm.bends(final.q)) <= self.task.arm.bend_limits)
        return bool(within) and self.goal.on_goal(final) and self.goal.limits_met(final)
