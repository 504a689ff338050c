"""Slopes of the user's rows: what a gap or an equation is measured against."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.rounding import TINY


def slope_norms(slopes: FloatArray) -> FloatArray:
    """Norm of every row's slope by the link headings, shape (m,); never 0."""
    norms: FloatArray = np.maximum(np.linalg.norm(slopes, axis=1), TINY)
    return norms
