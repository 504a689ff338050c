"""Checks of places in a problem file: the base outside every obstacle. An unreachable goal is no defect of a file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.reading_settings import READING
from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import BOUNDARY_NAME, Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES
from ccm_opt.ground.length_words import file_length
from ccm_opt.problem import ImportedDrawing

_SLIPS = (1e-3, 1e3, 1.0 / 25.4, 25.4)
"""Factors by which scales are off where millimetres are taken for metres or inches, or the other way round."""
_TINY_SHARE = 0.01
"""What would be smaller than this share of the room is not what was meant."""


def depth_inside(obstacle: Obstacle, point: Sequence[float]) -> float:
    """How far a point is inside an obstacle [m]; negative outside, minus the distance to it."""
    place = shapely.Point(point)
    inside_core = isinstance(obstacle.core, shapely.Polygon) and shapely.contains_properly(obstacle.core, place)
    edge = obstacle.core.boundary if isinstance(obstacle.core, shapely.Polygon) else obstacle.core
    with np.errstate(divide="ignore"):  # of coordinates like 1e-320, whose distances are right all the same
        distance = float(shapely.distance(edge, place))
    return obstacle.rounding + (distance if inside_core else -distance)


def depth_outside(workspace: Workspace, point: Sequence[float]) -> float:
    """How far a point is outside the boundary [m]; negative inside, minus the distance to it."""
    return -depth_inside(Obstacle(BOUNDARY_NAME, workspace.boundary), point)


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
    corners = [f"({', '.join(f'{value:.4g}' for value in corner / METRES[unit])})" for corner in box]
    return f"{corners[0]} to {corners[1]} {unit}"


def check_base(
    workspace: Workspace, base: Sequence[float], issues: Issues, drawing: ImportedDrawing | None = None
) -> None:
    """The base may touch walls, as the mount does, but not stand inside an obstacle or outside the room."""
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    rounding = READING.depth_rounding * max(xmax - xmin, ymax - ymin)
    first_drawn = len(workspace.obstacles) - (0 if drawing is None else drawing.obstacles)
    for k, obstacle in enumerate(workspace.obstacles):
        if (depth := depth_inside(obstacle, base)) > rounding:
            advice = "move it out"
            if drawing is not None and k >= first_drawn:
                advice += (
                    f"; where that outline of {drawing.file} is no solid but the room, set workspace.closed = "
                    '"room", where it is a line, "walls"'
                )
            issues.add(("arm", "base"), f"the base is {file_length(depth)} inside '{obstacle.name}'; {advice}")
    if (depth := depth_outside(workspace, base)) > rounding:
        issues.add(("arm", "base"), f"the base is {file_length(depth)} outside the {BOUNDARY_NAME}; move it in")
