"""Obstacles from mesh files, mended."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES
from ccm_opt.io.build import build_placement
from ccm_opt.io.drawing import content_of, place_beside
from ccm_opt.io.glb import read_glb
from ccm_opt.io.issues import Issues, KeyPath
from ccm_opt.io.raw_mesh import MESHES, MeshSettings, RawMesh, counted
from ccm_opt.io.schema import SpaceObstacleTable
from ccm_opt.io.schema_tables import MAX_LENGTH
from ccm_opt.io.stl_obj_ply import read_obj, read_ply, read_stl
from ccm_opt.io.three_mf import read_3mf
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.shells import find_shells, repeated

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
    content = content_of(path, MESH_READERS, "mesh", settings.most_bytes, b"\0 \t\r\n")
    try:
        mesh = MESH_READERS[path.suffix.lower()](content, settings)
        _refuse_unusable(mesh, settings)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    except (MemoryError, RecursionError) as error:
        raise ProblemError(f"{path.name}: too large or too deeply nested to be read") from error
    return MeshFile(mesh, content, hashlib.sha256(content).hexdigest())


def _refuse_unusable(mesh: RawMesh, settings: MeshSettings) -> None:
    """Refuse a mesh without triangles, with too many, or with vertices that are nowhere."""
    count = len(mesh.faces)
    if count == 0:
        raise ProblemError("it holds no triangles; expected a mesh")
    if count > settings.most_triangles:
        raise ProblemError(f"it has {count} triangles, at most {settings.most_triangles} are used; export it coarser")
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


_MOST_FLAT = 0.5
"""Share of triangles without area from which on a mesh is refused, since its file must be broken. Taste: programs write
one in a hundred where they cut curved faces."""

_MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers without a pattern, by which the three coordinates of a vertex become one number."""


@dataclass(frozen=True, eq=False)
class MendedMesh:
    """A mesh whose triangles share their vertices.

    Attributes:
        mesh: vertices, each once, and triangles.
        mended: what was put right, in words.
    """

    mesh: RawMesh
    mended: tuple[str, ...]

    @property
    def closed(self) -> bool:
        """Whether every edge joins two triangles."""
        return bool(find_shells(self.mesh.vertices, self.mesh.faces).closed.all())


def mended_mesh(raw: RawMesh, settings: MeshSettings = MESHES) -> MendedMesh:
    """Join equal vertices, and leave out what is there twice or has no area and is the edge of another triangle.

    Where two bodies touch, the triangles of both stay.

    No place that belonged to the surface is lost: a triangle without area stays unless it covers nothing else than an
    edge of another.

    Args:
        raw: a mesh whose numbers are finite.
        settings: what counts as no area.

    Raises:
        ProblemError: most triangles have no area.
    """
    vertices, names = _distinct_rows(raw.vertices)
    faces = names[raw.faces]
    flat = _without_area(vertices, faces, settings)
    count = int(np.count_nonzero(flat))
    if count > _MOST_FLAT * len(faces):
        raise ProblemError(f"{count} of {len(faces)} triangles have no area; the file is broken, or no mesh")
    kept = faces[~flat]
    needed = faces[flat][~_on_edges(vertices, faces[flat], kept)] if count else faces[:0]
    once = kept[~find_shells(vertices, kept).copies] if repeated(kept).any() else kept
    mended = []
    if count > len(needed):
        mended.append(f"left out {counted(count - len(needed), 'triangle')} without area")
    if len(once) < len(kept):
        mended.append(f"left out {counted(len(kept) - len(once), 'repeated triangle')}")
    return MendedMesh(_with_used_vertices(vertices, np.concatenate((once, needed))), tuple(mended))


def _distinct_rows(points: FloatArray) -> tuple[FloatArray, IntArray]:
    """The different points, and the number of each given one among them, shape (v,)."""
    # Zero and minus zero are one place.
    points = np.ascontiguousarray(points + 0.0)
    bits = points.view(np.uint64)
    # Numbers of single precision have nothing but zeros in their lower half, which a product alone would leave there.
    bits = bits ^ (bits >> np.uint64(32))
    keys = (bits * _MIXERS).sum(axis=1, dtype=np.uint64)
    _, first, names = np.unique(keys, return_index=True, return_inverse=True)
    distinct = points[first]
    if np.array_equal(distinct[names], points):
        return distinct, names.astype(np.intp)
    # Two places happened to become one number: sort by all three coordinates, which takes longer.
    found, slow_names = np.unique(points, axis=0, return_inverse=True)
    return found, slow_names.reshape(-1).astype(np.intp)


def _without_area(vertices: FloatArray, faces: IntArray, settings: MeshSettings) -> BoolArray:
    """Which triangles are points or lines, shape (m,)."""
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.sqrt(np.einsum("fij,fij->fi", sides, sides))
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # Vertices that no triangle has may be anywhere, or be no numbers at all.
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    extent = float(np.ptp(vertices[used], axis=0).max())
    return np.asarray(doubled <= settings.least_height * extent * lengths.max(axis=1))


def _on_edges(vertices: FloatArray, flat: IntArray, others: IntArray) -> BoolArray:
    """Which triangles without area cover nothing else than a vertex or an edge of others, shape (f,)."""
    corners = vertices[flat]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = np.argmax(sides, axis=1)
    rows = np.arange(len(flat))
    first = flat[rows, longest]
    second = flat[rows, (longest + 1) % 3]
    base = np.uint64(len(vertices) + 1)
    low = np.minimum(first, second).astype(np.uint64)
    high = np.maximum(first, second).astype(np.uint64)
    edges = np.unique(_edge_keys(others, int(base)))
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[others] = True
    return np.asarray(np.where(low == high, used[first], np.isin(low * base + high, edges)))


def _edge_keys(faces: IntArray, base: int) -> npt.NDArray[np.uint64]:
    """Every edge of every triangle as one number, whichever way it runs, shape (3 m,); base: more than any vertex."""
    starts = faces.ravel().astype(np.uint64)
    ends = np.roll(faces, -1, axis=1).ravel().astype(np.uint64)
    return np.minimum(starts, ends) * np.uint64(base) + np.maximum(starts, ends)


def _with_used_vertices(vertices: FloatArray, faces: IntArray) -> RawMesh:
    """The mesh without vertices that no triangle has."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    names = np.cumsum(used) - 1
    return RawMesh(vertices[used], names[faces].astype(np.intp))
