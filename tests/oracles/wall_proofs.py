"""Proofs that links of a planar arm do not collide with walls on straight motions, by shapely."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.certificate import Links, MotionParts, WallProofs


@dataclass(frozen=True)
class InterpretedWallProofs:
    """Proofs with the results of ``WallProofs``, by shapely.

    Attributes:
        question: the proofs with walls and required distances.
    """

    question: WallProofs

    def unproved(self, parts: MotionParts, links: Links | None) -> tuple[Links, IntArray]:
        """Return the links that are not proved, and the intervals with a link in contact halfway, as ``WallProofs``."""
        part, link = self._all_links(parts) if links is None else links
        need = self.question.least[link] + parts.chord_deviation[part, link]

        # A disc about the hull first: hulls are costly to build, and few links are near a wall.
        corners = np.concatenate((self._ends(parts.a, part, link), self._ends(parts.b, part, link)), axis=1)
        centre = corners.mean(axis=1)
        extent = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        near = np.unique(self._near(np.asarray(shapely.points(centre)), need + extent)[0])

        hulls: Any = shapely.convex_hull(_lines(corners[near]))
        hit = near[np.unique(self._near(hulls, need[near])[0])]
        return (part[hit], link[hit]), self._touching(parts, part[hit], link[hit])

    def _all_links(self, parts: MotionParts) -> Links:
        """Return every interval with every link beyond the mount."""
        links = np.arange(self.question.mount[0], parts.arm.links)
        part, link = np.meshgrid(np.arange(len(parts.owner)), links, indexing="ij")
        return part.ravel(), link.ravel()

    def _touching(self, parts: MotionParts, part: IntArray, link: IntArray) -> IntArray:
        """Return the intervals with a link in contact halfway, for which bisection cannot succeed."""
        # The pose halfway is part of the motion, so contact there is contact of the motion.
        lines = _lines(self._ends(parts.middle, part, link))
        return part[np.unique(self._near(lines, self.question.least[link])[0])]

    def _ends(self, joints: FloatArray, part: IntArray, link: IntArray) -> FloatArray:
        """Return the end points of k links without the part inside the mount, shape (k, 2, 2) [m].

        Args:
            joints: joints and tips of m poses, shape (m, links + 1, 2) [m].
            part: index of the pose of each link, shape (k,).
            link: index of each link, shape (k,).
        """
        ends = np.stack((joints[part, link], joints[part, link + 1]), axis=1)
        mount, share = self.question.mount
        cut = link == mount
        ends[cut, 0] += share * (ends[cut, 1] - ends[cut, 0])
        return ends

    def _near(self, shapes: npt.NDArray[np.object_], distance: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the pairs (shape, wall) with at most a given distance per shape, shape (k,) [m]."""
        # The tree knows only the walls' cores; the largest rounding finds all candidates, and the next lines weigh each
        # by its own.
        shape, wall = self._tree.query(shapes, predicate="dwithin", distance=distance + self._rounding.max())
        if self._rounding.any():
            gap = shapely.distance(shapes[shape], self._tree.geometries[wall]) - self._rounding[wall]
            close = gap <= distance[shape]
            shape = shape[close]
            wall = wall[close]
        return shape, wall

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(np.concatenate(self._parts))

    @cached_property
    def _rounding(self) -> FloatArray:
        counts = [len(parts) for parts in self._parts]
        return np.repeat([wall.rounding for wall in self.question.workspace.walls], counts)

    @cached_property
    def _parts(self) -> list[npt.NDArray[np.object_]]:
        """Cores of the walls, with polylines divided into edges so that a query hits few of them."""
        return [_edges(wall.core) for wall in self.question.workspace.walls]


def _edges(core: shapely.Geometry) -> npt.NDArray[np.object_]:
    """Return the edges of a polyline; another geometry is returned as it is."""
    if not isinstance(core, shapely.LineString):
        return np.array([core], dtype=np.object_)
    points = shapely.get_coordinates(core)
    return _lines(np.stack((points[:-1], points[1:]), axis=1))


def _lines(points: FloatArray) -> npt.NDArray[np.object_]:
    """Return polylines with given vertices, shape (k, m, 2) [m]."""
    return np.asarray(shapely.linestrings(points), dtype=np.object_)
