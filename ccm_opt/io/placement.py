"""Checks of where base, drawing and meshes of a problem lie."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES, LengthUnit, file_length, said_unit
from ccm_opt.io.issues import Issues
from ccm_opt.problem import ImportedDrawing
from ccm_opt.problem.field_types import ODD_RATIO
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.enclosures import ways_out
from ccm_opt.scene.distances.insides import depth_inside
from ccm_opt.scene.surfaces import box_about
from ccm_opt.scene.workspace import BOUNDARY_NAME, ROOM_NAME, Obstacle, PlaneShape, Workspace

_DEPTH_ROUNDING = 1e-9
"""Depths below this share of the room are rounding. Derived: a thousandth of the contact tolerance of the verifier."""
_SLIPS = (1e-3, 1e3, 1.0 / 25.4, 25.4)
"""Factors by which scales are off where millimetres are taken for metres or inches, or the other way round."""
_TINY_SHARE = 0.01
"""What would be smaller than this share of the room is not what was meant."""


@dataclass(frozen=True)
class PlacedFile:
    """A drawing or a mesh as it lies in the room.

    Attributes:
        name: of the file.
        box: least and greatest corner, shape (2, d) [m].
        origin: where its own origin lies, shape (d,) [m].
        scale: length of one of its units, in the problem file's.
        scale_key: that says so.
        place_key: that says where its origin lies.
    """

    name: str
    box: FloatArray
    origin: FloatArray
    scale: float
    scale_key: str
    place_key: str

    def told_outside(self, room: FloatArray, unit: str) -> str:
        """Say that it lies wholly outside a room, shape (2, d) [m], and what would bring it in."""
        place = (self.origin + room.mean(axis=0) - self.box.mean(axis=0)) / METRES[unit]
        told = (
            f"{self.name} lies wholly outside the room: it spans {_span(self.box, unit)}, "
            f"the room {_span(room, unit)}; "
            f"{self.place_key} = [{', '.join(f'{value:.6g}' for value in place)}] would put it into the middle"
        )
        for slip in _SLIPS:
            box = self.origin + slip * (self.box - self.origin)
            fits = np.all(box[0] >= room[0]) and np.all(box[1] <= room[1])
            if fits and np.ptp(box, axis=0).max() > _TINY_SHARE * np.ptp(room, axis=0).max():
                return f"{told}, or {self.scale_key} = {self.scale * slip:.6g} would bring it in as it is placed"
        return told


def _span(box: FloatArray, unit: str) -> str:
    return f"{' to '.join(_place(corner, unit) for corner in box)} {unit}"


def _place(point: FloatArray, unit: str) -> str:
    return f"({', '.join(f'{value:.4g}' for value in point / METRES[unit])})"


def check_drawing(
    drawing: ImportedDrawing, offset: FloatArray, scale: float, room: shapely.Polygon, unit: LengthUnit, issues: Issues
) -> None:
    """Refuse a drawing that lies wholly outside the room: nobody means to plan without it.

    Args:
        drawing: what became of it.
        offset: where its origin lies, shape (2,), in the file's unit.
        scale: length of one of its units, likewise.
        room: the boundary [m].
        unit: of the file.
        issues: receives what is wrong.
    """
    if not shapely.intersects(room, shapely.box(*drawing.box)):
        box = np.reshape(drawing.box, (2, 2))
        placed = PlacedFile(drawing.file, box, METRES[unit] * offset, scale, "workspace.scale", "workspace.offset")
        issues.add(("workspace", "file"), placed.told_outside(np.reshape(room.bounds, (2, 2)), unit))


def check_meshes(meshes: Mapping[int, MeshBody], room: FloatArray, unit: LengthUnit, issues: Issues) -> None:
    """Refuse meshes that lie wholly outside the room, shape (2, 3) [m]: nobody means to plan without them."""
    for number, body in meshes.items():
        box = box_about(body.vertices)
        if np.any(box[0] > room[1]) or np.any(box[1] < room[0]):
            scale = body.scale / METRES[unit]
            placed = PlacedFile(body.file, box, body.placement.position, scale, "scale", "pose.position")
            issues.add(("workspace", "obstacles", number, "mesh"), placed.told_outside(room, unit))


def check_base(
    workspace: Workspace,
    base: FloatArray,
    arm_length: float,
    issues: Issues,
    drawing: ImportedDrawing | None = None,
) -> None:
    """Refuse a base inside an obstacle or outside the room; it may touch walls, as the mount does.

    Args:
        workspace: the room.
        base: where the motion begins, shape (d,) [m].
        arm_length: length of the arm [m].
        issues: receives what is wrong.
        drawing: the drawing that the last obstacles come from, if there is one.
    """
    unit = said_unit()
    if workspace.dimension == 3:
        size = max(float(np.ptp(workspace.extent, axis=0).max()), arm_length)
        depths = [depth_inside(obstacle.body, base) for obstacle in workspace.obstacles]
        outside, room = _depth_outside(workspace.bounds, base), ROOM_NAME
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
            told = f"{where} is {file_length(depth)} inside '{workspace.obstacles[k].name}'"
            issues.add(("arm", "base"), f"{told}; {_way_out(workspace, k, drawing)}")
    if outside > rounding:
        issues.add(("arm", "base"), f"{where} is {file_length(outside)} outside the {room}; move it in")


def _way_out(workspace: Workspace, number: int, drawing: ImportedDrawing | None) -> str:
    """What brings the base out of an obstacle."""
    if workspace.dimension == 3:
        return " or ".join(ways_out(workspace, workspace.obstacles[number].name, "it"))
    if drawing is None or number < len(workspace.obstacles) - drawing.obstacles:
        return "move it out"
    return (
        f"move it out; where that outline of {drawing.file} is no solid but the room, set workspace.closed = "
        '"room", where it is a line, "walls"'
    )


def _depth_inside(obstacle: Obstacle, point: FloatArray) -> float:
    """How far a point is inside an obstacle of the plane [m]; negative outside, minus the distance to it."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # of coordinates like 1e-320, whose distances are right all the same
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def _depth_outside(bounds: FloatArray | None, point: FloatArray) -> float:
    """How far a place is outside a room in space [m]; not above 0 inside of it, or where there is none."""
    if bounds is None:
        return 0.0
    return float(np.linalg.norm(np.maximum(np.maximum(bounds[0] - point, point - bounds[1]), 0.0)))


def odd_mesh_size(body: MeshBody, arm_length: float) -> str | None:
    """A warning where a mesh is so much larger or smaller than the arm that its scale must be wrong.

    Args:
        body: the mesh.
        arm_length: length of the arm [m].
    """
    extent = float(np.ptp(body.vertices, axis=0).max())
    ratio = extent / arm_length
    if ODD_RATIO**-1 < ratio < ODD_RATIO:
        return None
    larger = ratio > 1.0
    times = f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"
    return (
        f"{body.file} is {times} than the arm is long: {extent:.4g} m against {arm_length:.4g} m; is scale the length "
        "of one unit of the mesh? (0.001 where the mesh is in millimetres and the file in metres)"
    )
