"""What a fed arm is asked for."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import unit_vector
from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.planning.ends import refuse_blocked_tip
from ccm_opt.planning.following.leader import (
    LeaderPath,
    feed_step,
    path_of_pose,
    straight_while_held,
    travel_between_samples,
)
from ccm_opt.planning.settings import DEFAULT_FEED, DEFAULT_FOLLOWING, FeedPlannerSettings, FollowingSettings
from ccm_opt.planning.spline_path import certified_spline, spare_kept
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.bad_pose import refuse_bad_pose
from ccm_opt.scene.certificate import Certificate, allowed_contact
from ccm_opt.scene.workspace import Workspace

_SPARE_AT_ENDS = 0.5
"""Share of the narrower end's gap that the certificate may ask for along the motion. Taste."""

_CONTACT_REACH = 0.02
"""Contacts of a pose nearer than this are listed, as a share of the arm's length. Taste."""


def fed_pose(problem: Problem, pose: JointPose, which: str, settings: FeedPlannerSettings = DEFAULT_FEED) -> JointPose:
    """A pose of a problem, its bends exactly 0 where the guide tube holds a joint; ``which`` names it in messages.

    Raises:
        UnreachableGoal: a joint that the guide tube holds is bent.
    """
    arm = problem.arm
    held = arm.held(pose.feed)
    bends = np.array(pose.bends, dtype=np.float64)
    tolerance = ROUNDING
    if pose.curve is not None:
        # A bend moves the tip by no more than itself times the arm's length.
        tolerance = settings.straightening / (arm.length * max(int(held.sum()), 1))

    bent = held & (np.abs(bends) > tolerance)
    if bent.any():
        joint = int(np.argmax(bent))
        reason = f"the {which} bends joint {joint + 1} by {np.rad2deg(bends[joint]):.3g}° inside the guide tube"
        advice = (f"straighten the {which} inside the guide tube", f"raise {which}.feed")
        raise UnreachableGoal(Diagnosis(reason, which, advice))
    return JointPose(np.where(held, 0.0, bends), pose.feed)


def refuse_bad_tip(problem: Problem, goal: TipGoal) -> float:
    """The gap of the tip at the goal, or with a heading of the last link there [m].

    Raises:
        UnreachableGoal: the tip is deeper in a wall than tolerances allow.
    """
    refuse_blocked_tip(problem, goal)
    arm = problem.arm
    last_link = np.stack((goal.position, goal.position))
    if goal.heading is not None:
        last_link[0] -= arm.link_length * unit_vector(goal.heading)
    line = shapely.LineString(last_link)
    need = arm.radius + problem.workspace.clearance
    distances = [float(shapely.distance(line, wall.core)) - wall.rounding for wall in problem.workspace.walls]
    return min(distances) - need


@dataclass(frozen=True)
class FeedMotions:
    """What makes a motion of the arm on its feed axis safe.

    Attributes:
        arm: with a feed axis.
        workspace: walls and boundary.
        travel: of the base between two samples of a trajectory [m].
        gap: of the narrower end of the motion [m]; the certificate spares half of it at most, and lets motions touch
            as an end that touches does.
        settings: of following.
    """

    arm: Arm
    workspace: Workspace
    travel: float
    gap: float = np.inf
    settings: FollowingSettings = DEFAULT_FOLLOWING

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate that motions must pass."""
        # Ends that touch may be left by motions that touch no deeper; else a little more than contact is asked for.
        contact = allowed_contact(self.arm, self.workspace)
        wanted = _SPARE_AT_ENDS * self.gap - contact
        spare = np.clip(wanted, -contact, self.settings.spare * self.arm.length)
        return Certificate(self.arm, self.workspace, float(spare))

    def within_limits(self, keyframes: FloatArray) -> bool:
        """Whether keyframes keep joint limits and the range of the feed."""
        return bool(np.all((keyframes >= self.arm.lower_limits) & (keyframes <= self.arm.upper_limits)))

    def certified(self, keyframes: FloatArray) -> bool:
        """Whether keyframes of bends and feed, linear between them, are clear of everything."""
        return len(self.certificate.failures(self.arm.poses(keyframes))) == 0

    def path(self, keyframes: FloatArray) -> tuple[BSpline, float] | None:
        """The smooth path of bends and feed near keyframes, and the gap that it spares [m].

        Args:
            keyframes: bends and feed, shape (K, links + 1) [rad, m].

        Returns:
            None when no such path can be certified.
        """
        if not self.within_limits(keyframes):
            return None
        spline = certified_spline(self.arm.poses(keyframes), self.certificate)
        if spline is None:
            return None
        # Bends and feed are linear in the poses, so the control points can be turned into them one by one.
        path = BSpline(spline.t, self.arm.configurations(np.asarray(spline.c)), spline.k)
        if not straight_while_held(self.arm, path, self.travel):
            return None
        return path, spare_kept(spline, self.certificate)


@dataclass(frozen=True)
class FeedQuery:
    """A problem with its ends resolved.

    Attributes:
        problem: what is asked.
        feed: its feed axis.
        start: where the motion begins.
        goal: the whole arm's goal, or None when only the tip's is given.
        motions: what makes motions safe.
        deadline: when to stop.
        settings: of the planner.
    """

    problem: Problem
    feed: Feed
    start: JointPose
    goal: JointPose | None
    motions: FeedMotions
    deadline: Deadline
    settings: FeedPlannerSettings = DEFAULT_FEED

    @classmethod
    def from_problem(
        cls, problem: Problem, feed: Feed, deadline: Deadline, settings: FeedPlannerSettings = DEFAULT_FEED
    ) -> "FeedQuery":
        """Resolve the ends of a problem.

        Raises:
            UnreachableGoal: the start or the goal cannot be.
        """
        start = fed_pose(problem, problem.start, "start", settings)
        gap = _gap_of(problem, start, "start")
        goal = None
        if isinstance(problem.goal, TipGoal):
            # Deeper than contact, within the tolerance, counts as contact.
            gap_at_goal = max(refuse_bad_tip(problem, problem.goal), 0.0)
        else:
            goal = fed_pose(problem, problem.goal, "goal", settings)
            gap_at_goal = _gap_of(problem, goal, "goal")

        following = settings.following
        travel = travel_between_samples(problem.arm, problem.limits, following)
        motions = FeedMotions(problem.arm, problem.workspace, travel, min(gap, gap_at_goal), following)
        return cls(problem, feed, start, goal, motions, deadline, settings)

    def between(self, start: JointPose, goal: JointPose | None) -> "FeedQuery":
        """The same with other ends."""
        return replace(self, start=start, goal=goal)

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.problem.arm

    def pose(self, end: JointPose) -> FloatArray:
        """An end as planning handles it: link headings and the base's way, shape (c,) [rad, link lengths]."""
        return self.arm.poses(end.configuration(self.arm))

    @property
    def outside(self) -> float:
        """Arc length from which on joints may bend while the feed moves [m].

        Three control points of the smooth path shape each of its spans, and samples are taken as linear between.
        """
        return self.feed.hole + 3.0 * feed_step(self.arm) + 2.0 * self.motions.travel

    @property
    def least_straight(self) -> float:
        """Arc length that leaders' paths follow the feed axis at least [m].

        The joint that bends is the one before the one that leaves the axis, a link length behind it.
        """
        return self.outside + self.arm.link_length

    @cached_property
    def start_path(self) -> LeaderPath | None:
        """The path that the arm lies on at the start; None when it bends too near to the hole to have come by one."""
        return self.path_of(self.start)

    @cached_property
    def goal_path(self) -> LeaderPath | None:
        """The path that leads to a goal of the whole arm, or None."""
        return None if self.goal is None else self.path_of(self.goal)

    def path_of(self, pose: JointPose) -> LeaderPath | None:
        """The path that the arm lies on in a pose; None when it bends too near to the hole to have come by one."""
        return path_of_pose(self.arm, pose.bends, pose.feed, self.least_straight, self.settings.following)

    def fully_drawn_back(self, path: LeaderPath) -> float:
        """The greatest feed at which the whole arm lies on the straight part of a path [m]; may be below the range."""
        return path.straight - self.arm.length

    def end_on(self, path: LeaderPath) -> float | None:
        """The feed at which the tip is at the end of a path [m]; None when the base is not in its range then."""
        end = path.base_with_tip_at_end(self.arm.links, self.arm.link_length)
        if path is self.goal_path and self.goal is not None:
            end = self.goal.feed  # the same but for rounding
        in_range = self.feed.low <= end <= min(self.feed.high, path.straight)
        return end if in_range else None


def _gap_of(problem: Problem, pose: JointPose, which: str) -> float:
    """The least gap of a pose that the arm can have [m].

    Raises:
        UnreachableGoal: the pose breaks a joint limit or touches something.
    """
    arm = problem.arm
    reach = _CONTACT_REACH
    return refuse_bad_pose(arm, problem.workspace, arm.poses(pose.configuration(arm)), which, reach)
