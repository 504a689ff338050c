"""What is asked of the feed planner: a problem with both ends resolved, and the lengths that follow from it."""

from dataclasses import dataclass, replace
from functools import cached_property

from ccm_opt.collision.bad_pose import refuse_bad_pose
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.planners.feed.fed_poses import fed_pose, refuse_bad_tip
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.planners.following.feed_path import FeedMotions
from ccm_opt.planners.following.gating import travel_between_samples
from ccm_opt.planners.following.leader import LeaderPath
from ccm_opt.planners.following.path_of_shape import path_of_pose
from ccm_opt.planners.following.slide import feed_step
from ccm_opt.problem import JointPose, Problem, TipGoal


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
        gap = _gap_of(problem, start, "start", settings)
        goal = None
        if isinstance(problem.goal, TipGoal):
            # Deeper than contact, within the tolerance, counts as contact.
            gap_at_goal = max(refuse_bad_tip(problem, problem.goal), 0.0)
        else:
            goal = fed_pose(problem, problem.goal, "goal", settings)
            gap_at_goal = _gap_of(problem, goal, "goal", settings)

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
        return self.feed.hole + 3.0 * feed_step(self.arm, self.settings.following) + 2.0 * self.motions.travel

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


def _gap_of(problem: Problem, pose: JointPose, which: str, settings: FeedPlannerSettings) -> float:
    """The least gap of a pose that the arm can have [m].

    Raises:
        UnreachableGoal: the pose breaks a joint limit or touches something.
    """
    arm = problem.arm
    reach = settings.following.contact_reach
    return refuse_bad_pose(arm, problem.workspace, arm.poses(pose.configuration(arm)), which, reach)
