"""Checks of how far an arm with a feed axis is from the path of its tip, and the tip from a path given for it."""

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.robot.arc_sections import arc_deviation
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.chain_motion import ChainMotion, base_displacement
from ccm_opt.verification.selfcollision import link_word

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
_WINDOW = 128
"""Number of vertices of the tip path that may lie between those near to a part of a link over a step. Heuristic."""
_LEAST_SPACING = 0.5
"""Least way of the tip between two vertices of its path, as a fraction of the spacing of the vertices. Heuristic."""
_CHUNK = 200
"""Number of poses whose distances from the tip path are computed per batch."""


def check_following(problem: Problem, motion: ChainMotion, trajectory: JointTrajectory) -> list[Check]:
    """Check how far the arm deviates from its tip path at all times; return [] if the problem sets no bound.

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
        away, sample, link = _farthest(motion, slice(first, last + 1), _SPACING * within)
        if away >= worst:
            worst, where = away, f"{link_word(motion.arm, link)} at t = {motion.time[first + sample]:.4f} s"
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


def _farthest(motion: ChainMotion, samples: slice, spacing: float) -> tuple[float, int, int]:
    """Return a bound on the distance of the arm outside the tube from the reference path, at all times [m].

    The bound comes with the index of the sample, counted within `samples`, and of the link where it occurs. All three
    are 0 if the whole arm stays in the tube.

    Every link is cut into parts. Over a step, a part leaves the bilinear interpolation of its ends at both samples by
    at most an eighth of the bound on their second derivatives. So it is no farther from one of these four places than
    half of its length and half of their way, and no farther from the path than the farthest of them and this. Nor is
    the interpolation farther from the same one of four vertices of the path than these are from the places. Let the
    path between the vertices be within β of a line. It passes every chord between two of its points there within 2 β,
    so the interpolation of the vertices, a chord of chords, is within 4 β of the path.
    """
    arm = motion.arm
    points = motion.points[samples]
    along = _out_of_tube(arm, motion.positions[samples])
    bows = motion.second_derivatives[samples.start : samples.stop - 1] / 8.0
    path = _path(arm, points, along, spacing)
    tree = cKDTree(path)
    share = np.arange(_PLACES + 1)[:, None] / _PLACES
    found = (0.0, 0, 0)
    for begin in range(0, len(points) - 1, _CHUNK):
        some = points[begin : begin + _CHUNK + 1]
        places = some[:, :-1, None] + share * (some[:, 1:, None] - some[:, :-1, None])
        outside = along[begin : begin + _CHUNK + 1, :-1, None] + arm.lengths[:, None] * share[:, 0] > 0.0
        if not outside.any():
            continue
        # What is inside the tube is on its axis, at whose end the path begins.
        away, vertex = np.zeros(outside.shape), np.zeros(outside.shape, dtype=np.intp)
        away[outside], vertex[outside] = tree.query(places[outside])
        places[~outside] = path[0]
        corners, vertices = _corners(places), _corners(vertex)
        bow = np.maximum(bows[begin : begin + _CHUNK, :-1], bows[begin : begin + _CHUNK, 1:])[..., None]
        least = np.max(_corners(away), axis=0) + bow
        sides = (corners[0] - corners[1], corners[2] - corners[3], corners[0] - corners[2], corners[1] - corners[3])
        part, part_after, way, way_beyond = (lengths_of(side) for side in sides)
        bound = least + 0.5 * (np.maximum(part, part_after) + np.maximum(way, way_beyond))
        floor = max(found[0], float(np.max(least)))
        near = bound > floor
        bound[near] = np.minimum(
            bound[near],
            np.broadcast_to(bow, bound.shape)[near] + _beside_path(path, corners[:, near], vertices[:, near]),
        )
        bound[~np.any(_corners(outside), axis=0)] = 0.0
        k = int(np.argmax(bound))
        sample, link, _ = (int(index) for index in np.unravel_index(k, bound.shape))
        found = max(found, (float(bound.ravel()[k]), begin + sample, link))
    if arm.sections is None:
        return found
    # The links are tangents of the true arcs.
    beside = float(np.max(arc_deviation(2.0 * arm.sections.arcs, arm.sections.turn_limits)))
    return found[0] + beside, *found[1:]


def _beside_path(path: FloatArray, corners: FloatArray, vertices: IntArray) -> FloatArray:
    """Return bounds on the distance from a path of the bilinear interpolations of four places each, shape (k,) [m].

    Where the path passes more than once, the vertices nearest to the first place count for all four.

    Args:
        path: vertices, shape (m, d) [m].
        corners: the places, shape (4, k, d) [m].
        vertices: index of a vertex near each place, shape (4, k).
    """
    low, high = np.min(vertices, axis=0), np.max(vertices, axis=0)
    again = np.flatnonzero(high - low > _WINDOW)
    vertices = vertices.copy()
    window = np.clip(vertices[0, again, None] + np.arange(-_WINDOW // 2, _WINDOW // 2 + 1), 0, len(path) - 1)
    for corner in range(1, 4):
        off = lengths_of(path[window] - corners[corner, again, None])
        vertices[corner, again] = window[np.arange(len(again)), np.argmin(off, axis=1)]
    low, high = np.min(vertices, axis=0), np.max(vertices, axis=0)
    return np.asarray(np.max(lengths_of(corners - path[vertices]), axis=0) + 4.0 * _bulges(path, low, high))


def _out_of_tube(arm: Arm, positions: FloatArray) -> FloatArray:
    """Return the distances of joints and tip from the tube's end along the arm, (T, links + 1) [m]; ∞ without a tube.

    Distances are negative in the tube.

    Args:
        arm: arm whose base moves.
        positions: configurations at T samples, shape (T, c) [rad, m].
    """
    if arm.feed is None:
        return np.full((len(positions), arm.links + 1), np.inf)
    return np.asarray(base_displacement(arm, positions)[:, None] + arm.joint_places - arm.hole)


def _corners(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the values at the ends of the parts of links at both ends of the steps, shape (4, T − 1, links, parts).

    Args:
        values: values at the ends of all parts of links at all samples, shape (T, links, parts + 1).
    """
    return np.stack((values[:-1, :, :-1], values[:-1, :, 1:], values[1:, :, :-1], values[1:, :, 1:]))


def _bulges(path: FloatArray, low: IntArray, high: IntArray) -> FloatArray:
    """Return the largest distance of a polyline from the lines through two of its vertices, between them, (k,) [m].

    Args:
        path: vertices, shape (m, d) [m].
        low: index of the first of two vertices, shape (k,).
        high: index of the second, shape (k,).
    """
    start = path[low]
    chord = path[high] - start
    square = np.sum(chord**2, axis=1)
    along = chord / np.where(square > 0.0, np.sqrt(square), 1.0)[:, None]
    worst = np.zeros(len(low))
    for step in range(1, int(np.max(high - low, initial=0))):
        inner = np.flatnonzero(low + step < high)
        off = path[low[inner] + step] - start[inner]
        off -= np.sum(off * along[inner], axis=1)[:, None] * along[inner]
        worst[inner] = np.maximum(worst[inner], lengths_of(off))
    return worst


def _path(arm: Arm, points: FloatArray, along: FloatArray, spacing: float) -> FloatArray:
    """Return points on the reference path of the tip, at most a given distance apart, shape (m, d) [m].

    Args:
        arm: arm with a feed axis.
        points: joints and tip at the T samples, shape (T, links + 1, d) [m].
        along: distances of these points from the tube's end along the arm, negative in the tube, shape (T, links + 1)
            [m].
        spacing: largest distance between consecutive points [m].
    """
    hole = np.zeros((0, arm.dimension)) if arm.feed is None else (arm.base + arm.hole * arm.direction)[None]
    beyond = along[0] > 0.0
    leading = along[1:, -1] > 0.0
    corners = np.concatenate((hole, points[0][beyond], points[1:, -1][leading]))
    steps = lengths_of(np.diff(corners, axis=0))
    # Where the tip is slow, not every sample is a vertex.
    sections = np.floor(np.concatenate(([0.0], np.cumsum(steps))) / (_LEAST_SPACING * spacing))
    corners = corners[np.concatenate((np.diff(sections) > 0.0, [True]))]
    steps = lengths_of(np.diff(corners, axis=0))
    parts = np.maximum(np.ceil(steps / spacing), 1.0).astype(np.intp)
    # Every segment of the path is divided into equal parts.
    leg = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = (part / parts[leg])[:, None]
    return np.concatenate((corners[leg] + share * (corners[leg + 1] - corners[leg]), corners[-1:]))
