"""Meshes with fewer triangles: vertices that are near each other become one, and the error of that is known exactly.

Every place of a triangle is a mean of its corners, and moves by the same mean of their moves. So no place of the
surface moves farther than the vertex that moves farthest, and the new surface, grown by that, contains the old one.
"""

import numpy as np

from ccm_opt.files.scene_import.mesh_mending import mended_mesh
from ccm_opt.files.scene_import.mesh_settings import MESHES, MeshSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.arrays import FloatArray


def simplified_mesh(mesh: RawMesh, error: float, settings: MeshSettings = MESHES) -> tuple[RawMesh, float]:
    """Join the vertices that lie in one cell of a grid.

    Args:
        mesh: its vertices are different places.
        error: how far a vertex may move, above 0, in the unit of the mesh.
        settings: what counts as no area.

    Returns:
        The mesh, and how far its vertices have moved at most.

    Raises:
        ProblemError: nearly nothing would be left, since the error is as large as the mesh.
    """
    # Half the diagonal of a cell is the error, and joined vertices go to the middle of the box about them.
    cells = np.floor(mesh.vertices / (2.0 * error / np.sqrt(3.0)))
    _, names = np.unique(cells, axis=0, return_inverse=True)
    names = names.reshape(-1)
    middles = _middles(mesh.vertices, names)
    moved = float(np.linalg.norm(middles[names] - mesh.vertices, axis=1).max())
    lenient = MeshSettings(**{**settings.__dict__, "most_flat": 1.0})
    return mended_mesh(RawMesh(middles, names[mesh.faces].astype(np.intp)), lenient).mesh, moved


def _middles(points: FloatArray, names: np.ndarray[tuple[int], np.dtype[np.intp]]) -> FloatArray:
    """Middle of the box about the points of each name, shape (names, 3)."""
    count = int(names.max()) + 1
    low = np.full((count, 3), np.inf)
    high = np.full((count, 3), -np.inf)
    np.minimum.at(low, names, points)
    np.maximum.at(high, names, points)
    return np.asarray(0.5 * (low + high))
