"""Surfaces of bodies as triangles."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class TriangleSoup:
    """Triangles in no order; a place is as far from one as from its points, less its rounding.

    Triangles may have no area: a point with rounding is a ball, a segment with rounding a capsule.

    Attributes:
        triangles: shape (m, 3, 3) [m].
        rounding: of each, shape (m,) [m].
        owner: to which of the names each belongs, shape (m,).
        names: of the bodies, and of the room where there is one.
    """

    triangles: FloatArray
    rounding: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @classmethod
    def joined(cls, named: Iterable[tuple[str, FloatArray, float]]) -> "TriangleSoup":
        """The triangles of several things, each with its name, its triangles, shape (·, 3, 3), and its rounding."""
        parts = list(named)
        counts = [len(triangles) for _, triangles, _ in parts]
        triangles = [np.zeros((0, 3, 3)), *(triangles for _, triangles, _ in parts if len(triangles))]
        return cls(
            # Of a single large mesh no second copy is made.
            np.ascontiguousarray(triangles[1] if len(triangles) == 2 else np.concatenate(triangles)),
            np.repeat(np.array([rounding for _, _, rounding in parts], dtype=np.float64), counts),
            np.repeat(np.arange(len(parts), dtype=np.intp), counts),
            tuple(name for name, _, _ in parts),
        )

    def __len__(self) -> int:
        return len(self.triangles)


def box_about(places: FloatArray) -> FloatArray:
    """Lower and upper corner of the box about some places, shape (2, 3) [m].

    Args:
        places: at least one, shape (..., 3) [m].
    """
    # Column by column: of many rows of three numpy takes the least some ten times as slowly.
    columns = [places[..., axis] for axis in range(3)]
    return np.array([[column.min() for column in columns], [column.max() for column in columns]])


def thinned(vertices: FloatArray, faces: IntArray, cell: float) -> tuple[FloatArray, IntArray]:
    """Return a surface whose corners in each cell of a grid are one corner, their mean (Rossignac and Borrel 1993).

    Args:
        vertices: shape (v, 3) [m].
        faces: shape (m, 3).
        cell: width of a cell; no corner is moved by more than its diagonal [m].

    Returns:
        Corners and faces, without faces that have collapsed and without those that are there twice.
    """
    cells = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    # One number a cell, which is sorted much faster than three.
    _, across, up = cells.max(axis=0) + 1
    cell_number = (cells[:, 0] * across + cells[:, 1]) * up + cells[:, 2]
    _, number, count = np.unique(cell_number, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(number, column) for column in vertices.T], axis=1)
    joined = number[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    ordered = np.sort(joined, axis=1).astype(np.int64)
    corners = len(count)
    _, first = np.unique((ordered[:, 0] * corners + ordered[:, 1]) * corners + ordered[:, 2], return_index=True)
    return sums / count[:, None], joined[np.sort(first)]


def within(vertices: FloatArray, faces: IntArray, most: int, cell: float) -> tuple[FloatArray, IntArray]:
    """Return a surface with at most so many triangles.

    It is thinned by cells of a width, and wider ones as long as needed.
    """
    if len(faces) <= most:
        return vertices, faces
    while True:
        corners, kept = thinned(vertices, faces, cell)
        if len(kept) <= most:
            return corners, kept
        cell *= 1.5


def all_within(
    surfaces: Sequence[tuple[FloatArray, IntArray]], most: int, least: int, cell: float
) -> list[tuple[FloatArray, IntArray]]:
    """Thin several surfaces to at most so many triangles in all; what small ones do not need is left for large ones.

    Args:
        surfaces: vertices, shape (v, 3) [m], and faces, shape (m, 3), of each.
        most: triangles in all.
        least: triangles that each of them may have, however many there are.
        cell: width of the cells in which corners are joined first [m].
    """
    drawn = list(surfaces)
    left = most
    order = np.argsort([len(faces) for _, faces in surfaces], kind="stable").tolist()
    for rank, k in enumerate(order):
        vertices, faces = surfaces[k]
        drawn[k] = within(vertices, faces, max(left // (len(order) - rank), least), cell)
        left -= len(drawn[k][1])
    return drawn


def sharp_edges(vertices: FloatArray, faces: IntArray, angle: float) -> IntArray:
    """Return the edges at which a surface ends, or turns by more than an angle [rad]; their corners, shape (k, 2).

    Args:
        vertices: shape (v, 3) [m]; corners at the same place count as one.
        faces: shape (m, 3).
        angle: between the normals of the two faces of an edge [rad].
    """
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    joined = first[same.reshape(-1)][faces]
    corners = vertices[joined]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    edges = np.sort(np.concatenate((joined[:, [0, 1]], joined[:, [1, 2]], joined[:, [2, 0]])), axis=1)
    of_face = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges = edges[order]
    of_face = of_face[order]
    starts = np.flatnonzero(np.any(np.diff(edges, axis=0, prepend=-1) != 0, axis=1))
    counts = np.diff(starts, append=len(edges))
    pairs = starts[counts == 2]
    cos = np.abs(np.sum(normals[of_face[pairs]] * normals[of_face[pairs + 1]], axis=1))
    return np.concatenate((edges[pairs[cos < np.cos(angle)]], edges[starts[counts == 1]]))
