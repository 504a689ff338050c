"""Meshes with fewer triangles, and how far the old surface is off the new one at most.

Edges are collapsed: a vertex u goes to one of its neighbours v, and two triangles vanish (Hoppe, Progressive meshes,
1996). The triangles about u, its *fan*, are replaced by others within the same outline. Seen along one direction in
which no triangle of either turns over, both surfaces are heights over one star-shaped plane figure. They are linear on
the pieces into which the edges of both cut that figure, so that their largest difference is at a corner of a piece: at
u, or where an old edge crosses a new one. No place of the old fan is farther from the new one than that.

Every triangle keeps what all that it stands for is off it at most. A collapse adds its own difference to the largest of
its fan, by the triangle inequality, and is done only while the sum is allowed. So the new surface, grown by the largest
of these, contains the old one; flat faces lose their inner vertices for nothing. Vertices at borders, where sheets
meet, and where more than 24 triangles meet, stay.
"""

import ctypes
from pathlib import Path

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.edge_collapse import CollapsedFaces, collapsed_faces
from ccm_opt.files.scene_import.mesh_settings import SIMPLIFYING, SimplifyingSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.compiled_source import compiled_source

_POINTER = ctypes.c_void_p
_LONG = ctypes.c_int64
_DOUBLE = ctypes.c_double


class _CollapsingStruct(ctypes.Structure):
    """``Collapsing`` of edge_collapse.c."""

    _fields_ = (
        *((name, _LONG) for name in ("vertices", "faces")),
        *((name, _POINTER) for name in ("places", "corners", "off", "kept")),
        *((name, _DOUBLE) for name in ("allowed", "steepest")),
        *((name, _LONG) for name in ("sweeps", "levels", "done")),
    )


def simplified_mesh(mesh: RawMesh, error: float, settings: SimplifyingSettings = SIMPLIFYING) -> tuple[RawMesh, float]:
    """Collapse edges while the surface is off by no more than an error.

    Args:
        mesh: its vertices are different places.
        error: what the old surface may be off the new one, above 0, in the unit of the mesh.
        settings: how edges are collapsed.

    Returns:
        The mesh, and by how much it has to be grown to contain the old one, at most the error but for rounding.
    """
    found = _collapsed_by_c(mesh, error, settings) or collapsed_faces(mesh, error, settings)
    if len(found.faces) == len(mesh.faces):
        return mesh, 0.0
    used, faces = np.unique(found.faces, return_inverse=True)
    # Heights are differences of coordinates, and a place is moved by a few dozen collapses at most.
    rounding = settings.rounding * float(np.abs(mesh.vertices).max())
    return RawMesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.intp)), found.off + rounding


def collapsing_is_quick() -> bool:
    """Whether it is compiled, and takes microseconds a triangle instead of milliseconds."""
    return _library() is not None


def _library() -> ctypes.PyDLL | None:
    return compiled_source(Path(__file__).with_name("edge_collapse.c"), ("collapse_edges",))


def _collapsed_by_c(mesh: RawMesh, error: float, settings: SimplifyingSettings) -> CollapsedFaces | None:
    """The triangles that are left; None where there is no compiling.

    Raises:
        ProblemError: there is too little memory.
    """
    library = _library()
    if library is None:
        return None
    count = len(mesh.faces)
    places = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    corners = np.array(mesh.faces, dtype=np.int64, order="C")
    off = np.zeros(count)
    kept = np.zeros(count, dtype=np.uint8)
    job = _CollapsingStruct(
        len(places), count, *(array.ctypes.data for array in (places, corners, off, kept)),
        error, settings.steepest, settings.sweeps, settings.levels, 0,
    )  # fmt: skip
    library.collapse_edges(ctypes.byref(job))
    if not job.done:
        raise ProblemError("memory ran out while the mesh was simplified")
    left = kept.astype(np.bool_)
    return CollapsedFaces(corners[left].astype(np.intp), float(off[left].max(initial=0.0)))
