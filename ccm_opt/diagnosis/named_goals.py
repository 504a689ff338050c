"""Goals and required poses of a problem, with their names in messages and their keys in the problem file."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Goal, Problem, Stop, TipGoal, Tolerances
from ccm_opt.problem.poses import name_suffix
from ccm_opt.robot.arm import Arm

GoalT = TypeVar("GoalT")


@dataclass(frozen=True)
class NamedGoal(Generic[GoalT]):
    """A goal, for the tip or the whole arm, with its name in messages and its key in the problem file.

    Attributes:
        name: name of the goal in messages.
        key: key of the goal in the problem file.
        goal: required pose of the arm or its tip.
        tolerances: tolerances of the goal.
    """

    name: str
    key: str
    goal: GoalT
    tolerances: Tolerances


NamedTipGoal: TypeAlias = NamedGoal[TipGoal]
"""A goal for the tip alone, with its name in messages and its key in the problem file."""


def named_goals(problem: Problem) -> Iterator[NamedGoal[Goal]]:
    """Yield all goals of a problem in order, with their names in messages and keys in the problem file."""
    goals = (*problem.stops, Stop(problem.goal, problem.tolerances))
    for k, stop in enumerate(goals):
        several = len(goals) > 1
        name = f"goal {k + 1} of {len(goals)}{name_suffix(stop.goal)}" if several else "the goal"
        yield NamedGoal(name, f"goal[{k}]" if several else "goal", stop.goal, stop.tolerances)


def tip_goal(problem: Problem) -> TipGoal | None:
    """Return the last goal if it may be moved: one for the tip, with neither a path nor a place to look at; or None."""
    goal = problem.goal
    return goal.for_tip if goal.path is None and goal.look_at is None else None


def named_tip_goals(problem: Problem) -> Iterator[NamedTipGoal]:
    """Yield every goal of a problem that is for the tip, with its name and key."""
    for goal in named_goals(problem):
        if goal.goal.for_tip:
            key = "position" if goal.goal.look_at is None else "look_at"
            yield NamedGoal(goal.name, f"{goal.key}.{key}", goal.goal.for_tip, goal.tolerances)


@dataclass(frozen=True)
class NamedPose:
    """A required pose of the whole arm, with its name, key and tolerances.

    Attributes:
        name: name of the pose in messages.
        key: key of the pose in the problem file.
        q: configuration, shape (c,) [rad, m].
        bend_tolerance: tolerance of each bend [rad]; infinite if the pose is a curve, since another mapping from curve
            to joints may give other bends.
        base_tolerance: tolerance of the base's position on its axis [m].
    """

    name: str
    key: str
    q: FloatArray
    bend_tolerance: float = 0.0
    base_tolerance: float = 0.0

    def rotation_bounds(self, arm: Arm) -> FloatArray:
        """Return bounds on the rotation of each link within the tolerances of the pose, shape (links,) [rad]."""
        # A link is rotated by all bends before it, and their angles at most add up.
        bends = arm.coordinates.bends_a_joint * np.arange(1.0, arm.links + 1.0)
        return np.asarray(np.minimum(self.bend_tolerance * bends, np.pi))

    def displacement_bounds(self, arm: Arm) -> FloatArray:
        """Return bounds on the displacement of each link within the tolerances of the pose, shape (links,) [m]."""
        # The displacements of all links up to link j add up at its end; a rotation moves a link by at most its chord.
        chords = 2.0 * np.sin(0.5 * self.rotation_bounds(arm))
        return np.asarray(self.base_tolerance + np.cumsum(arm.lengths * chords))


def named_poses(problem: Problem) -> Iterator[NamedPose]:
    """Yield the start pose of a problem, then the pose of every whole-arm goal, with names, keys and tolerances."""
    arm = problem.arm
    yield NamedPose("the start", "start", problem.start.configuration(arm))
    for goal in named_goals(problem):
        pose = goal.goal.for_joints
        if pose:
            tolerance = goal.tolerances.heading if pose.curve is None else np.inf
            yield NamedPose(goal.name, goal.key, pose.configuration(arm), tolerance, goal.tolerances.position)
