"""Follow-the-leader keyframes: the arm carried along a path, or along its own shape.

Keyframes are rows of bends [rad] and the feed [m], shape (K, links + 1).
"""

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.following.leader import LeaderPath

STEP, LEAST_STEP = 1.0 / 8.0, 1.0 / 300.0
"""Feed between two keyframes, in link lengths; but for arms of many links this share of the arm's length."""
_NO_BEND = 1e-10
"""Bends below this are rounding of straight chords [rad]."""


def slide(arm: Arm, path: LeaderPath, start: float, end: float) -> FloatArray:
    """Keyframes of the arm carried along a path from one feed to another, shape (K, links + 1)."""
    feeds = feeds_between(arm, start, end)
    joints = path.joints(feeds, arm.links, arm.link_length)
    bends = arm.bends(path.link_headings(joints))
    return np.column_stack((np.where(np.abs(bends) < _NO_BEND, 0.0, bends), feeds))


def pose_on(arm: Arm, path: LeaderPath, feed: float) -> FloatArray:
    """Bends of the arm on a path, shape (links,) [rad]."""
    return slide(arm, path, feed, feed)[0, :-1]


def feeds_between(arm: Arm, start: float, end: float) -> FloatArray:
    """Feeds from one to another, both held, at most a ``feed_step`` apart [m]."""
    if start == end:
        return np.array([start])
    return np.linspace(start, end, 1 + int(np.ceil(abs(end - start) / feed_step(arm) - 1e-9)))


def feed_step(arm: Arm) -> float:
    """Feed between two keyframes [m]."""
    return max(STEP * arm.link_length, LEAST_STEP * arm.length)


def joined(*pieces: FloatArray) -> FloatArray:
    """Keyframes of several pieces in a row, each beginning where the one before ends."""
    first, *others = [piece for piece in pieces if len(piece)]
    return np.concatenate((first, *(piece[1:] for piece in others)))
