"""How far an arm strays from its leader."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import arc_lengths, leg_headings
from ccm_opt.planning.settings import DEFAULT_DEVIATION, DeviationSettings
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import SurfaceSoup

_STRAIGHT_TURN = 0.008726646259971648
"""A place of the path is straight when the path turns by no more than this within a link length to either side [rad].
Taste: half a degree."""


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
    distance, straight = _nearest_leader(points, leaders, arm.link_length, _STRAIGHT_TURN)
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


@dataclass(frozen=True)
class LeaderDeviation:
    """Distances of the arm's centre line beyond the hole from its leader's path.

    Attributes:
        mean: over all places and poses [m].
        worst: [m].
        straight_mean: mean over the places where the path is straight [m]; 0 when there are none.
    """

    mean: float
    worst: float
    straight_mean: float


def leader_deviation(
    arm: Arm, positions: FloatArray, settings: DeviationSettings = DEFAULT_DEVIATION
) -> LeaderDeviation | None:
    """The deviation of a motion from the path of the tip; None where the base is not fed or nothing leaves the tube.

    Args:
        arm: the arm.
        positions: configurations at samples of the motion, shape (T, c) [rad, m].
        settings: how finely to look.
    """
    if not arm.base_axes:
        return None
    numbers = np.linspace(0, len(positions) - 1, min(settings.poses, len(positions)))
    poses = positions[np.unique(numbers.astype(int))]
    joints = arm.joint_positions_at(poses)
    shares = (np.arange(settings.places_per_link) + 0.5) / settings.places_per_link
    places = joints[:, :-1, None] + shares[:, None] * (joints[:, 1:, None] - joints[:, :-1, None])
    along = np.add.outer(np.arange(arm.links), shares) * arm.link_length
    beyond = arm.coordinates.advance(poses)[:, None, None] + along > arm.hole
    points = places[beyond]
    path = leaders_path(arm, poses, joints)
    if len(points) == 0 or len(path) < 2:
        return None

    # A leg of the path is a triangle without area.
    legs = np.stack((path[:-1], path[1:], path[1:]), axis=1)
    owner = np.arange(len(legs), dtype=np.intp)
    tree = SurfaceTree.of(SurfaceSoup(legs, np.zeros(len(legs)), owner, ("",) * len(legs)))
    near = tree.nearest(np.stack((points, points), axis=1), 2.0 * arm.length)
    straight = near.gap[_leader_in_space_straight_legs(path, arm.link_length, _STRAIGHT_TURN)[near.owner]]
    mean_on_straight = float(np.mean(straight)) if len(straight) else 0.0
    return LeaderDeviation(float(np.mean(near.gap)), float(np.max(near.gap)), mean_on_straight)


def leaders_path(arm: Arm, poses: FloatArray, joints: FloatArray) -> FloatArray:
    """The path of the leader from the hole on: the arm as it lies at the start, then the way of its tip, (m, 3) [m].

    Args:
        arm: with a feed axis.
        poses: configurations in their order, shape (T, c) [rad, m].
        joints: joints and tip in the same, shape (T, links + 1, 3) [m].
    """
    hole = arm.base + arm.hole * arm.direction
    feeds = arm.coordinates.advance(poses)
    outside = feeds[0] + arm.link_length * np.arange(arm.links + 1) > arm.hole
    # A tip that is in the tube leads nothing.
    leading = feeds[1:] + arm.length > arm.hole
    path = np.concatenate((hole[None], joints[0][outside], joints[1:, -1][leading]))
    far = np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-3 * arm.link_length
    return path[np.concatenate(([True], far))]


def _leader_in_space_straight_legs(path: FloatArray, reach: float, straight_turn: float) -> BoolArray:
    """Whether a path, shape (m, 3), turns by little within a reach to either side of each of its legs, (m − 1,).

    Args:
        path: the corners.
        reach: how far to either side counts [m].
        straight_turn: total turn within reach up to which it is straight [rad].
    """
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    directions = legs / lengths[:, None]
    sines = np.linalg.norm(np.cross(directions[:-1], directions[1:]), axis=1)
    turns = np.arctan2(sines, np.einsum("md,md->m", directions[:-1], directions[1:]))
    middles = np.cumsum(lengths) - 0.5 * lengths
    total = np.concatenate(([0.0], np.cumsum(turns)))
    spread = np.interp(middles + reach, middles, total) - np.interp(middles - reach, middles, total)
    return np.asarray(spread <= straight_turn)
