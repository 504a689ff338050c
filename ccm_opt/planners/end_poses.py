"""Where a motion ends: asks the goal-pose NLP on behalf of the search, and remembers what it said for the record."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.stages import Stages
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.ends import Ends
from ccm_opt.nlp.arm_pose.pose_settings import PoseSettings
from ccm_opt.nlp.arm_pose.pose_solver import ArmPose
from ccm_opt.planners.goal_pose import GoalPoseSearch, for_arm
from ccm_opt.problem import Problem
from ccm_opt.solution import GoalPoseRecord
from ccm_opt.user_terms.compiled_terms import UserTerms


@dataclass
class EndPoses:
    """Offers the search better poses at the goal than those in which its motions arrive; they are ``EndPosesOffered``.

    Attributes:
        problem: whose goal it is.
        ends: its ends as planning takes them.
        deadline: after which no further pose is asked for.
        stages: names and times the stage.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
        said: every pose that was asked for, with the search that asked, in the order of asking.
    """

    problem: Problem
    ends: Ends
    deadline: Deadline
    stages: Stages
    terms: UserTerms | None
    settings: PoseSettings
    said: list[tuple[GoalPoseSearch, ArmPose]] = field(default_factory=list)

    def __call__(self, arm: Arm, headings: FloatArray) -> Iterator[FloatArray]:
        """Link headings of better poses than the one in which a motion ends, the best first; none without need.

        The pose of the motion's own class comes first, for interpolation reaches it. Only where it lacks room are poses
        of other classes asked for.

        Args:
            arm: the arm, or one as long with fewer links.
            headings: of its links at the end of the motion, shape (links,) [rad].
        """
        if self.problem.wanted_gap == 0.0 or self.ends.goal_headings is not None:
            return
        with self.stages("configuration"):
            search = GoalPoseSearch(for_arm(self.problem, arm), self.ends, headings, self.terms, self.settings)
            poses = search.improved(headings)
            own = search.best_of(poses)
        self.said.append((search, own or poses[-1]))
        if own is not None and own.gap >= self.settings.room_enough * search.wanted_gap:
            yield own.headings
            return
        with self.stages("configuration"):
            others = [each.pose for each in search.candidates(headings, self.deadline)]
            poses_of_all = sorted(others if own is None else [own, *others], key=lambda pose: pose.answer.cost)
        for pose in poses_of_all:
            if pose is not own:
                self.said.append((search, pose))
            yield pose.headings

    def record(self, reached: FloatArray | None) -> GoalPoseRecord | None:
        """What was said of the pose in which the motion ends, or of the last that was asked for.

        Args:
            reached: link headings of the offered pose that the motion ends in, shape (links,) [rad]; None where it
                ends elsewhere.
        """
        if not self.said:
            return None
        taken = [each for each in self.said if reached is not None and np.array_equal(each[1].headings, reached)]
        search, pose = taken[-1] if taken else self.said[-1]
        return pose_record(search, pose, len(self.said), "" if taken else _why_not(search, pose))


def pose_record(search: GoalPoseSearch, pose: ArmPose, tried: int, reason: str = "") -> GoalPoseRecord:
    """What is kept of a pose of the NLP.

    Args:
        search: that asked for it.
        pose: the pose.
        tried: how many poses were asked for, this one among them.
        reason: why the motion does not end in it; empty when it does, or when there is none.
    """
    return GoalPoseRecord(
        reached=not reason,
        reason=reason,
        headings=pose.headings,
        curve=pose.curve,
        gap=pose.gap,
        wanted_gap=search.wanted_gap,
        costs=pose.answer.costs,
        multipliers=pose.answer.multipliers,
        iterations=pose.answer.iterations,
        size=pose.answer.size,
        status=pose.answer.status,
        tried=tried,
    )


def _why_not(search: GoalPoseSearch, pose: ArmPose) -> str:
    """Why a motion does not end in the pose that was asked for last."""
    if not search.feasible(pose):
        return (
            f"the nonlinear program ended with {pose.answer.status}, its row '{pose.answer.worst_row}' off by "
            f"{pose.answer.violation:.2g}; the motion ends where the search arrived"
        )
    return "no certified way leads from where the search arrived to this pose, so the motion ends where it arrived"
