"""A raster of the places where the axis of a link is surely too near to a wall, for many look-ups at once."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import BoolArray, FloatArray

_TO_CORNER = float(np.sqrt(0.5))
"""From the middle of a square of side 1 to its corner."""


@dataclass(frozen=True)
class BlockedRaster:
    """Cells of a square, blocked where all of the cell is nearer to a wall than the axis may be.

    A free cell says little; a blocked one refutes a pose.

    Attributes:
        corner: lower left corner of the square, shape (2,) [m].
        cell: side of a cell [m].
        blocked: by row (y) and column (x); a frame of one cell all round stands for what lies beyond, all blocked.
    """

    corner: FloatArray
    cell: float
    blocked: BoolArray

    @classmethod
    def around(cls, workspace: Workspace, middle: FloatArray, half: float, gap: float, cells: int) -> "BlockedRaster":
        """The raster of a square.

        Args:
            workspace: its walls.
            middle: of the square, shape (2,) [m].
            half: half of its side [m].
            gap: distance that an axis has to keep from walls [m].
            cells: along a side.
        """
        cell = 2.0 * half / cells
        corner = middle - half
        # What is blocked at the middle of a cell by more than its half diagonal is blocked in all of it.
        sure = gap - _TO_CORNER * cell
        square = shapely.box(*corner, *(corner + 2.0 * half))
        near = [wall for wall in workspace.obstacles if shapely.dwithin(wall.core, square, wall.rounding + gap)]
        bodies = [_grown(wall, sure) for wall in near]
        room = shapely.buffer(workspace.boundary, -sure)

        covered = _covered(bodies, corner, cell, cells)
        outside = ~_covered([room], corner, cell, cells)
        blocked = np.ones((cells + 2, cells + 2), dtype=bool)
        blocked[1:-1, 1:-1] = covered | outside
        return cls(corner, cell, blocked)

    def at(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> BoolArray:
        """Whether places of the square are blocked, by their coordinates, both of one shape [m]."""
        side = self.blocked.shape[0]
        scale = 1.0 / self.cell
        column = (x * scale + (1.0 - self.corner[0] * scale)).astype(np.int32)
        row = (y * scale + (1.0 - self.corner[1] * scale)).astype(np.int32)
        found: BoolArray = self.blocked.ravel().take(row * side + column, mode="clip")
        return found


def _grown(wall: Obstacle, by: float) -> shapely.Geometry:
    """A wall grown; GEOS inscribes the arcs, so that what is covered is surely too near."""
    grown: shapely.Geometry = shapely.buffer(wall.core, wall.rounding + by)
    return grown


def _covered(shapes: list[shapely.Geometry], corner: FloatArray, cell: float, cells: int) -> BoolArray:
    """Whether the middle of every cell lies in some polygon, shape (cells, cells).

    Along every row of middles each edge that crosses it adds its sign from the crossing on; where polygons overlap the
    sum is larger than one.
    """
    change = np.zeros((cells, cells + 1), dtype=np.int32)
    start, end = _edges(shapes)
    # In units of cells, with the middles of rows and columns at whole numbers.
    start = (start - corner) / cell - 0.5
    end = (end - corner) / cell - 0.5

    # Half-open in y, so that a row through a vertex meets just one of its two edges.
    first = np.clip(np.ceil(np.minimum(start[:, 1], end[:, 1])), 0, cells).astype(np.intp)
    beyond = np.clip(np.ceil(np.maximum(start[:, 1], end[:, 1])), 0, cells).astype(np.intp)
    count = beyond - first
    edge = np.repeat(np.arange(len(start)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]

    along = (row - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
    crossing = start[edge, 0] + along * (end[edge, 0] - start[edge, 0])
    column = np.clip(np.ceil(crossing), 0, cells).astype(np.intp)
    # Outer rings run counter-clockwise: from left to right a polygon is entered where its edge runs down.
    sign = np.where(end[edge, 1] < start[edge, 1], 1, -1)
    np.add.at(change, (row, column), sign)
    return np.asarray(np.cumsum(change[:, :-1], axis=1, dtype=np.int32) > 0)


def _edges(shapes: list[shapely.Geometry]) -> tuple[FloatArray, FloatArray]:
    """Ends of all edges of the polygons among shapes, outer rings counter-clockwise and holes clockwise."""
    parts = shapely.get_parts(np.array(shapes, dtype=object))
    # What has no area covers nothing for sure.
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]
    rings = shapely.get_rings(shapely.orient_polygons(np.array(polygons, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same]
