"""Array types and tolerances for rounding."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


ROUNDING = 1e-9
"""Lengths [m], angles [rad] and shares below this count as rounding: a thousandth of the finest tolerance of any check
of a motion."""
TINY = 1e-12
"""Guards divisions; negligible next to numbers near one: some thousand times the spacing of doubles there."""
SHORTEST = 1e-6
"""Shortest length [m], or share of one, used in shapes: the direction of anything shorter is unreliable."""


def in_space(places: FloatArray) -> FloatArray:
    """Return points padded with zeros to three coordinates, shape (..., d) to (..., 3); points in space unchanged."""
    return np.pad(places, [(0, 0)] * (places.ndim - 1) + [(0, 3 - places.shape[-1])])
