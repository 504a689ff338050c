"""Points of scans as balls that cover them."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.surfaces import grid_cells

SPREAD_SHARE = 0.5
"""Distance by which balls may grow to cover points that are left out, as a fraction of the radius of points. Heuristic:
a scan with a point per millimetre and a radius of 5 mm keeps an eighth of them."""
_OCTAHEDRON = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
_MOST_DRAWN = 20_000
"""Number of balls above which fewer, larger ones are drawn. Heuristic: pages stay below some megabytes."""


@dataclass(frozen=True)
class BallRadii:
    """Parts of the radius of the balls about the points of a scan, which add up.

    Attributes:
        point: radius of a point [m].
        error: greatest error of the scan [m].
        spread: greatest distance of a point that was left out from the nearest one that is kept [m].
    """

    point: float
    error: float = 0.0
    spread: float = 0.0

    @property
    def whole(self) -> float:
        """Radius of the balls [m]."""
        return self.point + self.error + self.spread


def thin_points(points: FloatArray, spread: float) -> tuple[FloatArray, float]:
    """Return fewer points, such that every given point is within a distance of one of them, and that distance.

    Points in a cell of a grid are replaced by the centre of the rectangle around them.

    Args:
        points: points, shape (n, d).
        spread: distance that may not be exceeded; 0 merges equal points alone.
    """
    if spread <= 0.0:
        return np.unique(points, axis=0), 0.0
    # The centre of a square or cube is within half of its diagonal of every point in it.
    cell = 2.0 * spread / np.sqrt(float(points.shape[1])) * (1.0 - 1e-9)
    cells = grid_cells(points, cell)
    low, high = np.full((2, cells.max() + 1, points.shape[1]), np.inf)
    high = -high
    np.minimum.at(low, cells, points)
    np.maximum.at(high, cells, points)
    centres = 0.5 * (low + high)
    return centres, float(np.sqrt(np.max(np.sum((points - centres[cells]) ** 2, axis=1))))


def ball_surfaces(points: FloatArray, radius: float) -> tuple[FloatArray, IntArray]:
    """Return the vertices, shape (6 n, 3), and faces, shape (8 n, 3), of an octahedron in the ball about each point.

    Large numbers of points are thinned for it.
    """
    coarser = radius
    while len(points) > _MOST_DRAWN:
        points, spread = thin_points(points, coarser)
        radius, coarser = radius + spread, 1.5 * coarser
    corners = radius * np.concatenate((np.eye(3), -np.eye(3)))[[0, 3, 1, 4, 2, 5]]
    vertices = (points[:, None] + corners).reshape(-1, 3)
    return vertices, (6 * np.arange(len(points))[:, None, None] + _OCTAHEDRON).reshape(-1, 3)
