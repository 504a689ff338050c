"""A mesh as a file gives it, before anything is mended or placed."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RawMesh:
    """Vertices and triangles in the unit of the file.

    Attributes:
        vertices: shape (v, 3).
        faces: vertices of each triangle, shape (m, 3).
        metres: length of one unit, where the file says it itself [m].
        passed_over: what else the file holds, which is no surface, in words.
    """

    vertices: FloatArray
    faces: IntArray
    metres: float | None = None
    passed_over: tuple[str, ...] = ()

    @classmethod
    def of_corners(cls, corners: FloatArray) -> "RawMesh":
        """Return the mesh of triangles that share nothing, shape (m, 3, 3)."""
        return cls(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.intp).reshape(-1, 3))

    @classmethod
    def joined(
        cls, meshes: list["RawMesh"], metres: float | None = None, passed_over: tuple[str, ...] = ()
    ) -> "RawMesh":
        """Join several meshes to one, whose unit and whose other contents are given."""
        if not meshes:
            return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp), metres, passed_over)
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        return cls(vertices, np.concatenate(faces), metres, passed_over)


def counted(number: int, what: str) -> str:
    """Return a number of things in words, for example ``2 lines``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
