"""The goal pose in space by the NLP."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.goal_poses import GoalPoses, with_user_terms
from ccm_opt.ik.pose_program import PoseSize
from ccm_opt.ik.pose_settings import TORQUE_SHARE, SpacePoseSettings
from ccm_opt.ik.space_pose_program import SPACE_PARTS, SpacePoseProgram, space_pose_program
from ccm_opt.ik.space_pose_solver import SpaceArmPose, SpacePoseQuestion
from ccm_opt.ik.space_pose_task import LinkSides, SpacePoseTask
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_BEHIND = 1e-3
"""By how much a surface may stand out behind a side that covers it (as the distances have it)."""
_PAIR_REACH = 0.1
"""Links whose axes are farther apart than this share of the arm's length have no side between them (taste)."""
_REGION_SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32, 64)
"""Numbers of sides that programs are built for, so that poses share solvers (taste)."""


def link_sides(
    arm: Arm,
    tree: SurfaceTree,
    clearance: float,
    wanted_gap: float,
    points: FloatArray,
    settings: SpacePoseSettings,
) -> LinkSides:
    """The sides of every link's region about a pose.

    Args:
        arm: the arm.
        tree: of the surfaces.
        clearance: gap that the user asks for beyond the arm's radius [m].
        wanted_gap: room beyond that [m].
        points: joints and tip, shape (links + 1, 3) [m].
        settings: how far and how many.
    """
    surfaces = _surface_sides(arm, tree, clearance, points, settings)
    return surfaces.joined(_pair_sides(arm, wanted_gap, points))


def held_segments(arm: Arm, points: FloatArray) -> FloatArray:
    """The parts of the links that may touch nothing, shape (k, 2, 3) [m]: those of the last k links."""
    shares = arm.free_shares
    starts = points[:-1] + shares[:, None] * np.diff(points, axis=0)
    return np.asarray(np.stack((starts, points[1:]), axis=1)[shares < 1.0])


def _surface_sides(
    arm: Arm, tree: SurfaceTree, clearance: float, points: FloatArray, settings: SpacePoseSettings
) -> LinkSides:
    segments = held_segments(arm, points)
    reach = settings.reach * arm.length
    rows = tree.planes(segments, reach, settings.most_sides, _BEHIND * arm.length)
    nearest = segments[rows.link, 0] + rows.share[:, None] * (segments[rows.link, 1] - segments[rows.link, 0])
    # What a surface's rounding takes is told in the gap, so the side stands that far from the axis' nearest point.
    to_axis = np.einsum("rd,rd->r", rows.normal, nearest) - rows.gap
    link = rows.link + arm.links - len(segments)
    return LinkSides(link, rows.normal, to_axis + arm.radius + clearance, np.ones(len(link)))


def _pair_sides(arm: Arm, wanted_gap: float, points: FloatArray) -> LinkSides:
    """Two sides for every pair of links that may meet: each keeps to its side of the plane half-way between them.

    Links that are not far apart along the arm cannot keep the wanted gap, and are asked for the share of it that
    planning keeps between them.
    """
    first, second = arm.self_pairs
    if len(first) == 0:
        none = np.zeros(0, dtype=np.intp)
        return LinkSides(none, np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    ends = (points[first], points[first + 1], points[second], points[second + 1])
    first_at, second_at, distance, normal = segment_distances(*ends)
    near = np.flatnonzero((distance < _PAIR_REACH * arm.length) & (distance > 0.0))
    first, second = first[near], second[near]
    one = points[first] + first_at[near, None] * (points[first + 1] - points[first])
    other = points[second] + second_at[near, None] * (points[second + 1] - points[second])
    middle = np.einsum("kd,kd->k", normal[near], 0.5 * (one + other))
    shares = arm.link_margins(first, second, wanted_gap) / (2.0 * wanted_gap)
    return LinkSides(
        np.concatenate((first, second)),
        np.concatenate((normal[near], -normal[near])),
        np.concatenate((middle, -middle)) + arm.radius,
        np.concatenate((shares, shares)),
    )


@dataclass(frozen=True, eq=False)
class SpaceGoalPoses(GoalPoses[SpaceArmPose, SpacePoseSettings]):
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
    settings: SpacePoseSettings = field(default_factory=SpacePoseSettings)
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

    def strays(self, pose: SpaceArmPose) -> bool:
        """Whether a link has strayed beyond what its region was drawn for, and met a surface there."""
        return self.gap(pose.q) < min(pose.gap, 0.0) - self.allowed

    def solved_within(self, start: FloatArray, seed: FloatArray, drawn_with: SpacePoseSettings) -> SpaceArmPose:
        """One solution, its regions drawn with settings of their own; it stays near the seed unless told otherwise."""
        near = seed if self.near is None else self.near
        arm = self.problem.arm
        points = arm.joint_positions_at(start)
        clearance = self.problem.workspace.clearance
        sides = link_sides(arm, self.tree, clearance, self.wanted_gap, points, drawn_with)
        limits = self._torque_limits
        gravity = self.problem.simulation.gravity
        task = SpacePoseTask(
            arm, self.target, near, start, sides, self.wanted_gap, gravity=gravity, torque_limits=limits
        )
        return SpacePoseQuestion(self._program(sides), task, self._weights, self.settings).solve()

    @property
    def _torque_limits(self) -> FloatArray | None:
        """Torque that holding may take of both bends of every joint, shape (2 links,) [N m]; None without limits."""
        torque = self.problem.limits.torque
        if torque is None:
            return None
        return TORQUE_SHARE * np.column_stack((torque[0::3], torque[1::3])).ravel()

    def _program(self, sides: LinkSides) -> SpacePoseProgram:
        sizes = (size for size in _REGION_SIZES if size >= sides.most)
        size = next(sizes, sides.most)
        loaded = self._torque_limits is not None
        links = self.problem.arm.links
        program = space_pose_program(PoseSize.from_settings(links, size, loaded=loaded, settings=self.settings))
        return program if self.terms is None else with_user_terms(program, self.terms)

    @property
    def _weights(self) -> FloatArray:
        """Of the parts of the objective."""
        return self.settings.weights_of(SPACE_PARTS, self.problem.planner.weights)


def goal_pose(
    problem: Problem,
    seed: FloatArray,
    tree: SurfaceTree,
    *,
    near: FloatArray | None = None,
    terms: UserTerms | None = None,
    settings: SpacePoseSettings | None = None,
    deadline: Deadline | None = None,
) -> SpaceArmPose | None:
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
    poses = SpaceGoalPoses(problem, tree, near, terms, settings or SpacePoseSettings())
    return poses.best(seed, deadline)
