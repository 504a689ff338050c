"""A bounding-box hierarchy over points or segments, as flat arrays that C can walk.

The items are ordered along a Morton curve (Morton, 1966), so that neighbours in the order are neighbours in the plane;
every box of a level encloses two boxes of the level below. Nothing is balanced or stored as pointers: the children of
box k are boxes 2 k and 2 k + 1 of the level below.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray

_BITS = 16


@dataclass(frozen=True)
class BoxTree:
    """Boxes about boxes about items.

    Attributes:
        items: the items in the order of the lowest level, shape (n,).
        boxes: all levels from the top, each box as x low, y low, x high, y high, shape (nodes, 4) [m].
        offsets: index of the first box of every level, then the number of boxes, shape (levels + 1,).
    """

    items: IntArray
    boxes: FloatArray
    offsets: IntArray

    @classmethod
    def over(cls, low: FloatArray, high: FloatArray) -> "BoxTree":
        """Over items with bounding boxes from low to high, each of shape (n, 2) [m]."""
        items = np.argsort(_morton(0.5 * (low + high)), kind="stable")
        levels = [np.hstack((low[items], high[items]))]
        while len(levels[-1]) > 1:
            below = levels[-1]
            if len(below) % 2:
                below = np.vstack((below, below[-1]))
            pairs = below.reshape(-1, 2, 4)
            levels.append(np.hstack((pairs[:, :, :2].min(axis=1), pairs[:, :, 2:].max(axis=1))))
        levels.reverse()
        offsets = np.cumsum([0, *(len(level) for level in levels)])
        return cls(items, np.ascontiguousarray(np.concatenate(levels)), offsets)

    def for_c(self) -> dict[str, Any]:
        """The tree as ``Tree`` of box_tree.h."""
        levels = len(self.offsets) - 1 if len(self.items) else 0
        return {"levels": levels, "items": self.items, "boxes": self.boxes, "offsets": self.offsets}

    def meeting(self, low: FloatArray, high: FloatArray) -> IntArray:
        """The items whose boxes meet a box from low to high, each of shape (2,) [m]; sorted, shape (m,)."""
        level = len(self.offsets) - 2
        nodes = np.zeros(min(1, len(self.boxes)), dtype=np.intp)
        for k in range(level + 1):
            boxes = self.boxes[self.offsets[k] + nodes]
            nodes = nodes[np.all((boxes[:, :2] <= high) & (boxes[:, 2:] >= low), axis=1)]
            if k < level:
                nodes = (2 * nodes[:, None] + np.arange(2)).ravel()
                nodes = nodes[nodes < self.offsets[k + 2] - self.offsets[k + 1]]
        return np.sort(self.items[nodes])


def _morton(places: FloatArray) -> IntArray:
    """Numbers along the Morton curve through the bounding box of places (n, 2), shape (n,)."""
    if len(places) == 0:
        return np.zeros(0, dtype=np.intp)
    low = places.min(axis=0)
    span = max(float(np.max(places.max(axis=0) - low)), np.finfo(np.float64).tiny)
    cells = ((places - low) / span * (2**_BITS - 1)).astype(np.int64)
    number = np.zeros(len(places), dtype=np.int64)
    for bit in range(_BITS):
        number |= ((cells[:, 0] >> bit) & 1) << (2 * bit) | ((cells[:, 1] >> bit) & 1) << (2 * bit + 1)
    return number
