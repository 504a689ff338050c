"""Array types, and tolerances for rounding errors."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]


ROUNDING = 1e-9
"""Value below which lengths [m], angles [rad] and fractions count as rounding errors.

A thousandth of the finest tolerance of any check of a motion.
"""
TINY = 1e-12
"""Small number that guards divisions, negligible compared with numbers near one.

Several thousand times the spacing of doubles there.
"""
SHORTEST = 1e-6
"""Shortest length [m], or fraction of a length, in shapes; shorter vectors have no reliable direction."""


def in_space(places: FloatArray) -> FloatArray:
    """Return points (..., d) padded with zeros to three coordinates, shape (..., 3); points in space unchanged."""
    return np.pad(places, [(0, 0)] * (places.ndim - 1) + [(0, 3 - places.shape[-1])])
