"""The goal-pose NLP in the plane: its task, the better poses that it offers, and the record of its answer."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_settings import DEFAULT_POSES, PoseSettings
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.planning.ends import Ends
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.problem.solution import GoalPoseRecord
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def poses_at_goal(
    problem: Problem,
    ends: Ends,
    near: FloatArray,
    terms: UserTerms | None = None,
    settings: PoseSettings = DEFAULT_POSES,
) -> GoalPoses:
    """Return the task of the goal-pose NLP in the plane.

    Args:
        problem: problem with a goal for the tip.
        ends: ends of the problem as planning uses them.
        near: configuration near which the pose should stay, shape (c,) [rad]: where the motion would end without the
            NLP, or where it starts.
        terms: the user's constraints and costs, or None.
        settings: settings of the NLP.
    """
    tree = SurfaceTree.of(problem.workspace.soup)
    aim = TipGoal(ends.goal.position, ends.goal.direction)
    return GoalPoses(problem, tree, near, terms, settings, aim=aim, room=ends.goal.room, clamped=ends.clamped)


@dataclass
class EndPoses:
    """Offers the search better end poses than those in which its motions arrive; implements ``EndPosesOffered``.

    Attributes:
        problem: the problem.
        ends: ends of the problem as planning uses them.
        stages: reports each stage of planning and records its CPU time.
        terms: the user's constraints and costs, or None.
        settings: settings of the NLP.
        said: every task of the NLP with the pose that the NLP returned, in order.
    """

    problem: Problem
    ends: Ends
    stages: Stages
    terms: UserTerms | None
    settings: PoseSettings
    said: list[tuple[GoalPoses, ArmPose]] = field(default_factory=list)

    def __call__(self, arm: Arm, q: FloatArray) -> Iterator[FloatArray]:
        """Yield the configuration of a better pose than the one in which a motion ends, if there is one.

        No pose is sought where no preferred gap is set, or for a whole-arm goal.

        Args:
            arm: the arm, or an arm of the same length with fewer links.
            q: configuration of the arm at the end of the motion, shape (c,) [rad].
        """
        if self.problem.wanted_gap == 0.0 or self.ends.goal_pose is not None:
            return
        with self.stages("configuration"):
            asked = poses_at_goal(for_arm(self.problem, arm), self.ends, q, self.terms, self.settings)
            poses = asked.improved(q)
            best = asked.best_pose(poses)
        self.said.append((asked, best or poses[-1]))
        if best is not None:
            yield best.q

    def record(self, reached: FloatArray | None) -> GoalPoseRecord | None:
        """Return the record of the NLP's pose in which a motion ends, else of the NLP's last pose; None if it has none.

        Args:
            reached: configuration of the offered pose that the motion ends in, shape (c,); None where it ends
                elsewhere.
        """
        if not self.said:
            return None
        taken = [each for each in self.said if reached is not None and np.array_equal(each[1].q, reached)]
        asked, pose = taken[-1] if taken else self.said[-1]
        return pose_record(self.problem.wanted_gap, pose, len(self.said), "" if taken else _why_not(asked, pose))


def _why_not(asked: GoalPoses, pose: ArmPose) -> str:
    """Explain why a motion does not end in the pose that the NLP returned last."""
    if not asked.feasible(pose):
        return (
            f"the nonlinear program ended with {pose.answer.status}, its row '{pose.answer.worst_row}' violated by "
            f"{pose.answer.violation:.2g}; the motion ends where the search arrived"
        )
    return "no certified way leads from where the search arrived to this pose, so the motion ends where it arrived"


def pose_record(wanted_gap: float, pose: ArmPose, tried: int, reason: str = "") -> GoalPoseRecord:
    """Return the record of a pose of the NLP.

    Args:
        wanted_gap: preferred gap beyond radius and clearance [m].
        pose: the pose.
        tried: number of poses requested from the NLP, this one included.
        reason: why the motion does not end in the pose; empty when it does.
    """
    return GoalPoseRecord(
        reached=not reason,
        reason=reason,
        configuration=pose.q,
        curve=pose.curve,
        gap=pose.gap,
        wanted_gap=wanted_gap,
        costs=pose.answer.costs,
        multipliers=pose.answer.multipliers,
        iterations=pose.answer.iterations,
        size=pose.answer.size,
        status=pose.answer.status,
        tried=tried,
    )


def for_arm(problem: Problem, arm: Arm) -> Problem:
    """Return the problem with its arm replaced by the clamped arm, or by an arm of the same length with fewer links."""
    if arm.links == problem.arm.links:
        return replace(problem, arm=arm)
    fewer = arm.links
    limits = problem.limits
    # The pose needs only the torque limits: each joint has those of the joint at its place on the real arm.
    places = np.minimum(np.arange(3 * fewer) // 3 * problem.arm.links // fewer, problem.arm.links - 1)
    at = 3 * places + np.arange(3 * fewer) % 3
    resampled = replace(
        limits,
        velocity=limits.velocity[at],
        acceleration=limits.acceleration[at],
        torque=None if limits.torque is None else limits.torque[at],
        jerk=None if limits.jerk is None else limits.jerk[at],
    )
    return replace(problem, arm=arm, limits=resampled, start=JointPose(np.zeros(fewer)))
