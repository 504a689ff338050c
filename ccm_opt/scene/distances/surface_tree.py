"""Distances from segments to triangles, by a tree of boxes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arguments import LARGEST
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.native import NativeCall, element_type
from ccm_opt.scene.surfaces import TriangleSoup


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Where each of k segments is nearest to a surface; the gap is the reach and the owner −1 where nothing is nearer.

    Attributes:
        gap: distance of the segment from the surface, negative inside its rounding, shape (k,) [m].
        share: place on the segment, from 0 at its start to 1 at its end, shape (k,).
        point: place on the surface, shape (k, 3) [m].
        normal: unit direction from the surface to the segment, shape (k, 3).
        owner: number of the surface's owner, shape (k,).
    """

    gap: FloatArray
    share: FloatArray
    point: FloatArray
    normal: FloatArray
    owner: IntArray


@dataclass(frozen=True, eq=False)
class PlaneRows:
    """Half-spaces normal · (x − point) ≥ 0 that hold a segment and are free of the surfaces near it.

    The rows of a segment stand together, the nearest first.

    Attributes:
        link: number of the segment, shape (r,).
        share: place on the segment that is nearest to the surface, from 0 to 1, shape (r,).
        normal: unit direction from the surface to the segment, shape (r, 3).
        point: place on the surface, shape (r, 3) [m].
        gap: distance of the segment from the surface, shape (r,) [m].
        owner: number of the surface's owner, shape (r,).
    """

    link: IntArray
    share: FloatArray
    normal: FloatArray
    point: FloatArray
    gap: FloatArray
    owner: IntArray


@dataclass(frozen=True, eq=False)
class SurfaceBoxes:
    """Boxes about boxes about triangles.

    Attributes:
        nodes: box, largest rounding, longest edge, and number of triangles of each node, shape (nodes,);
            ``first`` is the first triangle of a leaf, or, of a node without any, the first of its two children, which
            stand side by side. A leaf that only fills a pair has the number −1.
        corners: triangles in the order of the leaves, the longest edge from the first corner to the second, shape
            (m, 3, 3) [m].
        rounding: radius of what is about every triangle, in the same order, shape (m,) [m].
        order: number of the triangle in the scene, likewise, shape (m,).
    """

    nodes: npt.NDArray[np.void]
    corners: FloatArray
    rounding: FloatArray
    order: IntArray

    @classmethod
    def of(cls, triangles: FloatArray, rounding: FloatArray, leaf: int) -> "SurfaceBoxes":
        """Build the hierarchy, every box cut where that costs later walks least.

        Args:
            triangles: corners, shape (m, 3, 3), 0 < m < 2³⁰ [m].
            rounding: shape (m,) [m].
            leaf: triangles of a leaf, at most.

        Raises:
            MemoryError: there is too little.
        """
        count = len(triangles)
        nodes = np.empty(2 * count, dtype=element_type("build_surfaces", "nodes"))
        boxes = cls(nodes, np.empty((count, 3, 3)), np.empty(count), np.empty(count, dtype=np.int64))
        call = NativeCall(
            "build_surfaces",
            triangles=count, leaf=leaf, given=triangles, given_rounding=rounding, nodes=nodes,
            corners=boxes.corners, rounding=boxes.rounding, order=boxes.order,
        )  # fmt: skip
        call()
        if call.fields.count == 0:
            raise MemoryError("no memory for the boxes about the triangles of the scene")
        return cls(nodes[: call.fields.count].copy(), boxes.corners, boxes.rounding, boxes.order)


@dataclass(frozen=True, eq=False)
class SurfaceSearch:
    """Searches a hierarchy of boxes; the owner in its answers is a place among the triangles of the leaves.

    Attributes:
        boxes: the hierarchy.
    """

    boxes: SurfaceBoxes

    @cached_property
    def for_c(self) -> dict[str, Any]:
        """The hierarchy as ``Surfaces`` of surface_nodes.h."""
        return {"nodes": self.boxes.nodes, "corners": self.boxes.corners, "rounding": self.boxes.rounding}

    def distances(self, segments: FloatArray, reach: float, slack: float) -> FloatArray:
        """Least gap of each segment (k, 2, 3), or less by the slack at most, cut off at the reach, shape (k,) [m].

        Not a number where the segment is none.
        """
        gap = np.empty(len(segments))
        NativeCall(
            "nearest_surfaces",
            surfaces=self.for_c, count=len(segments), together=1, segments=segments, reach=reach, slack=slack, gap=gap,
        )()  # fmt: skip
        return gap

    def nearest(self, segments: FloatArray, reach: float, together: int) -> Witnesses:
        """Return where each segment (k, 2, 3) is nearest, or of so many in a row the nearest of them."""
        count = len(segments)
        face = np.empty(count, dtype=np.int64)
        found = Witnesses(np.empty(count), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)), face)
        NativeCall(
            "nearest_surfaces",
            surfaces=self.for_c, count=count, together=together, segments=segments, reach=reach, gap=found.gap,
            share=found.share, point=found.point, normal=found.normal, face=face, known=np.empty(together),
        )()  # fmt: skip
        return found

    def planes(self, segments: FloatArray, reach: float, most: int, behind: float, slack: float) -> PlaneRows:
        """At most so many half-spaces about each segment (k, 2, 3), the nearest first, or nearest but for the slack."""
        count = len(segments)
        whole = np.empty((2, count * most), dtype=np.int64)
        real = np.empty((8, count * most))
        share, gap = real[:2]
        normal, point = real[2:].reshape(2, -1, 3)
        call = NativeCall(
            "free_planes",
            surfaces=self.for_c, count=count, segments=segments, reach=reach, behind=behind, slack=slack, most=most,
            segment=whole[0], face=whole[1], share=share, normal=normal, point=point, gap=gap,
        )  # fmt: skip
        call()
        rows = call.fields.rows
        if rows < 0:
            raise MemoryError("no memory for the half-spaces about the links")
        return PlaneRows(whole[0, :rows], share[:rows], normal[:rows], point[:rows], gap[:rows], whole[1, :rows])

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Gaps of the middles of the cells of a grid, the first of which is at ``low``, cut off at the reach [m]."""
        gap = np.empty(counts)
        NativeCall("grid_gaps", surfaces=self.for_c, counts=counts, low=low, cell=cell, reach=reach, gap=gap)()
        return gap


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
    def of(cls, soup: TriangleSoup, settings: DistanceSettings = DEFAULT_DISTANCES) -> "SurfaceTree":
        """Return the tree over the surfaces of a scene.

        Raises:
            ProblemError: a place is no number, or too far away.
            MemoryError: there is too little.
        """
        if len(soup) == 0:
            return cls(np.zeros(0, dtype=np.intp), None, settings)
        # Python's own max passes over what is no number.
        farthest = float(np.maximum(np.abs(soup.triangles).max(), np.abs(soup.rounding).max()))
        if not farthest <= LARGEST:
            raise ProblemError(
                f"the scene reaches to {farthest:g} m, at most {LARGEST:g} m are taken: is its unit meant?"
            )
        if len(soup) >= _MOST_TRIANGLES:
            raise MemoryError(f"a scene of {len(soup)} triangles: at most {_MOST_TRIANGLES} are taken")
        boxes = SurfaceBoxes.of(soup.triangles, soup.rounding, settings.leaf)
        return cls(soup.owner[boxes.order], SurfaceSearch(boxes), settings)

    def distances(self, segments: FloatArray, reach: float, slack: float = 0.0) -> FloatArray:
        """Return the least distance of each segment from the surfaces.

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
        """Return where each segment is nearest to a surface, as ``distances``.

        The owner is −1 where nothing is in reach.

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
        """Return the half-spaces that hold a segment and are free of the surfaces near it: a convex region about each.

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
        """Return the distances of the middles of the cells of a grid from the surfaces, as of segments without length.

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
    """Return the segments, which C takes so many in a row.

    Raises:
        ValueError: they have another shape.
    """
    if segments.ndim != 3 or segments.shape[1:] != (2, 3) or together < 1 or len(segments) % together:
        raise ValueError(f"segments have the shape {segments.shape}; expected (k, 2, 3), k a multiple of {together}")
    return segments
