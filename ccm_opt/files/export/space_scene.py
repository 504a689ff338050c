"""The obstacles of a room in space for other programs: names that they take, sides of the room as boxes, mesh files."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from ccm_opt.files.export.export_settings import EXPORT, ExportSettings
from ccm_opt.files.export.scene_urdf import triangles_stl
from ccm_opt.files.export.solid_names import told_apart
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import Body, BoxBody, MeshBody
from ccm_opt.space.scene.scene import ROOM_NAME

KEPT_MESHES = "meshes"
"""Folder in an output folder with the mesh files that the problem was read with."""


@dataclass(frozen=True)
class NamedBody:
    """A body that the arm can touch.

    Attributes:
        name: printable and unlike that of any other.
        slug: the same with letters, digits and underscores alone.
        body: its shape, where it stands.
    """

    name: str
    slug: str
    body: Body

    @property
    def mesh_file(self) -> str:
        """Name of the file of its mesh; of no matter where it is no mesh."""
        return f"{self.slug}.stl"


def named_bodies(problem: SpaceProblem, settings: ExportSettings = EXPORT) -> tuple[NamedBody, ...]:
    """All obstacles, then the sides of the room where there is one."""
    workspace = problem.workspace
    bodies: list[tuple[str, Body]] = [(each.name, each.body) for each in workspace.obstacles]
    if workspace.bounds is not None:
        thickness = settings.room_wall * problem.arm.length
        bodies += [(ROOM_NAME, slab) for slab in _slabs(workspace.bounds, thickness)]
    names = told_apart(name for name, _ in bodies)
    return tuple(NamedBody(*name, body) for name, (_, body) in zip(names, bodies, strict=True))


def space_meshes(bodies: tuple[NamedBody, ...], folder: str) -> dict[str, bytes]:
    """The mesh files of a scene in binary STL, metres, as they stand in the world; ``folder`` is before their names."""
    return {
        f"{folder}/{named.mesh_file}": triangles_stl(named.body.triangles)
        for named in bodies
        if isinstance(named.body, MeshBody)
    }


def kept_meshes(problem: SpaceProblem) -> dict[str, bytes]:
    """The mesh files that a problem was read with, byte for byte, so that a folder can be verified by itself.

    Meshes that were made in Python are written as they stand.
    """
    return {
        name: obstacle.body.content or triangles_stl(obstacle.body.triangles)
        for obstacle, name in zip(problem.workspace.obstacles, kept_names(problem), strict=True)
        if isinstance(obstacle.body, MeshBody)
    }


def kept_names(problem: SpaceProblem) -> list[str]:
    """Where the mesh of each obstacle is kept, relative to the folder; of no matter where it is no mesh."""
    slugs = [slug for _, slug in told_apart(each.name for each in problem.workspace.obstacles)]
    return [
        f"{KEPT_MESHES}/{slug}{_suffix(each.body)}"
        for slug, each in zip(slugs, problem.workspace.obstacles, strict=True)
    ]


def _suffix(body: Body) -> str:
    """Of the file of a mesh; those that have none are written as STL."""
    kept = isinstance(body, MeshBody) and body.content
    return PurePosixPath(body.file).suffix.lower() if isinstance(body, MeshBody) and kept else ".stl"


def _slabs(bounds: FloatArray, thickness: float) -> Iterator[BoxBody]:
    """The six sides of a room, outside it."""
    low, high = bounds
    for axis in range(3):
        # Each reaches past the room by the thickness all round, so that the corners are closed.
        own = np.arange(3) == axis
        yield BoxBody(low - thickness, np.where(own, low, high + thickness))
        yield BoxBody(np.where(own, high, low - thickness), high + thickness)
