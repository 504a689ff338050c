"""A motion by RRT-Connect: trees of link headings, joined, shortened, and taken over to the curve's coordinates."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.motion.connect.connect_search import ConnectSearch
from ccm_opt.motion.connect.goal_draws import GoalDraws
from ccm_opt.motion.connect.heading_tree import HeadingTree
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.shortcuts import Shortcuts, dense
from ccm_opt.motion.connect.target_draws import TargetDraws
from ccm_opt.motion.goal import GoalPose, polish
from ccm_opt.motion.link_space import KNOTS, LinkSpace, fit_coordinates
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.pose import Pose, pose_in
from ccm_opt.motion.settings.connect_settings import ConnectSettings

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
        check = SampledCheck.of(task.arm, task.workspace, self.settings.sampling)
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
        coordinates = self._coordinates(dense(way, self.settings.turn))
        headings = self.space.headings(coordinates)
        # The same motion but for rounding, and for the last bit of the way onto the goal.
        if not self._on_goal(coordinates[-1]) or len(self.task.certificate.failures(headings)):
            return None
        return Motion(self.space, coordinates, headings, CONNECT)

    def _search(self, check: SampledCheck, rng: np.random.Generator) -> ConnectSearch:
        """Trees with nothing but the start."""
        task = self.task
        ends = [self.start.headings]
        if self.goal.coordinates is not None:
            ends.append(self.space.headings(self.goal.coordinates))
        share = task.settings.step.limit_share
        draws = TargetDraws.within(self.space, ends, KNOTS + 1, share, self.settings)
        trees = (HeadingTree.empty(task.arm.links), HeadingTree.empty(task.arm.links))
        trees[0].add(self.start.headings[None], np.array([-1]))
        goals = self._goals(draws, check, rng)
        unproved = task.certificate.failures
        return ConnectSearch(check, draws, unproved, goals, task.deadline.passed, rng, self.settings, trees)

    def _goals(self, draws: TargetDraws, check: SampledCheck, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Poses at the goal: that of the whole arm, or some that have the tip there."""
        if self.goal.coordinates is not None:
            yield self.space.headings(self.goal.coordinates)[None]
            return
        drawn = GoalDraws(draws, self.goal, check, self.settings.goals).poses(rng)
        yield next(drawn)
        # Poses drawn at random seldom fit where it is narrow; those of the NLP are costlier.
        for pose in self.known_goals():
            yield pose.headings[None]
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
        missed = headings - space.headings(near)
        # Few links leave many curves with the same headings: the smoothest, and then what it misses.
        change = fit_coordinates(space.matrix, missed, space.arm.length)
        rest = missed - space.matrix @ change
        return near + change + np.linalg.lstsq(space.matrix, rest, rcond=None)[0]

    def _on_goal(self, v: FloatArray) -> bool:
        if self.goal.coordinates is not None:
            return True
        final = pose_in(self.space, v)
        within = np.all(np.abs(self.task.arm.bends(final.headings)) <= self.task.arm.bend_limits)
        return bool(within) and self.goal.on_goal(final) and self.goal.limits_met(final)
