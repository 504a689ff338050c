"""How near points are to the walls, from a grid of distances: a guide for climbs, no proof."""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.hill_climbing.climbing_settings import DEFAULT_CLIMBING


@dataclass(frozen=True)
class ClearanceField:
    """Distance of places from the nearest wall, less what the arm needs.

    Attributes:
        corner: of the grid, shape (2,) [m].
        cell: size of a cell [m].
        gaps: at the grid's nodes, shape (columns, rows) [m].
    """

    corner: FloatArray
    cell: float
    gaps: FloatArray

    @classmethod
    def from_workspace(
        cls, workspace: Workspace, need: float, cells: int = DEFAULT_CLIMBING.field_cells
    ) -> "ClearanceField":
        """The field of a room, ``cells`` along its longer side, for an arm that needs a distance ``need`` [m]."""
        xmin, ymin, xmax, ymax = workspace.boundary.bounds
        cell = max(xmax - xmin, ymax - ymin) / cells
        x = np.arange(xmin, xmax + cell, cell)
        y = np.arange(ymin, ymax + cell, cell)
        nodes = np.asarray(shapely.points(*np.meshgrid(x, y, indexing="ij")))
        gaps = np.full(nodes.shape, np.inf)
        for wall in workspace.walls:
            np.minimum(gaps, shapely.distance(nodes, wall.core) - wall.rounding, out=gaps)
        return cls(np.array([xmin, ymin]), cell, gaps - need)

    def gap(self, points: FloatArray) -> FloatArray:
        """Interpolated gaps at points (..., 2) [m]; shape (...). Places outside the room take those at its edge."""
        places = np.moveaxis((points - self.corner) / self.cell, -1, 0)
        gaps: FloatArray = map_coordinates(self.gaps, places, order=1, mode="nearest")
        return gaps
