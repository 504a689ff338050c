"""A tree of boxes as compiled C walks it."""

import ctypes
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.box_tree import BoxTree


class TreeStruct(ctypes.Structure):
    """``Tree`` of box_tree.h."""

    _fields_ = (
        ("levels", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("items", "boxes", "offsets")),
    )


@dataclass(frozen=True, eq=False)
class TreeForC:
    """The structure, with the arrays that it points to: keep this as long as C may walk the tree.

    Attributes:
        struct: to be copied into the query of a source.
        arrays: items, boxes and offsets.
    """

    struct: TreeStruct
    arrays: tuple[FloatArray | IntArray, ...]

    @classmethod
    def of(cls, tree: BoxTree) -> "TreeForC":
        """A tree for C."""
        items = np.ascontiguousarray(tree.items, dtype=np.int64)
        boxes = np.ascontiguousarray(tree.boxes, dtype=np.float64)
        offsets = np.ascontiguousarray(tree.offsets, dtype=np.int64)
        levels = len(tree.offsets) - 1 if len(tree.items) else 0
        struct = TreeStruct(levels, items.ctypes.data, boxes.ctypes.data, offsets.ctypes.data)
        return cls(struct, (items, boxes, offsets))
