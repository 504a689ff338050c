"""Distances of segments from triangles, by a tree of bounding boxes in C."""

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
    """Nearest points of k segments and the surfaces of a scene.

    A segment without a surface in reach has the reach as its gap and the owner −1.

    Attributes:
        gap: distance of the segment from the surface, negative inside the radius of an inflated triangle, shape (k,)
            [m].
        share: nearest point of the segment, as a fraction from 0 at its start to 1 at its end, shape (k,).
        point: nearest point of the surface, shape (k, 3) [m].
        normal: unit direction from the surface to the segment, shape (k, 3).
        owner: index of the body to which the surface belongs, shape (k,).
    """

    gap: FloatArray
    share: FloatArray
    point: FloatArray
    normal: FloatArray
    owner: IntArray


@dataclass(frozen=True, eq=False)
class PlaneRows:
    """Half-spaces normal · (x − point) ≥ 0 that contain a segment and are free of the surfaces near that segment.

    The r half-spaces are ordered by segment, and those of a segment by distance.

    Attributes:
        link: index of the segment, shape (r,).
        share: point of the segment nearest to the surface, as a fraction from 0 to 1, shape (r,).
        normal: unit direction from the surface to the segment, shape (r, 3).
        point: point of the surface, shape (r, 3) [m].
        gap: distance of the segment from the surface, shape (r,) [m].
        owner: index of the body to which the surface belongs, shape (r,).
    """

    link: IntArray
    share: FloatArray
    normal: FloatArray
    point: FloatArray
    gap: FloatArray
    owner: IntArray


@dataclass(frozen=True, eq=False)
class SurfaceBoxes:
    """A tree of bounding boxes over m triangles, as arrays for C.

    Attributes:
        nodes: box, largest rounding, longest edge, and number of triangles of each node, shape (nodes,); ``first`` is
            the first triangle of a leaf, or, for a node without triangles, the first of its two children, which are
            adjacent. A leaf that only completes a pair has the number −1.
        corners: triangles in the order of the leaves, with the longest edge from first to second corner, shape (m, 3,
            3) [m].
        rounding: radius by which each triangle is inflated, in leaf order, shape (m,) [m].
        order: index of each triangle in the scene, in leaf order, shape (m,).
    """

    nodes: npt.NDArray[np.void]
    corners: FloatArray
    rounding: FloatArray
    order: IntArray

    @classmethod
    def from_triangles(cls, triangles: FloatArray, rounding: FloatArray, leaf: int) -> "SurfaceBoxes":
        """Build a tree of boxes over triangles, splitting every box where later searches cost least.

        Args:
            triangles: corners, shape (m, 3, 3), 0 < m < 2³⁰ [m].
            rounding: radius by which each triangle is inflated, shape (m,) [m].
            leaf: maximum number of triangles in a leaf.

        Raises:
            MemoryError: there is too little memory.
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
    """Nearest-surface queries on a tree of boxes around triangles, numbered in the order of the leaves.

    Attributes:
        boxes: the tree.
    """

    boxes: SurfaceBoxes

    @cached_property
    def for_c(self) -> dict[str, Any]:
        """Tree of boxes as named fields of ``Surfaces`` in surface_nodes.h."""
        return {"nodes": self.boxes.nodes, "corners": self.boxes.corners, "rounding": self.boxes.rounding}

    def distances(self, segments: FloatArray, reach: float, slack: float, row: int = 0) -> FloatArray:
        """Return the least gap of each segment (k, 2, 3) from the surfaces, capped at `reach`, shape (k,) [m].

        The reported gap may be too small by at most `slack` [m]; it is NaN for segments with NaN. ``row`` is the number
        of segments of a moving chain, or 0.
        """
        gap = np.empty(len(segments))
        NativeCall(
            "nearest_surfaces",
            surfaces=self.for_c, count=len(segments), together=1, segments=segments, reach=reach, slack=slack, gap=gap,
            row=row,
        )()  # fmt: skip
        return gap

    def nearest(self, segments: FloatArray, reach: float, together: int) -> Witnesses:
        """Return the nearest points of k segments (k, 2, 3) and the surfaces.

        Of every ``together`` consecutive segments, only the one nearest to a surface is searched for.
        """
        count = len(segments)
        face = np.empty(count, dtype=np.int64)
        found = Witnesses(np.empty(count), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)), face)
        NativeCall(
            "nearest_surfaces",
            surfaces=self.for_c, count=count, together=together, segments=segments, reach=reach, gap=found.gap,
            share=found.share, point=found.point, normal=found.normal, face=face, known=np.empty(together),
        )()  # fmt: skip
        return found

    def planes(
        self, segments: FloatArray, reach: float, most: int, behind: float, slack: float, row: int = 0
    ) -> PlaneRows:
        """Return up to ``most`` free half-spaces around each segment (k, 2, 3), nearest first up to ``slack`` [m].

        Surfaces that protrude through a half-space's plane by less than ``behind`` [m] count as excluded. ``row`` is
        the number of segments of a moving chain, or 0.
        """
        count = len(segments)
        whole = np.empty((2, count * most), dtype=np.int64)
        real = np.empty((8, count * most))
        share, gap = real[:2]
        normal, point = real[2:].reshape(2, -1, 3)
        call = NativeCall(
            "free_planes",
            surfaces=self.for_c, count=count, segments=segments, reach=reach, behind=behind, slack=slack, most=most,
            segment=whole[0], face=whole[1], share=share, normal=normal, point=point, gap=gap,
            row=row, known=np.empty(count if row else 0),
        )  # fmt: skip
        call()
        rows = call.fields.rows
        if rows < 0:
            raise MemoryError("no memory for the half-spaces about the links")
        return PlaneRows(whole[0, :rows], share[:rows], normal[:rows], point[:rows], gap[:rows], whole[1, :rows])

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Return the gaps at the cell centres of a grid, the first at ``low`` (3,), capped at `reach` [m]."""
        gap = np.empty(counts)
        NativeCall("grid_gaps", surfaces=self.for_c, counts=counts, low=low, cell=cell, reach=reach, gap=gap)()
        return gap


@dataclass(frozen=True)
class DistanceSettings:
    """Settings of the bounding-box tree over triangles and of its searches.

    Attributes:
        leaf: maximum number of triangles in a box that is not split further. Measured by
            ``tests/benchmarks/bench_surfaces.py``: two to sixteen are within a tenth of each other, and larger leaves
            take less memory.
        most_planes: maximum number of half-spaces around a segment. Heuristic: anything beyond the nearest fourteen
            rarely matters.
        behind: distance by which a surface may protrude through a plane and still count as behind the plane, as a
            fraction of the reach. Heuristic: a fine mesh of a curved wall gives a few planes instead of one per
        triangle. slack: extra distance at which a surface may still be treated as the nearest one in the search for
            half-spaces, as a fraction of the reach. Measured by ``tests/benchmarks/bench_surfaces.py`` along a fine
            duct.
    """

    leaf: int = 8
    most_planes: int = 14
    behind: float = 0.07
    slack: float = 0.01


DEFAULT_DISTANCES = DistanceSettings()
"""Default settings of the bounding-box tree and of its searches."""


_MOST_TRIANGLES = 2**30
"""Largest number of triangles in a tree, whose nodes are numbered in 32 bits."""


@dataclass(frozen=True, eq=False)
class SurfaceTree:
    """Triangles, each inflated by a radius, in a tree of bounding boxes for distance queries.

    All distances are those of a segment from the triangles minus their radii, exact up to floating-point rounding.
    Distances are capped at a reach; the smaller the reach, the faster the search. Only surfaces count: a segment wholly
    inside a closed mesh has a positive distance from the mesh. Segments with NaN have the distance NaN, so that no
    comparison takes them for free.

    Attributes:
        owner: index of the body to which each triangle belongs, in leaf order, shape (m,).
        search: searches the boxes; None if there are no triangles.
        settings: settings of the searches.
    """

    owner: IntArray
    search: SurfaceSearch | None
    settings: DistanceSettings = DEFAULT_DISTANCES

    @classmethod
    def from_triangles(
        cls, triangle_soup: TriangleSoup, settings: DistanceSettings = DEFAULT_DISTANCES
    ) -> "SurfaceTree":
        """Build the tree over the surfaces of a scene.

        Raises:
            ProblemError: a coordinate is not a number, or too large.
            MemoryError: there is too little memory, or there are too many triangles.
        """
        if len(triangle_soup) == 0:
            return cls(np.zeros(0, dtype=np.intp), None, settings)
        # Python's own max would skip NaN.
        farthest = float(np.maximum(np.abs(triangle_soup.triangles).max(), np.abs(triangle_soup.rounding).max()))
        if not farthest <= LARGEST:
            raise ProblemError(
                f"the scene reaches to {farthest:g} m, at most {LARGEST:g} m are taken: is its unit meant?"
            )
        if len(triangle_soup) >= _MOST_TRIANGLES:
            raise MemoryError(f"a scene of {len(triangle_soup)} triangles: at most {_MOST_TRIANGLES} are taken")
        boxes = SurfaceBoxes.from_triangles(triangle_soup.triangles, triangle_soup.rounding, settings.leaf)
        return cls(triangle_soup.owner[boxes.order], SurfaceSearch(boxes), settings)

    def distances(self, segments: FloatArray, reach: float, slack: float = 0.0, poses: int = 1) -> FloatArray:
        """Return the least distance of each of k segments from the surfaces.

        Args:
            segments: end points, shape (k, 2, 3) [m].
            reach: value at which distances are capped [m].
            slack: largest amount by which reported distances may be too small; they are never too large [m]. Along
                finely meshed walls a little slack saves most of the time.
            poses: number of consecutive poses of a chain, to which equally many of the segments belong, one pose after
                the other. Where a chain moves little from pose to pose this is much faster.

        Returns:
            Distances, at most the reach, negative inside the radius of an inflated triangle, shape (k,) [m].
        """
        if self.search is None:
            return np.full(len(segments), float(reach))
        return self.search.distances(_checked(segments), reach, slack, _row(segments, poses))

    def nearest(self, segments: FloatArray, reach: float, together: int = 1) -> Witnesses:
        """Return the nearest points of each of k segments and the surfaces, with gaps as in ``distances``.

        The owner is −1 if nothing is in reach.

        Args:
            segments: end points, shape (k, 2, 3) [m].
            reach: distance from which on surfaces are ignored [m].
            together: size of groups of consecutive segments; in every group only the first of the segments nearest to a
                surface is searched for, and the others may be reported to have nothing in reach. This is much faster.
        """
        if self.search is None:
            k = len(segments)
            none = np.full(k, -1, dtype=np.intp)
            return Witnesses(np.full(k, float(reach)), np.zeros(k), np.zeros((k, 3)), np.zeros((k, 3)), none)
        found = self.search.nearest(_checked(segments, together), reach, together)
        return replace(found, owner=np.where(found.owner < 0, -1, self.owner[found.owner]))

    def planes(
        self,
        segments: FloatArray,
        reach: float,
        most: int | None = None,
        behind: float | None = None,
        poses: int = 1,
    ) -> PlaneRows:
        """Return half-spaces that bound a convex free region around each of k segments.

        Surfaces are taken in order of distance, up to the slack of the settings. The plane through a surface's nearest
        point, perpendicular to the shortest connection, is added; everything behind an added plane is dropped.

        Args:
            segments: end points, shape (k, 2, 3) [m].
            reach: distance from which on surfaces are ignored [m].
            most: maximum number of planes per segment; that of the settings if None.
            behind: distance by which a surface may protrude through a plane and still count as behind the plane [m];
                that of the settings if None.
            poses: as in ``distances``.
        """
        if self.search is None:
            none = np.zeros(0, dtype=np.intp)
            return PlaneRows(none, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), none)
        most = self.settings.most_planes if most is None else most
        behind = self.settings.behind * reach if behind is None else behind
        slack = self.settings.slack * reach
        found = self.search.planes(_checked(segments), reach, most, behind, slack, _row(segments, poses))
        return replace(found, owner=self.owner[found.owner])

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Return the distances of the cell centres of a regular grid from the surfaces.

        Any point of a cell is at least as far from the surfaces as the centre, minus half the cell's diagonal.

        Args:
            low: centre of the first cell, shape (3,) [m].
            cell: size of a cell [m].
            counts: number of cells along x, y and z.
            reach: value at which distances are capped [m].

        Returns:
            Distances, in an array of shape ``counts`` [m].
        """
        if self.search is None:
            return np.full(counts, float(reach))
        return self.search.grid(low, cell, counts, reach)


def _checked(segments: FloatArray, together: int = 1) -> FloatArray:
    """Return segments (k, 2, 3) unchanged, after checking their shape for the C code.

    The C code takes ``together`` segments at a time, so k must be a multiple of it.

    Raises:
        ValueError: the segments have another shape.
    """
    if segments.ndim != 3 or segments.shape[1:] != (2, 3) or together < 1 or len(segments) % together:
        raise ValueError(f"segments have the shape {segments.shape}; expected (k, 2, 3), k a multiple of {together}")
    return segments


def _row(segments: FloatArray, poses: int) -> int:
    """Return how many of the segments (k, 2, 3) of several poses belong to each; 0 for a single pose.

    Raises:
        ValueError: the number of segments is no multiple of that of the poses.
    """
    if poses < 1 or len(segments) % poses:
        raise ValueError(f"{len(segments)} segments; expected a multiple of {poses}, the number of poses")
    return 0 if poses == 1 else len(segments) // poses
