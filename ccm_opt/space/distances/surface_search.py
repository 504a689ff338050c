"""What searches the surfaces of a scene: compiled C, or numpy."""

from typing import NamedTuple, Protocol

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.distances.surface_answers import PlaneRows, Witnesses


class SegmentGapCall(NamedTuple):
    """What other compiled code of the package needs to take distances: valid as long as the search is kept.

    Attributes:
        function: address of ``segment_gap`` of nearest_surfaces.c.
        surfaces: address of what it is asked of.
    """

    function: int
    surfaces: int


class SurfaceSearch(Protocol):
    """Searches a hierarchy of boxes; the owner in its answers is a place among the triangles of the leaves."""

    @property
    def gap_call(self) -> SegmentGapCall | None:
        """What compiled code needs to take distances here, as long as the search is kept; None where nothing is."""
        ...

    def distances(self, segments: FloatArray, reach: float, slack: float) -> FloatArray:
        """Least gap of each segment (k, 2, 3), or less by the slack at most, cut off at the reach, shape (k,) [m]."""
        ...

    def nearest(self, segments: FloatArray, reach: float, together: int) -> Witnesses:
        """Where each segment (k, 2, 3) is nearest, or of so many in a row the nearest of them."""
        ...

    def planes(self, segments: FloatArray, reach: float, most: int, behind: float, slack: float) -> PlaneRows:
        """At most so many half-spaces about each segment (k, 2, 3), the nearest first, or nearest but for the slack."""
        ...

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Gaps of the middles of the cells of a grid, the first of which is at ``low``, cut off at the reach [m]."""
        ...
