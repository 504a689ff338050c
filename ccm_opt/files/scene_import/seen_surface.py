"""Surfaces with fewer triangles, to be looked at alone: edges are collapsed, and only then corners in cells joined."""

from collections.abc import Sequence

import numpy as np

from ccm_opt.files.scene_import.mesh_simplifying import collapsing_is_quick, simplified_mesh
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.scene.thin_surfaces import within

_ERRORS = (0.25, 1.0)
"""What a surface may be off the one that is drawn, in turn, as shares of the cell [taste]."""
_MOST_COLLAPSED = 20
"""Of surfaces of more triangles than this multiple of what is drawn corners are joined first: collapsing takes some
microseconds a triangle."""


def seen_surface(vertices: FloatArray, faces: IntArray, most: int, cell: float) -> tuple[FloatArray, IntArray]:
    """A surface of at most so many triangles that looks like another one.

    Args:
        vertices: shape (v, 3) [m].
        faces: shape (m, 3).
        most: triangles; one that has no more stays as it is.
        cell: width of the cells in which corners are joined where collapsing edges leaves too many; nothing is off by
            more before [m].
    """
    if len(faces) <= most or not collapsing_is_quick():
        return within(vertices, faces, most, cell)
    mesh = RawMesh(*within(vertices, faces, _MOST_COLLAPSED * most, 0.1 * cell))
    for share in _ERRORS:
        fewer, _ = simplified_mesh(mesh, share * cell)
        if len(fewer.faces) <= most:
            return fewer.vertices, fewer.faces
    return within(fewer.vertices, fewer.faces, most, cell)


def seen_surfaces(
    surfaces: Sequence[tuple[FloatArray, IntArray]], most: int, least: int, cell: float
) -> list[tuple[FloatArray, IntArray]]:
    """Several surfaces of at most so many triangles in all; what small ones do not need is left for large ones.

    Args:
        surfaces: vertices, shape (v, 3) [m], and faces, shape (m, 3), of each.
        most: triangles in all.
        least: triangles that each of them may have, however many there are.
        cell: as ``seen_surface`` takes it [m].
    """
    drawn = list(surfaces)
    left = most
    order = np.argsort([len(faces) for _, faces in surfaces], kind="stable").tolist()
    for rank, k in enumerate(order):
        vertices, faces = surfaces[k]
        drawn[k] = seen_surface(vertices, faces, max(left // (len(order) - rank), least), cell)
        left -= len(drawn[k][1])
    return drawn
