"""Poses at the goal, improved by the goal-pose NLP in several rounds, with the user's constraints and costs."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.functions import CompiledConstraint
from ccm_opt.ik.pose_program import PoseProgram, PoseSize, pose_program
from ccm_opt.ik.pose_regions import JointRegions, held_segments, regions_about
from ccm_opt.ik.pose_settings import DEFAULT_POSES, TORQUE_SHARE, PoseSettings
from ccm_opt.ik.pose_solver import ArmPose, PoseQuestion
from ccm_opt.ik.row_program import RowBlock
from ccm_opt.ik.spline_curve import link_shares
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree

Rows = tuple[tuple[float, ...], ...]
_GOAL = 1.0
"""Path parameter at the goal."""
_REGION_SIZES = (8, 16, 24, 32, 48, 64, 96, 128)
"""Numbers of sides per joint for which NLPs are built; the number a pose needs is rounded up to one of these, so that
poses share solvers (measured: all of 42 scenes of clutter in the plane need eight or fewer)."""


@lru_cache(maxsize=4)  # regions are redrawn several times per question, but the solver is built once
def with_user_terms(program: PoseProgram, terms: UserTerms) -> PoseProgram:
    """Return a goal-pose NLP with the user's constraints and costs added.

    Hard constraints become constraints of the NLP; soft constraints and costs are added to its objective.

    Args:
        program: the NLP without the user's constraints and costs.
        terms: constraints and costs compiled for the arm; those that do not apply at the goal are left out.
    """
    pose = ca.vec(program.frames.bends)
    feed = terms.quantities.arm.length * program.unknowns["feed"]
    rows = tuple(_rows_of(item, pose, feed) for item in terms.hard_at_goal)
    parts = dict(program.parts)
    objective = program.objective
    heaviest = 1.0
    for item in terms.all_costs:
        if bool(item.applies(np.array([_GOAL]))[0]):
            value = item.function(pose, feed, _GOAL)
            parts[f"user: {item.cost.name}"] = item.cost.weight * value
            objective += item.cost.weight * value
            heaviest = max(heaviest, item.cost.weight)
    return replace(program, rows=(*program.rows, *rows), parts=parts, objective=objective, magnitude=heaviest)


def _rows_of(item: CompiledConstraint, pose: ca.SX, feed: ca.SX) -> RowBlock:
    """Return the NLP constraints of a user's hard constraint at the goal, one per entry of its expression, in its unit.

    Args:
        item: the constraint.
        pose: symbols of the bends in one column, shape (bends, 1) [rad].
        feed: expression of the base position on its feed axis [m].
    """
    name = item.constraint.name
    count = len(item.lower)
    names = (f"user: {name}",) if count == 1 else tuple(f"user: {name}, entry {k + 1}" for k in range(count))
    return RowBlock(names, item.function(pose, feed, _GOAL), item.lower, item.upper)


def bounded(pose: ArmPose) -> bool:
    """Return whether any side of the links' convex regions is active, so that new regions may improve the pose."""
    return any("of its region" in name for name in pose.answer.multipliers)


@dataclass(frozen=True, eq=False)
class GoalPoses:
    """Solver that improves poses of an arm at the goal of its tip, by the goal-pose NLP.

    Attributes:
        problem: the problem, with a goal for the tip.
        tree: distance tree of the walls and surfaces of the workspace.
        near: configuration from which deviations are penalised, shape (c,) [rad, m]; None for the pose to be improved.
        terms: compiled constraints and costs of the user, or None.
        settings: settings of the NLP.
        wanted_share: multiple of the preferred clearance above which more clearance does not lower the cost.
        aim: goal of the tip that replaces the problem's goal, or None.
        room: tolerances of the tip position [m] and of the last link's direction [rad]; all poses within them are
            equally good.
        clamped: whether the first link keeps its direction.
    """

    problem: Problem
    tree: SurfaceTree
    near: FloatArray | None = None
    terms: UserTerms | None = None
    settings: PoseSettings = DEFAULT_POSES
    wanted_share: float = 1.0
    aim: TipGoal | None = None
    room: tuple[float, float] = (0.0, 0.0)
    clamped: bool = False

    @cached_property
    def target(self) -> TipGoal:
        """Goal of the tip, position and direction.

        Raises:
            ProblemError: the problem's goal is a pose of the whole arm, which leaves nothing to choose.
        """
        goal = self.aim or self.problem.goal.for_tip
        if goal is None:
            raise ProblemError("the goal is a pose of the whole arm; expected one of the tip, to find a pose for")
        return goal

    @property
    def allowed(self) -> float:
        """Amount by which the required clearance may be violated because of rounding [m]."""
        return self.settings.feasible * self.problem.arm.length

    @property
    def wanted_gap(self) -> float:
        """Gap beyond the required clearance above which more does not lower the cost [m].

        The gap is ``wanted_share`` times the problem's preferred clearance or, if that is zero, the default one.
        """
        return self.wanted_share * (self.problem.wanted_gap or self.problem.default_gap)

    def gap(self, q: FloatArray) -> float:
        """Return the least gap of a pose [m]: to walls beyond radius and required clearance, or between its links.

        Negative values mean contact or too little clearance. The gap to walls is capped at ``settings.reach`` times the
        arm's length, the distance up to which walls are considered. ``q`` is the configuration, shape (c,) [rad, m].
        """
        arm = self.problem.arm
        points = arm.joint_positions_at(q)
        first, second = arm.self_pairs
        if len(first) == 0:
            return self._wall_gap(points)
        ends = (points[first], points[first + 1], points[second], points[second + 1])
        return min(
            self._wall_gap(points), float(np.min(segment_distances(*ends)[2] - (arm.radii[first] + arm.radii[second])))
        )

    def _wall_gap(self, points: FloatArray) -> float:
        """Return the least gap of a pose to walls and surfaces, beyond radius and required clearance [m].

        It is capped at ``settings.reach`` times the arm's length.

        Args:
            points: positions of joints and tip, shape (links + 1, d) [m].
        """
        arm = self.problem.arm
        reach = self.settings.reach * arm.length
        segments = held_segments(arm, points)
        kept = arm.radii[arm.links - len(segments) :] + self.problem.workspace.clearance
        gaps = self.tree.distances(segments, reach + float(np.max(kept, initial=0.0)))
        return float(np.min(gaps - kept, initial=reach))

    def regions(self, q: FloatArray, drawn_with: PoseSettings) -> JointRegions:
        """Return the convex regions of the joints around a pose.

        Args:
            q: configuration of the pose, shape (c,) [rad, m].
            drawn_with: settings with the distance up to which walls bound a region, and the maximum number of sides.
        """
        arm = self.problem.arm
        points = arm.joint_positions_at(q)
        clearance = self.problem.workspace.clearance
        return regions_about(arm, self.tree, clearance, self.wanted_gap, points, drawn_with)

    def solved_within(self, start: FloatArray, seed: FloatArray, drawn_with: PoseSettings) -> ArmPose:
        """Return one solution of the NLP, feasible or not, in regions built around a start pose.

        Args:
            start: configuration from which the solver starts, shape (c,) [rad, m].
            seed: configuration from which deviations are penalised unless ``near`` is set, shape (c,) [rad, m].
            drawn_with: settings with the distance up to which walls bound a region, and the maximum number of sides.
        """
        arm = self.problem.arm
        regions = self.regions(start, drawn_with)
        loads = self._loads
        sides = next((size for size in _REGION_SIZES if size >= regions.most), regions.most)
        segments = self.settings.segments_for(arm.links)
        along = () if arm.tool_links is None else tuple(arm.tool_links.along.ravel().tolist())
        roll = TipRoll.of(self.target, arm, self.problem.tolerances.roll)
        up = () if roll is None else tuple(arm.up_in_last_link.tolist())
        size = PoseSize(
            arm.dimension,
            arm.links,
            sides,
            segments,
            loads is not None,
            link_shares(arm),
            along,
            up,
            *driven(arm),
            carrier_rows(arm),
        )
        plain = pose_program(size)
        program = plain if self.terms is None else with_user_terms(plain, self.terms)
        weights = self.settings.objective_weights(tuple(plain.parts), self.problem.planner.weights, arm.bends_a_joint)
        return PoseQuestion(
            program=program,
            settings=self.settings,
            weights=weights,
            arm=arm,
            position=self.target.position,
            direction=self.target.direction,
            roll=roll,
            near=seed if self.near is None else self.near,
            start=start,
            regions=regions,
            wanted_gap=self.wanted_gap,
            gravity=arm.embedded(np.eye(arm.dimension)) @ self.problem.simulation.gravity,
            clamped=self.clamped,
            room=self.room,
            torque_limits=loads,
            base_weights=self.base_weights,
        ).solve()

    @property
    def base_weights(self) -> FloatArray | None:
        """Weight of the deviation of each axis that carries the base from the pose to be improved, shape (k,).

        It is 0 if deviations from another pose, ``near``, are penalised, from which the base may be far.
        Deviations are in arm lengths or rad. An axis weighs as much as a joint that takes as long, and at least
        as a joint for a turn, or as one for each nominal link's length. None for a feed axis, or a fixed base.
        """
        arm = self.problem.arm
        if not arm.carrier:
            return None
        if self.near is not None:
            return np.zeros(len(arm.carrier))
        limits = self.problem.limits.of_coordinates(arm.coordinates).velocity
        joints, axes = limits[arm.coordinates.bends], limits[arm.coordinates.base]
        turns = np.array([axis.revolute for axis in arm.carrier])
        times = np.where(turns, 1.0, arm.length) * np.divide(float(np.median(joints)), axes)
        return np.asarray(np.maximum(np.nan_to_num(times, posinf=1.0), np.where(turns, 1.0, NOMINAL_LINKS)))

    @property
    def _loads(self) -> FloatArray | None:
        """Torque with which a pose may load each bend, or each drive that moves several; None if it is not limited."""
        arm = self.problem.arm
        torque = self.problem.limits.torque
        if torque is None:
            return None
        if arm.drives is not None:
            return TORQUE_SHARE * arm.drives.of_drives(torque[: 3 * arm.links])
        return np.asarray(TORQUE_SHARE * torque[list(arm.coordinates.drives[: len(arm.bend_limits)])])

    def strays(self, pose: ArmPose) -> bool:
        """Return whether a solution has less clearance than the sides of its regions imply.

        This happens if a link has moved farther than the distance up to which its region takes walls into account, or
        if the region was limited to its nearest sides.
        """
        points = self.problem.arm.joint_positions_at(pose.q)
        hidden = self.settings.behind * self.problem.arm.length
        return self.gap(pose.q) < min(pose.gap, 0.0) - self.allowed or (
            self._wall_gap(points) < pose.gap - hidden - self.allowed
        )

    def solved(self, start: FloatArray, seed: FloatArray | None = None) -> ArmPose:
        """Return one solution of the NLP, feasible or not, in regions that are large enough for the links' motion.

        If the solution has less clearance than its regions imply (``strays``), the NLP is solved again with regions
        that take farther walls and more sides into account.

        Args:
            start: configuration from which the solver starts, shape (c,) [rad, m].
            seed: configuration from which the first of several rounds started; ``start`` if None.
        """
        for drawn_with in self.settings.widening:
            pose = self.solved_within(start, start if seed is None else seed, drawn_with)
            if pose.answer.violation > self.settings.feasible or not self.strays(pose):
                break
        return pose

    def improved(self, seed: FloatArray, deadline: Deadline | None = None) -> tuple[ArmPose, ...]:
        """Return successive solutions of the NLP, each started from the previous one with new regions around it.

        Args:
            seed: collision-free configuration at or near the goal, shape (c,) [rad, m].
            deadline: time by which further solutions end that take as long as the one before, or None.

        Returns:
            At least one pose; if the last is feasible, it is the best. The answer of an infeasible pose names the
            violated constraints.
        """
        found: list[ArmPose] = []
        start = seed
        deadline = deadline or Deadline.never()
        for _ in range(self.settings.rounds):
            left = deadline.left
            pose = self.solved(start, seed)
            found.append(pose)
            if not self.feasible(pose) or self._good_enough(found) or deadline.left < left - deadline.left:
                break
            start = pose.q
        return tuple(found)

    def _good_enough(self, found: list[ArmPose]) -> bool:
        """Return whether another round of the NLP is not worthwhile after the solutions found so far.

        This is so if the preferred clearance is reached and no side of a region is active, or if the last round
        improved the pose little.
        """
        settings = self.settings
        pose = found[-1]
        wide = pose.gap >= settings.enough * self.wanted_gap
        if wide and not bounded(pose):
            return True
        if len(found) == 1:
            return False
        gain = 1.0 - pose.answer.cost / found[-2].answer.cost
        growth = pose.gap - found[-2].gap
        return gain < settings.worthwhile and (wide or growth < settings.worthwhile * self.wanted_gap)

    def feasible(self, pose: ArmPose) -> bool:
        """Return whether a solution satisfies all NLP constraints and passes a separate collision check."""
        return pose.answer.violation <= self.settings.feasible and self.gap(pose.q) > -self.allowed

    def best(self, seed: FloatArray, deadline: Deadline | None = None) -> ArmPose | None:
        """Return the feasible solution with the least cost among several rounds of the NLP that start from a pose.

        The result is None if no solution is feasible. Arguments are those of ``improved``.
        """
        return self.best_pose(self.improved(seed, deadline))

    def best_pose(self, poses: tuple[ArmPose, ...]) -> ArmPose | None:
        """Return the solution of the NLP with the least cost among those that are feasible; None if none is."""
        feasible = [pose for pose in poses if self.feasible(pose)]
        return min(feasible, key=lambda pose: pose.answer.cost, default=None)


def driven(arm: Arm) -> tuple[Rows, Rows, tuple[float, ...]]:
    """Return the coupling of the bends to drives, the travels of tendons for these, and half of the arcs of an arm.

    They are as in ``PoseSize``, and empty for an arm whose bends have drives of their own.
    """
    drives = arm.drives
    if drives is None:
        return (), (), ()
    coupling, travels = drives.coupling, drives.travel_rows @ drives.coupling
    arcs = () if arm.arcs is None else tuple((arm.arcs / arm.length).tolist())
    return tuple(map(tuple, coupling.tolist())), tuple(map(tuple, travels.tolist())), arcs


def carrier_rows(arm: Arm) -> Rows:
    """Return the axes that carry the base of an arm in space, in base axes and arm lengths, as in ``PoseSize``."""
    if not arm.carrier:
        return ()
    rows = arm.axis_rows.copy()
    rows[:, 1:4] = rows[:, 1:4] @ arm.base_rotation
    rows[:, 4:] = (rows[:, 4:] - arm.base) @ arm.base_rotation / arm.length
    return tuple(map(tuple, rows.tolist()))
