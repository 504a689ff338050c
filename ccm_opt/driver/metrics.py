"""Figures of a plan."""

from collections.abc import Mapping

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import path_length, wrap
from ccm_opt.planning.following.deviation import Deviation, LeaderDeviation, deviation, leader_deviation
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion, goal_errors
from ccm_opt.verification.interpolated_message import interpolation_deviation


def metrics(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    joints: JointStates,
    simulated: SimulatedMotion,
    checks: tuple[Check, ...],
) -> Mapping[str, float]:
    """The figures of merit of a plan, named with their units."""
    figures = dict(figures_of_motion(problem, trajectory, joints, checks))
    figures["keyframes"] = float(len(path.keyframes))
    figures["tracking_error_rad"] = simulated.tracking_error
    # An arm that followed no leader has no deviation from one.
    if path.leaders and problem.dimension == 2:
        figures.update(_leader_figures(deviation(problem.arm, trajectory.positions, path.leaders)))
    return figures


def figures_of_motion(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, checks: tuple[Check, ...]
) -> Mapping[str, float]:
    """Those figures that the motion itself has, so that whoever has its arrays can make them again."""
    bends = trajectory.bend_angles
    if problem.dimension == 3:
        turns = bend_of_joints(problem.arm.bend_pairs(trajectory.positions))
        ends = _in_space(problem, trajectory)
    else:
        turns = np.abs(bends)
        ends = _in_the_plane(problem, trajectory)
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(joints.torques), initial=0.0)),
        "joint_path_length_rad": path_length(bends),
        # The bend at the base turns the whole arm and curves nothing, so it does not count.
        "largest_curvature_per_m": float(np.max(turns[:, 1:], initial=0.0) / problem.arm.link_length),
        # The error at the goal is that of the motion as it is written, not of the path it was planned from.
        **ends,
    }
    # Of lengths in metres only the clearances are merits; the other checks are promises that hold or do not.
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def _in_the_plane(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """How the arm ends, and how far it leaves the motion that is proved when a controller interpolates its message."""
    arm = problem.arm
    figures = {"interpolation_deviation_m": interpolation_deviation(arm, trajectory)}
    if isinstance(problem.goal, TipGoal):
        tip = arm.joint_positions_at(trajectory.positions[-1])[-1]
        figures["tip_error_m"] = float(np.hypot(*(tip - problem.goal.position)))
        if problem.goal.heading is not None:
            turn = wrap(arm.headings(trajectory.bend_angles[-1])[-1] - problem.goal.heading)
            figures["heading_error_rad"] = abs(float(turn))
    return figures


def _in_space(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """How the arm ends, and how well it follows its tip where its base is fed."""
    errors = goal_errors(problem, trajectory.positions[-1])
    ends = {"tip_error_m": errors.position, "direction_error_rad": errors.direction, "tip_roll_rad": errors.roll}
    followed = leader_deviation(problem.arm, trajectory.positions)
    return {
        **{name: error for name, error in ends.items() if error is not None},
        **({} if followed is None else _leader_figures(followed)),
    }


def _leader_figures(found: Deviation | LeaderDeviation) -> dict[str, float]:
    """How well the arm follows its leader, as figures of merit."""
    return {
        "leader_deviation_mean_m": found.mean,
        "leader_deviation_worst_m": found.worst,
        "leader_deviation_straight_mean_m": found.straight_mean,
    }


def bend_of_joints(pairs: FloatArray) -> FloatArray:
    """Angle between the links on both sides of a joint from its two bends, shape (..., 2) to (...) [rad]."""
    cos = np.cos(pairs[..., 0]) * np.cos(pairs[..., 1])
    return np.asarray(np.arccos(np.clip(cos, -1.0, 1.0)))
