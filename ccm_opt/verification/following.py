"""Checks of how far an arm with a feed axis is from the path of its tip, and the tip from a path given for it."""

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.chain_motion import ChainMotion, base_displacement

_PLACES = 8
"""Number of parts into which a link is divided to measure its distance from the tip path. Heuristic."""
_SPACING = 0.05
"""Spacing of the points that represent the tip path, as a fraction of the allowed deviation.

From half the allowed deviation on, the distance to the nearest point exceeds that to the path by at most a thousandth
of the allowed deviation.
"""
_PATH_PARTS = 8
"""Minimum number of samples of a given path per point of it. Heuristic."""
_MOST_PARTS = 20000
"""Number of samples of a given path above which they are not as close as its tolerance. Heuristic."""
_AHEAD = 3.0
"""Longest way on a given path that is searched for the tip's next place, as a multiple of the tip's step. Heuristic."""
_NEWTON_STEPS = 3
"""Number of steps of Newton's method onto a given path. Heuristic."""
_CHUNK = 200
"""Number of poses whose distances from the tip path are computed per batch."""


def check_following(problem: Problem, motion: ChainMotion, trajectory: JointTrajectory) -> list[Check]:
    """Check how far the arm deviates from its tip path at all samples; return [] if the problem sets no bound.

    The reference path to a goal is the arm's centre line outside the guide tube when the motion to that goal begins,
    followed by the path of the tip.

    Args:
        problem: the problem, with the allowed deviation ``planner.follow_within``.
        motion: the motion.
        trajectory: the same motion, with the samples at which the arm rests at intermediate goals.
    """
    within = problem.planner.follow_within
    if within is None or not problem.arm.base_axes:
        return []
    worst, where = 0.0, "t = 0.0000 s"
    for first, last in pairwise((0, *trajectory.stops, len(motion.time) - 1)):
        away, sample, link = _farthest(problem.arm, motion, slice(first, last + 1), _SPACING * within)
        if away >= worst:
            worst, where = away, f"link {link + 1} at t = {motion.time[first + sample]:.4f} s"
    return [Check("following the tip", worst, within, "m", where, passed=worst <= within)]


def check_given_paths(problem: Problem, motion: ChainMotion, trajectory: JointTrajectory) -> list[Check]:
    """Check that the tip follows the paths that goals give, from their beginning and never backwards, at all times.

    The bound is ``position_tolerance`` of the goal.

    Args:
        problem: the problem.
        motion: the motion.
        trajectory: the same motion, with the samples at which the arm rests at intermediate goals.
    """
    checks = []
    ends = pairwise((0, *trajectory.stops, len(motion.time) - 1))
    for number, (stop, (first, last)) in enumerate(zip(problem.goals, ends, strict=True), start=1):
        path = stop.goal.path
        if path is None:
            continue
        name = f"stop {number} path" if number < len(problem.goals) else "goal path"
        within = stop.tolerances.position
        bends = motion.second_derivatives[first:last, -1]
        away = _off_path(motion.points[first : last + 1, -1], bends, path, within)
        k = int(np.argmax(away))
        where = f"tip at t = {motion.time[first + k]:.4f} s"
        checks.append(Check(name, float(away[k]), within, "m", where, passed=bool(away[k] <= within)))
    return checks


def _off_path(tips: FloatArray, bends: FloatArray, points: FloatArray, within: float) -> FloatArray:
    """Return bounds on the distance of the tip from a path over every step, shape (T − 1,) [m].

    The path is the natural cubic spline C(τ) through the points over their chord lengths. Over a step the tip leaves
    its chord by at most an eighth of the bound on its second derivative. With parameters τ for both ends of the step, C
    leaves its own chord by at most max |C''| Δτ² / 8. So the greater of the two distances from C(τ) and these two add
    up to a bound for any τ. They are chosen nearest, never decrease, and begin and end with the path.

    Args:
        tips: positions of the tip at T samples, shape (T, 3) [m].
        bends: bounds on the tip's second derivative by the fraction of each step, shape (T − 1,) [m].
        points: points of the path, shape (m, 3) [m].
        within: allowed distance [m].
    """
    chords = lengths_of(np.diff(points, axis=0))
    curve = CubicSpline(np.concatenate(([0.0], np.cumsum(chords))), points, bc_type="natural")
    end = float(curve.x[-1])
    count = int(np.ceil(_PATH_PARTS * len(points) + end / max(within, end / _MOST_PARTS)))
    samples = np.asarray(curve(np.linspace(0.0, end, count + 1)))
    steps = lengths_of(np.diff(tips, axis=0, prepend=tips[:1]))
    ahead = np.ceil((_AHEAD * steps + within) * count / end).astype(np.intp) + 2
    nearest = np.zeros(len(tips), dtype=np.intp)
    here = 0
    for k, tip in enumerate(tips):
        here += int(np.argmin(lengths_of(samples[here : here + ahead[k]] - tip)))
        nearest[k] = here
    at = nearest * (end / count)
    for _ in range(_NEWTON_STEPS):
        slope = np.asarray(curve(at, 1))
        at = at + np.sum(slope * (tips - curve(at)), axis=1) / np.sum(slope**2, axis=1)
        at = np.clip(at, (nearest - 1) * (end / count), (nearest + 1) * (end / count))
    at = np.maximum.accumulate(np.clip(at, 0.0, end))
    at[0], at[-1] = 0.0, end
    away = lengths_of(tips - np.asarray(curve(at)))
    bulge = float(np.max(lengths_of(np.asarray(curve(curve.x, 2))))) * np.diff(at) ** 2 / 8.0
    return np.asarray(np.maximum(away[:-1], away[1:]) + bends / 8.0 + bulge)


def _farthest(arm: Arm, motion: ChainMotion, samples: slice, spacing: float) -> tuple[float, int, int]:
    """Return the largest distance of any point of the arm outside the tube from the reference path [m].

    The distance comes with the index of the sample, counted within `samples`, and of the link where it occurs. All
    three are 0 if the whole arm stays in the tube.
    """
    points = motion.points[samples]
    along = base_displacement(arm, motion.positions[samples])[:, None] + arm.joint_places - arm.hole
    path = _path(arm, points, along, spacing)
    tree = cKDTree(path)
    share = np.arange(_PLACES + 1)[:, None] / _PLACES
    found = (0.0, 0, 0)
    for begin in range(0, len(points), _CHUNK):
        some = points[begin : begin + _CHUNK]
        places = some[:, :-1, None] + share * (some[:, 1:, None] - some[:, :-1, None])
        outside = along[begin : begin + _CHUNK, :-1, None] + arm.lengths[:, None] * share[:, 0] > 0.0
        if not outside.any():
            continue
        distance = np.asarray(tree.query(places[outside])[0])
        k = int(np.argmax(distance))
        sample, link, _ = (int(index[k]) for index in np.nonzero(outside))
        found = max(found, (float(distance[k]), begin + sample, link))
    return found


def _path(arm: Arm, points: FloatArray, along: FloatArray, spacing: float) -> FloatArray:
    """Return points on the reference path of the tip, at most a given distance apart, shape (m, d) [m].

    Args:
        arm: arm with a feed axis.
        points: joints and tip at the T samples, shape (T, links + 1, d) [m].
        along: distances of these points from the tube's end along the arm, negative in the tube, shape (T, links + 1)
            [m].
        spacing: largest distance between consecutive points [m].
    """
    hole = arm.base + arm.hole * arm.direction
    beyond = along[0] > 0.0
    leading = along[1:, -1] > 0.0
    corners = np.concatenate((hole[None], points[0][beyond], points[1:, -1][leading]))
    steps = lengths_of(np.diff(corners, axis=0))
    parts = np.maximum(np.ceil(steps / spacing), 1.0).astype(np.intp)
    # Every segment of the path is divided into equal parts.
    leg = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = (part / parts[leg])[:, None]
    return np.concatenate((corners[leg] + share * (corners[leg + 1] - corners[leg]), corners[-1:]))
