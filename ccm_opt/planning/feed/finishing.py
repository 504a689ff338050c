"""Finishes the motion of a fed arm: optimised where that is worth while, and a smooth path."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.curve_planner import laid_path
from ccm_opt.planning.ending import optimised_to_end_pose
from ccm_opt.planning.feed.fed_task import task_of_optimising
from ccm_opt.planning.feed.member_problems import ProposedMotion
from ccm_opt.planning.feed.query import FeedQuery
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import keeps_limits, lacks_room, optimise
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.settings import MotionSettings
from ccm_opt.planning.spline_path import DEGREE, clamped_spline
from ccm_opt.problem import Limits, Weights
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm

if TYPE_CHECKING:
    from ccm_opt.planning.search import Failure

_LONG = 2.5
"""Times the duration of the straight line between its ends from which on a motion is put off. Taste."""
_GRAZING = 0.5
"""Share of the wanted gap, or of what the ends have of it, below which a path waits for a few others. Taste."""
_ROOM_SAMPLES = 200
"""Places of a path at which its room is measured. Taste."""

_WORTH_SHORTENING = 1.2
"""Times the duration of the straight line between its ends from which on a motion is optimised. Taste: a motion that
follows its leader without drawing back is as long as its feed."""
_TIME_SAMPLES = 1500
"""Places of a path at which its speed is bounded. Derived: several to every span of the paths that occur."""
_ROOM_EXPONENT = 0.5
"""Of paths that are compared, the one with a certain share of another's room may last that share to this power as long.
Taste."""
_FINER_SAMPLES = 4
"""Samples to a keyframe of an optimised motion, beside which an even path is laid. Taste."""
_LEAST_ROOM = 0.02
"""Share of the wanted gap that counts for paths with less. Taste."""


def straight_in_tube(arm: Arm, poses: FloatArray, travel: float) -> FloatArray:
    """Poses along the spline beside others, shape (K, c), what the tube bends there moved on to the next joints.

    Args:
        arm: with a feed axis.
        poses: at the keyframes, shape (k, c) [rad, link lengths].
        travel: how far beyond the hole a joint stays straight [m].
    """
    q = arm.configurations(clamped_spline(poses)(np.linspace(0.0, 1.0, _FINER_SAMPLES * len(poses))))
    # A sample shapes the spline as far as the third beside it.
    around = np.pad(arm.coordinates.advance(q), DEGREE, mode="edge")
    least = np.lib.stride_tricks.sliding_window_view(around, 2 * DEGREE + 1).min(axis=1)
    held = arm.held(least - travel)
    for joint in range(arm.links - 1):
        moved = np.where(held[:, joint], q[:, joint], 0.0)
        q[:, joint] -= moved
        q[:, joint + 1] += moved
    q[:, : arm.links][held] = 0.0
    return np.concatenate((poses[:1], arm.poses(q[1:-1]), poses[-1:]))


def path_time(arm: Arm, limits: Limits, path: BSpline, samples: int = _TIME_SAMPLES) -> float:
    """Least duration of a path by the limits on speeds, and by those on accelerations at an even pace [s].

    With s the path parameter, |q′| ṡ ≤ v and |q″| ṡ² ≤ a bound ṡ everywhere; what it costs to change the pace is left
    out.

    Args:
        arm: the arm.
        limits: of its drives.
        path: of bends and feed, over [0, 1].
        samples: places at which its speed is bounded.
    """
    axes = len(arm.base_axes)
    speed = np.append(limits.velocity[1::3], np.full(axes, limits.feed_velocity or np.inf))
    acceleration = np.append(limits.acceleration[1::3], np.full(axes, limits.feed_acceleration or np.inf))
    s = np.linspace(0.0, 1.0, samples)
    by_speed = np.max(np.abs(path.derivative(1)(s)) / speed, axis=1)
    by_acceleration = np.sqrt(np.max(np.abs(path.derivative(2)(s)) / acceleration, axis=1))
    return float(np.mean(np.maximum(by_speed, by_acceleration)))


@dataclass
class Finishing:
    """Makes paths of proposed motions.

    Attributes:
        query: what is asked.
        task: the same as a task of the optimisation, with all limits.
        refused: why motions were refused.
        terms: the user's constraints and costs, which are limits of the task; or None.
    """

    query: FeedQuery
    task: MotionTask
    refused: list[str]
    terms: UserTerms | None = None

    def path(self, proposed: ProposedMotion) -> JointPath | None:
        """The certified path of a motion, optimised where that is worth while; None when there is none."""
        arm = self.query.arm
        if np.any((proposed.keyframes < arm.lower_limits) | (proposed.keyframes > arm.upper_limits)):
            self.refused.append(f"{proposed.name}: beyond a limit of the joints or of the feed")
            return None
        found = self._motion(proposed)
        if self.task.user_limits:
            return self._on_limits(found)
        plain = self._laid(found, self._of_samples) or self._even(found)
        if plain is None:
            self.refused.append(f"{proposed.name}: not certified")
            return None
        plain = replace(plain, leaders=proposed.leaders)
        if self._worthwhile(found, follows=bool(proposed.leaders)):
            path = self._smooth(optimised_to_end_pose(found, task_of_optimising(self.task, self.query, found)))
            if path is not None and (
                self.task.weights != Weights() or self.time_for_room(path) < self.time_for_room(plain)
            ):
                return path
        return plain

    def time(self, path: JointPath) -> float:
        """Least duration of a path [s]."""
        return path_time(self.query.arm, self.query.problem.limits, path.spline)

    @cached_property
    def _of_samples(self) -> MotionTask:
        """The task for paths beside fine samples, between which no room is lost that would have to be looked for."""
        return replace(self.task, wanted_gap=0.0)

    def _laid(self, motion: Motion, task: MotionTask) -> JointPath | None:
        """The smooth path near the keyframes of a motion, exactly straight where its link headings only round."""
        path = laid_path(motion, task)
        if path is None:
            return None
        spline = path.spline
        control = np.where(np.abs(spline.c) > TINY, spline.c, 0.0)
        return replace(path, spline=BSpline(spline.t, control, spline.k))

    def _smooth(self, motion: Motion) -> JointPath | None:
        """The quicker smooth path of two along a motion."""
        paths = (self._laid(motion, self.task), self._even(motion))
        return min(filter(None, paths), key=self.time, default=None)

    def _even(self, motion: Motion) -> JointPath | None:
        """A smooth path that is even where joints come out of the tube; none where it may not leave the keyframes.

        Beside few keyframes a joint bends a little before it comes out, so that the spline has to be drawn onto its
        legs there, all corners. Laid beside fine samples that are straight in the tube it is as smooth as elsewhere.
        """
        if len(motion.configurations) <= DEGREE or any(limit.shapes_path for limit in self.task.user_limits):
            return None
        poses = straight_in_tube(self.query.arm, motion.configurations, self.query.travel)
        even = Motion(*self.task.space_through(poses), poses, motion.candidate)
        return self._laid(even, self._of_samples)

    def duration(self, proposed: ProposedMotion) -> float:
        """An estimate of how long a motion lasts, in turns of the average joint [rad]."""
        return duration_estimate(self._motion(proposed))

    def is_long(self, proposed: ProposedMotion) -> bool:
        """Whether a motion lasts much longer than the straight line between its ends."""
        motion = self._motion(proposed)
        return duration_estimate(motion) > _LONG * _straight_line(motion)

    def _motion(self, proposed: ProposedMotion) -> Motion:
        poses = self.query.arm.poses(proposed.keyframes)
        return Motion(*self.task.space_through(poses), poses, proposed.name)

    # ------------------------------------------------------------ the user's constraints and costs
    def _on_limits(self, found: Motion) -> JointPath | None:
        """The path of a motion brought onto the user's limits, and optimised under them."""
        for motion in self._kept(found):
            optimised = optimise(motion, task_of_optimising(self.task, self.query, motion))
            motions = (optimised, motion) if keeps_limits(optimised, self.task) else (motion,)
            paths = [path for each in motions if (path := self._smooth(each)) is not None]
            if paths:
                # What costs weigh is in the optimised motion; constraints alone leave the quicker of the two.
                weighed = self.terms is not None and len(self.terms.all_costs) > 0
                return min(paths, key=self._cost if weighed else self.time)
            self.refused.append(f"{motion.candidate}: no smooth path keeps the constraints")
        return None

    def _kept(self, found: Motion) -> Iterator[Motion]:
        """The motion where it keeps the limits, and the same tracked under them with less and less margin."""
        task = self.task
        if not task.parametric and keeps_limits(found, task):
            yield found
        keeping_up = replace(task, settings=_keeping_up(task.settings, found))
        for links in task.settings.search.margins:
            failures: list[Failure] = []
            motion = PlanarRun.from_task(keeping_up, links).tracked(found, failures)
            if motion is not None:
                yield motion if task.parametric else replace(motion, u=None)
            self.refused.extend(f"{failure.candidate}: {failure.message}" for failure in failures)

    # ------------------------------------------------------------ shorter, and with more room
    def _worthwhile(self, found: Motion, *, follows: bool) -> bool:
        """Whether a motion is much longer than the straight line between its ends, lacks room, or is weighed anew.

        Args:
            found: the motion.
            follows: whether it follows a leader all the way: then it has the room that the leader's path has.
        """
        if self.task.optimiser == "none":
            return False
        longer = duration_estimate(found) > _WORTH_SHORTENING * _straight_line(found)
        return longer or self.task.weights != Weights() or (not follows and lacks_room(found, self.task))

    def grazes(self, path: JointPath) -> bool:
        """Whether a path passes walls much closer than its ends lie and than is wanted."""
        ends = self.query.arm.poses(path.spline(np.array([0.0, 1.0])))
        most = min(self.task.wanted_gap, self.task.least_gap(ends))
        return self._room(path) < _GRAZING * most

    def time_for_room(self, path: JointPath) -> float:
        """The least duration of a path [s], longer by the room that it lacks: half the room counts as √2 times."""
        time = self.time(path)
        wanted = self.task.wanted_gap
        if wanted == 0.0:
            return time
        share = self._room(path) / wanted
        return time * float(np.clip(share, _LEAST_ROOM, 1.0) ** -_ROOM_EXPONENT)

    def _cost(self, path: JointPath) -> float:
        """What the user's costs make of a path: their weighted means over its samples."""
        u = np.linspace(0.0, 1.0, _ROOM_SAMPLES)
        poses = self.query.arm.poses(path.spline(u))
        costs = () if self.terms is None else self.terms.all_costs
        return float(sum(cost.cost.weight * np.mean(cost.values(poses, u)[cost.applies(u)]) for cost in costs))

    def _room(self, path: JointPath) -> float:
        """Least gap along a path, as far as the wanted gap sees [m]."""
        samples = np.linspace(0.0, 1.0, _ROOM_SAMPLES)
        return self.task.least_gap(self.query.arm.poses(path.spline(samples)))


def _keeping_up(settings: MotionSettings, found: Motion) -> MotionSettings:
    """Settings with which a motion that is tracked runs no faster than steps can follow: a long feed takes many."""
    tracking = settings.tracking
    length = float(np.abs(np.diff(found.configurations, axis=0)).max(axis=1).sum())
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
    return _at_full_speed(motion.curve.drives(motion.configurations))


def _straight_line(motion: Motion) -> float:
    """The same of the straight line between the ends of a motion."""
    return _at_full_speed(motion.curve.drives(motion.configurations[[0, -1]]))


def _at_full_speed(drives: FloatArray) -> float:
    """Sum of the longest change in every interval, shape (K, c) [rad]."""
    return float(np.abs(np.diff(drives, axis=0)).max(axis=1).sum())
