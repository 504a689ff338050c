"""Withdrawals of fed arms in space: back along their own shape into the guide tube, and out again."""

from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.guides import ArmTrack, TrackLed
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import SpaceStepper

_TURNING_FEEDS = 24
"""Number of feeds at which the arm may go over from its way back to its way onward. Taste."""


def withdrawn(stepper: SpaceStepper, start: FloatArray, deadline: Deadline) -> list[Pose]:
    """Return the poses from the given one back along the feed, as far as they are certified.

    The curve is fixed in space while the arm is drawn along it. Where bends that the curve cannot reproduce prevent
    this, the arm is led back step by step.

    Args:
        stepper: stepper of a fed arm.
        start: unknowns, shape (p,).
        deadline: time limit.
    """
    curve = stepper.space
    column = curve.feed_column
    end = start.copy()
    end[column] = curve.arm.base_range[0] / curve.scale[column]
    back = float(start[column] - end[column]) * float(curve.scale[column])
    # Steps as long as links, so that a failure in the last one keeps what is certified before it.
    count = max(1, int(back / curve.arm.link_length))
    stops = [start + (end - start) * k / count for k in range(count + 1)]
    poses = [stepper.pose(start)]
    for before, after in pairwise(stops):
        for v in stepper.space.pieces(before, after)[1:]:
            pose = stepper.pose(v)
            if not stepper.safe(poses[-1].q, pose.q):
                return [*poses[:-1], *_led_back(stepper, poses[-1], deadline)]
            poses.append(pose)
    return poses


def _led_back(stepper: SpaceStepper, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Return the poses from the given one back along the arm's own shape, as far as steps lead."""
    arm = stepper.space.arm
    left = float(pose.q[-1]) - arm.base_range[0]
    shape = ArmTrack.behind(pose.points, np.zeros((0, 3)))
    guide = TrackLed(stepper.space, shape, arm.length - left)
    try:
        return follow(stepper, guide, pose, deadline)
    except Stalled as stalled:
        return stalled.poses


def turned_over(
    stepper: SpaceStepper, back: FloatArray, onward: FloatArray, *, wholly: bool = False
) -> FloatArray | None:
    """Return a motion back into the guide tube, no farther than necessary, and out again; None without one.

    At a certain feed the arm goes straight over from its shape on the way back to its shape on the way onward.

    Args:
        stepper: stepper in whose unknowns both ways are.
        back: unknowns on the way back, shape (K, p).
        onward: unknowns on the way onward, from the feed where the way back ends, shape (M, p).
        wholly: whether the way back and the way onward are to be kept whole.

    Returns:
        Unknowns of the certified motion, shape (N, p).
    """
    if len(stepper.failing_edges(back)) or len(stepper.failing_edges(onward)):
        return None
    column = stepper.space.feed_column
    back = back[: int(np.argmin(back[:, column])) + 1]
    feeds = np.linspace(min(back[0, column], onward[-1, column]), back[-1, column], _TURNING_FEEDS)
    for feed in feeds[-1:] if wholly else feeds:
        # The way back up to where it comes down to this feed, and the way onward from where it leaves it for good.
        kept = _up_to_feed(back, feed, column)
        left = _up_to_feed(onward[::-1], feed, column)[::-1]
        if stepper.edge_is_safe(kept[-1], left[0]):
            return np.vstack((kept, left))
    return None


def _up_to_feed(unknowns: FloatArray, feed: float, column: int) -> FloatArray:
    """Return the part of a motion, shape (K, p), up to where its feed has come down to a value, shape (m, p)."""
    feeds = unknowns[:, column]
    m = int(np.argmax(feeds <= feed)) if np.any(feeds <= feed) else len(feeds) - 1
    if m == 0 or feeds[m] >= feed:
        return unknowns[: m + 1]
    share = (feeds[m - 1] - feed) / (feeds[m - 1] - feeds[m])
    return np.vstack((unknowns[:m], unknowns[m - 1] + share * (unknowns[m] - unknowns[m - 1])))
