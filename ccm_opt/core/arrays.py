"""Array types, and the rounding of their numbers."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


ROUNDING = 1e-9
"""Lengths [m], angles [rad] and shares below this are rounding: a thousandth of what any check of a motion notices."""
TINY = 1e-12
"""Keeps divisions finite, and is nothing beside numbers round one: some thousand times the spacing of doubles there."""
SHORTEST = 1e-6
"""Shortest length [m], or share of one, that shapes are made of: what is shorter has no direction to be trusted."""


def in_space(places: FloatArray) -> FloatArray:
    """Return places of the plane with a third coordinate of zero, others as they are, shape (..., d) to (..., 3)."""
    return np.pad(places, [(0, 0)] * (places.ndim - 1) + [(0, 3 - places.shape[-1])])
