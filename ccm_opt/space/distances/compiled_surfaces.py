"""The hierarchy of boxes and its search by compiled C."""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.compiled_source import compiled_source
from ccm_opt.space.distances.surface_answers import PlaneRows, Witnesses
from ccm_opt.space.distances.surface_boxes import NODE, SurfaceBoxes
from ccm_opt.space.distances.surface_search import SegmentGapCall

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double


class _BuildingStruct(ctypes.Structure):
    """``Building`` of surface_building.c."""

    _fields_ = (
        *((name, _LONG) for name in ("triangles", "leaf")),
        *((name, _POINTER) for name in ("given", "given_rounding", "nodes", "corners", "rounding", "order")),
        ("count", _LONG),
        ("items", _POINTER),
        ("clustered", _LONG),
    )


class _SurfacesStruct(ctypes.Structure):
    """``Surfaces`` of surface_nodes.h."""

    _fields_ = tuple((name, _POINTER) for name in ("nodes", "corners", "rounding"))


class _NearestStruct(ctypes.Structure):
    """``NearestQuery`` of nearest_surfaces.c."""

    _fields_ = (
        ("surfaces", _SurfacesStruct),
        *((name, _LONG) for name in ("count", "together")),
        ("segments", _POINTER),
        *((name, _DOUBLE) for name in ("reach", "slack")),
        *((name, _POINTER) for name in ("gap", "share", "point", "normal", "face", "known")),
    )


class _PlaneStruct(ctypes.Structure):
    """``PlaneQuery`` of free_planes.c."""

    _fields_ = (
        ("surfaces", _SurfacesStruct),
        ("count", _LONG),
        ("segments", _POINTER),
        *((name, _DOUBLE) for name in ("reach", "behind", "slack")),
        *((name, _LONG) for name in ("most", "rows")),
        *((name, _POINTER) for name in ("segment", "face", "share", "normal", "point", "gap", "waiting")),
        *((name, _LONG) for name in ("size", "room")),
    )


class _GridStruct(ctypes.Structure):
    """``GridQuery`` of grid_gaps.c."""

    _fields_ = (
        ("surfaces", _SurfacesStruct),
        ("counts", _LONG * 3),
        ("low", _DOUBLE * 3),
        *((name, _DOUBLE) for name in ("cell", "reach")),
        ("gap", _POINTER),
    )


def boxes_by_c(triangles: FloatArray, rounding: FloatArray, leaf: int) -> SurfaceBoxes | None:
    """The hierarchy, every box cut where that costs later walks least; None where there is no compiling.

    Args:
        triangles: corners, shape (m, 3, 3), 0 < m < 2³⁰ [m].
        rounding: shape (m,) [m].
        leaf: triangles of a leaf, at most.

    Raises:
        MemoryError: there is too little.
    """
    library = compiled_source(Path(__file__).with_name("surface_building.c"), ("build_surfaces",))
    if library is None:
        return None
    count = len(triangles)
    triangles = np.ascontiguousarray(triangles, dtype=np.float64)
    rounding = np.ascontiguousarray(rounding, dtype=np.float64)
    nodes = np.empty(2 * count, dtype=NODE)
    boxes = SurfaceBoxes(nodes, np.empty((count, 3, 3)), np.empty(count), np.empty(count, dtype=np.int64))
    arrays = (triangles, rounding, nodes, boxes.corners, boxes.rounding, boxes.order)
    building = _BuildingStruct(count, leaf, *(array.ctypes.data for array in arrays), 0, None)
    library.build_surfaces(ctypes.byref(building))
    if building.count == 0:
        raise MemoryError("no memory for the boxes about the triangles of the scene")
    return SurfaceBoxes(nodes[: building.count].copy(), boxes.corners, boxes.rounding, boxes.order)


class CompiledSearch:
    """Satisfies the ``SurfaceSearch`` protocol.

    Args:
        boxes: the hierarchy.
        nearest: library of nearest_surfaces.c.
        planes: library of free_planes.c.
        grid: library of grid_gaps.c.
    """

    def __init__(self, boxes: SurfaceBoxes, nearest: ctypes.PyDLL, planes: ctypes.PyDLL, grid: ctypes.PyDLL) -> None:
        self._boxes = boxes  # C has the addresses of its arrays
        self._nearest = nearest.nearest_surfaces
        self._planes = planes.free_planes
        self._grid = grid.grid_gaps
        arrays = (boxes.nodes, boxes.corners, boxes.rounding)
        self._surfaces = _SurfacesStruct(*(array.ctypes.data for array in arrays))
        function = ctypes.cast(nearest.segment_gap, _POINTER).value or 0
        self._gap_call = SegmentGapCall(function, ctypes.addressof(self._surfaces))

    @property
    def gap_call(self) -> SegmentGapCall:
        """What other compiled code needs to take distances here; it may be used as long as the search is kept."""
        return self._gap_call

    def distances(self, segments: FloatArray, reach: float, slack: float) -> FloatArray:
        """Least gap of each segment, or the reach; not a number where the segment is none."""
        gap = np.empty(len(segments))
        query = _NearestStruct(self._surfaces, len(segments), 1, segments.ctypes.data, reach, slack, gap.ctypes.data)
        self._nearest(ctypes.byref(query))
        return gap

    def nearest(self, segments: FloatArray, reach: float, together: int) -> Witnesses:
        """Where each segment is nearest to a surface."""
        count = len(segments)
        face = np.empty(count, dtype=np.int64)
        found = Witnesses(np.empty(count), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3)), face)
        known = np.empty(together)
        arrays = (found.gap, found.share, found.point, found.normal, found.owner, known)
        addresses = (array.ctypes.data for array in arrays)
        query = _NearestStruct(self._surfaces, count, together, segments.ctypes.data, reach, 0.0, *addresses)
        self._nearest(ctypes.byref(query))
        return found

    def planes(self, segments: FloatArray, reach: float, most: int, behind: float, slack: float) -> PlaneRows:
        """Half-spaces about each segment."""
        count = len(segments)
        whole = np.empty((2, count * most), dtype=np.int64)
        real = np.empty((8, count * most))
        share, gap = real[:2]
        normal, point = real[2:].reshape(2, -1, 3)
        addresses = (array.ctypes.data for array in (*whole, share, normal, point, gap))
        query = _PlaneStruct(self._surfaces, count, segments.ctypes.data, reach, behind, slack, most, 0, *addresses)
        self._planes(ctypes.byref(query))
        rows = query.rows
        if rows < 0:
            raise MemoryError("no memory for the half-spaces about the links")
        return PlaneRows(whole[0, :rows], share[:rows], normal[:rows], point[:rows], gap[:rows], whole[1, :rows])

    def grid(self, low: FloatArray, cell: float, counts: tuple[int, int, int], reach: float) -> FloatArray:
        """Gaps of the middles of cells, or the reach, shape of the counts."""
        gap = np.empty(counts)
        query = _GridStruct(self._surfaces, (_LONG * 3)(*counts), (_DOUBLE * 3)(*low), cell, reach, gap.ctypes.data)
        self._grid(ctypes.byref(query))
        return gap


def compiled_search(boxes: SurfaceBoxes) -> CompiledSearch | None:
    """A compiled search; None where there is no compiling."""
    nearest = compiled_source(Path(__file__).with_name("nearest_surfaces.c"), ("nearest_surfaces", "segment_gap"))
    planes = compiled_source(Path(__file__).with_name("free_planes.c"), ("free_planes",))
    grid = compiled_source(Path(__file__).with_name("grid_gaps.c"), ("grid_gaps",))
    if nearest is None or planes is None or grid is None:
        return None
    return CompiledSearch(boxes, nearest, planes, grid)
