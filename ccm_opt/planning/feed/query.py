"""What a fed arm is asked for."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, UnreachableGoal
from ccm_opt.planning.ends import refuse_blocked_tip
from ccm_opt.planning.feed.leader import LeaderPath, feed_step, path_of_pose, travel_between_samples
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.scene.bad_pose import refuse_bad_pose

_STRAIGHTENING = 5e-4
"""Distance that the tip may move when what the mapping of a curve bends inside the guide tube is straightened [m].
Taste."""
_CONTACT_REACH = 0.02
"""Contacts of a pose nearer than this are listed, as a share of the arm's length. Taste."""


def fed_pose(problem: Problem, pose: JointPose, which: str) -> JointPose:
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
        tolerance = _STRAIGHTENING / (arm.length * max(int(held.sum()), 1))

    bent = held & (np.abs(bends) > tolerance)
    if bent.any():
        joint = int(np.argmax(bent))
        reason = f"the {which} bends joint {joint + 1} by {np.rad2deg(bends[joint]):.3g}° inside the guide tube"
        advice = (f"straighten the {which} inside the guide tube", f"raise {which}.feed")
        raise UnreachableGoal(Diagnosis(reason, which, advice))
    return JointPose(np.where(held, 0.0, bends), pose.feed)


@dataclass(frozen=True)
class FeedQuery:
    """A problem with its ends resolved.

    Attributes:
        problem: what is asked.
        feed: its feed axis.
        start: where the motion begins.
        goal: the whole arm's goal, or None when only the tip's is given.
        travel: of the base between two samples of a trajectory [m].
        deadline: when to stop.
        settings: of the planner.
    """

    problem: Problem
    feed: Feed
    start: JointPose
    goal: JointPose | None
    travel: float
    deadline: Deadline
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER

    @classmethod
    def from_problem(
        cls, problem: Problem, feed: Feed, deadline: Deadline, settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
    ) -> "FeedQuery":
        """Resolve the ends of a problem.

        Raises:
            UnreachableGoal: the start or the goal cannot be.
        """
        start = fed_pose(problem, problem.start, "start")
        _refuse_bad(problem, start, "start")
        goal = None
        if isinstance(problem.goal, TipGoal):
            refuse_blocked_tip(problem, problem.goal)
        else:
            goal = fed_pose(problem, problem.goal, "goal")
            _refuse_bad(problem, goal, "goal")
        travel = travel_between_samples(problem.arm, problem.limits)
        return cls(problem, feed, start, goal, travel, deadline, settings)

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
        return self.feed.hole + 3.0 * feed_step(self.arm) + 2.0 * self.travel

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
        return path_of_pose(self.arm, pose.bends, pose.feed, self.least_straight)

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


def _refuse_bad(problem: Problem, pose: JointPose, which: str) -> None:
    """Refuse a pose that breaks a joint limit or touches something.

    Raises:
        UnreachableGoal: it does.
    """
    arm = problem.arm
    refuse_bad_pose(arm, problem.workspace, arm.poses(pose.configuration(arm)), which, _CONTACT_REACH)
