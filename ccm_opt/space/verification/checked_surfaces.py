"""The surfaces of a scene as the verifier knows them: triangles, and boxes about eight, sixty-four, … of them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.space.scene.surfaces import SurfaceSoup
from ccm_opt.space.verification.vector_lengths import lengths_of

_FAN = 8
"""Boxes in a box."""


@dataclass(frozen=True, eq=False)
class CheckedSurfaces:
    """Boxes level by level from the top, of which the last are those of single triangles.

    Attributes:
        low: lower corners of the boxes, shape (nodes, 3) [m].
        high: upper corners, likewise.
        rounding: the largest radius of what is about the triangles in a box, shape (nodes,) [m].
        offsets: number of the first box of every level, then that of all boxes, shape (levels + 1,).
        triangles: in the order of the last level, shape (m, 3, 3) [m].
        owner: number of the triangles' owners, likewise, shape (m,).
    """

    low: FloatArray
    high: FloatArray
    rounding: FloatArray
    offsets: IntArray
    triangles: FloatArray
    owner: IntArray

    @classmethod
    def of(cls, soup: SurfaceSoup) -> "CheckedSurfaces":
        """The boxes over at least one triangle: of about one size and place in the lower levels."""
        order = _by_size_and_place(soup.triangles)
        triangles = soup.triangles[order]
        levels = [(triangles.min(axis=1), triangles.max(axis=1), soup.rounding[order])]
        while len(levels[-1][0]) > 1:
            low, high, rounding = levels[-1]
            starts = np.arange(0, len(low), _FAN)
            above = (np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts))
            levels.append((*above, np.maximum.reduceat(rounding, starts)))
        levels.reverse()
        low, high, rounding = (np.concatenate(part) for part in zip(*levels, strict=True))
        offsets = np.cumsum([0, *(len(level[0]) for level in levels)])
        return cls(low, high, rounding, offsets, triangles, soup.owner[order])

    def is_triangle(self, node: IntArray) -> BoolArray:
        """Which nodes are single triangles, shape (P,)."""
        return np.asarray(node >= self.offsets[-2])

    def children(self, node: IntArray) -> tuple[IntArray, IntArray]:
        """Places in the list of nodes, and the children of these, each of shape (Q,)."""
        level = np.searchsorted(self.offsets, node, side="right") - 1
        first = self.offsets[level + 1] + _FAN * (node - self.offsets[level])
        count = np.minimum(self.offsets[level + 2] - first, _FAN)
        place = np.repeat(np.arange(len(node)), count)
        within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
        return place, first[place] + within

    def bounds(self, node: IntArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far segments (P, 3) are from what is in boxes, at least and at most, without rounding, each (P,) [m]."""
        # Numpy takes rows in a quarter of the time in which it indexes them.
        low = self.low.take(node, axis=0)
        high = self.high.take(node, axis=0)
        beyond = np.maximum(low - np.maximum(start, end), np.minimum(start, end) - high)
        apart = lengths_of(np.maximum(beyond, 0.0))
        line = end - start
        centre = 0.5 * (low + high)
        square = np.einsum("pd,pd->p", line, line)
        share = np.einsum("pd,pd->p", centre - start, line) / np.where(square > 0.0, square, 1.0)
        from_centre = lengths_of(start + np.clip(share, 0.0, 1.0)[:, None] * line - centre)
        half = 0.5 * self.size(node)
        return np.maximum(apart, from_centre - half), from_centre + half

    def size(self, node: IntArray) -> FloatArray:
        """Diagonals of boxes, shape (P,) [m]."""
        return self._sizes.take(node)

    @cached_property
    def _sizes(self) -> FloatArray:
        """Of all boxes, shape (nodes,) [m]."""
        return lengths_of(self.high - self.low)


def _by_size_and_place(triangles: FloatArray) -> IntArray:
    """An order in which neighbours are alike in size and near each other, shape (m,)."""
    low = triangles.min(axis=1)
    high = triangles.max(axis=1)
    extent = high.max(axis=0) - low.min(axis=0)
    span = max(float(extent.max()), np.finfo(np.float64).tiny)
    # Walls of few large triangles would blow up the boxes of fine meshes beside them.
    size = lengths_of(high - low) / span
    kind = np.floor(np.log2(np.maximum(size, 1e-6)) / 3.0)
    cells = ((0.5 * (low + high) - low.min(axis=0)) / span * 1023.0).astype(np.int64)
    number = np.zeros(len(triangles), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            number |= (cells[:, axis] >> bit & 1) << 3 * bit + axis
    return np.lexsort((number, kind))
