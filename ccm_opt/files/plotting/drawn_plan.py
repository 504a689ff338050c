"""What pictures and films show of a plan, whether it was just made or is read from its folder."""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import JointTrajectory, NearPlace, Solution


@dataclass(frozen=True)
class DrawnPlan:
    """What pictures show of a plan.

    Attributes:
        problem: what was asked.
        trajectory: the motion.
        points: joints and tip at every sample, shape (T, links + 1, 2) [m].
        curves: behind the planner's keyframes, in order; may be none.
        nearest: where the least gap is; None where nobody measured it or nothing is near.
        simulated: joints and tip of the simulated arm in space, shape (T, links + 1, 3) [m]; None where it was not.
    """

    problem: Problem
    trajectory: JointTrajectory
    points: FloatArray
    curves: tuple[Configuration, ...] = ()
    nearest: NearPlace | None = None
    simulated: FloatArray | None = None

    @classmethod
    def from_solution(cls, solution: Solution) -> "DrawnPlan":
        """What a solution shows."""
        near = None if solution.room is None or not solution.room.nearest.link else solution.room.nearest
        return cls(solution.problem, solution.trajectory, solution.joint_positions, solution.path.curves, near)

    @property
    def nearest_point(self) -> FloatArray | None:
        """Half-way between the two bodies at the time of their least gap, shape (2,) [m]."""
        near = self.nearest
        if near is None:
            return None
        at = [np.interp(near.time, self.trajectory.time, column) for column in self.trajectory.positions.T]
        pose = self.problem.arm.joint_positions_at(np.array(at))
        link = shapely.LineString(pose[near.link - 1 : near.link + 1])
        if near.second_link:
            other: shapely.Geometry = shapely.LineString(pose[near.second_link - 1 : near.second_link + 1])
        else:
            walls = (wall for wall in self.problem.workspace.walls if wall.name == near.obstacle)
            wall = next(walls, None)
            if wall is None:
                return None
            other = wall.core
        middle: FloatArray = shapely.get_coordinates(shapely.shortest_line(link, other)).mean(axis=0)
        return middle
