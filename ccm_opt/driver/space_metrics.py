"""The figures of merit of a plan in space, named with their units as those in the plane."""

from collections.abc import Mapping

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.space.leader_in_space import leader_deviation
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.space_solution import goal_errors


def space_figures_of_motion(
    problem: SpaceProblem, trajectory: JointTrajectory, joints: JointStates, checks: tuple[Check, ...]
) -> Mapping[str, float]:
    """Those figures that the motion itself has, so that whoever has its arrays can make them again."""
    arm = problem.arm
    turns = bend_of_joints(arm.bend_pairs(trajectory.positions))
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(joints.torques), initial=0.0)),
        "joint_path_length_rad": path_length(trajectory.bend_angles),
        # The bend at the base turns the whole arm and curves nothing, so it does not count.
        "largest_curvature_per_m": float(np.max(turns[:, 1:], initial=0.0) / arm.link_length),
    }
    errors = goal_errors(problem, trajectory.positions[-1])
    if errors.position is not None:
        figures["tip_error_m"] = errors.position
    if errors.direction is not None:
        figures["direction_error_rad"] = errors.direction
    figures["tip_roll_rad"] = errors.roll
    followed = leader_deviation(arm, trajectory.positions)
    if followed is not None:
        figures["leader_deviation_mean_m"] = followed.mean
        figures["leader_deviation_worst_m"] = followed.worst
        figures["leader_deviation_straight_mean_m"] = followed.straight_mean
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def bend_of_joints(pairs: FloatArray) -> FloatArray:
    """Angle between the links on both sides of a joint from its two bends, shape (..., 2) to (...) [rad]."""
    cos = np.cos(pairs[..., 0]) * np.cos(pairs[..., 1])
    return np.asarray(np.arccos(np.clip(cos, -1.0, 1.0)))
