"""Whether the mesh files that a description of the arm's surroundings names are those of the problem's bodies."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ccm_opt.files.export.scene_urdf import URDF_MESHES
from ccm_opt.files.export.space_scene import named_bodies
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.scene.bodies import MeshBody

HEAD = 84
"""Bytes of a binary STL before its triangles, the last four of which are their number."""
TRIANGLE = np.dtype([("numbers", "<f4", (4, 3)), ("attributes", "<u2")])
"""A triangle of a binary STL: its normal and its corners."""
ROUNDING = 1e-6
"""By which a corner may be off, as a share of the mesh's size: the files have single precision."""


def mesh_defects(folder: Path, text: str, problem: AnyProblem) -> Iterator[str]:
    """What of the meshes that a description names is otherwise than the problem says; of the plane nothing is known.

    Args:
        folder: of the description.
        text: of the description.
        problem: in space, whose meshes they are.
    """
    if not isinstance(problem, SpaceProblem):
        return
    for named in named_bodies(problem):
        name = f"{URDF_MESHES}/{named.mesh_file}"
        if isinstance(named.body, MeshBody) and name in text:
            yield from _defects_of_file(folder / name, name, named.body.triangles)


def _defects_of_file(path: Path, name: str, triangles: FloatArray) -> Iterator[str]:
    # A file of another size is not read, however large it is.
    if not path.is_file() or path.stat().st_size != HEAD + len(triangles) * TRIANGLE.itemsize:
        yield f"{name} is missing, or has another number of triangles than the problem's mesh"
        return
    content = path.read_bytes()
    (count,) = struct.unpack_from("<I", content, HEAD - 4)
    found = np.frombuffer(content, TRIANGLE, offset=HEAD)["numbers"][:, 1:].astype(np.float64)
    allowed = ROUNDING * float(np.max(np.abs(triangles)))
    # What is no number is off, too.
    off = ~(np.abs(found - triangles) <= allowed)
    if content.startswith(b"solid"):
        yield f"{name} begins as a file of text does, and other programs would read it as one"
    elif count != len(triangles) or np.any(off):
        number = int(np.argmax(np.any(off, axis=(1, 2)))) + 1
        yield f"{name} is not the problem's mesh, from triangle {number} on"
