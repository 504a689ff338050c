"""Half-planes round sweeps by compiled C: one call for all links and intervals of a motion."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.box_tree import BoxTree
from ccm_opt.ground.compiled_source import compiled_source, pointer_to
from ccm_opt.ground.tree_for_c import TreeForC, TreeStruct

SYMBOLS = ("sweep_planes",)
_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double
_PLANE = 5 * 8
"""Bytes of ``Plane`` of sweep_planes.c."""
_PLANES = 8
"""Half-planes about a sweep that there is room for at first."""


class _QueryStruct(ctypes.Structure):
    """``Query`` of sweep_planes.c."""

    _fields_ = (
        ("sweeps", _LONG),
        ("corners", _POINTER),
        ("halfway", _POINTER),
        ("tree", TreeStruct),
        ("ends", _POINTER),
        ("rounding", _POINTER),
        *((name, _DOUBLE) for name in ("far", "shortest", "behind")),
        ("planes", _POINTER),
        *((name, _LONG) for name in ("capacity", "count")),
        *((name, _POINTER) for name in ("sweep", "normal", "bound")),
    )


@dataclass(frozen=True)
class SweptLinks:
    """What is asked: sweeps of links, walls, and which of these count.

    Attributes:
        corners: ends of each link at three times, shape (m, 6, 2) [m].
        halfway: ends of it at the middle one, shape (m, 2, 2) [m].
        ends: of the segments of walls, shape (E, 2, 2) [m].
        rounding: radius of the disc that sweeps each segment, shape (E,) [m].
        tree: over the segments.
        far: segments farther away are left out [m].
        shortest: shorter lines have no direction [m].
        behind: by which a wall may stand out of a half-plane that it counts as behind [m].
    """

    corners: FloatArray
    halfway: FloatArray
    ends: FloatArray
    rounding: FloatArray
    tree: BoxTree
    far: float
    shortest: float
    behind: float


def compiled_planes(asked: SweptLinks) -> tuple[IntArray, FloatArray, FloatArray] | None:
    """The sweep, the unit normal and the bound of every half-plane, by sweep and distance; None without a compiler.

    Returns:
        Shapes (k,), (k, 2) and (k,) [m]; n·x ≤ b is on the sweep's side.
    """
    source = Path(__file__).with_name("sweep_planes.c")
    library = compiled_source(source, SYMBOLS)
    if library is None:
        return None
    query = _QueryStruct(sweeps=len(asked.corners), far=asked.far, shortest=asked.shortest, behind=asked.behind)
    # C has the addresses of these.
    tree = TreeForC.of(asked.tree)
    query.tree = tree.struct
    working = np.empty((len(asked.ends), _PLANE), dtype=np.uint8)
    for_c: dict[str, npt.NDArray[Any]] = {
        "corners": np.ascontiguousarray(asked.corners, dtype=np.float64),
        "halfway": np.ascontiguousarray(asked.halfway, dtype=np.float64),
        "ends": np.ascontiguousarray(asked.ends, dtype=np.float64),
        "rounding": np.ascontiguousarray(asked.rounding, dtype=np.float64),
        "planes": working,
    }
    for name, array in for_c.items():
        setattr(query, name, array.ctypes.data)

    capacity = _PLANES * len(asked.corners)
    while True:
        sweep = np.empty(capacity, dtype=np.int64)
        normal = np.empty((capacity, 2))
        bound = np.empty(capacity)
        query.capacity = capacity
        query.sweep, query.normal, query.bound = (array.ctypes.data for array in (sweep, normal, bound))
        library.sweep_planes(pointer_to(query))
        if query.count <= capacity:
            return sweep[: query.count], normal[: query.count], bound[: query.count]
        capacity = query.count
