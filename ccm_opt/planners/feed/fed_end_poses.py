"""Where a motion of a fed arm ends: asks the goal-pose NLP for the part of the arm beyond the hole, at the end's feed.

Ends of leaders' paths are hardly improved by that (see ADR 0010), so those that simply follow a leader stay as they
are; motions that are optimised anyhow are bent to what the NLP says.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import NoPlanFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.nlp.arm_pose.pose_settings import PoseSettings
from ccm_opt.planners.feed.part_beyond import PartBeyond
from ccm_opt.planners.feed.query import FeedQuery
from ccm_opt.planners.goal_pose import GoalPoseSearch
from ccm_opt.problem import JointPose, TipGoal


@dataclass(frozen=True)
class FedEndPoses:
    """Offers the optimisation a better pose at the goal than the one in which a motion ends; ``EndPosesOffered``.

    Attributes:
        query: what is asked.
        settings: of the NLP.
    """

    query: FeedQuery
    settings: PoseSettings

    def __call__(self, arm: Arm, pose: FloatArray) -> Iterator[FloatArray]:
        """The best pose of the same class and feed; none without need.

        Args:
            arm: with a feed axis.
            pose: link headings and the base's way at the end of a motion, shape (c,) [rad, link lengths].
        """
        query = self.query
        goal = query.problem.goal
        if query.goal is not None or not isinstance(goal, TipGoal) or query.problem.wanted_gap == 0.0:
            return
        configuration = arm.configurations(pose)
        end = JointPose(configuration[:-1], float(configuration[-1]))
        part = PartBeyond.of(query.problem, end, goal, query.outside, query.settings)
        if part is None:
            return
        headings = pose[part.first : arm.links]
        try:
            ends = part.ends(query.settings)
        except NoPlanFound:
            return
        search = GoalPoseSearch(part.problem, ends, headings, None, self.settings)
        best = search.best(headings)
        if best is not None:
            yield np.concatenate((pose[: part.first], best.headings, pose[arm.links :]))
