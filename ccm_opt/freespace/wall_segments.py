"""The walls as one list of segments, each swept by a disc, and which of them enclose solids; with indices over them."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from ccm_opt.freespace.walls import Walls
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.box_tree import BoxTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccm_opt.freespace.obstacle import Obstacle


@dataclass(frozen=True)
class WallSegments:
    """The edges of all walls, and the points of those that have no edge.

    Attributes:
        ends: shape (E, 2, 2) [m].
        rounding: radius of the disc that sweeps each, shape (E,) [m].
        solids: first segment of every wall whose core has an inside, and the one past its last, shape (S, 2).
    """

    ends: FloatArray
    rounding: FloatArray
    solids: IntArray

    @classmethod
    def of(cls, obstacles: "Sequence[Obstacle]", walls: Walls) -> "WallSegments":
        """The segments of walls, given as they are and as arrays of edges and vertices."""
        # A round obstacle is a point swept by a disc: it has no edge, and becomes a segment of length 0.
        lone = ~np.isin(walls.vertex_wall, walls.edge_wall)
        points = np.repeat(walls.vertices[lone][:, None], 2, axis=1)
        owner = np.concatenate((walls.edge_wall, walls.vertex_wall[lone]))

        # The edges come wall by wall; the edge of the room is a line.
        cores: Any = np.array([obstacle.core for obstacle in obstacles])
        solid = np.flatnonzero(shapely.get_type_id(cores) == shapely.GeometryType.POLYGON)
        solids = np.stack([np.searchsorted(walls.edge_wall, solid, side=side) for side in ("left", "right")], axis=1)
        return cls(np.concatenate((walls.edges, points)), walls.rounding[owner], solids)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index of the segments."""
        # A line of length 0 is no valid geometry, so such segments enter the tree as points.
        lone = np.all(self.ends[:, 0] == self.ends[:, 1], axis=1)
        lines: Any = shapely.linestrings(self.ends)
        lines[lone] = shapely.points(self.ends[lone, 0])
        return shapely.STRtree(lines)

    @cached_property
    def boxes(self) -> BoxTree:
        """The same index as flat arrays, for C."""
        return BoxTree.over(self.ends.min(axis=1), self.ends.max(axis=1))

    @cached_property
    def solid_boxes(self) -> BoxTree:
        """Index of the solids."""
        if len(self.solids) == 0:
            return BoxTree.over(np.zeros((0, 2)), np.zeros((0, 2)))
        # Outlines are closed: the places where their segments begin are all there are. Between the runs of two solids
        # may be other segments: every other run is a solid.
        places = self.ends[: self.solids[-1, 1], 0]
        runs = self.solids.ravel()[:-1]
        low = np.minimum.reduceat(places, runs)[::2]
        high = np.maximum.reduceat(places, runs)[::2]
        return BoxTree.over(low, high)
