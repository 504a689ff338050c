"""Check of how far a fed arm deviates from the path of its tip."""

from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import ChainMotion, carried, lengths_of

_PLACES = 8
"""Parts of a link at whose ends its distance from the path is measured. Taste."""
_SPACING = 0.05
"""Spacing of the places on the path that stand for it, as a share of the bound: the distance from the nearest of them
is at most a thousandth of the bound more than that from the path, where it is half the bound or more."""
_CHUNK = 200
"""Poses that are looked at together."""


def check_following(problem: Problem, motion: ChainMotion, trajectory: JointTrajectory) -> list[Check]:
    """Check how far the arm deviates from its tip's path at all samples; return no checks without a bound.

    The path to a goal consists of the arm's centre line beyond the hole when the motion to that goal begins, followed
    by the path of the tip.

    Args:
        problem: the problem that the motion is to solve.
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
    """Return the largest distance of the centre line beyond the hole from the path [m], its sample and its link."""
    points = motion.points[samples]
    along = carried(arm, motion.positions[samples])[:, None] + arm.link_length * np.arange(arm.links + 1) - arm.hole
    path = _path(arm, points, along, spacing)
    tree = cKDTree(path)
    share = np.arange(_PLACES + 1)[:, None] / _PLACES
    found = (0.0, 0, 0)
    for begin in range(0, len(points), _CHUNK):
        some = points[begin : begin + _CHUNK]
        places = some[:, :-1, None] + share * (some[:, 1:, None] - some[:, :-1, None])
        outside = along[begin : begin + _CHUNK, :-1, None] + arm.link_length * share[:, 0] > 0.0
        if not outside.any():
            continue
        distance = np.asarray(tree.query(places[outside])[0])
        k = int(np.argmax(distance))
        sample, link, _ = (int(index[k]) for index in np.nonzero(outside))
        found = max(found, (float(distance[k]), begin + sample, link))
    return found


def _path(arm: Arm, points: FloatArray, along: FloatArray, spacing: float) -> FloatArray:
    """Return points on the path of the tip with at most a given spacing, shape (m, d) [m].

    Args:
        arm: arm with a feed axis.
        points: joints and tip at the samples, shape (T, links + 1, d) [m].
        along: distances of these points from the hole along the arm, negative in the tube, shape (T, links + 1) [m].
        spacing: greatest distance between consecutive points [m].
    """
    hole = arm.base + arm.hole * arm.direction
    beyond = along[0] > 0.0
    leading = along[1:, -1] > 0.0
    corners = np.concatenate((hole[None], points[0][beyond], points[1:, -1][leading]))
    steps = lengths_of(np.diff(corners, axis=0))
    parts = np.maximum(np.ceil(steps / spacing), 1.0).astype(np.intp)
    # Every leg is cut into equal parts.
    leg = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = (part / parts[leg])[:, None]
    return np.concatenate((corners[leg] + share * (corners[leg + 1] - corners[leg]), corners[-1:]))
