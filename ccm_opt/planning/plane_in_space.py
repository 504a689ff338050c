"""Problems in the plane planned as problems in space, with bends about one axis alone.

The plane is the x-z plane of the world. The second bend of each joint in space is minus its bend in the plane, the
first is locked at zero, so that no arm leaves the plane; walls become prisms across it. Distances within the plane are
those between the arm and prisms, so that what is certified in space is certified in the plane.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeVar

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Finding, NoPlanFound
from ccm_opt.core.length_words import words_in_plane
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import Goal, JointPose, Problem, TipGoal, VerificationOptions
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.robot.tool import RigidBody, Tool, ToolBody, in_link
from ccm_opt.scene.bodies import Body, CapsuleBody, MeshBody
from ccm_opt.scene.workspace import BOUNDARY_NAME, Obstacle, PlaneShape, Workspace

_Fixed = TypeVar("_Fixed", bound=RigidBody)

_DEPTH = 0.25
"""Least distance of the ends of prisms from the plane, as a fraction of the arm's length. Heuristic."""
_DEPTH_OF_ARM = 4.0
"""The same, in radii of the arm with the clearance. Heuristic: the ends must not bound the clearance."""


def needs_space(arm: Arm) -> bool:
    """Return whether motions of a planar arm are planned in space.

    They are those of sections that bend evenly, and of arms on a feed axis with bodies or locked joints.
    """
    particular = arm.feed is not None and bool(arm.rigid_bodies or np.any(arm.locked_joints))
    return arm.dimension == 2 and (arm.sections is not None or particular)


def problem_in_space(problem: Problem) -> Problem:
    """Return a problem in the plane as a problem in space whose joints bend about the normal of the plane alone.

    Args:
        problem: the problem, whose goal is for the tip or the whole arm.
    """
    arm = problem.arm
    thickest = max(arm.radius, *(part.radius for body in arm.rigid_bodies for part in body.bodies), 0.0)
    wide = thickest + problem.workspace.clearance + problem.wanted_gap
    depth = max(_DEPTH * arm.length, _DEPTH_OF_ARM * wide)
    return replace(
        problem,
        arm=arm_in_space(arm),
        workspace=_workspace(problem.workspace, depth),
        start=_pose(problem.start),
        goal=_goal(problem.goal),
        stops=(),
        coverage=None,
        planner=replace(problem.planner, mapping="least-squares", wanted_gap=problem.wanted_gap),
        verification=VerificationOptions(problem.contact_tolerance),
    )


@contextmanager
def told_in_plane() -> Iterator[None]:
    """Provide a ``with`` block for a problem in the plane that is planned in space, whose places are told in the plane.

    Raises:
        NoPlanFound: raised in the block; places in its diagnosis are in the plane.
    """
    try:
        with words_in_plane():
            yield
    except NoPlanFound as failure:
        findings = tuple(map(_finding, failure.diagnosis.findings))
        raise type(failure)(replace(failure.diagnosis, findings=findings)) from failure


def _finding(finding: Finding) -> Finding:
    """Return a finding in space with its places in the plane."""
    place = finding.place if finding.place is None else finding.place[::2]
    return replace(finding, place=place, way=tuple(each[::2] for each in finding.way))


def path_in_plane(path: JointPath, arm: Arm) -> JointPath:
    """Return the path of a planar arm that corresponds to one in space.

    Args:
        path: path of the arm in space, from ``problem_in_space``.
        arm: the planar arm.
    """
    spline = path.spline
    keyframes = rows_in_plane(path.keyframes, arm.links)
    return replace(
        path,
        spline=type(spline)(spline.t, rows_in_plane(spline.c, arm.links), spline.k),
        keyframes=keyframes,
        curves=nearest_curves(arm, keyframes),
        goal_pose=None,
        parts=tuple(path_in_plane(part, arm) for part in path.parts),
    )


def rows_in_space(values: FloatArray, links: int) -> FloatArray:
    """Return configurations in the plane, shape (K, c), as those in space, shape (K, c + links) [rad, m]."""
    pairs = np.stack((np.zeros((len(values), links)), 0.0 - values[:, :links]), axis=-1)
    return np.hstack((pairs.reshape(len(values), -1), values[:, links:]))


def rows_in_plane(values: FloatArray, links: int) -> FloatArray:
    """Return configurations in space, shape (K, c), as those in the plane, shape (K, c − links) [rad, m]."""
    return np.ascontiguousarray(np.hstack((0.0 - values[:, 1 : 2 * links : 2], values[:, 2 * links :])))


def arm_in_space(arm: Arm) -> Arm:
    """Return a planar arm as one in space, with the first bend of each joint locked."""
    links = arm.links
    shares = np.ones(links) if arm.proportions is None else arm.proportions.limits
    both = np.column_stack((np.zeros(links), shares)).ravel()
    proportions = Proportions(np.ones(links), np.ones(links), both)
    if arm.proportions is not None:
        proportions = replace(arm.proportions, limits=both)
    return replace(
        arm,
        base=arm.base_position,
        base_heading=0.0,
        direction=arm.base_rotation[:, 0],
        up=arm.base_rotation[:, 2],
        axes="zyx",
        proportions=proportions,
        sections=None if arm.sections is None else replace(arm.sections, bends=np.array([[0.0], [-1.0]])),
        bodies=tuple(map(_body, arm.bodies)),
        tool=None if arm.tool is None else _body(arm.tool),
    )


def _body(body: _Fixed) -> _Fixed:
    """Return a body on a link of a planar arm as one in space."""
    parts = tuple(ToolBody(in_link(part.start), in_link(part.end), part.radius) for part in body.bodies)
    found = replace(body, bodies=parts, centre=body.centre_in_space)
    if isinstance(found, Tool):
        return replace(found, tip=in_link(found.tip), direction=in_link(found.direction))
    return found


def _pose(pose: JointPose) -> JointPose:
    return JointPose(np.column_stack((np.zeros(len(pose.bends)), 0.0 - pose.bends)), pose.feed)


def _goal(goal: Goal) -> Goal:
    if goal.for_joints is not None:
        return _pose(goal.for_joints)
    tip = goal.for_tip
    direction = None if tip.direction is None else in_link(tip.direction)
    return TipGoal(in_link(tip.position), direction, name=tip.name)


def _workspace(workspace: Workspace, depth: float) -> Workspace:
    """Return a workspace whose obstacles, and what of the bounding box is not in the room, are prisms.

    Args:
        workspace: workspace in the plane.
        depth: distance of both ends of the prisms from the plane [m].
    """
    low_x, low_z, high_x, high_z = workspace.boundary.bounds
    outside = shapely.difference(shapely.box(*workspace.boundary.bounds), workspace.boundary)
    walls = (*workspace.obstacles, Obstacle(BOUNDARY_NAME, PlaneShape(outside)))
    return Workspace(
        obstacles=tuple(
            Obstacle(wall.name, body) for wall in walls for body in _prisms(wall.core, wall.rounding, depth)
        ),
        clearance=workspace.clearance,
        bounds=np.array([[low_x, -depth, low_z], [high_x, depth, high_z]]),
    )


def _prisms(core: shapely.Geometry, rounding: float, depth: float) -> Iterator[Body]:
    """Yield bodies that together are a planar geometry, inflated by a radius, extended across the plane."""
    for part in shapely.get_parts(core):
        if isinstance(part, shapely.Point):
            ends = [np.array([part.x, y, part.y]) for y in (-depth, depth)]
            yield CapsuleBody(ends[0], ends[1], rounding)
        elif isinstance(part, shapely.Polygon):
            if part.area > 0.0:
                yield replace(_mesh(_prism(part, depth)), margin=rounding)
        elif not part.is_empty:
            triangles = list(_sides(shapely.get_coordinates(part), depth))
            yield replace(_mesh(triangles), margin=rounding, solid=False)


def _prism(polygon: shapely.Polygon, depth: float) -> list[FloatArray]:
    """Return the triangles (3, 3) of the surface of a prism about a polygon, whose normals point out of it."""
    whole = shapely.orient_polygons(polygon)
    found = []
    for tile in shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(whole))):
        corners = shapely.get_coordinates(tile)[:3]
        found += [_across(corners, -depth), _across(corners[::-1], depth)]
    for ring in (whole.exterior, *whole.interiors):
        found += _sides(shapely.get_coordinates(ring), depth)
    return found


def _sides(line: FloatArray, depth: float) -> Iterator[FloatArray]:
    """Yield the triangles (3, 3) that a polyline in the plane, shape (m, 2), sweeps across it; to its right is out."""
    near, far = _across(line, -depth), _across(line, depth)
    for k in range(len(line) - 1):
        yield np.stack((far[k], far[k + 1], near[k + 1]))
        yield np.stack((far[k], near[k + 1], near[k]))


def _across(points: FloatArray, y: float) -> FloatArray:
    """Return points of the plane, shape (m, 2), at a distance from it in the world, shape (m, 3) [m]."""
    return np.column_stack((points[:, 0], np.full(len(points), y), points[:, 1]))


def _mesh(triangles: list[FloatArray]) -> MeshBody:
    """Return the mesh of triangles, each of shape (3, 3), whose common corners are one."""
    vertices, faces = np.unique(np.concatenate(triangles), axis=0, return_inverse=True)
    return MeshBody.of_arrays(vertices, faces.reshape(-1, 3))
