"""One question to the feed planner: a problem with both ends resolved, and the lengths that follow from it."""

from dataclasses import dataclass, replace
from functools import cached_property

from ccm_opt.jointed.arm import Arm, Feed
from ccm_opt.motion.continuation import Deadline
from ccm_opt.planners.feed.fed_poses import FedPose, fed_pose, refuse_bad_pose, refuse_bad_tip
from ccm_opt.planners.following.feed_path import FeedMotions
from ccm_opt.planners.following.gating import travel_between_samples
from ccm_opt.planners.following.leader import LeaderPath
from ccm_opt.planners.following.path_of_shape import own_path
from ccm_opt.planners.following.slide import feed_step
from ccm_opt.problem import Problem, TipGoal


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
    """

    problem: Problem
    feed: Feed
    start: FedPose
    goal: FedPose | None
    motions: FeedMotions
    deadline: Deadline

    @classmethod
    def of(cls, problem: Problem, feed: Feed, deadline: Deadline) -> "FeedQuery":
        """Resolve the ends of a problem.

        Raises:
            UnreachableGoal: the start or the goal cannot be.
        """
        motions = FeedMotions(problem.arm, problem.workspace, travel_between_samples(problem.arm, problem.limits))
        start, goal = fed_pose(problem, problem.start, "start"), None
        gap = refuse_bad_pose(motions, start, "start")
        if isinstance(problem.goal, TipGoal):
            gap = min(gap, max(refuse_bad_tip(problem, problem.goal), 0.0))
        else:
            goal = fed_pose(problem, problem.goal, "goal")
            gap = min(gap, refuse_bad_pose(motions, goal, "goal"))
        return cls(problem, feed, start, goal, replace(motions, gap=gap), deadline)

    def between(self, start: FedPose, goal: FedPose | None) -> "FeedQuery":
        """The question with other ends."""
        return replace(self, start=start, goal=goal)

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.problem.arm

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
        return own_path(self.arm, self.start.bends, self.start.feed, self.least_straight)

    @cached_property
    def goal_path(self) -> LeaderPath | None:
        """The path that leads to a goal of the whole arm, or None."""
        if self.goal is None:
            return None
        return own_path(self.arm, self.goal.bends, self.goal.feed, self.least_straight)

    def fully_drawn_back(self, path: LeaderPath) -> float:
        """The greatest feed at which the whole arm lies on the straight part of a path [m]; may be below the range."""
        return path.straight - self.arm.length

    def end_on(self, path: LeaderPath) -> float | None:
        """The feed at which the tip is at the end of a path [m]; None when the base is not in its range then."""
        end = path.base_with_tip_at_end(self.arm.links, self.arm.link_length)
        if path is self.goal_path and self.goal is not None:
            end = self.goal.feed
        return end if self.feed.low <= end <= min(self.feed.high, path.straight) else None
