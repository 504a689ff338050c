"""Follow-the-leader keyframes: the arm carried along a path, or along its own shape.

Keyframes are rows of bends [rad] and the feed [m], shape (K, links + 1).
"""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.following.following_settings import DEFAULT_FOLLOWING, FollowingSettings
from ccm_opt.planners.following.leader import LeaderPath

_NO_BEND = 1e-10
"""Bends below this are rounding of straight chords [rad]; the guide tube asks for exactly straight joints."""


def slide(
    arm: Arm, path: LeaderPath, start: float, end: float, settings: FollowingSettings = DEFAULT_FOLLOWING
) -> FloatArray:
    """Keyframes of the arm carried along a path from one feed to another, shape (K, links + 1)."""
    feeds = feeds_between(arm, start, end, settings)
    joints = path.joints(feeds, arm.links, arm.link_length)
    bends = arm.bends(path.link_headings(joints))
    # The guide tube takes exactly straight joints only.
    bends = np.where(np.abs(bends) < _NO_BEND, 0.0, bends)
    return np.column_stack((bends, feeds))


def pose_on(arm: Arm, path: LeaderPath, feed: float) -> FloatArray:
    """Bends of the arm on a path, shape (links,) [rad]."""
    return slide(arm, path, feed, feed)[0, :-1]


def feeds_between(arm: Arm, start: float, end: float, settings: FollowingSettings = DEFAULT_FOLLOWING) -> FloatArray:
    """Feeds from one to another, both held, at most a ``feed_step`` apart [m]."""
    if start == end:
        return np.array([start])
    # Whole steps stay whole when rounding puts the distance a little beyond them.
    steps = np.ceil(abs(end - start) / feed_step(arm, settings) - ROUNDING)
    return np.linspace(start, end, 1 + int(steps))


def feed_step(arm: Arm, settings: FollowingSettings = DEFAULT_FOLLOWING) -> float:
    """Feed between two keyframes [m]."""
    return max(settings.feed_step * arm.link_length, settings.least_feed_step * arm.length)


def joined_keyframes(*pieces: FloatArray) -> FloatArray:
    """Keyframes of several pieces in a row, each beginning where the one before ends."""
    first, *others = [piece for piece in pieces if len(piece)]
    beginnings_dropped = [piece[1:] for piece in others]
    return np.concatenate((first, *beginnings_dropped))
