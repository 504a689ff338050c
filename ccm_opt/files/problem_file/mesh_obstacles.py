"""Obstacles of a problem file that are meshes: their files are found, read, mended, scaled and placed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file.beside_file import place_beside
from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath
from ccm_opt.files.problem_file.schema import SpaceObstacleTable
from ccm_opt.files.problem_file.space_build import build_placement
from ccm_opt.files.problem_file.typed_quantities import MAX_LENGTH
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import METRES
from ccm_opt.space.scene.bodies import MeshBody

if TYPE_CHECKING:
    from ccm_opt.files.scene_import.mesh_file import MeshFile
    from ccm_opt.files.scene_import.mesh_mending import MendedMesh
    from ccm_opt.files.scene_import.raw_mesh import RawMesh

_SAME = 1e-9
"""Share by which two scales may differ and are the same but for rounding."""
EXPECTED = "a mesh, for example 'casing.stl'"


@dataclass
class MeshObstacles:
    """Reads the meshes of one problem file, each file once.

    Attributes:
        folder: of the problem file; None where there is none.
        metres: in its unit.
        issues: receives what is wrong with a mesh.
        allow_outside: whether meshes may lie outside the folder.
    """

    folder: Path | None
    metres: float
    issues: Issues
    allow_outside: bool = False
    _read: dict[Path, "tuple[MeshFile, MendedMesh] | ProblemError"] = field(default_factory=dict)

    def bodies(self, listed: Sequence[tuple[int, SpaceObstacleTable]]) -> dict[int, MeshBody]:
        """The meshes among the obstacles, by their place in the file; what is wrong with one is noted."""
        found: dict[int, MeshBody] = {}
        for number, table in listed:
            path: KeyPath = ("workspace", "obstacles", number)
            body = None if table.mesh is None else self._body(table, table.mesh, path)
            if body is not None:
                found[number] = body
        self._refuse_too_many(found)
        return found

    def _body(self, table: SpaceObstacleTable, file: str, path: KeyPath) -> MeshBody | None:
        place = self._place(file, path)
        if place is None:
            return None
        read = self._file(place)
        if isinstance(read, ProblemError):
            self.issues.add((*path, "mesh"), str(read))
            return None
        if table.sha256 is not None and read[0].digest != table.sha256:
            self.issues.add(
                (*path, "sha256"), f"{file} has the hash {read[0].digest}; it is not the mesh that was meant"
            )
            return None
        return self._placed(table, file, path, *read)

    def _place(self, file: str, path: KeyPath) -> Path | None:
        return place_beside(file, self.folder, (*path, "mesh"), EXPECTED, self.issues, allow_outside=self.allow_outside)

    def _file(self, place: Path) -> "tuple[MeshFile, MendedMesh] | ProblemError":
        """What a file holds, or why it cannot be used."""
        from ccm_opt.files.scene_import.mesh_file import read_mesh_file  # noqa: PLC0415 - most problems have no mesh
        from ccm_opt.files.scene_import.mesh_mending import mended_mesh  # noqa: PLC0415

        if place not in self._read:
            try:
                read = read_mesh_file(place)
                self._read[place] = (read, mended_mesh(read.mesh))
            except ProblemError as error:
                named = str(error) if str(error).startswith((place.name, str(place))) else f"{place.name}: {error}"
                self._read[place] = ProblemError(named)
        return self._read[place]

    def _placed(
        self, table: SpaceObstacleTable, file: str, path: KeyPath, read: "MeshFile", mended: "MendedMesh"
    ) -> MeshBody | None:
        """The mesh in metres, where it stands; None where it lies beyond all measure."""
        scale, notes = self._scale(table, file, read.mesh)
        mesh = mended.mesh
        placement = build_placement(table.pose)
        vertices = placement.points(scale * (turned_up(mesh.vertices) if table.up == "y" else mesh.vertices))
        if abs(vertices).max() > MAX_LENGTH:
            self.issues.add((*path, "mesh"), f"it reaches beyond {MAX_LENGTH:g} m; is its scale right?")
            return None
        return MeshBody(
            vertices,
            mesh.faces,
            file=file,
            digest=read.digest,
            solid=table.solid is not False,
            scale=scale,
            placement=placement,
            up=table.up or "z",
            content=read.content,
            triangles_read=len(read.mesh.faces),
            mended=mended.mended,
            notes=notes,
        )

    def _scale(self, table: SpaceObstacleTable, file: str, mesh: "RawMesh") -> tuple[float, tuple[str, ...]]:
        """Metres in one unit of a mesh, and what people should know of its unit, its axes and its other contents."""
        notes = [f"passed over {what}" for what in mesh.passed_over]
        unit = next((name for name, metres in METRES.items() if metres == self.metres), "m")
        scale = self.metres * (1.0 if table.scale is None else table.scale)
        if mesh.metres is not None:
            own = f"its own unit is {mesh.metres / self.metres:.6g} {unit}"
            if table.scale is None:
                scale = mesh.metres
                notes += [own] if scale != self.metres else []
            elif abs(scale - mesh.metres) > _SAME * mesh.metres:
                notes.append(f"{own}, but scale = {table.scale:g} makes it {table.scale:g} {unit}")
        elif Path(file).suffix.lower() == ".glb" and table.scale is None and self.metres != 1.0:
            notes.append(
                f"the unit of GLB is the metre, but one is taken as 1 {unit}; scale = {1.0 / self.metres:g} if it is"
            )
        if Path(file).suffix.lower() == ".glb" and table.up is None:
            notes.append('in GLB y is up, but it is taken as it stands; up = "y" turns its y to z, up = "z" does not')
        return scale, tuple(notes)

    def _refuse_too_many(self, found: Mapping[int, MeshBody]) -> None:
        """All meshes together have no more triangles than one may have."""
        from ccm_opt.files.scene_import.mesh_settings import MESHES  # noqa: PLC0415

        total = sum(len(body.faces) for body in found.values())
        if total > MESHES.most_triangles:
            self.issues.add(
                ("workspace", "obstacles"),
                f"the meshes have {total} triangles together, at most {MESHES.most_triangles} can be used; "
                "export them coarser",
            )


def turned_up(places: FloatArray) -> FloatArray:
    """Turn places whose y is up, shape (n, 3), about x so that their z is."""
    return np.stack((places[:, 0], -places[:, 2], places[:, 1]), axis=1)
