"""The goal pose in space by the NLP."""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.curve_program import RowBlock
from ccm_opt.ik.functions import CompiledConstraint
from ccm_opt.ik.space_pose_program import SpacePoseProgram, SpacePoseSize, space_pose_program
from ccm_opt.ik.space_pose_solver import SpaceArmPose, SpacePoseQuestion
from ccm_opt.ik.space_pose_task import LinkSides, SpacePoseSettings, SpacePoseTask, free_shares
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_TORQUE_SHARE = 0.9
"""Share of a torque limit that holding the pose may take (as in the plane)."""
_ROOM_WEIGHT = 10.0
"""Cost of having no room at all, of the wanted gap; beside it bending costs little (as in the plane)."""
_KNOT_WEIGHT = 4.0
"""Of uneven knots and segments (as in the plane)."""
_BOW_WEIGHT = 1e-3
"""Of what the curvatures leave their chords by between knots (as in the plane)."""
_TORQUE_WEIGHT = 0.1
"""Of the mean square holding torque, as shares of its limits (as in the plane)."""
_BEHIND = 1e-3
"""By how much a surface may stand out behind a side that covers it (as the distances have it)."""
_REGION_SIZES = (2, 4, 6, 8, 10, 12, 16, 24, 32, 64)
"""Numbers of sides that programs are built for, so that poses share solvers (taste)."""

_STRAY_WEIGHT = 1.0
"""Of the squared angles by which links point elsewhere than the curve [1/rad²] (taste)."""


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
    return surfaces.joined(_pair_sides(arm, wanted_gap, points, settings))


def held_segments(arm: Arm, points: FloatArray) -> FloatArray:
    """The parts of the links that may touch nothing, shape (k, 2, 3) [m]: those of the last k links."""
    shares = free_shares(arm)
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


def _pair_sides(arm: Arm, wanted_gap: float, points: FloatArray, settings: SpacePoseSettings) -> LinkSides:
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
    near = np.flatnonzero((distance < settings.pair_reach * arm.length) & (distance > 0.0))
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


_GOAL = 1.0
"""Path parameter of the goal."""


@lru_cache(maxsize=4)  # the regions are drawn anew several times for one question; its solver is built once
def with_terms_in_space(program: SpacePoseProgram, terms: UserTerms) -> SpacePoseProgram:
    """The program with the user's hard constraints as rows, and soft ones and costs in its objective.

    Args:
        program: without them.
        terms: compiled for the same arm; those that do not cover the goal are left out.
    """
    bends = ca.vec(program.bends)
    feed = terms.quantities.arm.length * program.feed
    rows = tuple(_rows_of(item, bends, feed) for item in terms.hard_at_goal)
    parts = dict(program.parts)
    objective = program.objective
    for item in terms.all_costs:
        if bool(item.applies(np.array([_GOAL]))[0]):
            value = item.function(bends, feed, _GOAL)
            parts[f"user: {item.cost.name}"] = item.cost.weight * value
            objective += item.cost.weight * value
    return replace(program, rows=(*program.rows, *rows), parts=parts, objective=objective)


def _rows_of(item: CompiledConstraint, bends: ca.SX, feed: ca.SX) -> RowBlock:
    """A hard constraint at the goal, one row an entry, in the user's unit."""
    name = item.constraint.name
    count = len(item.lower)
    names = (f"user: {name}",) if count == 1 else tuple(f"user: {name}, entry {k + 1}" for k in range(count))
    return RowBlock(names, item.function(bends, feed, _GOAL), item.lower, item.upper)


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

    problem: Problem
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
        points = arm.joint_positions_at(q)
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
    def target(self) -> TipGoal:
        """Where the tip has to be.

        Raises:
            ProblemError: the goal is a pose of the whole arm, of which nothing is left to choose.
        """
        goal = self.problem.goal
        if not isinstance(goal, TipGoal):
            raise ProblemError("the goal is a pose of the whole arm; expected one of the tip, to find a pose for")
        return goal

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
        return _TORQUE_SHARE * np.column_stack((torque[0::3], torque[1::3])).ravel()

    def _program(self, sides: LinkSides) -> SpacePoseProgram:
        sizes = (size for size in _REGION_SIZES if size >= sides.most)
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
                _ROOM_WEIGHT,
                settings.bending_weight * given.bending,
                settings.distance_weight * given.path_length,
                _KNOT_WEIGHT,
                _BOW_WEIGHT,
                _STRAY_WEIGHT,
                _TORQUE_WEIGHT,
            ]
        )


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
