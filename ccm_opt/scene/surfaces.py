"""Surfaces of bodies as triangles, and their simplification for display."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class TriangleSoup:
    """An unordered set of m triangles, each inflated by a radius (its rounding).

    Triangles may have no area: a point with a radius is a ball, a segment with a radius a capsule.

    Attributes:
        triangles: corners, shape (m, 3, 3) [m].
        rounding: radius by which each triangle is inflated, shape (m,) [m].
        owner: index in ``names`` of the body to which each triangle belongs, shape (m,).
        names: names of the bodies, and of the room if there is one.
    """

    triangles: FloatArray
    rounding: FloatArray
    owner: IntArray
    names: tuple[str, ...]

    @classmethod
    def joined(cls, named: Iterable[tuple[str, FloatArray, float]]) -> "TriangleSoup":
        """Return the triangles of several named surfaces as one set.

        Each surface is given by its name, its triangles, shape (·, 3, 3) [m], and the radius by which they are inflated
        [m].
        """
        parts = list(named)
        counts = [len(triangles) for _, triangles, _ in parts]
        triangles = [np.zeros((0, 3, 3)), *(triangles for _, triangles, _ in parts if len(triangles))]
        return cls(
            # A single large mesh is not copied.
            np.ascontiguousarray(triangles[1] if len(triangles) == 2 else np.concatenate(triangles)),
            np.repeat(np.array([rounding for _, _, rounding in parts], dtype=np.float64), counts),
            np.repeat(np.arange(len(parts), dtype=np.intp), counts),
            tuple(name for name, _, _ in parts),
        )

    def __len__(self) -> int:
        return len(self.triangles)


def box_about(places: FloatArray) -> FloatArray:
    """Return the lower and upper corner of the bounding box of points, shape (2, d).

    Args:
        places: at least one point, shape (..., d).
    """
    # Column by column: numpy takes the minimum of many rows of three some ten times as slowly.
    columns = [places[..., axis] for axis in range(places.shape[-1])]
    return np.array([[column.min() for column in columns], [column.max() for column in columns]])


def grid_cells(points: FloatArray, cell: float) -> IntArray:
    """Return the number of the grid cell in which each point lies, among those that hold any, counted from 0, (n,).

    Args:
        points: points, shape (n, d) [m].
        cell: width of a cell [m].
    """
    cells = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    counts = [int(most) + 1 for most in cells.max(axis=0)]
    if math.prod(counts) >= 2**63:
        return np.asarray(np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1))
    # One number per cell, which sorts much faster than several.
    return np.unique(np.ravel_multi_index(tuple(cells.T), counts), return_inverse=True)[1]


def thinned(vertices: FloatArray, faces: IntArray, cell: float) -> tuple[FloatArray, IntArray]:
    """Return a surface simplified by merging all vertices in a grid cell into their mean (Rossignac and Borrel 1993).

    Args:
        vertices: vertices, shape (v, 3) [m].
        faces: vertex indices of the triangles, shape (m, 3).
        cell: width of a cell; no vertex moves by more than the diagonal of a cell [m].

    Returns:
        Vertices and faces, without collapsed faces and duplicates.
    """
    number = grid_cells(vertices, cell)
    count = np.bincount(number)
    sums = np.stack([np.bincount(number, column) for column in vertices.T], axis=1)
    joined = number[faces]
    whole = (joined[:, 0] != joined[:, 1]) & (joined[:, 1] != joined[:, 2]) & (joined[:, 2] != joined[:, 0])
    joined = joined[whole]
    ordered = np.sort(joined, axis=1).astype(np.int64)
    corners = len(count)
    _, first = np.unique((ordered[:, 0] * corners + ordered[:, 1]) * corners + ordered[:, 2], return_index=True)
    return sums / count[:, None], joined[np.sort(first)]


def within(vertices: FloatArray, faces: IntArray, most: int, cell: float) -> tuple[FloatArray, IntArray]:
    """Return a surface simplified to at most ``most`` triangles.

    Vertices are merged in grid cells of the given width [m], which is increased as needed.
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
    """Return several surfaces simplified to about a total number of triangles, which ``least`` may exceed.

    Triangles that small surfaces do not need are allotted to large surfaces.

    Args:
        surfaces: vertices, shape (v, 3) [m], and faces, shape (m, 3), of each surface.
        most: wanted total number of triangles.
        least: number of triangles that each surface may have, even if the total then exceeds ``most``.
        cell: initial width of the cells in which vertices are merged [m].
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
    """Return the edges at which a surface ends or turns sharply, as vertex indices, shape (k, 2).

    Args:
        vertices: vertices, shape (v, 3) [m]; vertices at the same position count as one.
        faces: vertex indices of the triangles, shape (m, 3).
        angle: angle between the normals of an edge's two faces above which the edge is sharp [rad].
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
