"""Motions in space along a path that the user gives: the tip stays on it, and the arm follows.

An arm on a feed axis is slid along the path, joint behind joint (``OwnPath``).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, ProblemError
from ccm_opt.core.length_words import file_length, short_length
from ccm_opt.planning.ends import describe_contact
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.leader_motion import OwnPath
from ccm_opt.planning.limits.following import FOLLOWING_SHARE, FollowingLimit
from ccm_opt.planning.path_on_limits import certified_samples
from ccm_opt.planning.slides import feeds_to_end
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm

_STRAIGHT = 1e-9
"""Bends up to which joints count as straight, and excess of limits that counts as rounding [rad, m]."""
_FINE = 400
"""Number of samples of the path per arm length. Heuristic: their chords deviate by less than a millionth of the length
from an arc of 90 degrees over the arm."""


@dataclass(frozen=True, eq=False)
class TipPath:
    """The path of a tip: the natural cubic spline through given points over their chord lengths.

    Attributes:
        points: the points, shape (m ≥ 2, 3) [m].
        spacing: maximum spacing of the samples by which arc lengths are measured [m].
    """

    points: FloatArray
    spacing: float

    @cached_property
    def _curve(self) -> CubicSpline:
        chords = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return CubicSpline(np.concatenate(([0.0], np.cumsum(chords))), self.points, bc_type="natural")

    @cached_property
    def _parameter(self) -> CubicSpline:
        """The spline's parameter over the arc length."""
        ends = self._curve.x
        count = max(4, int(np.ceil(ends[-1] / self.spacing)))
        places = np.union1d(ends, np.linspace(0.0, ends[-1], 4 * count + 1))
        # The trapezoidal rule for the speed, whose ends are corrected by the chords' own middle (Simpson).
        middle = 0.5 * (places[:-1] + places[1:])
        speed, between = (np.linalg.norm(self._curve(at, 1), axis=1) for at in (places, middle))
        arcs = np.diff(places) * (speed[:-1] + 4.0 * between + speed[1:]) / 6.0
        return CubicSpline(np.concatenate(([0.0], np.cumsum(arcs))), places)

    @property
    def length(self) -> float:
        """Arc length of the path [m]."""
        return float(self._parameter.x[-1])

    def at(self, arcs: FloatArray) -> FloatArray:
        """Return the points at arc lengths (k,) [m], shape (k, 3) [m]."""
        return np.asarray(self._curve(self._parameter(arcs)))

    def tangents(self, arcs: FloatArray) -> FloatArray:
        """Return the unit vectors along the path at arc lengths (k,) [m], shape (k, 3)."""
        slopes = self._curve(self._parameter(arcs), 1)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1, keepdims=True))

    @cached_property
    def samples(self) -> FloatArray:
        """Points along the path, at most ``spacing`` apart, shape (k, 3) [m]."""
        count = max(2, int(np.ceil(self.length / self.spacing)) + 1)
        return self.at(np.linspace(0.0, self.length, count))


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
        where = ", ".join(file_length(float(value), 6) for value in tip)
        raise ProblemError(
            f"goal.path begins {short_length(away)} from the tip at the start; begin it at [{where}], or move the start"
        )
    path = TipPath(np.vstack((tip, points[1:])), arm.length / _FINE)
    slide = _slide(task, path)
    spline = path_near_configurations(slide, task)
    if spline is None:
        _refuse_beyond_limits(arm, slide)
        raise MotionNotFound(_touching(task, slide))
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
    behind = limit.worst_deviation(q)
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
    keyframes = np.asarray(spline(np.linspace(0.0, 1.0, len(slide))))
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


def _slide(task: SpaceTask, path: TipPath) -> FloatArray:
    """Return keyframes (K, c) of an arm that slides along the path of its tip.

    Raises:
        ProblemError: the arm is bent at the start.
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
    slide = OwnPath(arm, pose, 0.0, way).slide(feed, np.inf)
    slide[0] = start
    return slide
