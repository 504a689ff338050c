"""Problems whose arm has its tool as links, and paths of the arm alone that follow from paths for them."""

from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import Goal, JointPose, Limits, Problem, VerificationOptions
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.tool_links import with_tool_links

_STRONG = 1e3
"""Torque limit of the locked joints of tool links, in the greatest limits of the arm's. Heuristic: it never binds."""


def problem_with_tool_links(problem: Problem) -> Problem:
    """Return the problem of an arm whose last links are its tool, or the problem itself for an arm without a tool.

    Goals, clearances and tolerances stay as they are; the tool's mass acts at its first link.
    """
    tool = problem.arm.tool
    arm = with_tool_links(problem.arm)
    if tool is None:
        return problem
    count = arm.links - problem.arm.links
    if count and tool.mass:
        masses = arm.masses.copy()
        masses[problem.arm.links] = tool.mass
        arm = replace(arm, masses=masses)
    return replace(
        problem,
        arm=arm,
        limits=_limits(problem.limits, count),
        start=_pose(problem.start, count),
        goal=_goal(problem.goal, count),
        stops=tuple(replace(stop, goal=_goal(stop.goal, count)) for stop in problem.stops),
        planner=replace(problem.planner, wanted_gap=problem.wanted_gap),
        verification=VerificationOptions(problem.contact_tolerance),
    )


def _limits(limits: Limits, count: int) -> Limits:
    """Return limits with values for the locked joints of ``count`` tool links."""

    def longer(values: FloatArray) -> FloatArray:
        return np.append(values, np.tile(values[-3:], count))

    torque, jerk = limits.torque, limits.jerk
    if torque is not None:
        torque = np.append(torque, np.full(3 * count, _STRONG * float(np.max(torque))))
    return replace(
        limits,
        velocity=longer(limits.velocity),
        acceleration=longer(limits.acceleration),
        torque=torque,
        jerk=None if jerk is None else longer(jerk),
    )


def _pose(pose: JointPose, count: int) -> JointPose:
    """Return a pose with ``count`` further joints, which are straight."""
    straight = np.zeros((count, *pose.bends.shape[1:]))
    return replace(pose, bends=np.concatenate((pose.bends, straight)), curve=None)


def _goal(goal: Goal, count: int) -> Goal:
    return goal if goal.for_joints is None else _pose(goal.for_joints, count)


def motion_with_tool_links(trajectory: JointTrajectory, arm: Arm, whole: Arm) -> JointTrajectory:
    """Return the motion of an arm with its tool as links.

    Args:
        trajectory: motion of the arm.
        arm: the arm.
        whole: the arm with its tool as links.
    """
    bends = arm.coordinates.joints
    still = np.zeros((len(trajectory.time), whole.coordinates.joints - bends))

    def longer(columns: FloatArray) -> FloatArray:
        return np.concatenate((columns[:, :bends], still, columns[:, bends:]), axis=1)

    return replace(
        trajectory,
        coordinates=whole.coordinates,
        positions=longer(trajectory.positions),
        velocities=longer(trajectory.velocities),
        accelerations=longer(trajectory.accelerations),
    )


def path_without_tool_links(path: JointPath, arm: Arm, links: int) -> JointPath:
    """Return the path of an arm that follows from that of the arm with its tool as links.

    Args:
        path: path of the arm whose last links are its tool.
        arm: the arm, with its tool.
        links: number of links of the arm with its tool as links.
    """
    kept = np.ones(links * arm.bends_a_joint + len(arm.coordinates.base_names), dtype=bool)
    kept[arm.links * arm.bends_a_joint : links * arm.bends_a_joint] = False
    spline = path.spline
    keyframes = np.ascontiguousarray(path.keyframes[:, kept])
    return replace(
        path,
        spline=type(spline)(spline.t, np.ascontiguousarray(spline.c[:, kept]), spline.k),
        keyframes=keyframes,
        curves=nearest_curves(arm, keyframes) if path.curves else (),
        goal_pose=None,
        parts=tuple(path_without_tool_links(part, arm, links) for part in path.parts),
    )
