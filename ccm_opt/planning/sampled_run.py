"""Strategies of the search for a motion in space that lead the whole arm to poses at the goal, or draw at random."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice
from typing import Self

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.continuation import Stalled
from ccm_opt.planning.curve_map import KNOTS, CurveMap
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.rrt_connect import MOST_GOALS
from ccm_opt.planning.sampled_motions import SampledMotions
from ccm_opt.planning.sampled_poses import (
    CurveDraws,
    CurvePoints,
    chained_goal_poses,
    free_goal_poses,
    goal_poses,
    swung,
)
from ccm_opt.planning.search import Failure
from ccm_opt.planning.search_run import SearchRun
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper

_WANTED_POSES = 8
"""Number of poses at the goal to which motions are tried in turn before sampling."""
_SAMPLED = 100
"""First seed number of the sampled trees, among those of a task."""
_CHAINED = 200
"""First seed number of the chains of links that become poses at the goal, among those of a task."""
_CHAINED_TURNS = (8, 24, 60)
"""Number of turns in each round of ``by_chains``, each a growth of chains of links and a search for a motion to them.
Heuristic: a turn takes a tenth of a second."""
_CHAINED_EXTENSIONS = 1000
"""Maximum number of extensions of the trees in one turn of ``by_chains``. Measured among bars: they mostly meet after
less than a hundred, or never."""
_LED_A_ROUND = 8
"""Maximum number of poses at the goal to which the whole arm is led in a round of samplers that found nothing.
Heuristic: each takes a quarter of a second."""
_SETTLED_FROM = 3.0
"""Distance from the goal below which the tip alone is led onto it, in nominal links. Heuristic."""
_SAMPLED_ROUNDS = ((1, 1000), (3, 10_000), (3, 20_000), (4, 30_000), (6, 60_000), (8, 60_000))
"""Effort of each round of sampled trees: maximum number of searches for poses at the tip goal, and of tree extensions.
Heuristic: such a search takes a twentieth of a second, and 1000 extensions half of that."""
_TO_POSE = 2500
"""Least of these numbers of extensions for a goal of the whole arm, for which the first round is tried before all else.
Heuristic: they take a sixteenth of a second."""
SAMPLED_ROUNDS = len(_SAMPLED_ROUNDS)
"""Number of rounds of sampled trees."""
_SAMPLED_GOALS = 6
"""Number of known collision-free poses at the goal from which on no further ones are sought. Heuristic."""


@dataclass(frozen=True, eq=False)
class SampledRun(SearchRun[SpaceTask, CurveMap]):
    """Search for a motion in space to poses at the goal, all given by the unknowns of one ``CurveMap``."""

    stepper: SpaceStepper

    @classmethod
    def from_task(cls, task: SpaceTask, knots: int = KNOTS) -> Self:
        """Return the search of a task in a new curve through the start, or in the curve of the task's stage.

        ``knots`` is the number of knots of a new curve, unless the task says how many.
        """
        curve, start = task.stage or unknowns_through(task.arm, task.start, task.knots or knots)
        goal = task.limited_goal
        if task.goal_pose is None:
            stepper = task.stepper(curve)
            return cls(task, stepper, stepper.pose(start), goal)
        plain = curve
        curve, end = plain.blended_to(task.goal_pose)
        stepper = task.stepper(curve)
        whole = stepper.pose(end)
        goal = replace(goal, position=whole.tip, direction=whole.tip_direction, coordinates=end)
        return cls(task, stepper, stepper.pose(curve.extended(start[None], plain)[0]), goal)

    def to_poses(self, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion to a pose at the goal, or None if none is found.

        Straight lines in the unknowns to a few poses are tried first, then, on a fixed base, straightening the arm,
        turning it and bending it again.

        Goals of the tip are first replaced by a few poses of the whole arm with the tip at the goal.
        """
        task = self.task
        name = "straight to the pose" if task.goal_pose is not None else "straight to a pose at the goal"
        goals = []
        for pose in islice(self._goals(self._draws()), _WANTED_POSES):
            goals.append(pose)
            found = self.attempt(name, partial(self.led_to, pose.v, self.start), failures)
            if found is not None or task.deadline.passed():
                return found
        # A fed arm is instead retracted into its guide tube, and sections have no joint that turns the base.
        if task.arm.feed or task.arm.drives is not None or not goals:
            return None
        ways = partial(swung, self.stepper, self._motions, self.start, goals, self._draws(), task.deadline)
        return self.attempt("unbent and swung", partial(self._met, ways), failures)

    def by_sampling(self, number: int, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion found by two trees with edges checked by samples (RRT-Connect), then certified, or None.

        Args:
            number: index of the round, which determines the effort.
            failures: list to which a failure is appended.
        """
        searches, extensions = _SAMPLED_ROUNDS[number]
        if self.goal.coordinates is not None:
            extensions = max(extensions, _TO_POSE)
        rng = self._draws(_SAMPLED + number)
        points = CurvePoints(self.stepper, self.start)
        goals = self._free_goals
        for _ in range(searches):
            if len(goals) >= _SAMPLED_GOALS or self.goal.coordinates is not None or self.task.deadline.passed():
                break
            goals += free_goal_poses(self.task, points, self._motions, rng)
        if not goals:
            return None
        # A pose that is soon reached makes a short motion; the first rounds try the nearest alone.
        draws = CurveDraws(points, self._motions, self._nearest(goals)[: 2 ** (number + 1)])
        way = partial(draws.way, rng, extensions, self.task.deadline)
        found = self.attempt("a quick sampler", partial(self._met, way), failures)
        # A goal of the whole arm is led to by a strategy of its own.
        led = number > 0 and self.goal.coordinates is None
        return self._led_to_nearest(goals, failures) if found is None and led else found

    def by_chains(self, number: int, failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion found by RRT-Connect to a pose at the goal made of a chain of links, or None.

        Used only while no other collision-free pose at the goal is known. Sampling new poses and short searches for a
        motion to any of them take turns, since two trees meet soon or never.

        Args:
            number: index of the round, which determines the effort.
            failures: list to which a failure is appended.
        """
        if self._free_goals:
            return None
        rng = self._draws(_CHAINED + number)
        points = CurvePoints(self.stepper, self.start)
        goals = self._chained_goals

        def way() -> list[Pose] | None:
            for turn in range(_CHAINED_TURNS[number]):
                if self.task.deadline.passed():
                    break
                if len(goals) < MOST_GOALS:
                    goals.extend(chained_goal_poses(self.task, points, goals, turn, rng))
                if not goals:
                    continue
                draws = CurveDraws(points, self._motions, self._nearest(goals))
                found = draws.way(rng, _CHAINED_EXTENSIONS, self.task.deadline)
                if found is not None:
                    return found
            if not goals:
                raise Stalled("no collision-free pose at the goal was found", [self.start])
            return None

        found = self.attempt("a quick sampler, to chains of links", partial(self._met, way), failures)
        return self._led_to_nearest(goals, failures) if found is None else found

    def _led_to_nearest(self, goals: list[Pose], failures: list[Failure]) -> SpaceMotion | None:
        """Return a motion that leads the whole arm to one of the nearest poses not led to before, or None.

        Steps slide along obstacles where extensions of trees end, so that an arm between many of them gets on.

        Args:
            goals: collision-free poses at the goal.
            failures: list to which failures are appended.
        """
        fresh = (pose for pose in self._nearest(goals) if not any(pose is known for known in self._led_to))
        for pose in islice(fresh, _LED_A_ROUND):
            if self.task.deadline.passed():
                return None
            self._led_to.append(pose)
            found = self.attempt("straight to a pose at the goal", partial(self._led_near, pose.v), failures)
            if found is not None:
                return found
        return None

    def _led_near(self, end: FloatArray) -> list[Pose]:
        """Return poses that lead towards unknowns at the goal, shape (p,), and with the tip alone onto it from nearby.

        Raises:
            Stalled: the goal is not reached.
        """
        try:
            return self.led_to(end, self.start)
        except Stalled as stalled:
            if self._remaining(stalled.poses[-1]) > _SETTLED_FROM * self.task.unit:
                raise
            return self.arrived(stalled.poses)

    def _nearest(self, goals: list[Pose]) -> list[Pose]:
        """Return poses sorted by the time that the slowest joint takes from the start to each, the nearest first."""
        return sorted(goals, key=lambda pose: float(np.max(np.abs(pose.q - self.start.q) * self.task.slowness)))

    @cached_property
    def _free_goals(self) -> list[Pose]:
        """Collision-free poses at the goal found so far, extended by each round; a whole-arm goal is the only one."""
        return [] if self.goal.coordinates is None else [self.stepper.pose(self.goal.coordinates)]

    @cached_property
    def _chained_goals(self) -> list[Pose]:
        """Poses at the goal made of chains of links that are known so far; the list is extended by each round."""
        return []

    @cached_property
    def _led_to(self) -> list[Pose]:
        """Poses at the goal to which the whole arm was led in vain; the list is extended by each round."""
        return []

    @cached_property
    def _motions(self) -> SampledMotions:
        task = self.task
        return SampledMotions(task.arm, task.tree, task.clearance, task.scene, self.stepper.space.emergence)

    def _goals(self, rng: np.random.Generator) -> Iterator[Pose]:
        """Return an iterator over poses at the goal: that of the whole arm, or poses sampled at the tip's goal."""
        if self.goal.coordinates is None:
            return goal_poses(self.task, self.stepper, rng)
        return iter([self.stepper.pose(self.goal.coordinates)])

    def _met(self, way: Callable[[], list[Pose] | None]) -> list[Pose]:
        """Return the poses of a motion that a function finds by trees.

        Raises:
            Stalled: the function returns None, as the trees do not meet.
        """
        poses = way()
        if poses is None:
            raise Stalled("no tree met the other", [self.start])
        return poses

    def _draws(self, number: int = 0) -> np.random.Generator:
        """Return a random generator for a round of a strategy, with a different seed for each round number."""
        return np.random.default_rng((self.task.seed, number) if number else self.task.seed)
