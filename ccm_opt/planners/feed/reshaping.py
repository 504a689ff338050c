"""Motions at a fixed feed: the part of the arm beyond the hole, planned as an arm of its own."""

from dataclasses import dataclass, fields, replace

import numpy as np
import shapely

from ccm_opt.errors import NoPlanFound
from ccm_opt.freespace.workspace import Obstacle, Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.ends import resolve_ends
from ccm_opt.motion.search import find_motion
from ccm_opt.planners.curve import CurvePlanner
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal


@dataclass(frozen=True)
class Reshaping:
    """Plans motions of the part of the arm that is beyond the hole.

    Attributes:
        problem: of the whole arm, with a feed axis.
        deadline: when to stop.
        settings: of the planner.
    """

    problem: Problem
    deadline: Deadline
    settings: FeedPlannerSettings = DEFAULT_FEED

    def keyframes(self, start: JointPose, goal: FloatArray | TipGoal, outside: float) -> FloatArray | None:
        """Keyframes from a pose to other bends, or to a goal of the tip, at the feed of the pose.

        Args:
            start: where the motion begins.
            goal: bends of the whole arm, shape (links,) [rad], or a goal of the tip.
            outside: arc length from which on joints may bend [m].

        Returns:
            Shape (K, links + 1), or None when no motion was found.
        """
        links = self.problem.arm.links
        first = self._first_joint(start, outside)
        too_few = links - first < self.settings.least_links_reshaped
        start_bent = bool(np.any(start.bends[:first]))
        goal_bent = not isinstance(goal, TipGoal) and bool(np.any(goal[:first]))
        if too_few or start_bent or goal_bent:
            return None

        # An arm has an even number of links: an odd part gets one link more, which the guide tube keeps straight.
        clamped = (links - first) % 2 == 1
        part = self._part(start, goal, first - int(clamped))
        try:
            ends = resolve_ends(part, self.settings.curve.motion.ends)
            # Clamped ends keep the first link still, which holds the extra link straight.
            ends = replace(ends, clamped=clamped or ends.clamped)
            motion = find_motion(CurvePlanner(settings=self.settings.curve).motion_task(part, ends, self.deadline))
        except NoPlanFound:
            return None
        return self._whole(start, part.arm.bends(motion.headings), clamped=clamped)

    def _first_joint(self, start: JointPose, outside: float) -> int:
        """The first joint that is beyond an arc length [m]."""
        joints = start.feed + self.problem.arm.link_length * np.arange(self.problem.arm.links)
        return int(np.searchsorted(joints, outside - ROUNDING))

    def _part(self, start: JointPose, goal: FloatArray | TipGoal, first: int) -> Problem:
        """The problem of the arm from a joint on, what is before it an obstacle."""
        problem = self.problem
        part = part_of(problem.arm, first, start.feed)
        limits = Limits(problem.limits.velocity[3 * first :], problem.limits.acceleration[3 * first :])
        return replace(
            problem,
            arm=part,
            limits=limits,
            workspace=self._with_held_links(start, first),
            start=JointPose(start.bends[first:]),
            goal=goal if isinstance(goal, TipGoal) else JointPose(goal[first:]),
            stops=(),
            planner=replace(problem.planner, mapping="least-squares"),
        )

    def _with_held_links(self, start: JointPose, first: int) -> Workspace:
        """The workspace with those links in the guide tube that the arm from a joint on might meet."""
        problem = self.problem
        arm = problem.arm
        held = first + 1 - arm.first_self_pair
        if held < 1 or not arm.self_collision:
            return problem.workspace
        # Self-contact is measured between distant links only, so the last links in the guide tube are left out.
        ends = arm.base + np.outer([start.feed, start.feed + held * arm.link_length], arm.feed_direction)
        rounding = max(arm.radius - problem.workspace.clearance, 0.0)
        body = Obstacle("the arm in its guide tube", shapely.LineString(ends), rounding)
        return replace(problem.workspace, obstacles=(*problem.workspace.obstacles, body))

    def _whole(self, start: JointPose, bends: FloatArray, *, clamped: bool) -> FloatArray:
        """Keyframes of the whole arm, the part before straight."""
        links = self.problem.arm.links
        first = links - bends.shape[1]
        whole = np.zeros((len(bends), links + 1))
        whole[:, first:links] = bends
        if clamped:
            whole[:, first] = 0.0
        whole[:, -1] = start.feed
        return whole


def part_of(arm: Arm, first: int, feed: float) -> Arm:
    """The arm from one of its joints on, its base fixed where that joint is at some feed."""
    values = {each.name: getattr(arm, each.name) for each in fields(arm)}
    values |= {
        "links": arm.links - first,
        "base": arm.base + (feed + first * arm.link_length) * arm.feed_direction,
        "base_limit": arm.base_limit if first == 0 else arm.joint_limit,
        "mount_length": max(arm.mount_length - first * arm.link_length, 0.0),
        "feed": None,
    }
    for name in ("masses", "inertia_axial", "inertia_transverse"):
        values[name] = values[name][first:]
    for name in ("rotor_inertia", "friction"):
        values[name] = values[name] if np.ndim(values[name]) == 0 else values[name][3 * first :]
    return Arm(**values)
