"""Rasterised triangles: the nearest surface behind every pixel of a picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.native import NativeCall

Shades = NDArray[np.float32]
"""Quantities of pixels, for which half the usual precision is enough."""
Numbers = NDArray[np.int32]
"""Numbers of faces."""


@dataclass(frozen=True, eq=False)
class Glass:
    """Which surfaces are glass, and what they let through.

    Attributes:
        kinds: 0 for each face that is solid, 1 for one that is glass in front of the cut, 2 for glass, shape (f,).
        cut: depth beyond which faces of kind 1 are solid, shape (h, w) [m].
        opacity: logarithm of the fraction of light that each triangle lets through, shape (m,).
    """

    kinds: NDArray[np.uint8]
    cut: Shades
    opacity: FloatArray


@dataclass(frozen=True, eq=False)
class Layer:
    """The nearest surface behind every pixel of a picture.

    Attributes:
        depth: position towards the viewer, -inf where there is nothing, shape (h, w) [m].
        light: brightness of the surface, 1 where there is nothing, shape (h, w).
        owner: number of the face or link, -1 where there is nothing, shape (h, w).
        passed: logarithm of the fraction of light that all surfaces behind the pixel let through, shape (h, w).
        fragments: number of pixels of each face, hidden ones included, shape (f,).
    """

    depth: Shades
    light: Shades
    owner: Numbers
    passed: FloatArray
    fragments: IntArray

    def outlines(self, step: float) -> BoolArray:
        """Return where neighbouring pixels show different faces, or differ in depth by more than a step [m], (h, w)."""
        found = np.zeros(self.owner.shape, dtype=np.bool_)
        depth = np.where(np.isfinite(self.depth), self.depth, np.float32(-1e9))
        for axis in (0, 1):
            here = (slice(1, None), slice(None))[:: 1 - 2 * axis]
            there = (slice(None, -1), slice(None))[:: 1 - 2 * axis]
            found[here] |= (self.owner[here] != self.owner[there]) | (np.abs(depth[here] - depth[there]) > step)
        return found


@dataclass(frozen=True, eq=False)
class FlatTriangles:
    """Triangles in a picture.

    Attributes:
        corners: columns and rows of the corners, shape (m, 3, 2) [pixel].
        height: position of the corners towards the viewer, shape (m, 3) [m].
        light: brightness of the surface at the corners, from 0 to 1, shape (m, 3).
        owner: number of each triangle's face or link, shape (m,).
        owners: number of all faces or links.
    """

    corners: FloatArray
    height: FloatArray
    light: FloatArray
    owner: IntArray
    owners: int

    def nearest(self, floor: Shades, glass: Glass | None = None, *, of_glass: bool = False) -> Layer:
        """Return the nearest surface behind every pixel.

        Args:
            floor: depth up to which nothing is seen, shape (h, w) [m].
            glass: surfaces that are glass; None for none.
            of_glass: whether those are wanted, or the solid ones.
        """
        shape = floor.shape
        glass = glass or Glass(np.zeros(self.owners, dtype=np.uint8), floor, np.zeros(len(self.owner)))
        layer = Layer(
            np.full(shape, -np.inf, dtype=np.float32),
            np.ones(shape, dtype=np.float32),
            np.full(shape, -1, dtype=np.int32),
            np.zeros(shape),
            np.zeros(self.owners, dtype=np.int64),
        )
        NativeCall(
            "rasterise", count=len(self.owner), rows=shape[0], columns=shape[1], glass=int(of_glass),
            corners=self.corners, height=self.height, light=self.light, owner=self.owner, kinds=glass.kinds,
            cut=glass.cut, floor=floor, opacity=glass.opacity, depth=layer.depth, brightness=layer.light,
            nearest=layer.owner, passed=layer.passed, fragments=layer.fragments,
        )()  # fmt: skip
        return layer
