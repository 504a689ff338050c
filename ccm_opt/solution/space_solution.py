"""Solutions, poses and reach maps in space."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem import Problem
from ccm_opt.robot.space_configuration import SpaceConfiguration
from ccm_opt.solution import JointTrajectory, PoseOutcome, ReachMap, SpaceGoalPoseRecord, StaticPose
from ccm_opt.solution.solution import GoalErrors, goal_errors


class SpacePlan(Protocol):
    """What pictures show of a plan in space, whether it was just made or read."""

    @property
    def problem(self) -> Problem:
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

    problem: Problem
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
        return self.problem.arm.joint_positions_at(self.pose.configuration)

    @property
    def goal_errors(self) -> GoalErrors:
        """How the last link lies at the goal."""
        return goal_errors(self.problem, self.pose.configuration)


AnyStaticPose: TypeAlias = StaticPose | SpaceStaticPose
"""The best pose at a goal in the plane or in space."""


@dataclass(frozen=True, eq=False)
class SpaceReachMap:
    """For each cell of a grid whether a pose was found with the tip in its middle, and with which directions.

    Attributes:
        problem: arm and scene.
        step: width of a cell [m].
        x: middles of the cells along x, shape (nx,) [m].
        y: likewise, shape (ny,) [m].
        z: likewise, shape (nz,) [m].
        directions: of the last link that were tried, unit vectors, shape (K, 3).
        reachable: whether a pose was found, with any direction, shape (nx, ny, nz).
        taken: whether one was found with each direction, shape (nx, ny, nz, K).
        gap: largest room beyond radius and clearance of any pose found in the cell, as far as it was looked at, shape
            (nx, ny, nz) [m]; NaN where there is none.
        proved: whether it is proved that no pose exists, likewise; elsewhere nothing is known where none was found.
        seen: room above which gaps are not told apart [m].
        timings: CPU time by stage [s].
    """

    problem: Problem
    step: float
    x: FloatArray
    y: FloatArray
    z: FloatArray
    directions: FloatArray
    reachable: BoolArray
    taken: BoolArray
    gap: FloatArray
    proved: BoolArray
    seen: float
    timings: Mapping[str, float]

    @property
    def volume(self) -> float:
        """Of the cells in which a pose was found [m³]."""
        return float(self.reachable.sum()) * self.step**3

    @property
    def places(self) -> FloatArray:
        """Middles of all cells, shape (nx, ny, nz, 3) [m]."""
        return np.stack(np.meshgrid(self.x, self.y, self.z, indexing="ij"), axis=-1)


AnyReachMap: TypeAlias = ReachMap | SpaceReachMap
"""Where the tip can be, in the plane or in space."""


def even_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over the sphere, on a spiral of the golden angle, shape (count, 3)."""
    number = np.arange(count) + 0.5
    up = 1.0 - 2.0 * number / max(count, 1)
    across = np.sqrt(1.0 - up**2)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number
    return np.stack((across * np.cos(angle), across * np.sin(angle), up), axis=1)


@dataclass(frozen=True)
class SpaceReachSettings:
    """How it is found out where the tip can be in space.

    Attributes:
        step: width of a cell, as a share of the arm's length, where none is given. Taste: with a base that stands still
            some two thousand cells, in about half a minute.
        directions: that are tried in a cell, where no number is given. Taste: none, for each of them takes as long as
            all of the map without.
        drawn: poses that are drawn, each of which is a beginning in the cell of its tip. Taste: a thousandth of a
            second each; they find what lies beyond narrow places.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        most_cells: of a grid; more are refused. Derived: some minutes of work and 10 MB of arrays.
    """

    step: float = 1.0 / 8.0
    directions: int = 0
    drawn: int = 300
    seen: float = 0.05
    most_cells: int = 200_000


DEFAULT_SPACE_REACH = SpaceReachSettings()
"""Used where no other settings are given."""
