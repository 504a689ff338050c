"""Lengths of many short vectors."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, shape (..., 3) to (...); numpy's norm along a short axis takes three times as long."""
    return np.asarray(np.sqrt(np.einsum("...d,...d->...", vectors, vectors)))
