"""Use of the goal-pose NLP for planar arms: better end poses for motions, and the record of the NLP's result."""

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


def poses_at_goal(
    problem: Problem,
    ends: Ends,
    near: FloatArray,
    terms: UserTerms | None = None,
    settings: PoseSettings = DEFAULT_POSES,
) -> GoalPoses:
    """Return the solver of the goal-pose NLP for a planar problem.

    Args:
        problem: problem with a goal for the tip.
        ends: start and goal in the form that planning uses.
        near: configuration from which deviations cost, shape (c,) [rad]: the end of the motion without the NLP, or the
            start.
        terms: compiled constraints and costs of the user, or None.
        settings: settings of the NLP.
    """
    tree = problem.workspace.surface_tree
    aim = TipGoal(ends.goal.position, ends.goal.direction)
    return GoalPoses(problem, tree, near, terms, settings, aim=aim, room=ends.goal.room, clamped=ends.clamped)


@dataclass
class EndPoses:
    """Generator of better end poses for motions by the goal-pose NLP; implements ``EndPosesOffered``.

    Attributes:
        problem: the problem.
        ends: start and goal in the form that planning uses.
        stages: reporter of the stages of planning, which records their CPU time.
        terms: compiled constraints and costs of the user, or None.
        settings: settings of the NLP.
        said: solver and resulting pose of every call, in order.
    """

    problem: Problem
    ends: Ends
    stages: Stages
    terms: UserTerms | None
    settings: PoseSettings
    said: list[tuple[GoalPoses, ArmPose]] = field(default_factory=list)

    def __call__(self, arm: Arm, q: FloatArray) -> Iterator[FloatArray]:
        """Yield the configuration (c,) of a better pose at the goal than that in which a motion ends, if there is one.

        Nothing is yielded without a preferred gap, or for a goal of the whole arm.

        Args:
            arm: the arm, or an arm of equal length with fewer links.
            q: configuration at the end of the motion, shape (c,) [rad].
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
        """Return the record of the NLP's pose in which a motion ends, or of the NLP's last pose.

        The result is None if the NLP has not been solved.

        Args:
            reached: configuration of the offered pose in which the motion ends, shape (c,); None if the motion ends
                elsewhere.
        """
        if not self.said:
            return None
        taken = [each for each in self.said if reached is not None and np.array_equal(each[1].q, reached)]
        asked, pose = taken[-1] if taken else self.said[-1]
        return pose_record(self.problem.wanted_gap, pose, len(self.said), "" if taken else _why_not(asked, pose))


def _why_not(asked: GoalPoses, pose: ArmPose) -> str:
    """Return a message that says why a motion does not end in a pose of the goal-pose NLP."""
    if not asked.feasible(pose):
        return (
            f"the nonlinear program ended with {pose.answer.status}, its row '{pose.answer.worst_row}' violated by "
            f"{pose.answer.violation:.2g}; the motion ends where the search arrived"
        )
    return "no certified way leads from where the search arrived to this pose, so the motion ends where it arrived"


def pose_record(wanted_gap: float, pose: ArmPose, tried: int, reason: str = "") -> GoalPoseRecord:
    """Return the record of a pose of the goal-pose NLP, for the results of planning.

    Args:
        wanted_gap: preferred gap beyond radius and clearance [m].
        pose: the pose.
        tried: number of solutions of the NLP, including the recorded one.
        reason: reason why the motion does not end in the pose; empty if it does.
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
    """Return a problem adapted to another arm: one with a clamped base, or one of equal length with fewer links."""
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
