"""The corridor of overlapping convex regions around a route: where the environment divides the arm (section 4.1).

Candidates are the regions grown from the cells on the route and from the edges between them. Each covers a span of
the taut string; as few as overlap well are kept, and each overlap gets a portal, a chord that the taut string
crosses.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.freespace.corridor import ConvexRegion, Corridor, Route
from ccm_opt.freespace.cover import Cover, RegionSpan
from ccm_opt.freespace.free_space_settings import DEFAULT_FREE_SPACE, FreeSpaceSettings
from ccm_opt.freespace.partition import Partition, merge
from ccm_opt.freespace.regions import grow
from ccm_opt.freespace.taut_stations import TautString
from ccm_opt.freespace.triangulation import Triangulation
from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class CorridorMaker:
    """Makes corridors in one triangulated free space; cells and grown regions are kept for the next route.

    Attributes:
        triangulation: of free space.
        slack: how far beside the regions the taut string may cut a corner [m]; must be less than the inflation by which
            the obstacles were grown, so that no obstacle fits in between.
        settings: numbers of the choice of regions.
    """

    triangulation: Triangulation
    slack: float = 0.0
    settings: FreeSpaceSettings = DEFAULT_FREE_SPACE

    @cached_property
    def partition(self) -> Partition:
        """The convex cells."""
        return merge(self.triangulation)

    @cached_property
    def _room(self) -> FloatArray:
        """The bounding box of free space, counter-clockwise, shape (4, 2) [m]."""
        x0, y0 = self.triangulation.vertices.min(axis=0)
        x1, y1 = self.triangulation.vertices.max(axis=0)
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])

    @cached_property
    def _grown(self) -> dict[bytes, ConvexRegion]:
        return {}

    def grown(self, seed: FloatArray) -> ConvexRegion:
        """The region grown from a convex free polygon or segment, vertices (m, 2) [m]."""
        key = seed.tobytes()
        if key not in self._grown:
            self._grown[key] = grow(seed, self.triangulation.walls, self._room, self.settings)
        return self._grown[key]

    def corridor_along(self, route: Route, path: FloatArray | None = None) -> Corridor:
        """The corridor of a route, with as few regions as overlap well.

        Args:
            route: its sleeve names the cells.
            path: the free part of the route's taut string, shape (k, 2) [m]; the whole string by default.

        Returns:
            Regions in order, the first holding the path's start, the last its end, and their directed portals.
        """
        edges = self.triangulation.portals(route.sleeve)
        taut = TautString.through(edges, route.taut if path is None else path, self.settings)
        # Portals need not be wider than the route allows; without an edge to cross any width is wide enough.
        narrowest = float(np.min(np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1), initial=np.inf))
        cover = Cover(self._candidates(route.sleeve, edges, taut), taut, self.slack, self.settings)
        kept = cover.sequence(self.settings.portal_width * narrowest)
        return Corridor(route, tuple(cover.candidates[k].region for k in kept), cover.portals(kept))

    def _candidates(self, sleeve: tuple[int, ...], edges: FloatArray, taut: TautString) -> list[RegionSpan]:
        """Regions grown from the cells along a sleeve and, in between, from the edges where the cell changes."""
        cells = self.partition.cell_of[list(sleeve)]
        changes = np.flatnonzero(np.diff(cells))
        times = np.concatenate(([0.0], taut.crossings[changes], [taut.length]))
        found: list[RegionSpan] = []
        for k, cell in enumerate(cells[np.concatenate((changes, [len(cells) - 1]))]):
            inside = self.grown(self.partition.cells[cell])
            found.append(RegionSpan.around(inside, times[k], times[k + 1], taut, self.slack))
            if k < len(changes):
                # A region grown from the edge itself overlaps both neighbours, where their own overlap may be thin.
                across = self.grown(edges[changes[k]])
                found.append(RegionSpan.around(across, times[k + 1], times[k + 1], taut, self.slack))
        return found
