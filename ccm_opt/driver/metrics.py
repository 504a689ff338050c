"""Measures of a plan for people, and how far it leaves a leader's path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import arc_lengths, leg_headings, path_length, wrap
from ccm_opt.planning.settings import DEFAULT_DEVIATION, DeviationSettings
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import SurfaceSoup
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion, goal_errors
from ccm_opt.verification.interpolated_message import interpolation_deviation

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


def metrics(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    joints: JointStates,
    simulated: SimulatedMotion,
    checks: tuple[Check, ...],
) -> Mapping[str, float]:
    """The figures of merit of a plan, named with their units."""
    figures = dict(figures_of_motion(problem, trajectory, joints, checks))
    figures["keyframes"] = float(len(path.keyframes))
    figures["tracking_error_rad"] = simulated.tracking_error
    # An arm that followed no leader has no deviation from one.
    if path.leaders and problem.dimension == 2:
        figures.update(_leader_figures(deviation(problem.arm, trajectory.positions, path.leaders)))
    return figures


def figures_of_motion(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, checks: tuple[Check, ...]
) -> Mapping[str, float]:
    """Those figures that the motion itself has, so that whoever has its arrays can make them again."""
    bends = trajectory.bend_angles
    if problem.dimension == 3:
        turns = bend_of_joints(problem.arm.bend_pairs(trajectory.positions))
        ends = _in_space(problem, trajectory)
    else:
        turns = np.abs(bends)
        ends = _in_the_plane(problem, trajectory)
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(joints.torques), initial=0.0)),
        "joint_path_length_rad": path_length(bends),
        # The bend at the base turns the whole arm and curves nothing, so it does not count.
        "largest_curvature_per_m": float(np.max(turns[:, 1:], initial=0.0) / problem.arm.link_length),
        # The error at the goal is that of the motion as it is written, not of the path it was planned from.
        **ends,
    }
    # Of lengths in metres only the clearances are merits; the other checks are promises that hold or do not.
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def _in_the_plane(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """How the arm ends, and how far it leaves the motion that is proved when a controller interpolates its message."""
    arm = problem.arm
    figures = {"interpolation_deviation_m": interpolation_deviation(arm, trajectory)}
    if isinstance(problem.goal, TipGoal):
        tip = arm.joint_positions_at(trajectory.positions[-1])[-1]
        figures["tip_error_m"] = float(np.hypot(*(tip - problem.goal.position)))
        if problem.goal.heading is not None:
            turn = wrap(arm.headings(trajectory.bend_angles[-1])[-1] - problem.goal.heading)
            figures["heading_error_rad"] = abs(float(turn))
    return figures


def _in_space(problem: Problem, trajectory: JointTrajectory) -> dict[str, float]:
    """How the arm ends, and how well it follows its tip where its base is fed."""
    errors = goal_errors(problem, trajectory.positions[-1])
    ends = {"tip_error_m": errors.position, "direction_error_rad": errors.direction, "tip_roll_rad": errors.roll}
    followed = leader_deviation(problem.arm, trajectory.positions)
    return {
        **{name: error for name, error in ends.items() if error is not None},
        **({} if followed is None else _leader_figures(followed)),
    }


def _leader_figures(found: Deviation | LeaderDeviation) -> dict[str, float]:
    """How well the arm follows its leader, as figures of merit."""
    return {
        "leader_deviation_mean_m": found.mean,
        "leader_deviation_worst_m": found.worst,
        "leader_deviation_straight_mean_m": found.straight_mean,
    }


def bend_of_joints(pairs: FloatArray) -> FloatArray:
    """Angle between the links on both sides of a joint from its two bends, shape (..., 2) to (...) [rad]."""
    cos = np.cos(pairs[..., 0]) * np.cos(pairs[..., 1])
    return np.asarray(np.arccos(np.clip(cos, -1.0, 1.0)))
