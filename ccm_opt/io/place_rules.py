"""Checks of places in a problem file: outside the workspace, inside obstacles, or of a size that looks wrong."""

from collections.abc import Mapping
from typing import cast

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, message_unit
from ccm_opt.io.issues import Issues
from ccm_opt.problem import ImportedDrawing
from ccm_opt.problem.field_types import odd_times
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.enclosures import enclosure_advice
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.surfaces import box_about
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, PlaneScan, PlaneShape, Workspace

_DEPTH_ROUNDING = 1e-9
"""Depth inside an obstacle that is attributed to rounding, as a fraction of the workspace's size. Derived: a
thousandth of the contact tolerance of the verifier."""
_SLIPS = (1e-3, 1e3, 1.0 / 25.4, 25.4)
"""Ratios of typical errors of scale: millimetres confused with metres or with inches."""
_TINY_SHARE = 0.01
"""Minimum size of a rescaled drawing, as a fraction of the workspace's size, for the new scale to be plausible."""


def outside_message(
    file: str, box: FloatArray, origin: FloatArray, room: FloatArray, unit: LengthUnit, *, scale: float, keys: str
) -> str:
    """Return the message that a drawing or mesh lies entirely outside the workspace, with a correction.

    Args:
        file: name of the file.
        box: lower and upper corner of the drawing's or mesh's bounding box, d = 2 or 3, shape (2, d) [m].
        origin: position of the drawing's or mesh's own origin, shape (d,) [m].
        room: lower and upper corner of the workspace, shape (2, d) [m].
        unit: unit of length of the problem file.
        scale: length of one unit of the drawing or mesh, in ``unit``.
        keys: key of the scale and key of the position, separated by a blank.
    """
    scale_key, place_key = keys.split()
    place = (origin + room.mean(axis=0) - box.mean(axis=0)) / METRES[unit]
    message = (
        f"{file} lies entirely outside the workspace: it spans {_span(box, unit)}, the workspace "
        f"{_span(room, unit)}; {place_key} = [{', '.join(f'{value:.6g}' for value in place)}] would centre "
        "it"
    )
    for slip in _SLIPS:
        slipped = origin + slip * (box - origin)
        fits = np.all(slipped[0] >= room[0]) and np.all(slipped[1] <= room[1])
        if fits and np.ptp(slipped, axis=0).max() > _TINY_SHARE * np.ptp(room, axis=0).max():
            return f"{message}, {scale_key} = {scale * slip:.6g} would bring it inside"
    return message


def _span(box: FloatArray, unit: str) -> str:
    return f"{' to '.join(_place(corner, unit) for corner in box)} {unit}"


def _place(point: FloatArray, unit: str) -> str:
    return f"({', '.join(f'{value:.4g}' for value in point / METRES[unit])})"


def check_drawing(
    drawing: ImportedDrawing, offset: FloatArray, scale: float, room: shapely.Polygon, unit: LengthUnit, issues: Issues
) -> None:
    """Report a drawing that lies entirely outside the workspace, where its obstacles would silently have no effect.

    Args:
        drawing: report on the imported drawing.
        offset: position of the drawing's origin, shape (2,), in ``unit``.
        scale: length of one unit of the drawing, in ``unit``.
        room: boundary of the workspace [m].
        unit: unit of length of the problem file.
        issues: receives the defect.
    """
    if not shapely.intersects(room, shapely.box(*drawing.box)):
        boxes = np.reshape(drawing.box, (2, 2)), METRES[unit] * offset, np.reshape(room.bounds, (2, 2))
        keys = "workspace.scale workspace.offset"
        issues.add(("workspace", "file"), outside_message(drawing.file, *boxes, unit, scale=scale, keys=keys))


def check_meshes(
    meshes: Mapping[int, MeshBody | PlaneShape], room: FloatArray, unit: LengthUnit, issues: Issues
) -> None:
    """Report meshes and scans that lie entirely outside the workspace, where they would silently have no effect.

    Args:
        meshes: meshes, or scans in the plane, by the index of the obstacle in the file.
        room: lower and upper corner of the workspace, shape (2, d) [m].
        unit: unit of length of the problem file.
        issues: receives the defects.
    """
    for number, body in meshes.items():
        box = box_about(body.vertices)
        if np.any(box[0] > room[1]) or np.any(box[1] < room[0]):
            if isinstance(body, MeshBody):
                file, scale, origin = body.file, body.scale, body.placement.position
                key = "mesh" if body.balls is None else "points"
            else:
                scan = cast("PlaneScan", body.scan)
                file, scale, origin, key = scan.file, scan.scale, np.array(scan.origin), "points"
            keys = "scale pose.position"
            message = outside_message(file, box, origin, room, unit, scale=scale / METRES[unit], keys=keys)
            issues.add(("workspace", "obstacles", number, key), message)


def check_base(
    workspace: Workspace,
    base: FloatArray,
    arm_length: float,
    issues: Issues,
    drawing: ImportedDrawing | None = None,
) -> None:
    """Report an arm base that lies inside an obstacle or outside the workspace; a base that touches a wall is allowed.

    Args:
        workspace: the workspace.
        base: position of the base at the start of the motion, shape (2,) or (3,) [m].
        arm_length: length of the arm [m].
        issues: receives the defects.
        drawing: report on the drawing whose shapes are the last obstacles of the workspace; None without a drawing.
    """
    unit = message_unit()
    if workspace.dimension == 3:
        size = max(float(np.ptp(workspace.extent, axis=0).max()), arm_length)
        depths = [depth_inside(obstacle.body, base) for obstacle in workspace.obstacles]
        bounds = workspace.bounds
        away = np.zeros(3) if bounds is None else np.maximum(np.maximum(bounds[0] - base, base - bounds[1]), 0.0)
        outside, room = float(np.linalg.norm(away)), ROOM_NAME
        where = f"the base at {_place(base, unit)} {unit}"
    else:
        xmin, ymin, xmax, ymax = workspace.boundary.bounds
        size = max(xmax - xmin, ymax - ymin)
        depths = [_depth_inside(obstacle, base) for obstacle in workspace.obstacles]
        outside, room = -_depth_inside(Obstacle(BOUNDARY_NAME, PlaneShape(workspace.boundary)), base), BOUNDARY_NAME
        where = "the base"
    rounding = _DEPTH_ROUNDING * size
    for k, depth in enumerate(depths):
        if depth > rounding:
            message = f"{where} is {file_length(depth)} inside '{workspace.obstacles[k].name}'"
            issues.add(("arm", "base"), f"{message}; {_way_out(workspace, k, drawing)}")
    if outside > rounding:
        advice = "move the base inside"
        if drawing is not None:
            low, high = np.reshape(drawing.box, (2, 2))
            advice += f", or move or scale {drawing.file} by workspace.offset and workspace.scale: it lies from "
            advice += f"{_place(low, unit)} to {_place(high, unit)} {unit}"
        issues.add(("arm", "base"), f"{where} is {file_length(outside)} outside the {room}; {advice}")


def _way_out(workspace: Workspace, number: int, drawing: ImportedDrawing | None) -> str:
    """Return a phrase that advises the user how to get the arm's base out of an obstacle.

    Args:
        workspace: the workspace.
        number: index of the obstacle.
        drawing: report on the drawing whose shapes are the last obstacles of the workspace; None without a drawing.
    """
    if workspace.dimension == 3:
        return " or ".join(enclosure_advice(workspace, workspace.obstacles[number].name, "it"))
    if drawing is None or number < len(workspace.obstacles) - drawing.obstacles:
        return "move the base out"
    return (
        f"move the base out; if that outline of {drawing.file} bounds the workspace, set workspace.closed = "
        '"room"; if it is a line, "walls"'
    )


def _depth_inside(obstacle: Obstacle, point: FloatArray) -> float:
    """Return how deep a point lies inside a planar obstacle [m]; for a point outside, minus its distance."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # warns of coordinates like 1e-320, but is right
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def odd_mesh_size(file: str, vertices: FloatArray, arm_length: float) -> str | None:
    """Return a warning if the size of a mesh, compared with the arm's length, suggests a wrong scale; else None.

    Args:
        file: file of the mesh.
        vertices: its vertices, or the points of a scan, shape (n, d) [m].
        arm_length: length of the arm [m].
    """
    extent = float(np.ptp(vertices, axis=0).max())
    if (times := odd_times(extent / arm_length)) is None:
        return None
    return (
        f"the mesh {file} spans {extent:.4g} m, {times} than the arm's {arm_length:.4g} m; check "
        "scale, the length of one unit of the mesh (0.001 for a mesh in millimetres and a problem file in "
        "metres)"
    )
