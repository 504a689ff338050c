"""Motions in space along a path that the user gives: the tip stays on it, and the arm follows.

An arm on a feed axis is slid along the path, joint behind joint (``OwnPath``). Other arms are fitted to it
(``path_fit``).
"""

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, ProblemError
from ccm_opt.core.length_words import file_length, in_unit, message_unit, short_length
from ccm_opt.planning.ends import describe_contact
from ccm_opt.planning.followable_ways import feeds_to_end
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.leader_motion import OwnPath
from ccm_opt.planning.limits.following import FOLLOWING_SHARE, FollowingLimit
from ccm_opt.planning.path_fit import fitted_path
from ccm_opt.planning.path_on_limits import certified_samples
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.tip_path import SAMPLES, TipPath
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm

_STRAIGHT = 1e-9
"""Bends up to which joints count as straight, and excess of limits that counts as rounding [rad, m]."""
_POSES = 301
"""Number of poses between which the arm counts as linear where its distance from the path is measured. Heuristic: the
verifier proves the bound at all times."""
_KEYFRAMES = 61
"""Number of keyframes, which are taken from the path. Heuristic."""


def motion_along(task: SpaceTask, points: FloatArray, tolerance: float, within: float | None) -> JointPath:
    """Return a certified path through joint space on which the tip follows given points, from the start to their end.

    Args:
        task: task whose start has its tip at the first point.
        points: points of the tip's path, shape (m ≥ 2, 3) [m].
        tolerance: largest distance of the tip from its path [m].
        within: bound on the distance of the arm from the path, or from its shape at the start; None for no bound [m].

    Raises:
        ProblemError: the path does not begin at the tip, or the arm has a fixed base.
        MotionNotFound: the tip leaves the path, or the arm touches something, exceeds a limit or the bound.
    """
    arm, start = task.arm, task.start
    tip = arm.joint_positions_at(start)[-1]
    away = float(np.linalg.norm(points[0] - tip))
    if away > tolerance:
        where = ", ".join(f"{in_unit(round(float(value), 7), message_unit()) + 0.0:g}" for value in tip)
        raise ProblemError(
            f"goal.path begins {short_length(away)} from the tip at the start; begin it at [{where}], or move the start"
        )
    path = TipPath(np.vstack((tip, points[1:])), arm.length / SAMPLES)
    spline = fitted_path(arm, start, path) if arm.feed is None else _slid(task, path)
    q = np.asarray(spline(certified_samples(spline)))
    _refuse_beyond_limits(arm, q)
    if len(failing := task.certificate.failures(q)):
        raise MotionNotFound(_touching(task, q[failing]))
    off = _distance(arm.joint_positions_at(q)[:, -1], path.samples)
    if off > FOLLOWING_SHARE * tolerance:
        raise MotionNotFound(
            Diagnosis(
                f"along goal.path the tip leaves the path by {short_length(off)}, "
                f"{short_length(off - FOLLOWING_SHARE * tolerance)} too far for goal.position_tolerance",
                "motion",
                (
                    f"goal.position_tolerance of at least {file_length(1.01 * off / FOLLOWING_SHARE, 3)}",
                    "a path that bends less, and later after the end of the guide tube",
                    "shorter links",
                ),
                {"tip_deviation_m": off},
            )
        )
    limit = FollowingLimit(arm, np.inf if within is None else within)
    behind = limit.worst_deviation(np.asarray(spline(np.linspace(0.0, 1.0, _POSES))))
    if behind > FOLLOWING_SHARE * limit.within:
        raise MotionNotFound(
            Diagnosis(
                f"along goal.path the arm leaves the path by {short_length(behind)}, "
                f"{short_length(behind - FOLLOWING_SHARE * limit.within)} too far for planner.follow_within",
                "motion",
                (
                    f"planner.follow_within of at least {file_length(1.01 * behind / FOLLOWING_SHARE, 3)}",
                    "a path that bends less",
                ),
                {"leader_deviation_m": behind},
            )
        )
    keyframes = np.asarray(spline(np.linspace(0.0, 1.0, _KEYFRAMES)))
    return JointPath(spline, keyframes, (), "along goal.path")


def _refuse_beyond_limits(arm: Arm, q: FloatArray) -> None:
    """Raise an error if configurations (k, c) exceed the limits of bends or axes.

    Raises:
        MotionNotFound: a limit is exceeded; the message names the coordinate.
    """
    over = np.max(np.maximum(arm.lower_limits - q, q - arm.upper_limits), axis=0)
    worst = int(np.argmax(over))
    if over[worst] <= _STRAIGHT:
        return
    name, unit = arm.coordinates.names[worst], arm.coordinates.units[worst]
    if worst < arm.coordinates.joints:
        joint = worst // arm.bends_a_joint
        name = name.replace(f"joint {joint + 1}", arm.joint_name(joint))
    amount = short_length(float(over[worst])) if unit == "m" else f"{np.rad2deg(over[worst]):.2g}°"
    raise MotionNotFound(
        Diagnosis(
            f"along goal.path {name.replace('_', ' ')} exceeds its limit by {amount}",
            "motion",
            ("a path that bends less, or is shorter", "a wider limit"),
        )
    )


def _touching(task: SpaceTask, q: FloatArray) -> Diagnosis:
    """Return a diagnosis of a motion, given by configurations (k, c), that is not certified."""
    arm = task.arm
    points = arm.joint_positions_at(q)
    near = task.tree.nearest(np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3), 2.0 * arm.length)
    gaps = near.gap.reshape(len(q), arm.links) - arm.radii
    worst = q[int(np.argmin(np.min(gaps, axis=1)))]
    why = describe_contact(task, worst) or describe_contact(task, worst, task.spare)
    why = why or "its clearance is too small to be certified, or links touch"
    return Diagnosis(
        f"along goal.path the arm is in contact: {why}",
        "motion",
        ("lead the path farther away from there", "a thinner arm, or less workspace.clearance"),
    )


def _distance(points: FloatArray, path: FloatArray) -> float:
    """Return the largest distance of points (k, 3) from a polyline with close vertices (m, 3) [m]."""
    found = np.clip(cKDTree(path).query(points)[1], 1, len(path) - 2)
    legs = path[found + 1] - path[found - 1]
    share = np.clip(np.sum((points - path[found - 1]) * legs, axis=1) / np.sum(legs**2, axis=1), 0.0, 1.0)
    return float(np.max(np.linalg.norm(points - path[found - 1] - share[:, None] * legs, axis=1)))


def _slid(task: SpaceTask, path: TipPath) -> BSpline:
    """Return a certified path of configurations on which a fed arm slides along the path of its tip.

    Raises:
        ProblemError: the arm is bent at the start.
        MotionNotFound: the arm exceeds a limit, or touches something.
    """
    arm, start = task.arm, task.start
    if np.any(np.abs(start[: 2 * arm.links]) > _STRAIGHT):
        raise ProblemError('goal.path: an arm with a guide tube starts straight; give start.shape = "straight"')
    feed = float(start[-1])
    samples = path.samples
    inside = (samples - arm.base) @ arm.direction <= arm.hole
    way = np.vstack((samples[0], samples[~inside]))
    track = ArmTrack.behind(arm.joint_positions_at(start), way)
    last = feeds_to_end(arm, track, feed, arm.length)[-1]
    pose = arm.configuration(np.zeros(2 * arm.links), float(last))
    slide = OwnPath(arm, pose, 0.0, way).slide(feed)
    slide[0] = start
    spline = path_near_configurations(slide, task)
    if spline is None:
        _refuse_beyond_limits(arm, slide)
        raise MotionNotFound(_touching(task, slide))
    return spline
