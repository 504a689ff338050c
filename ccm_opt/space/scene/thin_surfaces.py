"""Surfaces with fewer triangles, to be looked at alone: corners that share a cell of a grid become one."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray


def thinned(vertices: FloatArray, faces: IntArray, cell: float) -> tuple[FloatArray, IntArray]:
    """A surface whose corners in each cell of a grid are one corner, their mean (Rossignac and Borrel 1993).

    Args:
        vertices: shape (v, 3) [m].
        faces: shape (m, 3).
        cell: width of a cell; no corner is moved by more than its diagonal [m].

    Returns:
        Corners and faces, without faces that have collapsed and without those that are there twice.
    """
    cells = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    _, number, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    sums = np.stack([np.bincount(number, column) for column in vertices.T], axis=1)
    joined = number[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return sums / count[:, None], joined[np.sort(first)]


def within(vertices: FloatArray, faces: IntArray, most: int, cell: float) -> tuple[FloatArray, IntArray]:
    """A surface with at most so many triangles; it is thinned by cells of a width, and wider ones as long as needed."""
    if len(faces) <= most:
        return vertices, faces
    while True:
        corners, kept = thinned(vertices, faces, cell)
        if len(kept) <= most:
            return corners, kept
        cell *= 1.5
