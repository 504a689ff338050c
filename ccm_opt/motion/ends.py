"""The ends of a motion: resolved to link headings, and refused when they touch something or break a joint limit."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.errors import Diagnosis, UnreachableGoal
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.motion.contacts import ContactFinder
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.walls import Walls
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal


@dataclass(frozen=True)
class Ends:
    """Both ends of a motion.

    Attributes:
        start: link headings, shape (links,) [rad].
        goal: where the tip has to be.
        goal_headings: link headings of a whole-arm goal, shape (links,) [rad], or None.
    """

    start: FloatArray
    goal: GoalPose
    goal_headings: FloatArray | None


def resolve_ends(problem: Problem) -> Ends:
    """Start and goal of a problem on the links.

    Raises:
        UnreachableGoal: naming link and obstacle with the depth, or joint and angle.
    """
    start = _headings(problem, problem.start)
    _refuse_bad_pose(problem, start, "start")
    if isinstance(problem.goal, TipGoal):
        return Ends(start, GoalPose(problem.goal.position, problem.goal.heading), None)
    headings = _headings(problem, problem.goal)
    _refuse_bad_pose(problem, headings, "goal")
    tip = problem.arm.joint_positions(headings)[-1]
    return Ends(start, GoalPose(tip, float(headings[-1])), headings)


def _headings(problem: Problem, pose: JointPose | CurvePose) -> FloatArray:
    if isinstance(pose, JointPose):
        return problem.arm.headings(pose.bends)
    return map_curve(problem.arm, pose.configuration, problem.planner.mapping)


def _refuse_bad_pose(problem: Problem, headings: FloatArray, which: str) -> None:
    arm = problem.arm
    bends = arm.bends(headings)
    over = np.abs(bends) - arm.bend_limits
    if over.max() > 1e-9:
        joint = int(np.argmax(over))
        angle, limit = np.rad2deg(bends[joint]), np.rad2deg(arm.bend_limits[joint])
        reason = f"the {which} bends joint {joint + 1} by {angle:.2f}°, its limit is {limit:.2f}°"
        raise UnreachableGoal(Diagnosis(reason, which, (f"change the {which}", "raise arm.joint_limit_deg")))
    finder = ContactFinder(arm, Walls.of(problem.workspace), problem.workspace.clearance, 0.0, 0.02 * arm.length)
    points = arm.joint_positions(headings)
    contacts = finder.find(points)
    if np.any(contacts.gap <= 0.0) or finder.crosses(points):
        reason = f"the {which} touches something: {finder.describe(contacts)}"
        advice = (f"change the {which}", "use a smaller arm.radius or workspace.clearance")
        raise UnreachableGoal(Diagnosis(reason, which, advice))
