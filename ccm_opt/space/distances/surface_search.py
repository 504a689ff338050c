"""The hierarchy of boxes about the surfaces of a scene, and its search, by compiled C."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.native import NativeCall, element_type
from ccm_opt.space.distances.surface_answers import PlaneRows, Witnesses


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
        """Where each segment (k, 2, 3) is nearest, or of so many in a row the nearest of them."""
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
