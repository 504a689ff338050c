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
    """

    vertices: FloatArray
    faces: IntArray

    @classmethod
    def of_corners(cls, corners: FloatArray) -> "RawMesh":
        """The mesh of triangles that share nothing, shape (m, 3, 3)."""
        return cls(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.intp).reshape(-1, 3))

    @classmethod
    def joined(cls, meshes: list["RawMesh"]) -> "RawMesh":
        """Several meshes as one."""
        if not meshes:
            return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp))
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        return cls(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))
