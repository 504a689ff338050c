"""Poses of a motion over time for the viewer, with clearances and torques, and meshes of planar shapes."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.cli.view.settings import VIEW
from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.frames import drive_torque_limits, drive_torques
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.tool_links import BodyChain, drawn_radii, points_with_tool
from ccm_opt.viz.arm_drawing import radius_runs

_TUBE_FRAMES = 200
"""Number of poses whose union approximates the swept region."""
_FAR = 0.1
"""Largest clearance that is measured in space, as a fraction of the arm's length."""


@dataclass(frozen=True)
class MotionFrames:
    """Poses, clearances and torques of a motion with T samples, for display.

    The arm has m parts: its links and the parts of its tool and other bodies, in the order of ``BodyChain``.

    Attributes:
        problem: the problem.
        trajectory: the timed motion.
        joints: states of all revolute joints over the motion.
    """

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.trajectory.time[-1])

    @cached_property
    def chain(self) -> BodyChain:
        """Links of the arm and parts of its bodies."""
        return BodyChain.of(self.problem.arm)

    @cached_property
    def points(self) -> FloatArray:
        """Ends of all parts at every sample, the last of them the tip, shape (T, m + 1, d) with d = 2 or 3 [m]."""
        return points_with_tool(self.problem.arm, self.trajectory.positions)

    def pose(self, time: float) -> FloatArray:
        """Return the ends of all parts at a time [s], shape (m + 1, d) with d = 2 or 3 [m]."""
        return points_with_tool(self.problem.arm, self.configuration(time))

    def configuration(self, time: float) -> FloatArray:
        """Return the configuration at a time [s], shape (c,) [rad, m]."""
        return np.array([np.interp(time, self.trajectory.time, values) for values in self.trajectory.positions.T])

    def gaps(self, time: float) -> FloatArray:
        """Return the clearance of every part to obstacles, beyond the required one, near a time [s]; shape (m,) [m].

        In space, values are capped at a part of the arm's length. Bare parts have the cap, or inf.
        """
        return _nearest_row(self.inspected_times, self._gaps, time)

    @property
    def inspected_times(self) -> FloatArray:
        """Times of the F samples at which clearances are measured, shape (F,) [s]."""
        return np.asarray(self.trajectory.time[self._inspected_samples])

    @cached_property
    def least_gaps(self) -> FloatArray:
        """Least clearance of the arm beyond its mount at the F inspected samples, as in ``gaps``, shape (F,) [m]."""
        return np.asarray(np.min(self._gaps[:, self._inspected_parts], axis=1, initial=np.inf))

    @cached_property
    def largest_torques(self) -> FloatArray:
        """Largest torque at the F inspected samples, as a percentage of its limit or, without limits, [N m]; (F,)."""
        if self.problem.limits.torque is not None:
            return np.array([100.0 * self.torque_shares(time).max() for time in self.inspected_times])
        return np.asarray(np.abs(self.joints.torques[self._inspected_samples]).max(axis=1))

    def nearest(self, configuration: FloatArray) -> tuple[float, str, str]:
        """Return the least clearance beyond the required one [m] in a pose, and the names of part and obstacle.

        The clearance is inf, and the names are empty, without obstacles in reach.
        """
        workspace, arm = self.problem.workspace, self.problem.arm
        points = points_with_tool(arm, configuration)
        parts = np.flatnonzero(self._inspected_parts)
        axes = np.stack((points[:-1], points[1:]), axis=1)[parts]
        if not len(axes):
            return np.inf, "", ""
        kept = self.chain.radii[parts] + workspace.clearance
        if workspace.dimension == 3:
            near = self._tree.nearest(axes, arm.length)
            gaps = np.where(near.owner >= 0, near.gap - kept, np.inf)
            part = int(np.argmin(gaps))
            name = workspace.triangle_soup.names[near.owner[part]]
        else:
            lines = shapely.linestrings(axes)
            away = np.array([shapely.distance(lines, wall.core) - wall.rounding for wall in workspace.walls])
            wall, part = divmod(int(np.argmin(away - kept)), len(parts))
            gaps, name = away[wall] - kept, workspace.walls[wall].name
        if not np.isfinite(gaps[part]):
            return np.inf, "", ""
        nearest = parts[part]
        own = self.chain.names[nearest] or arm.link_name(int(self.chain.carriers[nearest]))
        return float(gaps[part]), own, name

    def most_bent(self, configuration: FloatArray) -> tuple[int, float]:
        """Return the joint, from 0, that is nearest to its limit in a pose, and its bend as a fraction of that."""
        limits = self.problem.arm.bend_limits
        shares = np.abs(configuration[: len(limits)]) / np.where(limits > 0.0, limits, np.inf)
        return int(np.argmax(shares)) // self.problem.arm.bends_a_joint, float(np.max(shares))

    @cached_property
    def _tree(self) -> SurfaceTree:
        return self.problem.workspace.surface_tree

    def torque_shares(self, time: float) -> FloatArray:
        """Return the maximum torque of every ball joint near a time [s], as a fraction of the torque limit, shape (n,).

        The fractions are 0 without torque limits. Joints have those of the drive that moves several.
        """
        torques, limit, arm = self.joints.torques, self.problem.limits.torque, self.problem.arm
        if limit is None:
            return np.zeros(arm.links)
        if arm.sections is not None:
            used = np.abs(drive_torques(arm, torques)) / drive_torque_limits(arm, limit)
            sections = used.reshape(len(torques), len(arm.sections.counts), -1).max(axis=2)
            return _nearest_row(self.trajectory.time, sections[:, np.maximum(arm.sections.section_of_joint, 0)], time)
        if arm.coupled is not None:
            used = np.abs(drive_torques(arm, torques)) / drive_torque_limits(arm, limit)
            of_bends = (used[:, None] * (arm.coupled.ratios != 0.0)).max(axis=2)
            return _nearest_row(self.trajectory.time, of_bends.reshape(len(torques), -1, 2).max(axis=2), time)
        shares = (np.abs(torques) / limit).reshape(len(torques), -1, 3).max(axis=2)
        return _nearest_row(self.trajectory.time, shares, time)

    def swept(self) -> shapely.Geometry:
        """Return the region swept by a planar arm, approximated by the union of evenly spaced poses."""
        chosen = np.linspace(0, len(self.points) - 1, _TUBE_FRAMES).astype(int)
        radii = np.maximum(drawn_radii(self.problem.arm), VIEW.thin_arm * self.problem.arm.length)
        axes = (
            (shapely.linestrings(self.points[chosen, run]), radius)
            for run, radius in radius_runs(np.where(self.chain.bare, 0.0, radii), len(radii))
            if radius > 0.0
        )
        bodies = [shapely.union_all(shapely.buffer(lines, radius, quad_segs=VIEW.curved)) for lines, radius in axes]
        return shapely.union_all(bodies)

    @cached_property
    def _inspected_parts(self) -> BoolArray:
        """Mask of the parts whose clearance matters: those with a body beyond the mount, shape (m,)."""
        return np.asarray(~self.chain.bare & (self.problem.arm.free_shares[self.chain.carriers] == 0.0))

    @cached_property
    def _inspected_samples(self) -> IntArray:
        """Indices of the F samples at which clearances are measured, shape (F,)."""
        samples = len(self.trajectory.time)
        return np.linspace(0, samples - 1, min(VIEW.frames, samples)).astype(int)

    @cached_property
    def _gaps(self) -> FloatArray:
        """Clearance of every part, beyond the required clearance, at the F inspected samples, shape (F, m) [m]."""
        arm, workspace = self.problem.arm, self.problem.workspace
        points = self.points[self._inspected_samples]
        links = np.stack((points[:, :-1], points[:, 1:]), axis=2)
        kept = np.nan_to_num(self.chain.radii) + workspace.clearance
        if workspace.dimension == 3:
            most = _FAR * arm.length
            away = self._tree.distances(links.reshape(-1, 2, 3), float(np.max(kept)) + most)
            return np.where(self.chain.bare, most, np.minimum(away.reshape(links.shape[:2]) - kept, most))
        lines = shapely.linestrings(links)
        gaps = [shapely.distance(lines, wall.core) - wall.rounding for wall in workspace.walls]
        return np.where(self.chain.bare, np.inf, np.min(gaps, axis=0) - kept)


def _nearest_row(times: FloatArray, rows: FloatArray, time: float) -> FloatArray:
    """Return the row of an array whose time is nearest to a given time.

    Args:
        times: times of the rows, shape (k,) [s].
        rows: values, shape (k, n).
        time: the time [s].
    """
    return np.asarray(rows[int(np.argmin(np.abs(times - time)))])


Mesh: TypeAlias = tuple[FloatArray, IntArray]
"""A triangle mesh: vertices, shape (v, 3), and vertex indices of triangles, shape (m, 3)."""


def extruded(shape: shapely.Geometry, near: float, far: float) -> Mesh:
    """Return planar polygons extruded between two depths as a mesh: two lids, and a wall along every ring.

    Args:
        shape: the polygons.
        near: depth of the front lid.
        far: depth of the back lid.
    """
    polygons = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    tiles = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(polygons)))
    lids = shapely.get_coordinates(tiles).reshape(-1, 4, 2)[:, :3]
    rings = map(shapely.get_coordinates, [ring for part in polygons for ring in (part.exterior, *part.interiors)])
    sides = np.concatenate([np.zeros((0, 2, 2)), *(np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings)])
    here, there = in_space(sides, near), in_space(sides, far)
    triangle_soup = (
        in_space(lids, near),
        in_space(lids[:, ::-1], far),
        np.stack((here[:, 0], there[:, 0], here[:, 1]), axis=1),
        np.stack((here[:, 1], there[:, 0], there[:, 1]), axis=1),
    )
    vertices = np.concatenate(triangle_soup).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def cut_away(mesh: Mesh, axis: int, place: float) -> Mesh:
    """Return the part of a mesh on the lower side of a plane across an axis; triangles that cross it are cut.

    Args:
        mesh: the mesh.
        axis: index of the axis, 0 to 2.
        place: coordinate of the plane.
    """
    corners = mesh[0][mesh[1]]
    beyond = corners[:, :, axis] > place
    count = beyond.sum(axis=1)
    kept = [corners[count == 0]]
    for number in (1, 2):
        crossing = corners[count == number]
        # The corner that is alone on its side comes first.
        alone = np.argmax(beyond[count == number] == (number == 1), axis=1)
        crossing = np.take_along_axis(crossing, ((alone[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
        first, others = crossing[:, :1], crossing[:, 1:]
        share = (place - first[..., axis]) / (others[..., axis] - first[..., axis])
        on_plane = first + share[..., None] * (others - first)
        if number == 1:
            kept.append(np.stack((on_plane[:, 0], others[:, 0], others[:, 1]), axis=1))
            kept.append(np.stack((on_plane[:, 0], others[:, 1], on_plane[:, 1]), axis=1))
        else:
            kept.append(np.stack((first[:, 0], on_plane[:, 0], on_plane[:, 1]), axis=1))
    vertices = np.concatenate(kept).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def in_space(points: FloatArray, depth: float) -> FloatArray:
    """Return points of the plane, shape (..., 2), as points in space, shape (..., 3), ``depth`` behind it."""
    return np.stack((points[..., 0], np.full(points.shape[:-1], depth), points[..., 1]), axis=-1)


def rotation_to_axis(directions: FloatArray) -> FloatArray:
    """Return quaternions (w, x, y, z) of the smallest rotations that take the x axis to given unit vectors.

    Args:
        directions: unit vectors, shape (..., 3).

    Returns:
        Quaternions, shape (..., 4).
    """
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    # The axis is x × d; for the opposite direction all half turns are equally small, and that about z is taken.
    back = x < -1.0 + 1e-12
    turns = np.stack((np.where(back, 0.0, 1.0 + x), zero, np.where(back, 0.0, -z), np.where(back, 1.0, y)), axis=-1)
    return np.asarray(turns / np.linalg.norm(turns, axis=-1, keepdims=True))
