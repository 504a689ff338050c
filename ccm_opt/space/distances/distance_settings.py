"""Settings of distances in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DistanceSettings:
    """Numbers of the hierarchy of boxes and of its walks.

    Attributes:
        leaf: triangles in a box that is not cut any more, at most. Measured by ``tests/benchmarks/bench_surfaces.py``:
            two to sixteen are within a tenth of each other, and larger leaves take less memory.
        most_planes: half-spaces about a segment, at most. Taste: what lies beyond the nearest fourteen rarely binds.
        behind: depth by which a surface may stand out from behind a plane and still counts as behind it, as a share of
            the reach. Taste: a fine mesh of a curved wall gives a few planes instead of one a triangle.
        slack: by how much a surface may be farther than the nearest and still be taken for it where half-spaces are
            sought, as a share of the reach. Measured by ``tests/benchmarks/bench_surfaces.py`` along a fine duct.
    """

    leaf: int = 8
    most_planes: int = 14
    behind: float = 0.07
    slack: float = 0.01


DEFAULT_DISTANCES = DistanceSettings()
"""The numbers that are used unless others are given."""
