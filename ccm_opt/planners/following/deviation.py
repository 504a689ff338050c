"""How far the arm leaves the path of its leader: the tip as it was when it passed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.arrays import BoolArray, FloatArray
from ccm_opt.jointed.arm import Arm

POINTS_A_LINK = 8
"""Places on every link whose distance from the path is taken."""
POSES = 400
"""Poses of a motion that are looked at, at most; the first and the last are among them."""
STRAIGHT_TURN = float(np.deg2rad(0.5))
"""A place of the path is straight when the path turns by no more than this within a link length to either side."""


@dataclass(frozen=True)
class Deviation:
    """Distances of the arm's centre line beyond the hole from the leader's path.

    Attributes:
        mean: over all places and poses [m].
        worst: [m].
        where: the worst place, in words.
        straight_mean: mean over the places where the path is straight [m]; 0 when there are none.
        straight_worst: worst of them [m].
    """

    mean: float
    worst: float
    where: str
    straight_mean: float
    straight_worst: float


def deviation(arm: Arm, bends: FloatArray, feeds: FloatArray, leaders: Sequence[FloatArray]) -> Deviation:
    """The deviation of a motion from its leader's paths.

    Args:
        arm: with a feed axis.
        bends: at samples of the motion, shape (T, links) [rad].
        feeds: shape (T,) [m].
        leaders: finely sampled polylines, each of shape (m, 2) [m]; of several the nearest counts, since an arm that is
            drawn back along one before it follows the next lies on either.
    """
    chosen = np.unique(np.linspace(0, len(feeds) - 1, min(POSES, len(feeds))).astype(int))
    joints = arm.joint_positions(arm.headings(bends[chosen]), feeds[chosen])
    shares = (np.arange(POINTS_A_LINK) + 0.5) / POINTS_A_LINK
    places = joints[:, :-1, None] + shares[:, None] * (joints[:, 1:, None] - joints[:, :-1, None])
    pose, link, share = np.nonzero(_beyond_hole(arm, feeds[chosen], shares))
    if len(pose) == 0:
        return Deviation(0.0, 0.0, "the arm stays in its guide", 0.0, 0.0)
    points = np.asarray(shapely.points(places[pose, link, share]))
    each = [_distances(points, leader, arm.link_length) for leader in leaders]
    nearest = np.argmin([distance for distance, _ in each], axis=0)
    every = np.arange(len(points))
    distance, straight = (np.stack(values)[nearest, every] for values in zip(*each, strict=True))
    k = int(np.argmax(distance))
    where = f"link {link[k] + 1} at a feed of {feeds[chosen][pose[k]]:.3f} m"
    inside = distance[straight] if straight.any() else np.zeros(1)
    return Deviation(float(distance.mean()), float(distance[k]), where, float(inside.mean()), float(inside.max()))


def _beyond_hole(arm: Arm, feeds: FloatArray, shares: FloatArray) -> BoolArray:
    """Which places on which links are beyond the hole, shape (T, links, places)."""
    hole = arm.feed.hole if arm.feed is not None else -np.inf
    beyond: BoolArray = feeds[:, None, None] + arm.link_length * np.add.outer(np.arange(arm.links), shares) > hole
    return beyond


def _distances(points: npt.NDArray[np.object_], leader: FloatArray, reach: float) -> tuple[FloatArray, BoolArray]:
    """Distances of points from a leader's path [m], and whether the path is straight there."""
    legs = shapely.STRtree(np.asarray(shapely.linestrings(np.stack((leader[:-1], leader[1:]), axis=1))))
    (_, leg), distance = legs.query_nearest(points, return_distance=True, all_matches=False)
    return distance, _straight_legs(leader, reach)[leg]


def _straight_legs(leader: FloatArray, reach: float) -> BoolArray:
    """Whether the leader's path is straight around each of its legs, shape (m - 1,)."""
    steps = np.diff(leader, axis=0)
    turned = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    ends = np.concatenate(([0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))
    middles = 0.5 * (ends[:-1] + ends[1:])
    total = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(turned)))))
    spread = np.interp(middles + reach, middles, total) - np.interp(middles - reach, middles, total)
    straight: BoolArray = spread <= STRAIGHT_TURN
    return straight
