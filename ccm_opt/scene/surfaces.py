"""Surfaces of bodies as triangles."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.bodies import Body, CapsuleBody, MeshBody, SphereBody


@dataclass(frozen=True, eq=False)
class SurfaceSoup:
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
    def joined(cls, named: Iterable[tuple[str, FloatArray, float]]) -> "SurfaceSoup":
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
    """A surface whose corners in each cell of a grid are one corner, their mean (Rossignac and Borrel 1993).

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
    """A surface with at most so many triangles; it is thinned by cells of a width, and wider ones as long as needed."""
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
    """Edges at which a surface ends, or turns by more than an angle [rad]; their corners, shape (k, 2).

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


def seen_triangles(body: Body, sides: int) -> tuple[FloatArray, IntArray]:
    """Corners, shape (v, 3) [m], and faces, shape (m, 3), of a body's surface.

    Args:
        body: any.
        sides: of round bodies, a multiple of four.
    """
    if isinstance(body, MeshBody):
        return body.vertices, body.faces
    if isinstance(body, SphereBody):
        corners, faces = capsule_surface(0.0, body.radius, sides)
        return corners + body.center, faces
    if isinstance(body, CapsuleBody):
        axis = body.end - body.start
        corners, faces = capsule_surface(float(np.linalg.norm(axis)), body.radius, sides)
        return corners @ turned_to(axis).T + body.start, faces
    triangles = body.triangles
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def turned_to(axis: FloatArray) -> FloatArray:
    """A rotation that turns x to an axis, shape (3, 3); the identity for an axis without length."""
    length = np.linalg.norm(axis)
    if length == 0.0:
        return np.eye(3)
    along = axis / length
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    return np.column_stack((along, across, np.cross(along, across)))


def capsule_surface(length: float, radius: float, sides: int) -> tuple[FloatArray, IntArray]:
    """A cylinder along x with a half sphere at either end: rings of equal sides from pole to pole."""
    quarters = sides // 4
    tilt = np.linspace(0.0, 0.5 * np.pi, quarters + 1)
    along = np.concatenate((-radius * np.cos(tilt), length + radius * np.sin(tilt)))
    widths = np.concatenate((radius * np.sin(tilt), radius * np.cos(tilt)))
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    vertices = np.concatenate(
        [
            np.column_stack((np.full(sides, x), width * np.cos(angles), width * np.sin(angles)))
            for x, width in zip(along, widths, strict=True)
        ]
    )
    here = np.arange(sides)
    following = np.roll(here, -1)
    faces = []
    last = len(along) - 2
    for ring in range(last + 1):
        low = ring * sides
        high = low + sides
        # At the poles a ring is one point, and one triangle of two has no area.
        if ring > 0:
            faces.append(np.column_stack((low + here, low + following, high + following)))
        if ring < last:
            faces.append(np.column_stack((low + here, high + following, high + here)))
    return vertices, np.vstack(faces)
