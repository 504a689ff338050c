"""The figures of merit of a plan, named with their units."""

from collections.abc import Mapping

import numpy as np

from ccm_opt.ground.angles import wrap
from ccm_opt.ground.polyline import path_length
from ccm_opt.planners.following.deviation import Deviation, deviation
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.verification.interpolation import interpolation_deviation


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
    if path.leaders:
        figures.update(leader_figures(deviation(problem.arm, trajectory.positions, path.leaders)))
    return figures


def figures_of_motion(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, checks: tuple[Check, ...]
) -> Mapping[str, float]:
    """Those figures that the motion itself has, so that whoever has its arrays can make them again."""
    arm = problem.arm
    # The error at the goal is that of the motion as it is written, not of the path it was planned from.
    headings = arm.headings(trajectory.bend_angles)
    tip = arm.joint_positions_at(trajectory.positions[-1])[-1]
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(joints.torques), initial=0.0)),
        "joint_path_length_rad": path_length(trajectory.bend_angles),
        "interpolation_deviation_m": interpolation_deviation(arm, trajectory),
        # The bend at the base turns the whole arm and curves nothing, so it does not count.
        "largest_curvature_per_m": float(np.max(np.abs(trajectory.bend_angles[:, 1:]), initial=0.0) / arm.link_length),
    }

    if isinstance(problem.goal, TipGoal):
        figures["tip_error_m"] = float(np.hypot(*(tip - problem.goal.position)))
        if problem.goal.heading is not None:
            turn = wrap(headings[-1, -1] - problem.goal.heading)
            figures["heading_error_rad"] = abs(float(turn))
    # Of lengths in metres only the clearances are merits; the other checks are promises that hold or do not.
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def leader_figures(found: Deviation) -> Mapping[str, float]:
    """How well the arm follows its leader, as figures of merit."""
    return {
        "leader_deviation_mean_m": found.mean,
        "leader_deviation_worst_m": found.worst,
        "leader_deviation_straight_mean_m": found.straight_mean,
    }
