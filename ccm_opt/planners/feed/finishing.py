"""From a proposed motion of a fed arm to its smooth path: brought onto the user's limits, shortened, given room."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY
from ccm_opt.motion.clamped_spline import clamped_spline
from ccm_opt.motion.continuation import Stalled
from ccm_opt.motion.ending import optimised_to_end_pose
from ccm_opt.motion.fed_space import FedSpace
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.more_room import lacks_room
from ccm_opt.motion.optimisation.optimise import keeps_limits, optimise
from ccm_opt.motion.settings.motion_settings import MotionSettings
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tracking import ReferenceMotion, follow_reference
from ccm_opt.planners.feed.fed_paths import FedPaths
from ccm_opt.planners.feed.fed_task import task_of_optimising
from ccm_opt.planners.feed.proposed_motion import ProposedMotion
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.problem import Weights
from ccm_opt.solution import JointPath
from ccm_opt.user_terms.compiled_terms import UserTerms


@dataclass
class Finishing:
    """Makes paths of proposed motions.

    Attributes:
        query: what is asked.
        task: the same as a task of the optimisation, with all limits.
        space: of the motions.
        refused: why motions were refused.
        terms: the user's constraints and costs, which are limits of the task; or None.
        paths: lays the paths.
    """

    query: FeedQuery
    task: MotionTask
    space: FedSpace
    refused: list[str]
    terms: UserTerms | None = None
    paths: FedPaths = field(init=False)

    def __post_init__(self) -> None:
        self.paths = FedPaths(self.query, self.task)

    def path(self, proposed: ProposedMotion) -> JointPath | None:
        """The certified path of a motion, optimised where that is worth while; None when there is none."""
        if not self.query.motions.within_limits(proposed.keyframes):
            self.refused.append(f"{proposed.name}: beyond a limit of the joints or of the feed")
            return None
        found = self._motion(proposed)
        if self.task.user_limits:
            return self._on_limits(found)
        certified = len(self.task.certificate.failures(found.headings)) == 0
        plain = self.paths.plain(proposed) or (self.paths.smooth(found) if certified else None)
        if certified and self._worthwhile(found, follows=bool(proposed.leaders)):
            better = optimised_to_end_pose(found, task_of_optimising(self.task, self.query, found))
            path = self.paths.smooth(better)
            if path is not None and (plain is None or self.task.weights != Weights() or self.preferred(path, plain)):
                return path
        if plain is None:
            self.refused.append(f"{proposed.name}: not certified")
        return plain

    def duration(self, proposed: ProposedMotion) -> float:
        """An estimate of how long a motion lasts, in turns of the average joint [rad]."""
        return duration_estimate(self._motion(proposed))

    def is_long(self, proposed: ProposedMotion) -> bool:
        """Whether a motion lasts much longer than the straight line between its ends."""
        motion = self._motion(proposed)
        return duration_estimate(motion) > self.query.settings.long * _straight_line(motion)

    def _motion(self, proposed: ProposedMotion) -> Motion:
        poses = self.query.arm.poses(proposed.keyframes)
        return Motion(self.space, self.space.coordinates(poses), poses, proposed.name)

    # ------------------------------------------------------------ the user's constraints and costs
    def _on_limits(self, found: Motion) -> JointPath | None:
        """The path of a motion brought onto the user's limits, and optimised under them."""
        for motion in self._kept(found):
            optimised = optimise(motion, task_of_optimising(self.task, self.query, motion))
            motions = (optimised, motion) if keeps_limits(optimised, self.task) else (motion,)
            paths = [path for each in motions if (path := self.paths.smooth(each)) is not None]
            if paths:
                # What costs weigh is in the optimised motion; constraints alone leave the quicker of the two.
                weighed = self.terms is not None and len(self.terms.all_costs) > 0
                return min(paths, key=self._cost if weighed else self.paths.time)
            self.refused.append(f"{motion.candidate}: no smooth path keeps the constraints")
        return None

    def _kept(self, found: Motion) -> Iterator[Motion]:
        """The motion where it keeps the limits, and the same tracked under them with less and less margin."""
        parametric = self.task.parametric
        if not parametric and keeps_limits(found, self.task):
            yield found
        for links in self.task.settings.search.margins:
            try:
                yield self._tracked(found, links)
            except Stalled as stalled:
                self.refused.append(f"{found.candidate}, tracked: {stalled}")

    def _tracked(self, found: Motion, links: float) -> Motion:
        """The motion drawn through the limits.

        Raises:
            Stalled: naming what could not be met.
        """
        task = self.task
        space = self.space
        finder = task.planning_finder(links * space.nominal_length, space.nominal_length)
        stepper = Stepper(space, finder, task.limits(finder), _keeping_up(task.settings, found))
        start = stepper.pose(found.coordinates[0])
        goal = task.limited_goal
        reference = ReferenceMotion.from_headings(found.headings)
        if task.goal_headings is not None:
            goal = replace(goal, coordinates=space.coordinates(task.goal_headings))
        way = follow_reference(stepper, reference, goal, start, task.deadline)
        poses = np.array([pose.headings for pose in way.poses])
        if task.goal_headings is not None:
            poses = np.vstack((poses, task.goal_headings))
        if len(task.certificate.failures(poses)):
            raise Stalled("the motion arrived but could not be certified", way.poses)
        u = np.array(way.u) if task.parametric else None
        return Motion(space, space.coordinates(poses), poses, f"{found.candidate}, tracked", u)

    # ------------------------------------------------------------ shorter, and with more room
    def _worthwhile(self, found: Motion, *, follows: bool) -> bool:
        """Whether a motion is much longer than the straight line between its ends, lacks room, or is weighed anew.

        Args:
            found: the motion.
            follows: whether it follows a leader all the way: then it has the room that the leader's path has.
        """
        if self.task.optimiser == "none":
            return False
        longer = duration_estimate(found) > self.query.settings.worth_shortening * _straight_line(found)
        return longer or self.task.weights != Weights() or (not follows and lacks_room(found, self.task))

    def preferred(self, one: JointPath, other: JointPath) -> bool:
        """Whether one path is quicker than another, or has so much more room that it makes up for it."""
        return self._time_for_room(one) < self._time_for_room(other)

    def grazes(self, path: JointPath) -> bool:
        """Whether a path passes walls much closer than its ends lie and than is wanted."""
        ends = self.query.arm.poses(path.spline(np.array([0.0, 1.0])))
        most = min(self.task.wanted_gap, self.task.least_gap(ends))
        return self._room(path) < self.query.settings.grazing * most

    def _time_for_room(self, path: JointPath) -> float:
        """The least duration of a path [s], longer by the room that it lacks: half the room counts as √2 times."""
        time = self.paths.time(path)
        wanted = self.task.wanted_gap
        if wanted == 0.0:
            return time
        share = self._room(path) / wanted
        settings = self.query.settings
        return time * float(np.clip(share, settings.least_room, 1.0) ** -settings.room_exponent)

    def quicker_as_it_is(self, proposed: ProposedMotion, path: JointPath) -> bool:
        """Whether the spline beside the keyframes of a motion, as they are, is quicker than a path."""
        spline = clamped_spline(proposed.keyframes)
        return self.paths.spline_time(spline) < self.paths.time(path)

    def _cost(self, path: JointPath) -> float:
        """What the user's costs make of a path: their weighted means over its samples."""
        u = np.linspace(0.0, 1.0, self.query.settings.room_samples)
        poses = self.query.arm.poses(path.spline(u))
        costs = () if self.terms is None else self.terms.all_costs
        return float(sum(cost.cost.weight * np.mean(cost.values(poses, u)[cost.applies(u)]) for cost in costs))

    def _room(self, path: JointPath) -> float:
        """Least gap along a path, as far as the wanted gap sees [m]."""
        samples = np.linspace(0.0, 1.0, self.query.settings.room_samples)
        return self.task.least_gap(self.query.arm.poses(path.spline(samples)))


def _keeping_up(settings: MotionSettings, found: Motion) -> MotionSettings:
    """Settings with which a motion that is tracked runs no faster than steps can follow: a long feed takes many."""
    tracking = settings.tracking
    length = float(np.abs(np.diff(found.headings, axis=0)).max(axis=1).sum())
    most = settings.step.largest_turn / max(length, TINY)
    paced = replace(
        tracking,
        first_advance=min(tracking.first_advance, 0.5 * most),
        largest_advance=min(tracking.largest_advance, 0.5 * most),
    )
    return replace(settings, tracking=paced)


def duration_estimate(motion: Motion) -> float:
    """How long a motion lasts at least at full speed, in turns of the average joint [rad].

    What the drives move is counted by the time that it takes, so the busiest of them decides in every interval.
    """
    return _at_full_speed(motion.space.drives(motion.headings))


def _straight_line(motion: Motion) -> float:
    """The same of the straight line between the ends of a motion."""
    return _at_full_speed(motion.space.drives(motion.headings[[0, -1]]))


def _at_full_speed(drives: FloatArray) -> float:
    """Sum of the longest change in every interval, shape (K, c) [rad]."""
    return float(np.abs(np.diff(drives, axis=0)).max(axis=1).sum())
