"""Figures of merit of a plan, and the deviation of an arm on a feed axis from the path of its tip."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import path_length, wrap
from ccm_opt.planning.limits.following import distances_from_leader
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion, goal_errors
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import drive_torques
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.verification.interpolated_message import interpolation_deviation
from ccm_opt.verification.tool_chain import arm_reaching_bodies

_POSES = 400
"""Maximum number of poses of a motion that are evaluated, including the first and the last. Heuristic."""
_STRAIGHT_TURN = 0.008726646259971648
"""Maximum turn of a tip path within a link length to each side, for the path to count as straight [rad]. Heuristic:
half a degree."""


@dataclass(frozen=True)
class LeaderDeviation:
    """Distances between the path of the tip and the arm's centre line outside the guide tube of the feed axis.

    Attributes:
        mean: mean distance over all points and poses [m].
        worst: maximum distance [m].
        straight_mean: mean distance over the points where the tip path is straight [m]; 0 if there are none.
    """

    mean: float
    worst: float
    straight_mean: float


def leader_deviation(arm: Arm, positions: FloatArray, stops: Sequence[int] = ()) -> LeaderDeviation | None:
    """Return how far an arm whose base moves deviates from the path of its tip; None for an arm on a fixed base.

    Args:
        arm: the arm.
        positions: configurations at T samples of the motion, with c coordinates each, shape (T, c) [rad, m].
        stops: indices of the samples at which the arm rests at intermediate goals, each of which begins a new tip path.
    """
    if not arm.base_axes:
        return None
    parts = []
    for first, last in pairwise((0, *stops, len(positions) - 1)):
        numbers = np.linspace(first, last, min(_POSES, last - first + 1))
        found = distances_from_leader(arm, positions[np.unique(numbers.astype(int))])
        if found is not None:
            parts.append((found.distance, _straight_legs(found.path, arm.link_length)[found.leg]))
    if not parts:
        return None
    distance, straight = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    mean_on_straight = float(np.mean(distance[straight])) if straight.any() else 0.0
    return LeaderDeviation(float(np.mean(distance)), float(np.max(distance)), mean_on_straight)


def _straight_legs(path: FloatArray, reach: float) -> BoolArray:
    """Return a mask of the segments around which a polygonal path is straight, shape (m − 1,).

    Args:
        path: vertices of the path, shape (m, 3) [m].
        reach: arc length to each side of a segment within which the path must be straight [m].
    """
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    directions = legs / lengths[:, None]
    sines = np.linalg.norm(np.cross(directions[:-1], directions[1:]), axis=1)
    turns = np.arctan2(sines, np.einsum("md,md->m", directions[:-1], directions[1:]))
    middles = np.cumsum(lengths) - 0.5 * lengths
    # The total turn grows with arc length, whichever way the path turns, so an S is not taken for a straight.
    total = np.concatenate(([0.0], np.cumsum(turns)))
    spread = np.interp(middles + reach, middles, total) - np.interp(middles - reach, middles, total)
    return np.asarray(spread <= _STRAIGHT_TURN)


def metrics(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    joints: JointStates,
    simulated: SimulatedMotion,
    checks: tuple[Check, ...],
    *,
    following: bool = True,
) -> Mapping[str, float]:
    """Return the figures of merit of a plan, by names that end in their unit; ``following`` as in motion_figures."""
    figures = dict(motion_figures(problem, trajectory, joints, checks, following=following))
    figures["keyframes"] = float(len(path.keyframes))
    figures["tracking_error_rad"] = simulated.tracking_error
    return figures


def motion_figures(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    checks: tuple[Check, ...],
    *,
    following: bool = True,
) -> Mapping[str, float]:
    """Return the figures of merit that can be recomputed from a plan's arrays, by names that end in their unit.

    Args:
        problem: the problem.
        trajectory: the motion.
        joints: states of all revolute joints over the motion.
        checks: verifier's checks, which hold the minimum clearances.
        following: whether figures of how closely the arm follows the path of its tip are included.
    """
    bends = trajectory.bend_angles
    if problem.dimension == 3:
        turns = total_bends(problem.arm.bend_pairs(trajectory.positions))
        ends = _in_space(problem, trajectory)
    else:
        turns = np.abs(bends)
        ends = _in_the_plane(problem, trajectory)
    torques = drive_torques(problem.arm, joints.torques)
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(torques), initial=0.0)),
        "joint_path_length_rad": path_length(bends),
        # The bend at the base turns the whole arm and curves nothing, so it does not count.
        "largest_curvature_per_m": float(np.max(turns[:, 1:] / _around_joints(problem.arm), initial=0.0)),
        # The error at the goal is that of the recorded motion, not of the planned path.
        **ends,
        **(_leader_figures(problem, trajectory) if following else {}),
    }
    # Of the checks in metres, only clearances are figures of merit; the others just hold or fail.
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def _in_the_plane(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """Return a planar motion's goal errors, and the deviation of the arm due to a controller's linear interpolation."""
    arm = problem.arm
    figures = {"interpolation_deviation_m": interpolation_deviation(arm_reaching_bodies(arm), trajectory)}
    if problem.goal.whole(arm) is None and problem.goal.look_at is None:
        tip = points_with_tool(arm, trajectory.positions[-1])[-1]
        figures["tip_error_m"] = float(np.hypot(*(tip - problem.goal.tip(arm))))
        if problem.goal.heading is not None:
            x, y = arm.ahead_in_last_link
            turn = wrap(arm.headings(trajectory.bend_angles[-1])[-1] + np.arctan2(y, x) - problem.goal.heading)
            figures["heading_error_rad"] = abs(float(turn))
    return figures


def _in_space(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """Return the goal errors of a motion in space as figures of merit."""
    errors = goal_errors(problem, trajectory.positions[-1])
    ends = {"tip_error_m": errors.position, "direction_error_rad": errors.direction, "tip_roll_rad": errors.roll}
    ends["roll_error_rad"] = errors.roll_error
    return {name: error for name, error in ends.items() if error is not None}


def _leader_figures(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """Return figures of merit of how closely an arm follows its tip path, on a feed axis or along given paths."""
    if problem.arm.feed is None and not all(stop.goal.path is not None for stop in problem.goals):
        return {}
    found = leader_deviation(problem.arm, trajectory.positions, trajectory.stops)
    if found is None:
        return {}
    return {
        "leader_deviation_mean_m": found.mean,
        "leader_deviation_worst_m": found.worst,
        "leader_deviation_straight_mean_m": found.straight_mean,
    }


def total_bends(pairs: FloatArray) -> FloatArray:
    """Return the angle between the links at each joint, shape (...) [rad], from two bend angles, shape (..., 2)."""
    cos = np.cos(pairs[..., 0]) * np.cos(pairs[..., 1])
    return np.asarray(np.arccos(np.clip(cos, -1.0, 1.0)))


def _around_joints(arm: Arm) -> FloatArray:
    """Return the mean length of the two links that meet at every joint but the first, shape (links - 1,) [m]."""
    return np.asarray(0.5 * (arm.lengths[1:] + arm.lengths[:-1]))
