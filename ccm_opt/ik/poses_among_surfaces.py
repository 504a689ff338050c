"""The goal pose in space by the NLP."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_settings import SPACE_POSES, PoseSettings
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.pose_task import JointRegions, PoseTask
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_BEHIND = 1e-3
"""By how much a surface may stand out behind a side that covers it (as the distances have it)."""
_PAIR_REACH = 0.1
"""Links whose axes are farther apart than this share of the arm's length have no side between them (taste)."""


LinkSides = tuple[IntArray, FloatArray, FloatArray, FloatArray]
"""Link, normal, offset and share of the gap of every side, as ``JointRegions`` has them."""


def regions_among_surfaces(
    arm: Arm,
    tree: SurfaceTree,
    clearance: float,
    wanted_gap: float,
    points: FloatArray,
    settings: PoseSettings,
) -> JointRegions:
    """The sides of every link's region about a pose, for both its ends.

    Args:
        arm: the arm.
        tree: of the surfaces.
        clearance: gap that the user asks for beyond the arm's radius [m].
        wanted_gap: room beyond that [m].
        points: joints and tip, shape (links + 1, 3) [m].
        settings: how far and how many.
    """
    sides = (_surface_sides(arm, tree, clearance, points, settings), _pair_sides(arm, wanted_gap, points))
    return JointRegions.of_links(*(np.concatenate(column) for column in zip(*sides, strict=True)))


def held_segments(arm: Arm, points: FloatArray) -> FloatArray:
    """The parts of the links that may touch nothing, shape (k, 2, 3) [m]: those of the last k links."""
    shares = arm.free_shares
    starts = points[:-1] + shares[:, None] * np.diff(points, axis=0)
    return np.asarray(np.stack((starts, points[1:]), axis=1)[shares < 1.0])


def _surface_sides(
    arm: Arm, tree: SurfaceTree, clearance: float, points: FloatArray, settings: PoseSettings
) -> LinkSides:
    segments = held_segments(arm, points)
    reach = settings.reach * arm.length
    rows = tree.planes(segments, reach, settings.most_sides, _BEHIND * arm.length)
    nearest = segments[rows.link, 0] + rows.share[:, None] * (segments[rows.link, 1] - segments[rows.link, 0])
    # What a surface's rounding takes is told in the gap, so the side stands that far from the axis' nearest point.
    to_axis = np.einsum("rd,rd->r", rows.normal, nearest) - rows.gap
    link = rows.link + arm.links - len(segments)
    return link, rows.normal, to_axis + arm.radius + clearance, np.ones(len(link))


def _pair_sides(arm: Arm, wanted_gap: float, points: FloatArray) -> LinkSides:
    """Two sides for every pair of links that may meet: each keeps to its side of the plane half-way between them.

    Links that are not far apart along the arm cannot keep the wanted gap, and are asked for the share of it that
    planning keeps between them.
    """
    first, second = arm.self_pairs
    if len(first) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    ends = (points[first], points[first + 1], points[second], points[second + 1])
    first_at, second_at, distance, normal = segment_distances(*ends)
    near = np.flatnonzero((distance < _PAIR_REACH * arm.length) & (distance > 0.0))
    first, second = first[near], second[near]
    one = points[first] + first_at[near, None] * (points[first + 1] - points[first])
    other = points[second] + second_at[near, None] * (points[second + 1] - points[second])
    middle = np.einsum("kd,kd->k", normal[near], 0.5 * (one + other))
    shares = arm.link_margins(first, second, wanted_gap) / (2.0 * wanted_gap)
    return (
        np.concatenate((first, second)),
        np.concatenate((normal[near], -normal[near])),
        np.concatenate((middle, -middle)) + arm.radius,
        np.concatenate((shares, shares)),
    )


@dataclass(frozen=True, eq=False)
class PosesAmongSurfaces(GoalPoses):
    """Improves poses at the goal of one problem in space.

    Attributes:
        problem: with a goal for the tip.
        tree: of the surfaces of its scene.
        near: configuration of the pose to stay near, shape (c,) [rad, m]; None for the pose that is improved.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
        room_share: room that is worth something, as a multiple of the problem's wanted gap.
    """

    problem: Problem
    tree: SurfaceTree
    near: FloatArray | None = None
    terms: UserTerms | None = None
    settings: PoseSettings = SPACE_POSES
    room_share: float = 1.0

    def gap(self, at: FloatArray) -> float:
        """Least gap of a pose beyond radius and clearance [m]; not told apart beyond the reach of regions."""
        arm = self.problem.arm
        points = arm.joint_positions_at(at)
        reach = self.settings.reach * arm.length
        to_surfaces = self.tree.distances(held_segments(arm, points), reach)
        least = float(np.min(to_surfaces, initial=reach)) - arm.radius - self.problem.workspace.clearance
        first, second = arm.self_pairs
        if len(first) == 0:
            return least
        apart = segment_distances(points[first], points[first + 1], points[second], points[second + 1])[2]
        return min(least, float(np.min(apart)) - 2.0 * arm.radius)

    @property
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance above which more is worth nothing [m]."""
        return self.room_share * super().wanted_gap

    @cached_property
    def target(self) -> TipGoal:
        """Where the tip has to be.

        Raises:
            ProblemError: the goal is a pose of the whole arm, of which nothing is left to choose.
        """
        goal = self.problem.goal
        if not isinstance(goal, TipGoal):
            raise ProblemError("the goal is a pose of the whole arm; expected one of the tip, to find a pose for")
        return goal

    def strays(self, pose: ArmPose) -> bool:
        """Whether a link has strayed beyond what its region was drawn for, and met a surface there."""
        return self.gap(pose.q) < min(pose.gap, 0.0) - self.allowed

    def task(self, start: FloatArray, seed: FloatArray, drawn_with: PoseSettings) -> PoseTask:
        """What is asked from a start, its regions drawn about it; it stays near the seed unless told otherwise."""
        arm = self.problem.arm
        points = arm.joint_positions_at(start)
        clearance = self.problem.workspace.clearance
        return PoseTask(
            arm,
            self.target.position,
            self.target.direction,
            near=seed if self.near is None else self.near,
            start=start,
            regions=regions_among_surfaces(arm, self.tree, clearance, self.wanted_gap, points, drawn_with),
            wanted_gap=self.wanted_gap,
            **self.forces,
        )


def goal_pose(
    problem: Problem,
    seed: FloatArray,
    tree: SurfaceTree,
    *,
    near: FloatArray | None = None,
    terms: UserTerms | None = None,
    settings: PoseSettings = SPACE_POSES,
    deadline: Deadline | None = None,
) -> ArmPose | None:
    """A better pose of the arm at the goal than one that was found, with room beside it where there is some.

    Args:
        problem: with a goal for the tip.
        seed: configuration at the goal that touches nothing, such as where a search ended, shape (c,) [rad, m].
        tree: of the surfaces of the problem's scene.
        near: configuration to stay near, such as where the motion starts; the seed when None.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
        deadline: no further solution is begun after it.

    Returns:
        A feasible pose, of the seed's own way round everything; None where none is found.

    Raises:
        ProblemError: the goal is a pose of the whole arm.
    """
    poses = PosesAmongSurfaces(problem, tree, near, terms, settings)
    return poses.best(seed, deadline)
