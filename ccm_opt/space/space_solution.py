"""A verified plan of an arm in space with everything computed on the way."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions, link_rotations
from ccm_opt.solution import JointTrajectory, Solution, SolutionOf
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal


@dataclass(frozen=True)
class GoalErrors:
    """How the last link of a motion lies at its goal.

    Attributes:
        position: distance of the tip from where it should be [m]; None for a goal of joints.
        direction: angle between where the last link points and where it should [rad]; None where any will do.
        roll: by which the last link is turned about its own axis, against the base turned to the same direction by the
            shortest turn [rad]; it follows from the bends.
    """

    position: float | None
    direction: float | None
    roll: float


class SpacePlan(Protocol):
    """What pictures show of a plan in space, whether it was just made or read."""

    @property
    def problem(self) -> SpaceProblem:
        """What was asked."""
        ...

    @property
    def trajectory(self) -> JointTrajectory:
        """The motion in time."""
        ...

    @property
    def joint_positions(self) -> FloatArray:
        """Joint and tip positions at every sample, shape (T, links + 1, 3) [m]."""
        ...

    @property
    def least_gap(self) -> float | None:
        """Least gap of the motion beyond radius and clearance [m]; None where nobody measured it."""
        ...


@dataclass(frozen=True, repr=False)
class SpaceSolution(SolutionOf[SpaceProblem]):
    """A verified plan in space; its attributes are those of ``SolutionOf``."""

    @property
    def joint_positions(self) -> FloatArray:
        """Joint and tip positions at every sample, shape (T, links + 1, 3) [m]."""
        return joint_positions(self.problem.arm, self.trajectory.positions)

    @property
    def least_gap(self) -> float | None:
        """Least gap of the motion beyond radius and clearance [m]; None where nobody measured it."""
        return None if self.room is None or not self.room.nearest.link else self.room.nearest.gap

    @property
    def goal_errors(self) -> GoalErrors:
        """How the last link lies at the end of the motion."""
        return goal_errors(self.problem, self.trajectory.positions[-1])


AnySolution: TypeAlias = Solution | SpaceSolution
"""A verified plan in the plane or in space."""


def goal_errors(problem: SpaceProblem, last: FloatArray) -> GoalErrors:
    """How the last link lies against the goal of a problem in a configuration, shape (c,) [rad, m]."""
    arm = problem.arm
    turn = link_rotations(arm, last)[-1]
    roll = roll_against(arm.base_rotation, turn)
    if not isinstance(problem.goal, SpaceTipGoal):
        return GoalErrors(None, None, roll)
    off = float(np.linalg.norm(joint_positions(arm, last)[-1] - problem.goal.position))
    wanted = problem.goal.direction
    return GoalErrors(off, None if wanted is None else angle_between(turn[:, 0], wanted), roll)


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """The angle between two vectors, shape (3,), exact for small ones too [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))


def roll_against(base: FloatArray, turn: FloatArray) -> float:
    """Turn about x of a frame against another one that is turned to its x by the shortest turn [rad].

    Args:
        base: the other frame, its axes as columns, shape (3, 3).
        turn: the frame, likewise.
    """
    start = base[:, 0]
    end = turn[:, 0]
    axis = np.cross(start, end)
    cos = float(start @ end)
    if 1.0 + cos < np.finfo(np.float64).eps:
        # Every half turn is as short as any other: that about the base's z axis is taken.
        moved = 2.0 * np.outer(base[:, 2], base[:, 2]) @ base - base
    else:
        cross = np.cross(np.eye(3), axis)  # the matrix of x ↦ axis × x
        moved = base + cross @ base + cross @ cross @ base / (1.0 + cos)
    return float(np.arctan2(turn[:, 1] @ moved[:, 2], turn[:, 1] @ moved[:, 1]))
