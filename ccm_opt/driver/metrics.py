"""Figures of a plan."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import path_length, wrap
from ccm_opt.planning.following.deviation import Deviation, deviation, leader_deviation
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.solution.space_solution import goal_errors
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


@dataclass(frozen=True)
class Touch:
    """A link of the simulated arm in contact.

    Attributes:
        link: number of the link, counted from 1.
        obstacle: name of the wall, or "link 9".
        time: when [s].
    """

    link: int
    obstacle: str
    time: float

    def __str__(self) -> str:
        return f"link {self.link} touches {self.obstacle} at {self.time:.4g} s"


@dataclass(frozen=True)
class Seen:
    """What was seen of a simulated arm among its obstacles.

    Attributes:
        touch: where it first touches something; None where it touches nothing.
        walls: least distance from walls, inf where nothing is near [m]; of no matter beyond a contact.
        itself: least distance between links, inf where none are near; None where links may meet [m].
    """

    touch: Touch | None
    walls: float
    itself: float | None
