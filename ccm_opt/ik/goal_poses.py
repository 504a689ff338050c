"""The goal-pose NLP solved in rounds, and the users' constraints and costs in its programs."""

from abc import ABC, abstractmethod
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.curve_program import RowBlock
from ccm_opt.ik.functions import CompiledConstraint
from ccm_opt.ik.pose_program import PoseProgram, PoseSize, pose_program
from ccm_opt.ik.pose_settings import TORQUE_SHARE, PoseSettings
from ccm_opt.ik.pose_solver import ArmPose, PoseQuestion
from ccm_opt.ik.pose_task import PoseTask
from ccm_opt.problem import Problem

_GOAL = 1.0
"""Path parameter of the goal."""
_REGION_SIZES = (8, 16, 24, 32, 48, 64, 96, 128)
"""Numbers of sides of a joint that programs are built for, so that poses share solvers (measured: of 42 scenes of
clutter in the plane all need eight or fewer)."""


@lru_cache(maxsize=4)  # the regions are drawn anew several times for one question; its solver is built once
def with_user_terms(program: PoseProgram, terms: UserTerms) -> PoseProgram:
    """The program with the user's hard constraints as rows, and soft ones and costs in its objective.

    Args:
        program: without them.
        terms: compiled for the same arm; those that do not cover the goal are left out.
    """
    pose = terms.quantities.of_shape(program.frames.shape)
    feed = terms.quantities.arm.length * program.unknowns["feed"]
    rows = tuple(_rows_of(item, pose, feed) for item in terms.hard_at_goal)
    parts = dict(program.parts)
    objective = program.objective
    for item in terms.all_costs:
        if bool(item.applies(np.array([_GOAL]))[0]):
            value = item.function(pose, feed, _GOAL)
            parts[f"user: {item.cost.name}"] = item.cost.weight * value
            objective += item.cost.weight * value
    return replace(program, rows=(*program.rows, *rows), parts=parts, objective=objective)


def _rows_of(item: CompiledConstraint, pose: ca.SX, feed: ca.SX) -> RowBlock:
    """A hard constraint at the goal, one row an entry, in the user's unit."""
    name = item.constraint.name
    count = len(item.lower)
    names = (f"user: {name}",) if count == 1 else tuple(f"user: {name}, entry {k + 1}" for k in range(count))
    return RowBlock(names, item.function(pose, feed, _GOAL), item.lower, item.upper)


def bounded(pose: ArmPose) -> bool:
    """Whether a side of a region shapes the pose, so that it may be better in regions drawn anew."""
    return any("of its region" in name for name in pose.answer.multipliers)


class GoalPoses(ABC):
    """Improves poses at the goal of one problem.

    Attributes:
        problem: with a goal for the tip.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
    """

    problem: Problem
    terms: UserTerms | None
    settings: PoseSettings

    @abstractmethod
    def gap(self, at: FloatArray) -> float:
        """Least gap of a pose beyond radius and clearance [m]; not told apart beyond the reach of regions."""

    @abstractmethod
    def strays(self, pose: ArmPose) -> bool:
        """Whether a link has strayed beyond what its region was drawn for, and met something there."""

    @abstractmethod
    def task(self, start: FloatArray, seed: FloatArray, drawn_with: PoseSettings) -> PoseTask:
        """What is asked from a start, its regions drawn about it; the first start of all is the seed."""

    def at(self, pose: ArmPose) -> FloatArray:
        """A pose as it is asked about here."""
        return pose.q

    def solved_within(self, start: FloatArray, seed: FloatArray, drawn_with: PoseSettings) -> ArmPose:
        """One solution, its regions drawn with settings of their own."""
        task = self.task(start, seed, drawn_with)
        sides = next((size for size in _REGION_SIZES if size >= task.regions.most), task.regions.most)
        arm = task.arm
        loaded = task.torque_limits is not None
        segments = self.settings.segments_for(arm.links)
        plain = pose_program(PoseSize(arm.dimension, arm.links, sides, segments, loaded))
        program = plain if self.terms is None else with_user_terms(plain, self.terms)
        weights = self.settings.weights_of(tuple(plain.parts), self.problem.planner.weights)
        return PoseQuestion(program, task, self.settings, weights).solve()

    @property
    def forces(self) -> dict[str, Any]:
        """Gravity in the arm's own coordinates, and what holding may take of the torque of every bend, for a task."""
        arm = self.problem.arm
        torque = self.problem.limits.torque
        return {
            "gravity": arm.embedded(np.eye(arm.dimension)) @ self.problem.simulation.gravity,
            "torque_limits": None
            if torque is None
            else TORQUE_SHARE * torque[list(arm.coordinates.drives[: len(arm.bend_limits)])],
        }

    @property
    def allowed(self) -> float:
        """Gap that may be missing for rounding [m]."""
        return self.settings.feasible * self.problem.arm.length

    @property
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance above which more is worth nothing [m].

        That of the problem; where its motion is to keep none, still what a pose would keep by default.
        """
        return self.problem.wanted_gap or self.problem.default_gap

    def solved(self, start: FloatArray, seed: FloatArray | None = None) -> ArmPose:
        """One solution, feasible or not, with more and farther sides where a link has strayed beyond its region.

        Args:
            start: the pose to start from.
            seed: where the first of several solutions started; the same when None.
        """
        for drawn_with in self.settings.widening:
            pose = self.solved_within(start, start if seed is None else seed, drawn_with)
            if pose.answer.violation > self.settings.feasible or not self.strays(pose):
                break
        return pose

    def improved(self, seed: FloatArray, deadline: Deadline | None = None) -> tuple[ArmPose, ...]:
        """Solutions from a pose, each from the one before with its regions drawn anew about it.

        Args:
            seed: a pose at or near the goal that touches nothing.
            deadline: no further solution is begun after it.

        Returns:
            At least one; the last is the best when it is feasible. One that is not says why.
        """
        found: list[ArmPose] = []
        start = seed
        for _ in range(self.settings.rounds):
            pose = self.solved(start, seed)
            found.append(pose)
            if not self.feasible(pose) or self._good_enough(found) or (deadline is not None and deadline.passed()):
                break
            start = self.at(pose)
        return tuple(found)

    def _good_enough(self, found: list[ArmPose]) -> bool:
        """Whether the last solution brought little, with all the room that is wanted or no side that shapes it."""
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
        """Whether a pose keeps every row, and touches nothing by distances of its own."""
        return pose.answer.violation <= self.settings.feasible and self.gap(self.at(pose)) > -self.allowed

    def best(self, seed: FloatArray, deadline: Deadline | None = None) -> ArmPose | None:
        """The best feasible pose of ``improved``; None when there is none."""
        return self.best_of(self.improved(seed, deadline))

    def best_of(self, poses: tuple[ArmPose, ...]) -> ArmPose | None:
        """The feasible pose that costs least; None when there is none."""
        feasible = [pose for pose in poses if self.feasible(pose)]
        return min(feasible, key=lambda pose: pose.answer.cost, default=None)
