"""Smooth paths from the feed axis through given points: the one along which an arm lies already, and others."""

from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.following.leader import FINENESS, LeaderPath

LEAST_STEP = 0.1
"""The first joint off the feed axis is at least this many link lengths ahead of where the path leaves the axis."""


def own_path(arm: Arm, bends: FloatArray, feed: float, straight: float) -> LeaderPath | None:
    """A smooth path through all joints of a pose; it follows the feed axis at least up to a given arc length.

    Beyond the axis it is a cubic spline through the joints, so that a joint that slides to its neighbour's place takes
    over its bend gradually, and the arm lies on the path exactly with chords of its links.

    Args:
        arm: with a feed axis.
        bends: of the pose, shape (links,) [rad].
        feed: of the pose [m].
        straight: arc length that the path follows the axis at least [m].

    Returns:
        The path, or None when a joint bends so near to the hole that no such path exists.
    """
    l, joints = arm.link_length, arm.joint_positions(arm.headings(bends), feed)
    bent = np.flatnonzero(bends)
    first = int(bent[0]) if len(bent) else arm.links
    leaves = max(straight, feed + first * l)
    off = joints[first + 1 :]
    if len(off) and float((off[0] - arm.base) @ arm.feed_direction) - leaves < LEAST_STEP * l:
        return None
    return path_through(arm, leaves, off, "own shape")


def path_through(
    arm: Arm, leaves: float, points: FloatArray, name: str, end_heading: float | None = None
) -> LeaderPath:
    """The path that follows the feed axis up to an arc length and then, a cubic spline, goes through points.

    Args:
        arm: with a feed axis.
        leaves: arc length at which the path leaves the axis [m].
        points: in order, shape (k, 2) [m]; with none the path is a piece of the axis.
        name: of the path.
        end_heading: heading at the last point [rad], or None when any will do.
    """
    if len(points) == 0:
        return _with_axis(arm, leaves, np.zeros((0, 4)), np.zeros(0), name)
    nodes = np.vstack((arm.base + leaves * arm.feed_direction, points))
    chords = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(nodes, axis=0).T))))
    order: Literal[1, 2] = 2 if end_heading is None else 1
    end = np.zeros(2) if end_heading is None else np.array([np.cos(end_heading), np.sin(end_heading)])
    curve = CubicSpline(chords, nodes, bc_type=((1, arm.feed_direction), (order, end)))
    return _with_axis(arm, leaves, *_sampled(curve, chords), name)


def _sampled(curve: CubicSpline, chords: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters and the curve's points, joints among the samples; the parameters are turned into arc lengths."""
    places = np.concatenate([a + (b - a) * np.arange(FINENESS) / FINENESS for a, b in pairwise(chords)] + [chords[-1:]])
    speed = np.hypot(*np.asarray(curve(places, 1)).T)
    arc = cumulative_simpson(speed, x=places, initial=0.0)
    return np.column_stack((curve(places), curve(places, 1))), np.asarray(arc)


def _with_axis(arm: Arm, leaves: float, samples: FloatArray, arc: FloatArray, name: str) -> LeaderPath:
    """The feed axis up to an arc length, then a sampled curve of points and tangents, shape (m, 4)."""
    low = arm.feed.low if arm.feed is not None else 0.0
    before = np.arange(min(low, leaves) - arm.link_length, leaves, arm.link_length)
    before = before[before < leaves - 1e-6 * arm.link_length]
    if len(arc) == 0:
        before = np.append(before, leaves)
        return LeaderPath(
            before,
            arm.base + before[:, None] * arm.feed_direction,
            np.full(len(before), arm.base_heading),
            leaves,
            name,
        )
    headings = arm.base_heading + np.unwrap(np.arctan2(samples[:, 3], samples[:, 2]) - arm.base_heading)
    headings -= 2.0 * np.pi * np.round((headings[0] - arm.base_heading) / (2.0 * np.pi))
    return LeaderPath(
        np.concatenate((before, leaves + arc)),
        np.concatenate((arm.base + before[:, None] * arm.feed_direction, samples[:, :2])),
        np.concatenate((np.full(len(before), arm.base_heading), headings)),
        leaves,
        name,
    )
