"""The surfaces of a scene, and what is asked of them: distances, witnesses, and half-spaces free of them."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arguments import LARGEST
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.distances.distance_settings import DEFAULT_DISTANCES, DistanceSettings
from ccm_opt.space.distances.surface_answers import PlaneRows, Witnesses
from ccm_opt.space.distances.surface_search import SurfaceBoxes, SurfaceSearch
from ccm_opt.space.scene.surfaces import SurfaceSoup

_MOST_TRIANGLES = 2**30
"""Nodes are numbered in 32 bits."""


@dataclass(frozen=True, eq=False)
class SurfaceTree:
    """Triangles with a rounding about them, in a hierarchy of boxes.

    All distances are those of a segment from the triangles less their rounding, and exact within the rounding of
    numbers. Everything is cut off at a reach, and the smaller that is, the shorter the walk. Only surfaces count: a
    segment wholly inside a closed mesh has a positive distance from it. Segments that are not finite are at no distance
    (not a number), so that no comparison takes them for free.

    Attributes:
        owner: number of each triangle's owner, in the order of the leaves, shape (m,).
        search: what walks the boxes; None where there are no triangles.
        settings: numbers of the walks.
    """

    owner: IntArray
    search: SurfaceSearch | None
    settings: DistanceSettings = DEFAULT_DISTANCES

    @classmethod
    def of(cls, soup: SurfaceSoup, settings: DistanceSettings = DEFAULT_DISTANCES) -> "SurfaceTree":
        """The tree over the surfaces of a scene.

        Raises:
            ProblemError: a place is no number, or too far away.
            MemoryError: there is too little.
        """
        if len(soup) == 0:
            return cls(np.zeros(0, dtype=np.intp), None, settings)
        farthest = max(float(np.abs(soup.triangles).max()), float(np.abs(soup.rounding).max()))
        if not farthest <= LARGEST:
            raise ProblemError(
                f"the scene reaches to {farthest:g} m, at most {LARGEST:g} m are taken: is its unit meant?"
            )
        if len(soup) >= _MOST_TRIANGLES:
            raise MemoryError(f"a scene of {len(soup)} triangles: at most {_MOST_TRIANGLES} are taken")
        boxes = SurfaceBoxes.of(soup.triangles, soup.rounding, settings.leaf)
        return cls(soup.owner[boxes.order], SurfaceSearch(boxes), settings)

    def distances(self, segments: FloatArray, reach: float, slack: float = 0.0) -> FloatArray:
        """Least distance of each segment from the surfaces.

        Args:
            segments: ends, shape (k, 2, 3) [m].
            reach: distances are cut off here [m].
            slack: by how much distances may be told less than they are, never more [m]. Along walls that are meshed
                finely a little of it saves most of the time.

        Returns:
            Distances, at most the reach, negative inside a rounding, shape (k,) [m].
        """
        if self.search is None:
            return np.full(len(segments), float(reach))
        return self.search.distances(_checked(segments), reach, slack)

    def nearest(self, segments: FloatArray, reach: float, together: int = 1) -> Witnesses:
        """Where each segment is nearest to a surface, as ``distances``; the owner is −1 where nothing is in reach.

        Args:
            segments: ends, shape (k, 2, 3) [m].
            reach: surfaces at this distance are not looked at [m].
            together: of so many segments in a row only the first of the nearest is asked for; what is told of the
                others may be that nothing is in reach. It takes a fraction of the time.
        """
        if self.search is None:
            k = len(segments)
            none = np.full(k, -1, dtype=np.intp)
            return Witnesses(np.full(k, float(reach)), np.zeros(k), np.zeros((k, 3)), np.zeros((k, 3)), none)
        found = self.search.nearest(_checked(segments, together), reach, together)
        return replace(found, owner=np.where(found.owner < 0, -1, self.owner[found.owner]))

    def planes(
        self, segments: FloatArray, reach: float, most: int | None = None, behind: float | None = None
    ) -> PlaneRows:
        """Half-spaces that hold a segment and are free of the surfaces near it: a convex region about each.

        Surfaces are taken in the order of their distance, but for the slack of the settings. The plane through a
        surface's nearest point, at right angles to the shortest way, is kept; all that lies behind a plane that is kept
        is dropped.

        Args:
            segments: ends, shape (k, 2, 3) [m].
            reach: surfaces at this distance are not looked at [m].
            most: planes a segment, at most; absent: that of the settings.
            behind: what stands out from a plane by no more than this lies behind it [m]; absent: by the settings.
        """
        if self.search is None:
            none = np.zeros(0, dtype=np.intp)
            return PlaneRows(none, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), none)
        most = self.settings.most_planes if most is None else most
        behind = self.settings.behind * reach if behind is None else behind
        slack = self.settings.slack * reach
        found = self.search.planes(_checked(segments), reach, most, behind, slack)
        return replace(found, owner=self.owner[found.owner])

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Distances of the middles of the cells of a grid from the surfaces, as of segments without length.

        Any point of a cell is as far from the surfaces as the middle, less half the cell's diagonal at most.

        Args:
            low: middle of the first cell, shape (3,) [m].
            cell: size of a cell [m].
            counts: number of cells along x, y and z.
            reach: distances are cut off here [m].

        Returns:
            Distances, shape of the counts [m].
        """
        if self.search is None:
            return np.full(counts, float(reach))
        return self.search.grid(low, cell, counts, reach)


def _checked(segments: FloatArray, together: int = 1) -> FloatArray:
    """The segments, which C takes so many in a row.

    Raises:
        ValueError: they have another shape.
    """
    if segments.ndim != 3 or segments.shape[1:] != (2, 3) or together < 1 or len(segments) % together:
        raise ValueError(f"segments have the shape {segments.shape}; expected (k, 2, 3), k a multiple of {together}")
    return segments
