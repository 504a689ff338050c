"""Search strategies for a planar arm on a feed axis, in which all joints follow the path of the leading tip.

The arm moves along a leader's path with every joint on the path. An arm whose start does not lie on the path is first
retracted along its own shape, and the part beyond the end of the guide tube (the hole) changes its shape at a fixed
feed, planned as an arm on a fixed base. Of the motions to one path that are found quickly, the shortest is tried first.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, SHORTEST, TINY, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import leg_headings, wrap
from ccm_opt.core.progress import report_candidate
from ccm_opt.planning.continuation import Stalled
from ccm_opt.planning.ends import Ends, resolve_ends
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.goal_members import GoalMember, goal_members
from ccm_opt.planning.leader import (
    LeaderPath,
    feed_step,
    joined_keyframes,
    pose_on_path,
    pose_path,
    slide,
    travel_between_samples,
)
from ccm_opt.planning.leader_paths import LeaderPaths
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import keeps_limits
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.search import Failure, Strategy
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.planning.settings import MotionSettings
from ccm_opt.planning.strategies import goes_straight_to_pose, straight
from ccm_opt.planning.tip_paths import CORNER_DISTANCE
from ccm_opt.problem import Goal, JointPose, Limits, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

ShapeChange: TypeAlias = Callable[[Problem, Ends, Deadline], Motion]
"""Function that plans a motion of an arm on a fixed base between given ends; raises ``NoPlanFound``."""

_SAME_POSE = 1e-7
"""Difference below which bends count as equal [rad]. Heuristic; far above the rounding of chords, far below any visible
difference."""
_CHANGE_TIME = 2.0
"""CPU time that one change of shape may take [s]. Measured on bent starts: successful ones take 0.1 to 0.5 s."""
_PATHS_CHANGED_TO = 3
"""Number of leader's paths to which a change of shape is tried. Heuristic."""
_LEAST_LINKS_CHANGED = 2
"""Minimum number of links beyond the hole for a change of shape. Derived: a single link has no shape."""
_SEPARATION = 2
"""Number of additional keyframes inserted between a feed motion and a change of shape near the hole. Derived: with two
further keyframes of equal pose no span of the cubic spline, which four control points shape, mixes the two."""
_TIGHT_GAP = 0.05
"""Clearance on either side of the arm, in link lengths, below which a passage on the feed axis is tight: joints cannot
bend there as paths would require. Heuristic."""
_TIGHT_SPACING = 0.05
"""Spacing of the points on the feed axis that are checked for tight passages, in link lengths. Heuristic."""
_TIGHT_PLACES = 3
"""Number of tight passages for which paths are tried that are straight up to the end of the passage. Heuristic."""


def fed_strategies(problem: Problem, change: ShapeChange) -> tuple[Strategy[MotionTask, Motion], ...]:
    """Return the search strategies for an arm on a feed axis, in order of trial.

    Args:
        problem: the problem, with the length of its arm as the unit of length.
        change: function that plans a change of shape at a fixed feed.
    """

    def led(task: MotionTask, failures: list[Failure]) -> Motion | None:
        """Return the first motion along a leader's path that satisfies all limits, or None.

        A motion that violates the user's limits is replaced by one that tracks it under these limits, if possible.

        Args:
            task: search task of the problem.
            failures: list to which failures are appended.

        Raises:
            UnreachableGoal: no motion is found, and it is proved that there is none.
        """
        for motion in LedWays(problem, task, change).motions():
            nearest = min((each.remaining for each in failures), default=np.inf)
            report_candidate(len(failures) + 1, motion.candidate, nearest)
            kept = _kept(motion, task, failures)
            if kept is not None or task.deadline.passed():
                return kept
        task.refuse()
        return None

    within = problem.planner.follow_within
    return (
        Strategy("interpolation", straight, lambda task: within is None and goes_straight_to_pose(task)),
        Strategy("leaders", led),
    )


def _kept(motion: Motion, task: MotionTask, failures: list[Failure]) -> Motion | None:
    """Return a motion if it satisfies all limits, else a motion that tracks the given one under the user's limits.

    The result is None, with a failure appended to ``failures``, if neither satisfies all limits.
    """
    arm = task.arm
    q = motion.configurations
    beyond = np.any((q < arm.lower_limits - TINY) | (q > arm.upper_limits + TINY), axis=1)
    failing = np.append(np.flatnonzero(beyond), task.certificate.failures(q))
    if len(failing) == 0 and not task.parametric and keeps_limits(motion, task):
        return motion
    if not task.user_limits:
        run = PlanarRun.from_task(task, MARGINS[-1])
        stopped = run.stepper.pose(motion.unknowns[failing.min()])
        failures.append(run.failure(motion.candidate, Stalled("the motion cannot be certified", [stopped])))
        return None
    keeping_up = replace(task, settings=_keeping_up(task.settings, motion))
    for links in MARGINS:
        tracked = PlanarRun.from_task(keeping_up, links).tracked(motion, failures)
        if tracked is not None:
            return tracked if task.parametric else replace(tracked, u=None)
    return None


def _keeping_up(settings: MotionSettings, found: Motion) -> MotionSettings:
    """Return settings with which tracking of a motion advances no faster than the arm's steps can follow.

    A motion with a long feed takes many steps.
    """
    tracking = settings.tracking
    length = float(np.abs(np.diff(found.curve.arm.poses(found.configurations), axis=0)).max(axis=1).sum())
    most = 0.5 * settings.step.largest_turn / max(length, TINY)
    first, largest = (min(advance, most) for advance in (tracking.first_advance, tracking.largest_advance))
    return replace(settings, tracking=replace(tracking, first_advance=first, largest_advance=largest))


@dataclass(frozen=True)
class LedWays:
    """Generator of motions of a fed planar arm along leader's paths.

    Keyframes are rows of bends [rad] and the feed [m], shape (K, links + 1).

    Attributes:
        problem: problem with a feed axis.
        task: search task of the problem.
        change: function that plans a change of shape at a fixed feed.
        seconds: CPU time that one change of shape may take [s].
    """

    problem: Problem
    task: MotionTask
    change: ShapeChange
    seconds: float = _CHANGE_TIME

    def motions(self) -> Iterator[Motion]:
        """Yield motions to the goal, those onto one leader's path sorted by length.

        For each path these are: the motion that follows the path from the start or, if there is none, the first two
        motions that move onto the path, and the motion without any feed, which comes last if no path needs others.
        """
        at_once = self.at_once()
        for number, path in enumerate(self._paths()):
            ways = self._along(path, changing=number < _PATHS_CHANGED_TO)
            first = next(ways, None)
            others = [] if first is not None and first.follows else [next(ways, None), *at_once]
            yield from sorted(filter(None, (first, *others)), key=lambda motion: motion.busiest)
        yield from at_once

    # ------------------------------------------------------------ lengths and the start's path
    @cached_property
    def _travel(self) -> float:
        """Maximum travel of the base between two samples of a trajectory [m]."""
        return travel_between_samples(self.problem.arm, self.problem.limits)

    @property
    def _outside(self) -> float:
        """Position on the feed axis from which on joints may bend while the feed moves [m].

        It is beyond the hole, since three control points of the smooth path shape the start of each span, and motions
        are linear between samples.
        """
        return self.problem.arm.hole + 3.0 * feed_step(self.problem.arm) + 2.0 * self._travel

    @property
    def _least_straight(self) -> float:
        """Minimum position on the feed axis up to which leader's paths are straight [m].

        When a joint leaves the axis, the previous joint bends, which is a link length closer to the base.
        """
        return self._outside + float(np.max(self.problem.arm.lengths))

    @cached_property
    def _start_path(self) -> LeaderPath | None:
        """Leader's path on which the arm lies at the start, or None if the arm lies on none."""
        return self._current_path(self.task.start)

    def _current_path(self, q: FloatArray) -> LeaderPath | None:
        """Return the leader's path on which a configuration (c,) lies, or None for a bend too near to the hole."""
        return pose_path(self.problem.arm, q[:-1], float(q[-1]), self._least_straight)

    # ------------------------------------------------------------ paths
    def _paths(self) -> Iterator[LeaderPath]:
        """Yield leader's paths to the goal, most promising first."""
        if self.task.goal_pose is not None:
            own = self._current_path(self.task.goal_pose)
            # A goal that bends too near to the hole is approached with the straight arm.
            path = own or self._current_path(np.append(np.zeros(self.problem.arm.links), self.task.goal_pose[-1]))
            yield from () if path is None else (path,)
            return
        for member in self._members():
            paths = LeaderPaths(self.problem, member)
            for path in chain.from_iterable(map(paths.bands, self._straights())):
                yield _path_to_member(path, self.task.goal, self.problem.arm)

    def _members(self) -> tuple[GoalMember, ...]:
        """Return the tip poses at the goal to which leader's paths are planned, most promising first."""
        goal = self.task.goal
        if not goal.is_set:
            return (GoalMember(goal.position, goal.heading),)
        workspace = self.problem.workspace
        arm = self.problem.arm
        room = FreeSpace(workspace, max(arm.tip_radius + workspace.clearance, SHORTEST))
        # The reach is counted from the hole, where the guide tube ends.
        at_hole = replace(arm, base=arm.base + arm.hole * arm.direction)
        members = goal_members(at_hole, goal, room, fed=max(arm.base_range[1] - arm.hole, 0.0))
        # The shortest path goes around nothing, and its own heading at the end needs no further turn.
        begin = arm.base + self._straights()[0] * arm.direction
        shrink = CORNER_DISTANCE * arm.length
        ways = [way for each in members for way in room.routes(begin, each.position, 1, shrink=shrink)]
        return (*(_way_end(way.taut, goal) for way in sorted(ways, key=lambda way: way.length)), *members)

    def _straights(self) -> list[float]:
        """Return positions on the feed axis up to which leader's paths are straight [m], most promising first."""
        arm = self.problem.arm
        least = self._least_straight
        low, high = arm.base_range
        # A straight arm need not be retracted for a path that is straight up to its tip,
        straights = [] if self.task.start[:-1].any() else [float(self.task.start[-1]) + arm.length]
        # any arm can be retracted as far as the feed's range allows,
        straights.append(low + arm.length)
        # no joint can bend in a guide or hole hardly wider than the arm, before the place where it widens,
        straights += [max(end + float(np.max(arm.lengths)), least) for end in self._tight_place_ends()]
        # the earliest bend reaches most goals; but the base cannot leave the axis, so where its range goes farther a
        # path may have to be straight for as long.
        straights += [least, high + 2.0 * self._travel]
        return [straight for straight in straights if straight >= least]

    def _tight_place_ends(self) -> list[float]:
        """Return positions on the feed axis where passages hardly wider than the arm end, nearest first [m]."""
        arm = self.problem.arm
        spacing = _TIGHT_SPACING * arm.link_length
        along = np.arange(arm.hole - arm.link_length, arm.base_range[1] + arm.length, spacing)
        points = shapely.points(arm.base + along[:, None] * arm.direction)
        need = arm.tip_radius + self.problem.workspace.clearance
        walls = self.problem.workspace.walls
        gaps = np.min([shapely.distance(wall.core, points) - wall.rounding - need for wall in walls], axis=0)
        # The arm cannot pass a wall across the axis; one that it touches within the contact tolerance, it can.
        blocked = np.flatnonzero(gaps < -self.problem.contact_tolerance)
        tight = gaps[: blocked[0] if len(blocked) else None] < _TIGHT_GAP * arm.link_length
        leaves = np.flatnonzero(tight[:-1] & ~tight[1:])
        return [float(along[k + 1]) for k in leaves[:_TIGHT_PLACES]]

    # ------------------------------------------------------------ motions along a path
    def _along(self, path: LeaderPath, *, changing: bool) -> Iterator[Motion]:
        """Yield motions that retract the arm along its start shape to several feeds, then follow a leader's path.

        If the start shape does not lie on the leader's path, a change of shape at the retracted feed comes in between.

        Args:
            path: leader's path.
            changing: whether the shape may be changed.
        """
        arm = self.problem.arm
        low, high = arm.base_range
        end = path.base_with_tip_at_end(arm.lengths)
        if self.task.goal_pose is not None:
            end = float(self.task.goal_pose[-1])  # equal up to rounding
        if not low <= end <= min(high, path.straight):
            return
        first = min(float(self.task.start[-1]), end)
        # Retracted to this feed, the arm lies on the feed axis, which both paths share.
        common = min(each.straight for each in (path, self._start_path) if each is not None) - arm.length
        for feed in dict.fromkeys((first, max(min(common, first), low), low, 0.5 * (first + low))):
            there = self._drawn_to(feed)
            if there is None:
                continue
            wanted = pose_on_path(arm, path, feed)
            follows = bool(np.max(np.abs(there[-1, :-1] - wanted)) < _SAME_POSE)
            name = "follow the leader" if feed == first else "draw back, then follow the leader"
            changed: FloatArray | None = there[-1:]
            if not follows:
                # Where the feed does not move before the change of shape, joints may bend right up to the hole.
                outside = arm.hole if len(there) == 1 else self._outside
                changed = self._changed(there[-1], JointPose(wanted), outside) if changing else None
                name = f"change shape at a feed of {long_length(feed)}"
            onward = slide(arm, path, feed, end)
            last = None if changed is None else self._settled(onward)
            if changed is not None and last is not None:
                ahead = follows and feed == first and last is onward
                keyframes = joined_keyframes(there, changed, last)
                yield replace(self._motion(keyframes, f"{name}, {path.name}"), follows=ahead)

    def _settled(self, keyframes: FloatArray) -> FloatArray | None:
        """Return keyframes (K, c) extended by a change of shape to the goal, if that is a pose of the whole arm.

        The result is None if no change of shape is found.
        """
        if self.task.goal_pose is None or np.max(np.abs(keyframes[-1] - self.task.goal_pose)) < _SAME_POSE:
            return keyframes
        changed = self._changed(keyframes[-1], JointPose(self.task.goal_pose[:-1]), self.problem.arm.hole)
        rest = np.tile(keyframes[-1], (1 + _SEPARATION, 1))
        return None if changed is None else joined_keyframes(keyframes, rest, changed)

    def _drawn_to(self, feed: float) -> FloatArray | None:
        """Return keyframes (K, c) of the arm retracted along its start shape to a feed [m].

        The result is None if the start shape bends too near to the hole to be a leader's path.
        """
        if feed == self.task.start[-1]:
            return self.task.start[None]
        if self._start_path is None:
            return None
        return slide(self.problem.arm, self._start_path, float(self.task.start[-1]), feed)

    def at_once(self) -> Iterator[Motion]:
        """Yield at most one motion, a change of shape at the feed of the start, for goals within reach without feed."""
        goal = self.problem.goal
        if self.task.goal_pose is not None:
            goal = JointPose(self.task.goal_pose[:-1])
            if self.task.goal_pose[-1] != self.task.start[-1]:
                return
        keyframes = self._changed(self.task.start, goal, self.problem.arm.hole)
        if keyframes is not None:
            yield self._motion(keyframes, "change shape at the start's feed")

    def _motion(self, keyframes: FloatArray, name: str) -> Motion:
        """Return the motion through keyframes, whose ends are set to the exact start and goal of the task."""
        keyframes[0] = self.task.start
        if self.task.goal_pose is not None:
            keyframes[-1] = self.task.goal_pose
        return Motion(*self.task.space_through(keyframes), keyframes, name)

    def _changed(self, start: FloatArray, goal: Goal, outside: float) -> FloatArray | None:
        """Return the keyframes (K, c) of a change of shape at a fixed feed, or None if no motion is found.

        Args:
            start: configuration, shape (links + 1,) [rad, m].
            goal: goal for the bends, or for the tip.
            outside: position on the feed axis from which on joints may bend [m].
        """
        arm = self.problem.arm
        joints = start[-1] + arm.joint_places[:-1]
        first = int(np.searchsorted(joints, outside - ROUNDING))
        whole = goal.whole(arm)
        bent = start[:first].any() or (whole is not None and whole[:first].any())
        if arm.links - first < _LEAST_LINKS_CHANGED or bent:
            return None
        # An arm has an even number of links: an odd part gets one more link, which the guide tube keeps straight.
        clamped = (arm.links - first) % 2 == 1
        first -= int(clamped)
        part = part_beyond(self.problem, start, goal, first)
        try:
            ends = resolve_ends(part)
            ends = replace(ends, clamped=clamped or ends.clamped)
            motion = self.change(part, ends, self.task.deadline.within(self.seconds))
        except NoPlanFound:
            return None
        keyframes = np.zeros((len(motion.configurations), arm.links + 1))
        keyframes[:, first:-1] = motion.configurations
        if clamped:
            keyframes[:, first] = 0.0
        keyframes[:, -1] = start[-1]
        return keyframes


def _way_end(way: FloatArray, goal: GoalPose) -> GoalMember:
    """Return the tip pose at the end of a path (k, 2) [m] whose heading is the allowed one nearest to the path's."""
    if goal.heading is None:
        return GoalMember(way[-1], None)
    turn = wrap(float(leg_headings(way)[-1]) - goal.heading)
    return GoalMember(way[-1], goal.heading + float(np.clip(turn, -goal.room[1], goal.room[1])))


def _path_to_member(path: LeaderPath, goal: GoalPose, arm: Arm) -> LeaderPath:
    """Return a leader's path cut where the tip of an arm on the path enters the goal set.

    The path is unchanged if the goal is not a set.
    """
    if not goal.is_set:
        return path
    met = np.linalg.norm(path.points - goal.position, axis=1) <= goal.room[0]
    if goal.heading is not None:
        # The last link is a chord, whose heading is that of the path at its middle.
        headings = np.interp(path.arc - 0.5 * arm.lengths[-1], path.arc, path.headings)
        met &= np.abs(wrap(headings - goal.heading)) <= goal.room[1]
    met[-1] = True
    count = max(int(np.argmax(met)) + 1, 2)
    return replace(path, arc=path.arc[:count], points=path.points[:count], headings=path.headings[:count])


def part_beyond(problem: Problem, start: FloatArray, goal: Goal, first: int) -> Problem:
    """Return the problem of the outer part of a fed arm on a fixed base, in which the inner links are an obstacle.

    Args:
        problem: problem of the whole arm, with a feed axis.
        start: configuration, shape (links + 1,) [rad, m].
        goal: goal for the bends at the start's feed, or for the tip.
        first: number of inner links.
    """
    arm = problem.arm
    limits = problem.limits
    whole = goal.whole(arm)
    base = arm.base + (start[-1] + arm.joint_places[first]) * arm.direction
    part = replace(arm.beyond(first), base=base, feed=None)
    return replace(
        problem,
        arm=part,
        limits=Limits(
            limits.velocity[3 * first :],
            limits.acceleration[3 * first :],
            None if limits.torque is None else limits.torque[3 * first :],
        ),
        workspace=_with_held_links(problem, float(start[-1]), first),
        start=JointPose(start[first:-1]),
        goal=goal if whole is None else JointPose(whole[first:-1]),
        stops=(),
        # The default of the wanted gap is a share of the arm's length, which differs for the part.
        planner=replace(problem.planner, mapping="least-squares", wanted_gap=problem.wanted_gap),
    )


def _with_held_links(problem: Problem, feed: float, first: int) -> Workspace:
    """Return a workspace with an obstacle for the inner links that the outer part of the arm might touch.

    Args:
        problem: problem of the whole arm.
        feed: position of the base [m].
        first: number of inner links, those in the guide tube.
    """
    arm = problem.arm
    # Self-contact is checked between distant links only, so the last links in the guide tube are left out.
    held = int(np.argmin(np.append(arm.distant_links[:, first], False)))
    if held < 1 or not arm.self_collision:
        return problem.workspace
    ends = arm.base + np.outer([feed, feed + arm.joint_places[held]], arm.direction)
    rounding = max(arm.radius - problem.workspace.clearance, 0.0)
    body = Obstacle("the arm in its guide tube", PlaneShape(shapely.LineString(ends), rounding))
    return replace(problem.workspace, obstacles=(*problem.workspace.obstacles, body))
