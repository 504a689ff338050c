"""A bounding-volume hierarchy of boxes around triangles in space, by NumPy."""

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import element_type
from ccm_opt.scene.distances.surface_tree import SurfaceBoxes

NODE = element_type("build_surfaces", "nodes")
_BITS = 10


def boxes_by_numpy(triangles: FloatArray, rounding: FloatArray, leaf: int) -> SurfaceBoxes:
    """Return the bounding-volume hierarchy of triangles, sorted along a Morton curve (Morton, 1966).

    Args:
        triangles: vertices, shape (m > 0, 3, 3) [m].
        rounding: rounding radii, shape (m,) [m].
        leaf: maximum number of triangles of a leaf.
    """
    order = np.argsort(_morton(triangles.mean(axis=1)), kind="stable")
    corners = longest_edge_first(triangles[order])
    rounding = rounding[order]
    starts = np.arange(0, len(order), leaf)
    level = np.zeros(len(starts), dtype=NODE)
    level["low"] = -_rounded_up(-np.minimum.reduceat(corners.min(axis=1), starts))
    level["high"] = _rounded_up(np.maximum.reduceat(corners.max(axis=1), starts))
    level["rounding"] = _rounded_up(np.maximum.reduceat(rounding, starts))
    edges = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)  # the longest of each
    level["edge"] = _rounded_up(np.maximum.reduceat(edges, starts))
    level["first"] = starts
    level["count"] = np.diff(np.append(starts, len(order)))
    levels = [level]
    while len(level) > 1:
        if len(level) % 2:
            # A leaf without triangles fills the pair.
            empty = level[-1:].copy()
            empty["count"] = -1
            level = levels[-1] = np.concatenate((level, empty))
        pairs = level.reshape(-1, 2)
        level = np.zeros(len(pairs), dtype=NODE)
        level["low"] = pairs["low"].min(axis=1)
        level["high"] = pairs["high"].max(axis=1)
        level["rounding"] = pairs["rounding"].max(axis=1)
        level["edge"] = pairs["edge"].max(axis=1)
        levels.append(level)
    return SurfaceBoxes(_joined(levels[::-1]), corners, rounding, order)


def _rounded_up(numbers: FloatArray) -> npt.NDArray[np.float32]:
    """The least numbers of single precision that are not below these."""
    near = numbers.astype(np.float32)
    return np.where(near < numbers, np.nextafter(near, np.float32(np.inf)), near)


def _joined(levels: list[npt.NDArray[np.void]]) -> npt.NDArray[np.void]:
    """Levels from the top one after the other, each node but the leaves told its children."""
    begins = np.cumsum([0, *(len(level) for level in levels)])
    for level, below in zip(levels[:-1], begins[1:-1], strict=True):
        inner = level["count"] == 0
        level["first"][inner] = (below + 2 * np.arange(len(level)))[inner]
    return np.concatenate(levels)


def longest_edge_first(triangles: FloatArray) -> FloatArray:
    """The same triangles (m, 3, 3), their corners turned so that the longest edge goes from the first to the second."""
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    turn = (np.argmax(edges, axis=1)[:, None] + np.arange(3)) % 3
    return np.ascontiguousarray(np.take_along_axis(triangles, turn[:, :, None], axis=1))


def _morton(places: FloatArray) -> IntArray:
    """Return indices of m points along the Morton curve through their bounding box, shape (m,)."""
    low = places.min(axis=0)
    span = max(float(np.max(places.max(axis=0) - low)), np.finfo(np.float64).tiny)
    cells = ((places - low) / span * (2**_BITS - 1)).astype(np.int64)
    number = np.zeros(len(places), dtype=np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            number |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return number
