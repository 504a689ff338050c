"""The part of a fed arm beyond the hole as an arm of its own, whose base stands still, and the problem that it has."""

from dataclasses import dataclass, fields, replace

import numpy as np
import shapely

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.ends import Ends, resolve_ends
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal


@dataclass(frozen=True)
class PartBeyond:
    """The problem of an arm from one of its joints on, at one feed.

    Attributes:
        problem: of the part, what is before it an obstacle.
        first: number of links before it.
        clamped: whether its first link is one that the guide tube keeps straight.
    """

    problem: Problem
    first: int
    clamped: bool

    @classmethod
    def of(
        cls,
        problem: Problem,
        start: JointPose,
        goal: FloatArray | TipGoal,
        outside: float,
        settings: FeedPlannerSettings = DEFAULT_FEED,
    ) -> "PartBeyond | None":
        """The part that begins in a pose and is to take other bends, or to come to a goal of the tip, at its feed.

        Args:
            problem: of the whole arm, with a feed axis.
            start: where it begins.
            goal: bends of the whole arm, shape (links,) [rad], or a goal of the tip.
            outside: arc length from which on joints may bend [m].
            settings: of the planner.

        Returns:
            None where too few links are beyond, or what is before them bends.
        """
        arm = problem.arm
        joints = start.feed + arm.link_length * np.arange(arm.links)
        first = int(np.searchsorted(joints, outside - ROUNDING))
        too_few = arm.links - first < settings.least_links_reshaped
        start_bent = bool(np.any(start.bends[:first]))
        goal_bent = not isinstance(goal, TipGoal) and bool(np.any(goal[:first]))
        if too_few or start_bent or goal_bent:
            return None
        # An arm has an even number of links: an odd part gets one link more, which the guide tube keeps straight.
        clamped = (arm.links - first) % 2 == 1
        first -= int(clamped)
        return cls(_problem_of_part(problem, start, goal, first), first, clamped)

    def ends(self, settings: FeedPlannerSettings) -> Ends:
        """Start and goal of the part.

        Raises:
            UnreachableGoal: one of them cannot be.
        """
        ends = resolve_ends(self.problem, settings.curve.motion.ends)
        # Clamped ends keep the first link still, which holds the extra link straight.
        return replace(ends, clamped=self.clamped or ends.clamped)


def _problem_of_part(problem: Problem, start: JointPose, goal: FloatArray | TipGoal, first: int) -> Problem:
    """The problem of the arm from a joint on, what is before it an obstacle."""
    limits = problem.limits
    torque = None if limits.torque is None else limits.torque[3 * first :]
    return replace(
        problem,
        arm=part_of(problem.arm, first, start.feed),
        limits=Limits(limits.velocity[3 * first :], limits.acceleration[3 * first :], torque),
        workspace=_with_held_links(problem, start, first),
        start=JointPose(start.bends[first:]),
        goal=goal if isinstance(goal, TipGoal) else JointPose(goal[first:]),
        stops=(),
        # What is wanted by default is a share of the arm's length.
        planner=replace(problem.planner, mapping="least-squares", wanted_gap=problem.wanted_gap),
    )


def _with_held_links(problem: Problem, start: JointPose, first: int) -> Workspace:
    """The workspace with those links in the guide tube that the arm from a joint on might meet."""
    arm = problem.arm
    held = first + 1 - arm.first_self_pair
    if held < 1 or not arm.self_collision:
        return problem.workspace
    # Self-contact is measured between distant links only, so the last links in the guide tube are left out.
    ends = arm.base + np.outer([start.feed, start.feed + held * arm.link_length], arm.feed_direction)
    rounding = max(arm.radius - problem.workspace.clearance, 0.0)
    body = Obstacle("the arm in its guide tube", shapely.LineString(ends), rounding)
    return replace(problem.workspace, obstacles=(*problem.workspace.obstacles, body))


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
