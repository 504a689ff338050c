"""The best pose of an arm in space at its goal, from a pose there: the goal-pose NLP, its regions drawn anew."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.curve.tip_target import TipTarget
from ccm_opt.space.distances.segment_pairs import segment_distances
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.nlp.link_sides import held_segments, link_sides
from ccm_opt.space.nlp.space_pose_program import SpacePoseProgram, SpacePoseSize, space_pose_program
from ccm_opt.space.nlp.space_pose_settings import SpacePoseSettings
from ccm_opt.space.nlp.space_pose_solver import SpaceArmPose, SpacePoseQuestion
from ccm_opt.space.nlp.space_pose_task import LinkSides, SpacePoseTask
from ccm_opt.space.nlp.space_pose_terms import with_terms_in_space
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal
from ccm_opt.user_terms.compiled_terms import UserTerms


@dataclass(frozen=True, eq=False)
class SpaceGoalPoses:
    """Improves poses at the goal of one problem in space.

    Attributes:
        problem: with a goal for the tip.
        tree: of the surfaces of its scene.
        near: configuration of the pose to stay near, shape (c,) [rad, m]; None for the pose that is improved.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
        room_share: room that is worth something, as a multiple of the problem's wanted gap.
    """

    problem: SpaceProblem
    tree: SurfaceTree
    near: FloatArray | None = None
    terms: UserTerms | None = None
    settings: SpacePoseSettings = field(default_factory=SpacePoseSettings)
    room_share: float = 1.0

    def best(self, seed: FloatArray, deadline: Deadline | None = None) -> SpaceArmPose | None:
        """The best feasible pose of ``improved``; None when there is none."""
        feasible = [pose for pose in self.improved(seed, deadline) if self.feasible(pose)]
        return min(feasible, key=lambda pose: pose.answer.cost, default=None)

    def improved(self, seed: FloatArray, deadline: Deadline | None = None) -> tuple[SpaceArmPose, ...]:
        """Solutions from a pose, each from the one before with its regions drawn anew about it.

        Args:
            seed: configuration of a pose at or near the goal that touches nothing, shape (c,) [rad, m].
            deadline: no further solution is begun after it.

        Returns:
            At least one; one that is not feasible says why and is the last.
        """
        settings = self.settings
        near = seed if self.near is None else self.near
        found: list[SpaceArmPose] = []
        start = seed
        for _ in range(settings.rounds):
            pose = self._solved(start, near)
            found.append(pose)
            if not self.feasible(pose) or self._good_enough(found) or (deadline is not None and deadline.passed()):
                break
            start = pose.q
        return tuple(found)

    def feasible(self, pose: SpaceArmPose) -> bool:
        """Whether a pose keeps every row, and touches nothing by distances of its own."""
        if pose.answer.violation > self.settings.feasible:
            return False
        return self.gap(pose.q) > -self.settings.feasible * self.problem.arm.length

    def gap(self, q: FloatArray) -> float:
        """Least gap of a pose beyond radius and clearance [m]; not told apart beyond the reach of regions."""
        arm = self.problem.arm
        points = joint_positions(arm, q)
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
        """Room beyond radius and clearance above which more is worth nothing [m]; never none, as in the plane."""
        return self.room_share * (self.problem.wanted_gap or self.problem.default_gap)

    @cached_property
    def target(self) -> TipTarget:
        """Where the tip has to be.

        Raises:
            ProblemError: the goal is a pose of the whole arm, of which nothing is left to choose.
        """
        goal = self.problem.goal
        if not isinstance(goal, SpaceTipGoal):
            raise ProblemError("the goal is a pose of the whole arm; expected one of the tip, to find a pose for")
        return TipTarget(goal.position, goal.direction)

    def _good_enough(self, found: list[SpaceArmPose]) -> bool:
        """Whether the last solution brought little, with all the room that is wanted or no side that shapes it."""
        settings = self.settings
        pose = found[-1]
        wide = pose.gap >= settings.enough * self.wanted_gap
        if wide and not any("of its region" in name for name in pose.answer.multipliers):
            return True
        if len(found) == 1:
            return False
        before = found[-2]
        gain = before.answer.cost - pose.answer.cost
        gained = gain > settings.worthwhile * before.answer.cost
        grown = pose.gap - before.gap > settings.worthwhile * self.wanted_gap
        return not gained and (wide or not grown)

    def _solved(self, start: FloatArray, near: FloatArray) -> SpaceArmPose:
        """One solution, with more and farther sides where a link has strayed beyond what its region was drawn for."""
        allowed = self.settings.feasible * self.problem.arm.length
        for widened in self.settings.widening:
            pose = self._solved_within(start, near, widened)
            if pose.answer.violation > self.settings.feasible or self.gap(pose.q) >= min(pose.gap, 0.0) - allowed:
                break
        return pose

    def _solved_within(self, start: FloatArray, near: FloatArray, drawn_with: SpacePoseSettings) -> SpaceArmPose:
        arm = self.problem.arm
        points = joint_positions(arm, start)
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
        return self.settings.torque_share * np.column_stack((torque[0::3], torque[1::3])).ravel()

    def _program(self, sides: LinkSides) -> SpacePoseProgram:
        sizes = (size for size in self.settings.region_sizes if size >= sides.most)
        size = next(sizes, sides.most)
        loaded = self._torque_limits is not None
        links = self.problem.arm.links
        program = space_pose_program(SpacePoseSize.from_settings(links, size, self.settings, loaded=loaded))
        return program if self.terms is None else with_terms_in_space(program, self.terms)

    @property
    def _weights(self) -> FloatArray:
        """Of the parts of the objective: the settings' times those that the problem gives."""
        settings = self.settings
        given = self.problem.planner.weights
        return np.array(
            [
                settings.room_weight,
                settings.bending_weight * given.bending,
                settings.distance_weight * given.path_length,
                settings.knot_weight,
                settings.bow_weight,
                settings.stray_weight,
                settings.torque_weight,
            ]
        )


def goal_pose(
    problem: SpaceProblem,
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
