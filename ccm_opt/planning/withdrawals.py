"""Retraction of fed arms in space along their own shape into the guide tube, and return to another path."""

from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.guides import ArmTrack, TrackLed
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import SpaceStepper

_TURNING_FEEDS = 24
"""Number of feeds at which a change from the retraction to the onward motion is tried. Heuristic."""


def withdrawal_poses(stepper: SpaceStepper, start: FloatArray, deadline: Deadline) -> list[Pose]:
    """Return the certified poses of a retraction of a fed arm into its guide tube, beginning with the start.

    The backbone curve is kept fixed in space while the feed decreases to its minimum. From the first motion that is not
    certified, the arm is instead retracted along its own shape by QP steps. Both may end short of the minimum feed.

    Args:
        stepper: solver of QP steps of a fed arm.
        start: unknowns at the start, shape (p,).
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
    """Return the poses of a retraction along the arm's own shape by QP steps, beginning with a given pose.

    The retraction ends at the minimum feed, or when no further step succeeds.
    """
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
    """Return a certified motion that joins a retraction into the guide tube and an onward motion, or None.

    The arm is retracted no farther than necessary: at each of several feeds, the greatest first, a linear motion is
    tried from the arm's shape at that feed in the retraction to its shape at the same feed in the onward motion.

    Args:
        stepper: solver of QP steps in the unknowns of both motions.
        back: unknowns at the keyframes of the retraction, shape (K, p).
        onward: unknowns at the keyframes of the onward motion, which begins at the feed at which the retraction ends,
            shape (M, p).
        wholly: whether the change may only happen at the end of the retraction, so that both motions are kept whole.

    Returns:
        Unknowns at the keyframes of the joined motion, shape (N, p); None if no change is certified.
    """
    if len(stepper.failing_edges(back)) or len(stepper.failing_edges(onward)):
        return None
    column = stepper.space.feed_column
    back = back[: int(np.argmin(back[:, column])) + 1]
    feeds = np.linspace(min(back[0, column], onward[-1, column]), back[-1, column], _TURNING_FEEDS)
    for feed in feeds[-1:] if wholly else feeds:
        # The retraction until it reaches this feed, and the onward motion after it has last had this feed.
        kept = _up_to_feed(back, feed, column)
        left = _up_to_feed(onward[::-1], feed, column)[::-1]
        if stepper.edge_is_safe(kept[-1], left[0]):
            return np.vstack((kept, left))
    return None


def _up_to_feed(unknowns: FloatArray, feed: float, column: int) -> FloatArray:
    """Return the keyframes of a motion until its feed first falls to a given value, shape (m, p).

    The last keyframe has exactly this feed and is interpolated linearly. The whole motion is returned if its feed stays
    above the value.

    Args:
        unknowns: unknowns at the keyframes, shape (K, p).
        feed: value of the feed, in the unit of the unknowns.
        column: index of the feed among the unknowns.
    """
    feeds = unknowns[:, column]
    m = int(np.argmax(feeds <= feed)) if np.any(feeds <= feed) else len(feeds) - 1
    if m == 0 or feeds[m] >= feed:
        return unknowns[: m + 1]
    share = (feeds[m - 1] - feed) / (feeds[m - 1] - feeds[m])
    return np.vstack((unknowns[:m], unknowns[m - 1] + share * (unknowns[m] - unknowns[m - 1])))
