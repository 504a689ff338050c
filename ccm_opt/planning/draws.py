"""RRT-Connect for planar arms in the space of link headings, with samplers of poses at the goal and elsewhere.

A motion that is linear in the coordinates of the curve is also linear in the link headings.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.polyline import arc_lengths, wrap
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.limit_stack import within_limits
from ccm_opt.planning.link_space import KNOTS, LinkSpace, fit_coordinates
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.rrt_connect import CONNECT, FEW_LINKS, ConnectSearch, PointTree
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.shortcuts import Shortcuts, dense
from ccm_opt.robot.arm import Arm

_GOAL_DRAWS = 64
"""Number of random poses that Newton's method moves onto the goal at a time. Heuristic."""
_GOAL_SHAPES = 1024
"""Number of random poses of an arm of many links, of which the ``_GOAL_DRAWS`` nearest are moved onto the goal.
Measured on arms wound among walls: ways are found in 0.1 s, with all poses moved there in 0.3 s or not at all."""
_FACING = 0.3
"""Position error of the tip that counts as much as a heading error of one radian [arm lengths]. Heuristic."""
_NEWTON_STEPS = 15
"""Number of steps of Newton's method. Measured: poses that have not converged by then seldom do."""
_NEWTON_TURN = 0.5
"""Largest turn of a link in one step of Newton's method [rad]. Heuristic."""
_ARRIVED = 1e-06
"""Position error [arm lengths] and heading error [rad] of the tip up to which a pose counts as at the goal. Derived:
far less than the final correction can repair."""
_APART = 0.1
"""Root mean square of the turns of all links between two poses at the goal above which the poses count as different
[rad]. Heuristic."""

_RANGE = 1.5
"""Longest extension for arms of few links, as the root mean square turn of the links [rad]. Measured: on scenes of 4 to
8 links half as much takes half as long again."""
_WINDING = 2.0 * np.pi
"""Angle by which the base may turn beyond its headings at start and goal [rad]. Heuristic: a whole turn permits both
directions."""
_KNOTS = 12
"""Number of knots between which the curvature of a smooth target is linear. Measured on the hardest of four scenes of
24 links: 12 finds a path in 6 of 6 searches of 60 000 extensions, 9 in 5; with 6, searches are half as long again."""
_TURNING = 25.0
"""Largest turn of a smooth target along the arm [rad]. Measured: past two posts 12 and 25 take 0.3 s, 5 takes 5 s,
because an arm that curls up gets out from behind them."""
_BUMP_WIDTHS = (0.05, 0.3)
"""Minimum and maximum width of a part of the arm that is bent sideways, as fractions of the arm's length. Heuristic."""

_SMOOTH_RANGE = 0.4
"""Longest extension for arms of many links, as the root mean square turn of the links [rad]. Measured on four hard
scenes of 24 links among 30 polygons: 0.4 solves them in 16 of 16 searches, by 1000 to 60 000 extensions each; 1.5 finds
nothing in two of them by 60 000."""
_BUMPED = 0.2
"""Fraction of targets that are poses of the tree with a part of the arm bent sideways. Heuristic."""
_ATTRACTED = 0.1
"""Fraction of targets that are poses of the other tree. Heuristic."""
_BUMP = 0.8
"""Standard deviation of the angle by which a part of the arm is bent sideways [rad]. Heuristic."""


_RANK = 1e-6
"""Fraction of the largest singular value below which a singular value counts as zero."""


_BATCH = (4, 32)
"""Minimum and maximum number of targets sampled at once. Heuristic: a plain scene is solved by a few extensions, a hard
one by tens of thousands, which NumPy processes together."""
_KEYFRAME_TURN = 0.15
"""Largest turn of a link between two keyframes [rad]. Derived: that of a step of the continuation."""


@dataclass(frozen=True)
class TargetDraws:
    """Sampler of target shapes for the extensions of search trees, within the shapes that the curve can take.

    Attributes:
        arm: the arm.
        projector: matrix that projects changes of link headings onto those that the coordinates of the curve can
            produce, shape (links, links).
        offsets: link headings for zero coordinates of the curve, with the coordinate that blends into a goal for the
            whole arm at 0 (start) and at 1 (goal), each of shape (links,) [rad].
        limits: bounds on the magnitudes of sampled bends, shape (links,) [rad].
        base: lower and upper bound on the sampled bend of the first joint [rad].
        batch: minimum and maximum number of targets sampled at once.
    """

    arm: Arm
    projector: FloatArray
    offsets: tuple[FloatArray, FloatArray]
    limits: FloatArray
    base: tuple[float, float]
    batch: tuple[int, int] = _BATCH

    @property
    def longest(self) -> float:
        """Longest extension of a tree, as the norm of the turns of the links [rad]."""
        few = self.arm.links <= FEW_LINKS
        return float(np.sqrt(self.arm.links)) * (_RANGE if few else _SMOOTH_RANGE)

    @classmethod
    def within(cls, space: LinkSpace, ends: list[FloatArray], curve_columns: int, share: float) -> "TargetDraws":
        """Return a sampler of targets for a motion between known ends.

        Args:
            space: map from coordinates to configurations, possibly with a coordinate that blends into a goal.
            ends: configurations, each of shape (links,) [rad], of the start and, for a goal of the whole arm, the goal.
            curve_columns: number of coordinates of the curve alone.
            share: fraction of the joint limits that is used; bends that occur at an end are allowed in any case.
        """
        arm = space.arm
        curve = space.turns[:, :curve_columns]
        projector = curve @ np.linalg.pinv(curve, rcond=_RANK)
        offset = arm.headings(space.offset)
        blended = offset + space.turns[:, curve_columns:].sum(axis=1)

        bends = np.array(ends)
        limits = np.maximum(share * arm.bend_limits, np.abs(bends).max(axis=0))
        # A base that turns further would wind the arm around itself.
        low = max(-limits[0], float(bends[:, 0].min()) - _WINDING)
        high = min(limits[0], float(bends[:, 0].max()) + _WINDING)
        return cls(arm, projector, (offset, blended), limits, (low, high))

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return the link headings of random targets for the extension of a tree, shape (count, links) [rad].

        A fraction of the targets are poses of the other tree, so that the trees grow towards each other.
        """
        targets = self.shapes(rng, count)
        kind = rng.random(count)
        bumped = np.flatnonzero(kind < _BUMPED)
        targets[bumped] = self._bumped(rng, tree.nodes[rng.integers(len(tree), size=len(bumped))])
        if len(other):
            attracted = np.flatnonzero(kind > 1.0 - _ATTRACTED)
            targets[attracted] = other.nodes[rng.integers(len(other), size=len(attracted))]
        return targets

    def shapes(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return the link headings of random shapes, shape (count, links) [rad]."""
        arm = self.arm
        if arm.links <= FEW_LINKS:
            bends = rng.uniform(-self.limits, self.limits, (count, arm.links))
        else:
            # Independent bends of many links would crumple the arm; smooth ones stretch through the scene.
            most = np.minimum(self.limits, _TURNING / arm.links)
            knots = rng.uniform(-1.0, 1.0, (count, _KNOTS))
            at = np.linspace(0.0, _KNOTS - 1.0, arm.links)
            left = np.minimum(at.astype(np.intp), _KNOTS - 2)
            bends = most * (knots[:, left] + (at - left) * (knots[:, left + 1] - knots[:, left]))
        bends[:, 0] = rng.uniform(*self.base, count)
        return self._in_space(rng, arm.headings(bends))

    def _bumped(self, rng: np.random.Generator, headings: FloatArray) -> FloatArray:
        """Return the link headings of given poses, shape (m, links) [rad], with a random part of the arm bent sideways.

        In an arm of few links the bend of one joint is changed; in an arm of many links, the headings of several.
        """
        arm = self.arm
        count = len(headings)
        turn = rng.normal(0.0, _BUMP, (count, 1))
        at = rng.uniform(0.0, 1.0, (count, 1))
        along = (np.arange(arm.links) + 0.5) / arm.links
        if arm.links <= FEW_LINKS:
            return self._clipped(headings + turn * (along >= at))
        width = rng.uniform(*_BUMP_WIDTHS, (count, 1))
        bumped = headings + turn * np.exp(-(((along - at) / width) ** 2))
        return self._in_space(rng, bumped)

    def _clipped(self, headings: FloatArray) -> FloatArray:
        bends = np.clip(self.arm.bends(headings), -self.limits, self.limits)
        return self.arm.headings(bends)

    def _in_space(self, rng: np.random.Generator, headings: FloatArray) -> FloatArray:
        """Return link headings (m, links) projected onto those that the curve can produce [rad].

        A random fraction of the difference between the offsets of start and goal is added.
        """
        share = rng.random((len(headings), 1))
        offset = self.offsets[0] + share * (self.offsets[1] - self.offsets[0])
        return offset + (headings - offset) @ self.projector.T


_RIDGE = 1e-9
"""Value added to the diagonal of Newton's equations, in squared arm lengths, which are singular at full stretch."""

_INSIDE = 0.99
"""Fraction of the goal's tolerance in which members are sampled, so that the rounding of Newton's method leaves none
outside."""


@dataclass(frozen=True)
class GoalDraws:
    """Sampler of random poses of a planar arm with the tip at a goal.

    Attributes:
        draws: sampler of random shapes of the arm.
        goal: goal for the tip.
        check: fast collision check of poses by samples.
    """

    draws: TargetDraws
    goal: GoalPose
    check: SampledCheck

    def poses(self, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Yield batches of distinct poses at the goal without detected collision, as link headings (m, links) [rad].

        A batch may be empty.
        """
        known = np.zeros((0, self.draws.arm.links))
        while True:
            drawn = self._brought(*self._nearest(rng))
            drawn = drawn[~self.check.refuted(drawn)]
            new = []
            for pose in drawn:
                apart = np.sqrt(np.mean((known - pose) ** 2, axis=1))
                if apart.min(initial=np.inf) > _APART:
                    new.append(pose)
                    known = np.vstack((known, pose))
            yield np.array(new).reshape(-1, self.draws.arm.links)

    def _nearest(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return link headings of random shapes nearest to goal members, (m, links) [rad], and those members, (m, 3).

        A member is a position and heading of the tip [m, rad].
        """
        arm = self.draws.arm
        count = _GOAL_SHAPES if arm.links > FEW_LINKS else _GOAL_DRAWS
        shapes, members = self.draws.shapes(rng, count), self._members(rng, count)
        away = np.linalg.norm(arm.joint_positions(shapes)[:, -1] - members[:, :2], axis=1) / arm.length
        if self.goal.heading is not None:
            away += _FACING * np.abs(wrap(members[:, 2] - shapes[:, -1]))
        near = np.sort(np.argsort(away)[:_GOAL_DRAWS])
        return shapes[near], members[near]

    def _members(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return random positions and headings of the tip that satisfy the goal, shape (count, 3) [m, rad].

        For a goal set, they are distributed uniformly over the set.
        """
        distance, turn = self.goal.room
        away = rng.uniform(0.0, 2.0 * np.pi, count)
        radius = _INSIDE * distance * np.sqrt(rng.random(count))
        places = self.goal.position + radius[:, None] * np.column_stack((np.cos(away), np.sin(away)))
        middle = 0.0 if self.goal.heading is None else self.goal.heading
        return np.column_stack((places, middle + _INSIDE * rng.uniform(-turn, turn, count)))

    def _brought(self, headings: FloatArray, members: FloatArray) -> FloatArray:
        """Return the link headings of poses moved onto members of the goal by Newton's method with least link turns.

        The shape is (k, links), k ≤ m [rad]. Poses that do not converge, or exceed the limits of the bends, are left
        out.

        Args:
            headings: link headings of the poses, shape (m, links) [rad].
            members: positions and headings of the tip, shape (m, 3) [m, rad].
        """
        arm = self.draws.arm
        projector = self.draws.projector
        for _ in range(_NEWTON_STEPS):
            rows, error = self._equations(headings, members)
            spread = projector @ rows.transpose(0, 2, 1)
            square = rows @ spread + _RIDGE * np.eye(rows.shape[1])
            change = (spread @ np.linalg.solve(square, error[..., None]))[..., 0]
            most = np.abs(change).max(axis=1, keepdims=True)
            headings = headings + change * np.minimum(1.0, _NEWTON_TURN / np.maximum(most, _NEWTON_TURN))
        _, error = self._equations(headings, members)
        arrived = np.abs(error).max(axis=1) < _ARRIVED
        within = np.all(np.abs(arm.bends(headings)) <= self.draws.limits, axis=1)
        brought: FloatArray = headings[arrived & within]
        return brought

    def _equations(self, headings: FloatArray, members: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of tip position and heading with respect to the link headings, and the tip errors.

        Args:
            headings: link headings of m poses, shape (m, links) [rad].
            members: required positions and headings of the tip, shape (m, 3) [m, rad].

        Returns:
            Derivatives, shape (m, 2 or 3, links), and errors, shape (m, 2 or 3) [arm lengths, rad].
        """
        arm = self.draws.arm
        tip = arm.joint_positions(headings)[:, -1]
        error = (members[:, :2] - tip) / arm.length
        rows = np.stack((-np.sin(headings), np.cos(headings)), axis=1) * arm.length_shares / arm.links
        if self.goal.heading is None:
            return rows, error
        last = np.zeros((len(headings), 1, arm.links))
        last[:, 0, -1] = 1.0
        turn = wrap(members[:, 2] - headings[:, -1])
        return np.concatenate((rows, last), axis=1), np.column_stack((error, turn))


@dataclass(frozen=True)
class Connecting:
    """Search for a motion of a planar arm by RRT-Connect in link headings.

    Attributes:
        task: search task.
        space: map from coordinates of the curve to configurations.
        start: pose at the start.
        goal: goal, with coordinates if it is a pose of the whole arm.
        known_goals: function that returns an iterator over poses at a goal of the tip from other methods, each computed
            on demand.
    """

    task: MotionTask
    space: LinkSpace
    start: Pose
    goal: GoalPose
    known_goals: Callable[[], Iterator[Pose]]

    def find(self, budgets: tuple[int, ...], seed: tuple[int, ...]) -> Motion | None:
        """Return a certified motion from the start to the goal, or None if no search finds one in time.

        Args:
            budgets: maximum number of extensions of each search in turn.
            seed: seed of every random choice.
        """
        task = self.task
        check = SampledCheck.for_workspace(task.arm, task.workspace)
        # Most searches end soon or never, so each starts afresh.
        for number, budget in enumerate(budgets):
            rng = np.random.default_rng((*seed, number))
            way = self._search(check, rng).run(budget)
            if way is not None:
                shortcuts = Shortcuts(check, task.certificate.heading_failures)
                return self._motion(shortcuts.shortened(way, rng))
            if task.deadline.passed():
                break
        return None

    def _motion(self, way: FloatArray) -> Motion | None:
        """Return the certified motion along a path of link headings (K, links), or None if it cannot be certified."""
        coordinates = self._coordinates(dense(way, _KEYFRAME_TURN))
        q = self.space.configurations(coordinates)
        # This is the searched motion up to rounding and the last correction onto the goal.
        if not self._on_goal(coordinates[-1]) or len(self.task.certificate.failures(q)):
            return None
        return Motion(self.space, coordinates, q, CONNECT)

    def _search(self, check: SampledCheck, rng: np.random.Generator) -> ConnectSearch:
        """Return an RRT-Connect search by two trees, in which the start is the only node so far."""
        task = self.task
        ends = [self.start.q]
        if self.goal.coordinates is not None:
            ends.append(self.space.configurations(self.goal.coordinates))
        share = task.settings.step.limit_share
        draws = TargetDraws.within(self.space, ends, KNOTS + 1, share)
        trees = (PointTree.empty(task.arm.links), PointTree.empty(task.arm.links))
        trees[0].add(task.arm.headings(self.start.q)[None], np.array([-1]))
        goals = self._goals(draws, check, rng)
        unproved = task.certificate.heading_failures
        return ConnectSearch(
            partial(check.connection, draws.limits), draws, unproved, goals, task.deadline.passed, rng, trees
        )

    def _goals(self, draws: TargetDraws, check: SampledCheck, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Yield batches of link headings (m, links) of the goal pose, or of sampled poses at the tip's goal [rad]."""
        arm = self.task.arm
        if self.goal.coordinates is not None:
            yield arm.headings(self.space.configurations(self.goal.coordinates))[None]
            return
        drawn = GoalDraws(draws, self.goal, check).poses(rng)
        yield next(drawn)
        # Random poses seldom fit where it is narrow; those of the NLP are costlier.
        for pose in self.known_goals():
            yield arm.headings(pose.q)[None]
            yield next(drawn)
        yield from drawn

    def _coordinates(self, way: FloatArray) -> FloatArray:
        """Return the coordinates of the curve (K, p) for a path of link headings (K, links), with exact ends."""
        space = self.space
        start = self.start.v
        end = self.goal.coordinates
        if end is None:
            end = moved_onto(space, self.goal, space.pose(self._fitted(way[-1], start))).v
        arcs = arc_lengths(way)
        line = start + (arcs / max(arcs[-1], TINY))[:, None] * (end - start)
        return np.stack((start, *(self._fitted(*pair) for pair in zip(way[1:-1], line[1:-1], strict=True)), end))

    def _fitted(self, headings: FloatArray, near: FloatArray) -> FloatArray:
        """Return the coordinates (p,) nearest to given ones that reproduce given link headings (links,)."""
        space = self.space
        missed = headings - space.arm.headings(space.configurations(near))
        # Few links leave many curves with the same headings: take the smoothest, then correct what it misses.
        change = fit_coordinates(space.turns, missed, space.arm.length)
        rest = missed - space.turns @ change
        return near + change + np.linalg.lstsq(space.turns, rest, rcond=None)[0]

    def _on_goal(self, v: FloatArray) -> bool:
        if self.goal.coordinates is not None:
            return True
        final = self.space.pose(v)
        return within_limits(self.task.arm, final.q) and self.goal.on_goal(final) and self.goal.limits_met(final)
