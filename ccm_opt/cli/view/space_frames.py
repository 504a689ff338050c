"""A motion in space as the viewer plays it: where every link is at any time, and how near to surfaces."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.cli.view.frames import nearest_row, torque_shares_at
from ccm_opt.cli.view.view_settings import VIEW, ViewSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.solution import JointStates, JointTrajectory
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceProblem


@dataclass(frozen=True)
class SpaceFrames:
    """The poses of a motion in space; attributes as of ``MotionFrames``."""

    problem: SpaceProblem
    trajectory: JointTrajectory
    joints: JointStates
    settings: ViewSettings = VIEW

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return float(self.trajectory.time[-1])

    @cached_property
    def points(self) -> FloatArray:
        """Joints and tip at every sample, shape (T, links + 1, 3) [m]."""
        return joint_positions(self.problem.arm, self.trajectory.positions)

    def pose(self, time: float) -> FloatArray:
        """Joints and tip at a time [s], shape (links + 1, 3) [m]."""
        columns = [np.interp(time, self.trajectory.time, values) for values in self.trajectory.positions.T]
        return joint_positions(self.problem.arm, np.array(columns))

    def gaps(self, time: float) -> FloatArray:
        """Gap of every link beyond radius and clearance at a time, as far as is looked, shape (links,) [m]."""
        return nearest_row(self._gap_times, self._gaps, time)

    def torque_shares(self, time: float) -> FloatArray:
        """Largest torque at every joint as a share of its limit at a time, shape (links,); 0 without limits."""
        return torque_shares_at(self.problem.limits.torque, self.trajectory.time, self.joints.torques, time)

    @cached_property
    def _gap_times(self) -> FloatArray:
        return np.asarray(self.trajectory.time[self._chosen])

    @cached_property
    def _chosen(self) -> FloatArray:
        count = min(self.settings.frames, len(self.trajectory.time))
        return np.linspace(0, len(self.trajectory.time) - 1, count).astype(int)

    @cached_property
    def _gaps(self) -> FloatArray:
        """Gap of every link at some times, shape (F, links) [m]."""
        problem = self.problem
        arm = problem.arm
        points = self.points[self._chosen]
        segments = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
        kept = arm.radius + problem.workspace.clearance
        reach = kept + arm.link_length
        away = SurfaceTree.of(problem.workspace.soup).distances(segments, reach)
        return np.asarray(np.minimum(away, reach).reshape(len(points), arm.links) - kept)
