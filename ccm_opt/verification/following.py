"""Check of how far an arm with a feed axis deviates from the path of its tip."""

from itertools import pairwise

import numpy as np
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
