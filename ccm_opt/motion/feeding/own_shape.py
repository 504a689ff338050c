"""The path along which an arm lies already, so that it can be drawn back as it would have come."""

from itertools import pairwise

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.feeding.leader import FINENESS, LeaderPath

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
    if first == arm.links:
        return _with_axis(arm, leaves, np.zeros((0, 2)), np.zeros(0))
    off = joints[first + 1 :]
    ahead = float((off[0] - arm.base) @ arm.feed_direction) - leaves
    if ahead < LEAST_STEP * l:
        return None
    start = arm.base + leaves * arm.feed_direction
    nodes = np.vstack((start, off))
    chords = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(nodes, axis=0).T))))
    curve = CubicSpline(chords, nodes, bc_type=((1, arm.feed_direction), (2, np.zeros(2))))
    return _with_axis(arm, leaves, *_sampled(curve, chords))


def _sampled(curve: CubicSpline, chords: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters and the curve's points, joints among the samples; the parameters are turned into arc lengths."""
    places = np.concatenate([a + (b - a) * np.arange(FINENESS) / FINENESS for a, b in pairwise(chords)] + [chords[-1:]])
    speed = np.hypot(*np.asarray(curve(places, 1)).T)
    arc = cumulative_simpson(speed, x=places, initial=0.0)
    return np.column_stack((curve(places), curve(places, 1))), np.asarray(arc)


def _with_axis(arm: Arm, leaves: float, samples: FloatArray, arc: FloatArray) -> LeaderPath:
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
            "own shape",
        )
    headings = arm.base_heading + np.unwrap(np.arctan2(samples[:, 3], samples[:, 2]) - arm.base_heading)
    headings -= 2.0 * np.pi * np.round((headings[0] - arm.base_heading) / (2.0 * np.pi))
    return LeaderPath(
        np.concatenate((before, leaves + arc)),
        np.concatenate((arm.base + before[:, None] * arm.feed_direction, samples[:, :2])),
        np.concatenate((np.full(len(before), arm.base_heading), headings)),
        leaves,
        "own shape",
    )
