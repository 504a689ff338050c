"""The answer to the static question in space: the best pose at the goal that was found, and what else was tried."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.solution import PoseOutcome, SpaceGoalPoseRecord, StaticPose
from ccm_opt.space.curve.space_configuration import SpaceConfiguration
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.space_solution import GoalErrors, goal_errors


@dataclass(frozen=True, eq=False)
class SpaceStaticPose:
    """The best pose that was found at the goal of a problem in space, whatever motion would lead to it.

    Attributes:
        problem: what was asked.
        pose: the pose, and what the NLP said about it.
        curve: the curve whose mean directions its links have.
        nearest: link and obstacle, or two links, that are nearest to each other, with their gap, in words.
        residuals: by how much the pose misses each of the user's constraints at the goal, soft ones too, by name.
        outcomes: of every beginning, the best first; the pose is that of the first.
        timings: CPU time of every stage [s].
    """

    problem: SpaceProblem
    pose: SpaceGoalPoseRecord
    curve: SpaceConfiguration
    nearest: str
    residuals: Mapping[str, float]
    outcomes: tuple[PoseOutcome, ...]
    timings: Mapping[str, float]

    @property
    def bends(self) -> FloatArray:
        """The two bends of every joint, shape (links, 2) [rad]."""
        return self.problem.arm.bend_pairs(self.pose.configuration)

    @property
    def feed(self) -> float:
        """Where the base is on its feed axis [m]; 0 without one."""
        return float(self.problem.arm.coordinates.advance(self.pose.configuration))

    @property
    def joint_positions(self) -> FloatArray:
        """Positions of the joints and the tip, shape (links + 1, 3) [m]."""
        return joint_positions(self.problem.arm, self.pose.configuration)

    @property
    def goal_errors(self) -> GoalErrors:
        """How the last link lies at the goal."""
        return goal_errors(self.problem, self.pose.configuration)


AnyStaticPose: TypeAlias = StaticPose | SpaceStaticPose
"""The best pose at a goal in the plane or in space."""
