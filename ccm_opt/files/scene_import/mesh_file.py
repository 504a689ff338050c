"""From the file of a mesh to its triangles: read by its format, checked, its bytes hashed."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.glb import read_glb
from ccm_opt.files.scene_import.mesh_settings import MESHES, MeshSettings
from ccm_opt.files.scene_import.obj import read_obj
from ccm_opt.files.scene_import.ply import read_ply
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.files.scene_import.stl import read_stl
from ccm_opt.files.scene_import.three_mf import read_3mf

MESH_READERS: Mapping[str, Callable[[bytes, MeshSettings], RawMesh]] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".glb": read_glb,
    ".3mf": read_3mf,
}
"""Reader by the suffix of the file, in small letters."""


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh that was read.

    Attributes:
        mesh: what the file holds, in its own unit; every number finite, every triangle of vertices that there are.
        content: the bytes of the file.
        digest: their SHA-256, in hexadecimal digits.
    """

    mesh: RawMesh
    content: bytes
    digest: str


def read_mesh_file(path: Path, settings: MeshSettings = MESHES) -> MeshFile:
    """Read a mesh.

    Args:
        path: an STL, OBJ, PLY, GLB or 3MF file, recognised by its suffix.
        settings: bounds.

    Raises:
        ProblemError: the file cannot be read, or holds no usable mesh.
    """
    content = _content(path, settings)
    try:
        mesh = MESH_READERS[path.suffix.lower()](content, settings)
        _refuse_unusable(mesh, settings)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    except (MemoryError, RecursionError) as error:
        raise ProblemError(f"{path.name}: too large or too deeply nested to be read") from error
    return MeshFile(mesh, content, hashlib.sha256(content).hexdigest())


def _content(path: Path, settings: MeshSettings) -> bytes:
    """The bytes of a file of a known kind."""
    if path.suffix.lower() not in MESH_READERS:
        kinds = ", ".join(MESH_READERS)
        raise ProblemError(f"{path.name} is no mesh of a known kind; expected a file that ends in one of {kinds}")
    try:
        if not path.is_file():
            what = "is a directory" if path.is_dir() else "does not exist"
            raise ProblemError(f"{path} {what}; expected a mesh, its path relative to the problem file")
        # Asked before reading, so that a huge file does not fill the memory first.
        size = path.stat().st_size
        if size > settings.most_bytes:
            raise ProblemError(
                f"{path.name} has {size} bytes, at most {settings.most_bytes} can be read; export it coarser"
            )
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise ProblemError(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not content.strip(b"\0 \t\r\n"):
        raise ProblemError(f"{path.name} is empty; expected a mesh")
    return content


def _refuse_unusable(mesh: RawMesh, settings: MeshSettings) -> None:
    """Refuse a mesh without triangles, with too many, or with vertices that are not there or nowhere."""
    count = len(mesh.faces)
    if mesh.vertices.shape[1:] != (3,) or mesh.faces.shape[1:] != (3,):
        raise ProblemError("its vertices have not three coordinates each, or its faces are no triangles")
    if count == 0:
        raise ProblemError("it holds no triangles; expected a mesh")
    if count > settings.most_triangles:
        raise ProblemError(f"it has {count} triangles, at most {settings.most_triangles} are used; export it coarser")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise ProblemError(f"a triangle has a vertex that is not there; there are {len(mesh.vertices)} vertices")
    finite = np.isfinite(mesh.vertices).all(axis=1)
    # Vertices that no triangle has do not matter.
    used = np.zeros(len(mesh.vertices), dtype=np.bool_)
    used[mesh.faces] = True
    broken = np.flatnonzero(used & ~finite)
    if len(broken):
        counted = f"{len(broken)} of {len(mesh.vertices)} vertices"
        raise ProblemError(f"{counted} are no numbers or infinite, the first is number {broken[0]}, from 0")
    largest = float(np.abs(mesh.vertices[used]).max())
    if largest > settings.largest_coordinate:
        raise ProblemError(
            f"a coordinate is {largest:g}, expected at most {settings.largest_coordinate:g} in the mesh's unit"
        )
