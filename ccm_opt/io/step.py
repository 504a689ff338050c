"""Solids of STEP files as triangle meshes, by cascadio, the extra ``step``."""

import io
import json
import os
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.raw_mesh import RawMesh

_SHARE = 0.5
"""Chord deviation asked of the mesher, as a share of the error that is allowed. Heuristic: in tests the mesher kept
what was asked; the other half is for surfaces on which it does not."""
_ANGLE = 0.5
"""Greatest angle between the normals of neighbouring triangles [rad], the mesher's own default."""
_MILLIMETRE = 1e-3
"""Unit in which the mesher takes chord deviations, whatever the unit of the file [m]."""


@dataclass(frozen=True, eq=False)
class StepPart:
    """A solid of a STEP file, at its place in the assembly.

    Attributes:
        name: name of the part, which several instances may have.
        mesh: its triangles [m].
    """

    name: str
    mesh: RawMesh


def chosen_parts(content: bytes, names: Sequence[str] | None, tolerance: float) -> RawMesh:
    """Return the solids of a STEP file that have one of some names, as one mesh in metres.

    Args:
        content: bytes of the file.
        names: names of the parts; None for all.
        tolerance: greatest distance between a surface and its triangles [m].

    Raises:
        ProblemError: cascadio is missing, the content is not STEP, or a name is unknown.
    """
    parts = step_parts(content, tolerance)
    known = list(dict.fromkeys(part.name for part in parts))
    if unknown := [name for name in names or () if name not in known]:
        listed = ", ".join(repr(name) for name in known)
        raise ProblemError(f"it has no part {', '.join(map(repr, unknown))}; its parts are {listed}")
    chosen = [part for part in parts if names is None or part.name in names]
    left = [name for name in known if names is not None and name not in names]
    passed_over = (f"the parts {', '.join(map(repr, left))}",) if left else ()
    mesh = RawMesh.joined([part.mesh for part in chosen], 1.0, passed_over)
    return replace(mesh, content=content)


@lru_cache(maxsize=4)  # an assembly is asked for each of its parts
def step_parts(content: bytes, tolerance: float) -> tuple[StepPart, ...]:
    """Return the solids of a STEP file, in the order of the file; arguments are those of ``chosen_parts``.

    Raises:
        ProblemError: cascadio is missing, or the content is not STEP or has no solids.
    """
    try:
        import cascadio  # type: ignore[import-not-found,import-untyped,unused-ignore] # noqa: PLC0415 - an extra
    except ImportError as error:
        said = "reading STEP needs the package cascadio; install it with: pip install cascadio"
        raise ProblemError(f"{said} ({error})") from error
    deviation = _SHARE * tolerance / _MILLIMETRE
    with _silent():
        glb = cascadio.to_glb_bytes(content, tol_linear=deviation, tol_angular=_ANGLE, use_parallel=False)
    if len(glb) == 0:
        raise ProblemError("not readable as STEP")
    parts = _parts(glb)
    if not parts:
        raise ProblemError("it contains no solids")
    return parts


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what the mesher prints of damaged files, past Python, out of the output."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in (1, 2)]
    try:
        with Path(os.devnull).open("wb") as nowhere:
            for stream in (1, 2):
                os.dup2(nowhere.fileno(), stream)
        yield
    finally:
        for stream, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)


def _parts(glb: bytes) -> tuple[StepPart, ...]:
    """Return the meshes of a GLB file that the mesher has written, each at its place, with the name of its part."""
    import trimesh  # noqa: PLC0415 - slow to load and seldom needed

    content, names = _with_numbered_meshes(glb)
    scene: Any = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
    found = []
    for node in sorted(scene.graph.nodes_geometry):
        place, key = scene.graph[node]
        mesh = scene.geometry[key]
        name = names[int(key.split(":")[0])]
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ place[:3, :3].T + place[:3, 3]
        found.append(StepPart(name, RawMesh(vertices, np.asarray(mesh.faces, dtype=np.intp))))
    return tuple(found)


def _with_numbered_meshes(glb: bytes) -> tuple[bytes, list[str]]:
    """Return a GLB file whose meshes are named by their numbers, as in "3:", and the names that they had.

    Where several meshes have one name, or a mesh has several pieces, trimesh appends a number, as other names may have.
    """
    (length,) = struct.unpack("<I", glb[12:16])
    tree = json.loads(glb[20 : 20 + length])
    names = []
    for number, mesh in enumerate(tree.get("meshes", [])):
        names.append(str(mesh.get("name", number)))
        mesh["name"] = f"{number}:"
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    whole = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return whole + text + rest, names
