"""A motion as the viewer plays it: where every link is at any time, and how near to what it may not reach."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.cli.view.view_settings import VIEW, ViewSettings
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import JointStates, JointTrajectory


@dataclass(frozen=True)
class MotionFrames:
    """The poses of a motion.

    Attributes:
        problem: what the motion solves.
        trajectory: in time.
        joints: the same for all drives.
        settings: how many poses are looked at.
    """

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates
    settings: ViewSettings = VIEW

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return float(self.trajectory.time[-1])

    @cached_property
    def points(self) -> FloatArray:
        """Joints and tip at every sample, shape (T, links + 1, 2) [m]."""
        return self.problem.arm.joint_positions_at(self.trajectory.positions)

    def pose(self, time: float) -> FloatArray:
        """Joints and tip at a time [s], shape (links + 1, 2) [m]."""
        arm = self.problem.arm
        columns = [np.interp(time, self.trajectory.time, values) for values in self.trajectory.positions.T]
        return np.asarray(arm.joint_positions_at(np.array(columns)[None])[0])

    def gaps(self, time: float) -> FloatArray:
        """Gap of every link beyond radius and clearance at a time, shape (links,) [m]."""
        return nearest_row(self._gap_times, self._gaps, time)

    def torque_shares(self, time: float) -> FloatArray:
        """Largest torque at every joint as a share of its limit at a time, shape (links,); 0 without limits."""
        return torque_shares_at(self.problem.limits.torque, self.trajectory.time, self.joints.torques, time)

    def swept(self) -> shapely.Geometry:
        """The region that the arm sweeps, as far as some of its poses show it."""
        chosen = np.linspace(0, len(self.points) - 1, self.settings.tube_frames).astype(int)
        radius = max(self.problem.arm.radius, self.settings.thin_arm * self.problem.arm.length)
        bodies = shapely.buffer(shapely.linestrings(self.points[chosen]), radius, quad_segs=self.settings.curved)
        return shapely.union_all(bodies)

    @cached_property
    def _gap_times(self) -> FloatArray:
        count = min(self.settings.frames, len(self.trajectory.time))
        return np.asarray(self.trajectory.time[np.linspace(0, len(self.trajectory.time) - 1, count).astype(int)])

    @cached_property
    def _gaps(self) -> FloatArray:
        """Gap of every link at some times, shape (F, links) [m]."""
        arm = self.problem.arm
        workspace = self.problem.workspace
        chosen = np.searchsorted(self.trajectory.time, self._gap_times)
        points = self.points[chosen]
        links = shapely.linestrings(np.stack((points[:, :-1], points[:, 1:]), axis=2))
        walls = [(wall.core, wall.rounding) for wall in workspace.walls]
        gaps = np.min([shapely.distance(links, core) - rounding for core, rounding in walls], axis=0)
        return np.asarray(gaps - arm.radius - workspace.clearance)


def nearest_row(times: FloatArray, rows: FloatArray, time: float) -> FloatArray:
    """The row that belongs to the time nearest to a given one."""
    return np.asarray(rows[int(np.argmin(np.abs(times - time)))])


def torque_shares_at(limit: FloatArray | None, times: FloatArray, torques: FloatArray, time: float) -> FloatArray:
    """Largest torque at every joint as a share of its limit at a time, shape (links,); 0 without limits.

    Args:
        limit: of every revolute, shape (3 links,) [N m], or None.
        times: of the samples, shape (T,) [s].
        torques: shape (T, 3 links) [N m].
        time: of the motion [s].
    """
    links = torques.shape[1] // 3
    if limit is None:
        return np.zeros(links)
    return nearest_row(times, (np.abs(torques) / limit).reshape(len(torques), links, 3).max(axis=2), time)
