"""Deviation of a fed arm from the path of its leading tip, as numbers and as a limit on the motion.

The leader's path is the centre line of the arm at the start of the motion, from the end of the guide tube (the hole) on
if there is one, followed by the path of the tip. The deviation is the distance of the arm's centre line beyond the hole
from the leader's path.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.polyline import points_at, without_repeats
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.pose import CurveUnknowns
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup

_PLACES_PER_LINK = 8
"""Number of points per link whose distance from the leader's path is measured. Heuristic."""
_POSES = 600
"""Minimum number of poses at which a motion is evaluated. Heuristic."""
FOLLOWING_SHARE = 0.97
"""Fraction of the bound on the deviation that planning uses; the rest is a reserve for timing and for the motion
between poses. Heuristic."""


@dataclass(frozen=True)
class LeaderDistances:
    """Distances of k points on the centre line of a moving arm, outside the guide tube, from the leader's path.

    Attributes:
        distance: distance of each point from the leader's path, shape (k,) [m].
        pose: index of the pose to which each point belongs, shape (k,).
        leg: index of the leg of the leader's path nearest to each point, shape (k,).
        path: vertices of the leader's path, shape (m, 3) [m].
    """

    distance: FloatArray
    pose: IntArray
    leg: IntArray
    path: FloatArray


def distances_from_leader(arm: Arm, poses: FloatArray) -> LeaderDistances | None:
    """Return the distances of the arm's centre line from the leader's path over a motion.

    The result is None if no part of the arm leaves the guide tube.

    Args:
        arm: arm with a feed axis.
        poses: configurations along the motion, shape (T, c) [rad, m].
    """
    joints = arm.joint_positions_at(poses)
    # Points on the links, shape (poses, links, places, d); those in the guide tube follow no leader.
    shares = (np.arange(_PLACES_PER_LINK) + 0.5) / _PLACES_PER_LINK
    places = joints[:, :-1, None] + shares[:, None] * (joints[:, 1:, None] - joints[:, :-1, None])
    along = arm.joint_places[:-1, None] + np.multiply.outer(arm.lengths, shares)
    outside = _feeds(arm, poses)[:, None, None] + along > arm.hole
    points = arm.embedded(places[outside])
    path = arm.embedded(leaders_path(arm, poses, joints))
    if len(points) == 0 or len(path) < 2:
        return None
    # Each leg of the path is a triangle without area.
    legs = np.stack((path[:-1], path[1:], path[1:]), axis=1)
    owner = np.arange(len(legs), dtype=np.intp)
    tree = SurfaceTree.from_triangles(TriangleSoup(legs, np.zeros(len(legs)), owner, ("",) * len(legs)))
    near = tree.nearest(np.stack((points, points), axis=1), 2.0 * arm.length)
    return LeaderDistances(near.gap, np.nonzero(outside)[0], near.owner, path)


def leaders_path(arm: Arm, poses: FloatArray, joints: FloatArray) -> FloatArray:
    """Return the leader's path of a motion from the end of the guide tube on, as a polyline, shape (m, d) [m].

    The path consists of the centre line at the start, followed by the path of the tip.

    Args:
        arm: arm with a feed axis.
        poses: configurations along the motion, shape (T, c) [rad, m].
        joints: joints and tip at these configurations, shape (T, links + 1, d) [m].
    """
    hole = joints[0, 0] if arm.feed is None else arm.base + arm.hole * arm.direction
    feeds = _feeds(arm, poses)
    outside = feeds[0] + arm.joint_places > arm.hole
    # A tip inside the tube leads nothing.
    leading = feeds[1:] + arm.length > arm.hole
    path = np.concatenate((hole[None], joints[0][outside], joints[1:, -1][leading]))
    return without_repeats(path, 1e-3 * arm.link_length)


def _feeds(arm: Arm, poses: FloatArray) -> FloatArray:
    """Return the position of the base on its feed axis for configurations (T, c), shape (T,) [m]; 0 without one."""
    return np.zeros(len(poses)) if arm.feed is None else arm.coordinates.advance(poses)


@dataclass(frozen=True)
class FollowingLimit(LimitOf[CurveUnknowns]):
    """Limit on the distance of a fed arm from the path of its leading tip.

    Attributes:
        arm: arm with a feed axis.
        within: bound on the distance [m].
    """

    arm: Arm
    within: float

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return the sorted indices of the intervals of a motion with samples too far from the leader's path.

        The leader's path begins with the arm at the first configuration.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: unused.
        """
        del depth
        away, owner = self._away(q)
        return np.unique(np.minimum(owner[away > FOLLOWING_SHARE * self.within], len(q) - 2))

    def worst_deviation(self, q: FloatArray) -> float:
        """Return the largest deviation from the leader's path among samples of a motion, configurations (K, c) [m]."""
        return float(np.max(self._away(q)[0]))

    def _away(self, q: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the deviation from the leader's path and the interval of each of m samples of a motion q (K, c).

        The deviation, shape (m,), is the maximum over the arm, and 0 inside the guide tube [m].
        """
        per = max(1, -(-_POSES // max(len(q) - 1, 1)))
        along = np.linspace(0.0, len(q) - 1.0, per * (len(q) - 1) + 1)
        samples = points_at(q, np.arange(float(len(q))), along)
        away = np.zeros(len(samples))
        found = distances_from_leader(self.arm, samples)
        if found is not None:
            np.maximum.at(away, found.pose, found.distance)
        return away, along.astype(np.intp)
