"""How far the arm leaves the path of its leader: the tip as it was when it passed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.length_words import long_length
from ccm_opt.ground.polyline import arc_lengths, leg_headings
from ccm_opt.jointed.arm import Arm
from ccm_opt.planners.following.following_settings import DEFAULT_DEVIATION, DeviationSettings


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


def deviation(
    arm: Arm,
    positions: FloatArray,
    leaders: Sequence[FloatArray],
    settings: DeviationSettings = DEFAULT_DEVIATION,
) -> Deviation:
    """The deviation of a motion from its leader's paths.

    Args:
        arm: the arm.
        positions: configurations at samples of the motion, shape (T, c) [rad, m].
        leaders: finely sampled polylines, each of shape (m, 2) [m]; of several the nearest counts, since an arm that is
            drawn back along one before it follows the next lies on either.
        settings: how finely to look.
    """
    numbers = np.linspace(0, len(positions) - 1, min(settings.poses, len(positions)))
    poses = positions[np.unique(numbers.astype(int))]
    joints = arm.joint_positions_at(poses)
    feeds = arm.coordinates.advance(poses)

    # Places on the links, shape (poses, links, places, 2), of which those in the guide tube follow no leader.
    shares = (np.arange(settings.places_per_link) + 0.5) / settings.places_per_link
    places = joints[:, :-1, None] + shares[:, None] * (joints[:, 1:, None] - joints[:, :-1, None])
    pose, link, place = np.nonzero(_beyond_hole(arm, feeds, shares))
    if len(pose) == 0:
        return Deviation(0.0, 0.0, "the arm stays in its guide tube", 0.0, 0.0)

    points = np.asarray(shapely.points(places[pose, link, place]))
    distance, straight = _nearest_leader(points, leaders, arm.link_length, settings.straight_turn)
    worst = int(np.argmax(distance))
    on_straight = distance[straight] if straight.any() else np.zeros(1)
    return Deviation(
        mean=float(distance.mean()),
        worst=float(distance[worst]),
        where=f"link {link[worst] + 1} at a feed of {long_length(feeds[pose[worst]])}",
        straight_mean=float(on_straight.mean()),
        straight_worst=float(on_straight.max()),
    )


def _beyond_hole(arm: Arm, feeds: FloatArray, shares: FloatArray) -> BoolArray:
    """Which places on which links are beyond the hole, shape (T, links, places)."""
    along = feeds[:, None, None] + arm.link_length * np.add.outer(np.arange(arm.links), shares)
    beyond: BoolArray = along > arm.hole
    return beyond


def _nearest_leader(
    points: npt.NDArray[np.object_], leaders: Sequence[FloatArray], reach: float, straight_turn: float
) -> tuple[FloatArray, BoolArray]:
    """Distances of points from the nearest leader's path [m], and whether that path is straight there."""
    distances = []
    straights = []
    for leader in leaders:
        distance, straight = _distances(points, leader, reach, straight_turn)
        distances.append(distance)
        straights.append(straight)
    nearest = np.argmin(distances, axis=0)
    every = np.arange(len(points))
    return np.stack(distances)[nearest, every], np.stack(straights)[nearest, every]


def _distances(
    points: npt.NDArray[np.object_], leader: FloatArray, reach: float, straight_turn: float
) -> tuple[FloatArray, BoolArray]:
    """Distances of points from a leader's path [m], and whether the path is straight there."""
    legs = shapely.STRtree(np.asarray(shapely.linestrings(np.stack((leader[:-1], leader[1:]), axis=1))))
    (_, leg), distance = legs.query_nearest(points, return_distance=True, all_matches=False)
    return distance, _straight_legs(leader, reach, straight_turn)[leg]


def _straight_legs(leader: FloatArray, reach: float, straight_turn: float) -> BoolArray:
    """Whether the leader's path is straight around each of its legs, shape (m - 1,).

    Args:
        leader: shape (m, 2) [m].
        reach: how far to either side counts [m].
        straight_turn: total turn within reach up to which the path is straight [rad].
    """
    headings = leg_headings(leader)
    ends = arc_lengths(leader)
    middles = 0.5 * (ends[:-1] + ends[1:])

    # The total turn grows with arc length, whichever way the path turns, so an S is not taken for a straight.
    total_turn = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(headings)))))
    spread = np.interp(middles + reach, middles, total_turn) - np.interp(middles - reach, middles, total_turn)
    straight: BoolArray = spread <= straight_turn
    return straight
