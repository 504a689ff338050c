"""Problems whose arm has its bodies as links, and paths of the arm alone that follow from paths for them."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import Goal, JointPose, Limits, Problem, VerificationOptions
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.tool_links import with_tool_links

_STRONG = 1e3
"""Torque limit of the locked joints of tool links, in the greatest limits of the arm's. Heuristic: it never binds."""


def problem_with_tool_links(problem: Problem, *, weighed: bool = False) -> Problem:
    """Return the problem of an arm some of whose links are its tool and other bodies, or the problem itself without.

    Goals, clearances and tolerances stay as they are.

    Args:
        problem: the problem.
        weighed: whether tool links carry the masses of bodies if torques are limited.
    """
    if not problem.arm.rigid_bodies:
        return problem
    arm = with_tool_links(problem.arm, weighed=weighed and problem.limits.torque is not None)
    own = _own_links(arm)
    return replace(
        problem,
        arm=arm,
        limits=_limits(problem.limits, own),
        start=_pose(problem.start, own),
        goal=_goal(problem.goal, own),
        stops=tuple(replace(stop, goal=_goal(stop.goal, own)) for stop in problem.stops),
        planner=replace(problem.planner, wanted_gap=problem.wanted_gap),
        verification=VerificationOptions(problem.contact_tolerance),
    )


def bodies_as_links(problem: Problem) -> tuple[Problem, Callable[[JointPath], JointPath]]:
    """Return the problem of an arm whose bodies are links, and what makes its paths those of the arm alone."""
    whole = problem_with_tool_links(problem, weighed=True)
    return whole, partial(path_without_tool_links, arm=problem.arm, whole=whole.arm)


def _own_links(arm: Arm) -> BoolArray:
    """Return a mask of the links of an arm that stand for no bodies, shape (links,)."""
    return np.ones(arm.links, dtype=bool) if arm.tool_links is None else arm.tool_links.own


def _limits(limits: Limits, own: BoolArray) -> Limits:
    """Return limits with values for the locked joints of tool links."""

    def longer(values: FloatArray, others: float | None = None) -> FloatArray:
        # By default those of the last joint: they never bind.
        each = values.reshape(-1, 3)
        found = np.tile(each[-1] if others is None else np.full(3, others), (len(own), 1))
        found[own] = each
        return np.ravel(found)

    torque, jerk = limits.torque, limits.jerk
    if torque is not None:
        torque = longer(torque, _STRONG * float(np.max(torque)))
    return replace(
        limits,
        velocity=longer(limits.velocity),
        acceleration=longer(limits.acceleration),
        torque=torque,
        jerk=None if jerk is None else longer(jerk),
    )


def _pose(pose: JointPose, own: BoolArray) -> JointPose:
    """Return a pose with further joints, which are straight."""
    bends = np.zeros((len(own), *pose.bends.shape[1:]))
    bends[own] = pose.bends
    return replace(pose, bends=bends, curve=None)


def _goal(goal: Goal, own: BoolArray) -> Goal:
    return goal if goal.for_joints is None else _pose(goal.for_joints, own)


def motion_with_tool_links(trajectory: JointTrajectory, whole: Arm) -> JointTrajectory:
    """Return the motion of an arm with its tool and bodies as links.

    Args:
        trajectory: motion of the arm.
        whole: the arm with its tool and bodies as links.
    """
    kept = own_coordinates(whole)

    def longer(columns: FloatArray) -> FloatArray:
        found = np.zeros((len(columns), len(kept)))
        found[:, kept] = columns
        return found

    return replace(
        trajectory,
        coordinates=whole.coordinates,
        positions=longer(trajectory.positions),
        velocities=longer(trajectory.velocities),
        accelerations=longer(trajectory.accelerations),
    )


def own_coordinates(whole: Arm) -> BoolArray:
    """Return a mask of the coordinates of an arm that are not those of tool links, shape (c,)."""
    joints = np.repeat(_own_links(whole), whole.bends_a_joint)
    return np.append(joints, np.ones(len(whole.coordinates.base_names), dtype=bool))


def with_bodies(values: FloatArray, whole: Arm, still: float) -> FloatArray:
    """Return values of an arm's coordinates, shape (..., c), with those of the joints of its bodies as links.

    Args:
        values: values of the arm's own coordinates.
        whole: the arm with its bodies as links.
        still: value of a coordinate that never changes.
    """
    own = own_coordinates(whole)
    found = np.full((*values.shape[:-1], len(own)), still)
    found[..., own] = values
    return found


def path_without_tool_links(path: JointPath, arm: Arm, whole: Arm) -> JointPath:
    """Return the path of an arm that follows from that of the arm with its tool and bodies as links.

    Args:
        path: path of the arm some of whose links are its tool and bodies.
        arm: the arm, with its bodies.
        whole: the arm with its bodies as links.
    """
    kept = own_coordinates(whole)
    spline = path.spline
    keyframes = np.ascontiguousarray(path.keyframes[:, kept])
    return replace(
        path,
        spline=type(spline)(spline.t, np.ascontiguousarray(spline.c[:, kept]), spline.k),
        keyframes=keyframes,
        curves=nearest_curves(arm, keyframes) if path.curves else (),
        goal_pose=None,
        parts=tuple(path_without_tool_links(part, arm, whole) for part in path.parts),
    )
