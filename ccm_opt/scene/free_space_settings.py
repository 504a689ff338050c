"""Settings for the approximation of planar free space, its routes and its corridors."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FreeSpaceSettings:
    """Settings for the approximation of planar free space and for the measurement of paths.

    Attributes:
        corner_quad_segs: polygon sides per quarter turn around corners, instead of tangents; 0 for tangents and circles
            with few vertices. Heuristic: with 24, only 0.06 % of the inflation is given away.
        dent: depth up to which dents of free space are filled, as a fraction of the inflation. Heuristic.
        edge_samples: number of points on each edge of the triangulation, ends included, between which paths are
            measured before their shortest form is computed. Heuristic; the cost of a walk grows with the square of this
            number.
        bisections: number of times that a straight piece which meets a wall is halved before the shortest walk is used
            instead. Heuristic.
    """

    corner_quad_segs: int = 0
    dent: float = 0.02
    edge_samples: int = 7
    bisections: int = 6


DEFAULT_FREE_SPACE = FreeSpaceSettings()
"""Default settings of free space, with few vertices."""
FINE_FREE_SPACE = FreeSpaceSettings(corner_quad_segs=24, dent=0.0)
"""Settings with many vertices and almost no free space given away, for passages that barely let the arm through."""
