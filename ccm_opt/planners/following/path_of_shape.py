"""Smooth paths from the feed axis through given points: the one along which an arm lies already, and others."""

from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from ccm_opt.ground.angles import unit_vector, vector_headings, whole_turns
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.ground.rounding import SHORTEST
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, FollowingSettings
from ccm_opt.planners.following.leader import LeaderPath


def path_of_pose(
    arm: Arm, bends: FloatArray, feed: float, straight: float, settings: FollowingSettings = DEFAULT_FOLLOWING
) -> LeaderPath | None:
    """A smooth path through all joints of a pose; it follows the feed axis at least up to a given arc length.

    Beyond the axis it is a cubic spline through the joints, so that a joint that slides to its neighbour's place takes
    over its bend gradually, and the arm lies on the path exactly with chords of its links.

    Args:
        arm: with a feed axis.
        bends: of the pose, shape (links,) [rad].
        feed: of the pose [m].
        straight: arc length that the path follows the axis at least [m].
        settings: of following.

    Returns:
        The path, or None when a joint bends so near to the hole that no such path exists.
    """
    l = arm.link_length
    joints = arm.joint_positions_at(arm.configuration(bends, feed))
    bent = np.flatnonzero(bends)
    first_bent = int(bent[0]) if len(bent) else arm.links
    # On the axis up to the first bent joint at least, for all before it lies there.
    leaves = max(straight, feed + first_bent * l)

    off_axis = joints[first_bent + 1 :]
    if len(off_axis):
        lead = float((off_axis[0] - arm.base) @ arm.feed_direction) - leaves
        if lead < settings.least_lead * l:
            return None
    return path_through(arm, leaves, off_axis, "own shape", settings=settings)


def path_through(
    arm: Arm,
    leaves: float,
    points: FloatArray,
    name: str,
    end_heading: float | None = None,
    settings: FollowingSettings = DEFAULT_FOLLOWING,
) -> LeaderPath:
    """The path that follows the feed axis up to an arc length and then, a cubic spline, goes through points.

    Args:
        arm: with a feed axis.
        leaves: arc length at which the path leaves the axis [m].
        points: in order, shape (k, 2) [m]; with none the path is a piece of the axis.
        name: of the path.
        end_heading: heading at the last point [rad], or None when any will do.
        settings: of following.
    """
    if len(points) == 0:
        return _axis_alone(arm, leaves, name, settings)
    nodes = np.vstack((arm.base + leaves * arm.feed_direction, points))
    chords = arc_lengths(nodes)

    # The first derivative is that of the axis; at the end it is the heading's, or else the second derivative is zero.
    order: Literal[1, 2]
    if end_heading is None:
        order = 2
        end = np.zeros(2)
    else:
        order = 1
        end = unit_vector(end_heading)
    curve = CubicSpline(chords, nodes, bc_type=((1, arm.feed_direction), (order, end)))

    parameters = _parameters(chords, settings.samples_per_link)
    tangents = np.asarray(curve(parameters, 1))
    speed = np.hypot(*tangents.T)
    arc = np.asarray(cumulative_simpson(speed, x=parameters, initial=0.0))
    return _with_axis(arm, leaves, arc, curve(parameters), tangents, name, settings)


def _parameters(chords: FloatArray, count: int) -> FloatArray:
    """Parameters of the curve at which it is sampled: so many to a chord, all joints among them."""
    inner = [a + (b - a) * np.arange(count) / count for a, b in pairwise(chords)]
    return np.concatenate([*inner, chords[-1:]])


def _axis_alone(arm: Arm, leaves: float, name: str, settings: FollowingSettings) -> LeaderPath:
    """The feed axis up to an arc length [m]."""
    arc = np.append(_on_axis(arm, leaves), leaves)
    points = arm.base + arc[:, None] * arm.feed_direction
    return LeaderPath(arc, points, np.full(len(arc), arm.base_heading), leaves, name, settings.chords)


def _with_axis(
    arm: Arm,
    leaves: float,
    arc: FloatArray,
    points: FloatArray,
    tangents: FloatArray,
    name: str,
    settings: FollowingSettings,
) -> LeaderPath:
    """The feed axis up to an arc length, then a sampled curve with arc lengths from there, points and tangents."""
    before = _on_axis(arm, leaves)
    headings = arm.base_heading + np.unwrap(vector_headings(tangents) - arm.base_heading)
    headings -= whole_turns(headings[0] - arm.base_heading)
    return LeaderPath(
        np.concatenate((before, leaves + arc)),
        np.concatenate((arm.base + before[:, None] * arm.feed_direction, points)),
        np.concatenate((np.full(len(before), arm.base_heading), headings)),
        leaves,
        name,
        settings.chords,
    )


def _on_axis(arm: Arm, leaves: float) -> FloatArray:
    """Arc lengths of samples of the feed axis before the path leaves it, a link length behind the base's range on."""
    low, _ = arm.base_range
    arc = np.arange(min(low, leaves) - arm.link_length, leaves, arm.link_length)
    # Two samples in one place would leave the interpolation no slope.
    return arc[arc < leaves - SHORTEST * arm.link_length]
