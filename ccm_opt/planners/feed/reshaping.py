"""Motions at a fixed feed: the part of the arm beyond the hole, planned as an arm of its own."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.motion.search import find_motion
from ccm_opt.planners.curve import CurvePlanner
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.planners.feed.part_beyond import PartBeyond
from ccm_opt.problem import JointPose, Problem, TipGoal


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
        part = PartBeyond.of(self.problem, start, goal, outside, self.settings)
        if part is None:
            return None
        planner = CurvePlanner(settings=self.settings.curve)
        try:
            motion = find_motion(planner.motion_task(part.problem, part.ends(self.settings), self.deadline))
        except NoPlanFound:
            return None
        return self._whole(start, part.problem.arm.bends(motion.headings), clamped=part.clamped)

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
