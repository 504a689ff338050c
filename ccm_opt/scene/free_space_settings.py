"""The numbers of free space, its routes and its corridors, in one place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FreeSpaceSettings:
    """How finely free space is drawn, how many classes of paths are looked at, and how regions are chosen.

    Attributes:
        corner_quad_segs: sides of the polygon round a quarter of a turn at corners, in place of tangents; 0 for
            tangents and circles of few vertices. Taste: with 24, only 0.06 % of the inflation is given away.
        dent: depth up to which dents of free space are filled, as a share of the inflation. Taste.
        edge_samples: points on each edge of the triangulation, ends included, between which paths are measured before
            any is drawn taut. Taste; a walk costs its square.
        bisections: times that a straight piece which meets a wall is halved before the shortest walk is taken. Taste.
    """

    corner_quad_segs: int = 0
    dent: float = 0.02
    edge_samples: int = 7
    bisections: int = 6


DEFAULT_FREE_SPACE = FreeSpaceSettings()
"""The numbers that are used unless others are passed."""
FINE_FREE_SPACE = FreeSpaceSettings(corner_quad_segs=24, dent=0.0)
"""Many vertices, but next to nothing given away, where passages hardly let the arm through."""
