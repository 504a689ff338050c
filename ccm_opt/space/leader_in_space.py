"""How far an arm that is fed in space leaves the path of its leader: the tip as it was when it passed."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.planners.following.following_settings import DEFAULT_DEVIATION, DeviationSettings
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.scene.surfaces import SurfaceSoup


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
    arm: SpaceArm, positions: FloatArray, settings: DeviationSettings = DEFAULT_DEVIATION
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
    joints = joint_positions(arm, poses)
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
    straight = near.gap[_straight_legs(path, arm.link_length, settings.straight_turn)[near.owner]]
    mean_on_straight = float(np.mean(straight)) if len(straight) else 0.0
    return LeaderDeviation(float(np.mean(near.gap)), float(np.max(near.gap)), mean_on_straight)


def leaders_path(arm: SpaceArm, poses: FloatArray, joints: FloatArray) -> FloatArray:
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


def _straight_legs(path: FloatArray, reach: float, straight_turn: float) -> BoolArray:
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
