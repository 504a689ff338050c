"""Obstacles from mesh files: reading, scaling, placement, and removal of repeated and degenerate triangles."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import METRES, file_length
from ccm_opt.io.build import build_placement
from ccm_opt.io.drawing import read_drawing, resolve_file
from ccm_opt.io.glb import read_glb
from ccm_opt.io.issues import Issues, KeyPath
from ccm_opt.io.quantities import MAX_LENGTH
from ccm_opt.io.raw_mesh import MESHES, STEP_SUFFIXES, MeshSettings, RawMesh, counted
from ccm_opt.io.scans import Scan, read_scan
from ccm_opt.io.scene_tables import ObstacleTable, SpaceObstacleTable
from ccm_opt.io.schema import SpaceArmTable
from ccm_opt.io.step import chosen_parts
from ccm_opt.io.stl_obj_ply import read_obj, read_ply, read_stl
from ccm_opt.io.three_mf import read_3mf
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.point_clouds import BallRadii
from ccm_opt.scene.shells import find_shells, repeated
from ccm_opt.scene.workspace import PlaneShape

_OBSTACLES: KeyPath = ("workspace", "obstacles")
_SAME = 1e-9
"""Maximum relative difference between two scale factors that count as equal."""
_CURVE_TOLERANCE = 2.5e-4
"""Default distance between the surfaces of a STEP file and their triangles [m]: that of curves in drawings."""
EXPECTED = "a mesh, for example 'casing.stl'"
_MOST_DISCS = 100_000
"""Greatest number of discs of a scan in the plane: the length of a list in a problem file."""
_SCAN = "a scan, for example 'gallery.ply'"


def mesh_bodies(
    listed: Sequence[tuple[int, SpaceObstacleTable]],
    folder: Path | None,
    metres: float,
    issues: Issues,
    *,
    allow_outside: bool = False,
    where: KeyPath = _OBSTACLES,
) -> dict[int, MeshBody]:
    """Return the obstacles that are meshes or scans, in world coordinates, by index among all obstacles of the file.

    A file to which several obstacles refer is read once.

    Args:
        listed: index (from 0) and table of each obstacle.
        folder: folder of the problem file, to which mesh paths are relative; None if there is no file.
        metres: metres per unit of length of the problem file.
        issues: receives the defects of meshes, which are then missing from the result.
        allow_outside: whether mesh files may lie outside the folder.
        where: key path of the list of obstacles, or of bodies on a link, in whose frame they then are.
    """
    read, scanned = cache(_read_and_repaired), cache(read_scan)
    found: dict[int, MeshBody] = {}
    for number, table in listed:
        file = table.mesh or table.points or ""
        path: KeyPath = (*where, number, "mesh" if table.mesh else "points")
        expected = EXPECTED if table.mesh else _SCAN
        place = file and resolve_file(file, folder, path, expected, issues, allow_outside=allow_outside)
        if not place:
            continue
        try:
            if table.points:
                body = _scan(table, scanned(place), metres)
            elif Path(file).suffix.lower() in STEP_SUFFIXES:
                body = _solids(table, place)
            else:
                body = _mesh(table, *read(place), metres)
        except ProblemError as error:
            issues.add(path, str(error))
            continue
        if table.sha256 not in {None, body.digest}:
            said = f"{file} has the SHA-256 {body.digest}, not the one given in the problem file"
            issues.add((*path[:-1], "sha256"), said)
        elif abs(body.vertices).max() > MAX_LENGTH:
            issues.add(path, f"it reaches beyond {MAX_LENGTH:g} m; check its scale")
        else:
            found[number] = body
    total = sum(len(body.faces) for body in found.values())
    if total > MESHES.most_triangles:
        issues.add(
            where,
            f"the meshes have {total} triangles and points in all; at most {MESHES.most_triangles} can be used; export "
            "them coarser",
        )
    return found


def cover_mesh_bodies(
    table: SpaceArmTable, folder: Path | None, metres: float, issues: Issues, *, allow_outside: bool = False
) -> None:
    """Cover the meshes of bodies on links with capsules; arguments are those of ``mesh_bodies``, after the arm's table.

    A mesh that encloses nothing has no centre of mass by itself, which is reported if it needs one.
    """
    rigid = {("arm", "bodies", k): each for k, each in enumerate(table.bodies)}
    for path, each in ([(("arm", "tool"), table.tool)] if table.tool else []) + list(rigid.items()):
        rows = {k: row for k, row in enumerate(each.bodies) if row.mesh is not None}
        listed = [
            (k, SpaceObstacleTable.model_construct(mesh=row.mesh, scale=row.scale, up=row.up, pose=row.pose))
            for k, row in rows.items()
        ]
        where = (*path, "bodies")
        read = mesh_bodies(listed, folder, metres, issues, allow_outside=allow_outside, where=where)
        for k, body in read.items():
            rows[k].cover_with(body)
            if each.mass and not rows[k].encloses and (each.centre is None or each.inertia is None):
                said = "it encloses no volume that mass could fill: give centre and inertia, or close the mesh"
                issues.add((*where, k, "mesh"), said)


def plane_scans(
    listed: Sequence[tuple[int, ObstacleTable]],
    folder: Path | None,
    metres: float,
    issues: Issues,
    *,
    allow_outside: bool = False,
) -> dict[int, PlaneShape]:
    """Return the obstacles in the plane that are files of points, by index among all obstacles of the file.

    The arguments are those of ``mesh_bodies``.
    """
    found: dict[int, PlaneShape] = {}
    for number, table in listed:
        if not isinstance(table.points, str):
            continue
        path: KeyPath = ("workspace", "obstacles", number, "points")
        place = resolve_file(table.points, folder, path, _SCAN, issues, allow_outside=allow_outside)
        if not place:
            continue
        try:
            shape = _plane_scan(table, table.points, read_scan(place, 2), metres)
        except ProblemError as error:
            issues.add(path, str(error))
            continue
        if len(shape.vertices) > _MOST_DISCS:
            said = f"it keeps {len(shape.vertices)} points; at most {_MOST_DISCS} can be written into a plan's record"
            issues.add(path, f"{said}; raise point_radius, by half of which discs may grow to cover points left out")
        elif abs(shape.vertices).max() > MAX_LENGTH:
            issues.add(path, f"it reaches beyond {MAX_LENGTH:g} m; check its scale")
        else:
            found[number] = shape
    return found


def _plane_scan(table: ObstacleTable, file: str, scan: Scan, metres: float) -> PlaneShape:
    """Return the discs about the points of a scan in the plane; arguments are those of ``_mesh``."""
    scale = metres * (1.0 if table.scale is None else table.scale)
    turn = 0.0 if table.pose is None else table.pose.rotation_deg
    x, y = [0.0, 0.0] if table.pose is None else table.pose.position
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = scale * scan.points @ rotation.T + (x, y)
    radii, notes = _radii(table, scan, scale)
    return PlaneShape.of_scan(points, radii, file, scale=scale, origin=(x, y), notes=notes)


def _radii(table: ObstacleTable | SpaceObstacleTable, scan: Scan, scale: float) -> tuple[BallRadii, tuple[str, ...]]:
    """Return the radii of the points of a scan, with a note for the user if they leave gaps between them.

    Args:
        table: table of the obstacle.
        scan: the scan, in the unit of its file.
        scale: metres per unit of the file.
    """
    radii = BallRadii(table.point_radius or 0.0, table.error or 0.0)
    if not scan.leaves_gaps((radii.point + radii.error) / scale):
        return radii, ()
    gaps = "points of point_radius leave gaps between them, through which a thin arm may pass; raise point_radius"
    return radii, (f"its points are {file_length(scale * scan.spacing)} apart in the median: {gaps}",)


def _mesh(table: SpaceObstacleTable, raw: RawMesh, mended: RawMesh, metres: float) -> MeshBody:
    """Return the mesh of an obstacle, in world coordinates.

    Args:
        table: table of the obstacle.
        raw: the mesh as read.
        mended: the mesh after repairs.
        metres: metres per unit of length of the problem file.
    """
    scale, notes = _scale(table, table.mesh or "", raw, metres)
    return MeshBody(
        _in_room(table, scale * mended.vertices),
        mended.faces,
        file=table.mesh or "",
        digest=hashlib.sha256(raw.content).hexdigest(),
        solid=table.solid is not False,
        scale=scale,
        placement=build_placement(table.pose),
        up=table.up or "z",
        content=raw.content,
        triangles_read=len(raw.faces),
        margin=table.error or 0.0,
        mended=mended.mended,
        notes=notes,
    )


def _solids(table: SpaceObstacleTable, place: Path) -> MeshBody:
    """Return the chosen solids of a STEP file, in world coordinates.

    The triangles are kept rather than the file, so that a plan is checked with those that it was made with.
    """
    content = read_drawing(place, STEP_SUFFIXES, "mesh", MESHES.most_bytes)
    tolerance = table.curve_tolerance or _CURVE_TOLERANCE
    try:
        raw = chosen_parts(content, table.parts, tolerance)
        _refuse_unusable(raw, MESHES)
        body = _mesh(table, raw, repaired_mesh(raw), 1.0)
    except ProblemError as error:
        raise ProblemError(f"{place.name}: {error}") from error
    return replace(body, content=b"", margin=body.margin + tolerance, notes=(*body.notes, _within(tolerance)))


def _within(tolerance: float) -> str:
    return f"its surfaces are within {file_length(tolerance)} of the triangles, which are kept as far away in addition"


def _scan(table: SpaceObstacleTable, scan: Scan, metres: float) -> MeshBody:
    """Return the balls about the points of a scan, in world coordinates; arguments are those of ``_mesh``."""
    scale = metres * (1.0 if table.scale is None else table.scale)
    radii, notes = _radii(table, scan, scale)
    return MeshBody.of_scan(
        _in_room(table, scale * scan.points),
        radii,
        file=table.points,
        digest=hashlib.sha256(scan.content).hexdigest(),
        scale=scale,
        placement=build_placement(table.pose),
        up=table.up or "z",
        content=scan.content,
        notes=notes,
    )


def _in_room(table: SpaceObstacleTable, points: FloatArray) -> FloatArray:
    """Return points of a file, shape (n, 3) [m], in world coordinates."""
    return build_placement(table.pose).points(turned_up(points) if table.up == "y" else points)


def _read_and_repaired(place: Path) -> tuple[RawMesh, RawMesh]:
    raw = read_mesh_file(place)
    try:
        return raw, repaired_mesh(raw)
    except ProblemError as error:
        raise ProblemError(f"{place.name}: {error}") from error


def _scale(table: SpaceObstacleTable, file: str, mesh: RawMesh, metres: float) -> tuple[float, tuple[str, ...]]:
    """Return metres per unit of a mesh file, with notes for the user on unit, axes and ignored contents.

    Args:
        table: table of the obstacle.
        file: name of the mesh file.
        mesh: the mesh as read.
        metres: metres per unit of length of the problem file.
    """
    notes = [f"ignored {what}" for what in mesh.passed_over]
    unit = next((name for name, length in METRES.items() if length == metres), "m")
    scale = metres * (1.0 if table.scale is None else table.scale)
    if mesh.metres is not None:
        scale_note = f"one unit of the file is {mesh.metres / metres:.6g} {unit}"
        if table.scale is None:
            scale = mesh.metres
            notes += [scale_note] if scale != metres else []
        elif abs(scale - mesh.metres) > _SAME * mesh.metres:
            notes.append(f"{scale_note}, but scale = {table.scale:g} sets it to {table.scale:g} {unit}")
    elif Path(file).suffix.lower() == ".glb" and table.scale is None and metres != 1.0:
        notes.append(
            f"GLB files are in metres, but one unit is taken as 1 {unit}; set scale = {1.0 / metres:g} if "
            "the file is in metres"
        )
    if Path(file).suffix.lower() == ".glb" and table.up is None:
        notes.append(
            'GLB files have y up, but the mesh is not rotated; set up = "y" to turn its y to z, or up = "z" to keep it'
        )
    return scale, tuple(notes)


def turned_up(places: FloatArray) -> FloatArray:
    """Return points of a y-up coordinate system, shape (n, 3), rotated about x into a z-up system."""
    return np.stack((places[:, 0], -places[:, 2], places[:, 1]), axis=1)


MESH_READERS: Mapping[str, Callable[[bytes, MeshSettings], RawMesh]] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".glb": read_glb,
    ".3mf": read_3mf,
}
"""Readers of mesh files, by file name suffix in lower case."""


def read_mesh_file(path: Path, settings: MeshSettings = MESHES) -> RawMesh:
    """Return the mesh in a file, in the unit of that file and without repairs.

    Args:
        path: an STL, OBJ, PLY, GLB or 3MF file, recognised by its suffix.
        settings: limits on the size of the file and the mesh.

    Raises:
        ProblemError: the file cannot be read, or contains no usable mesh.
    """
    content = read_drawing(path, MESH_READERS, "mesh", settings.most_bytes, b"\0 \t\r\n")
    try:
        mesh = MESH_READERS[path.suffix.lower()](content, settings)
        _refuse_unusable(mesh, settings)
    except ProblemError as error:
        raise ProblemError(f"{path.name}: {error}") from error
    except (MemoryError, RecursionError) as error:
        raise ProblemError(f"{path.name}: too large or too deeply nested to read") from error
    return replace(mesh, content=content)


def _refuse_unusable(mesh: RawMesh, settings: MeshSettings) -> None:
    """Raise an error for a mesh that has no or too many triangles, or used vertices that are not finite or too large.

    Raises:
        ProblemError: the mesh has one of these defects.
    """
    count = len(mesh.faces)
    if count == 0:
        raise ProblemError("it contains no triangles; expected a mesh")
    if count > settings.most_triangles:
        raise ProblemError(
            f"it has {count} triangles; at most {settings.most_triangles} can be used; export it coarser"
        )
    used = _used(mesh.vertices, mesh.faces)
    broken = np.flatnonzero(used & ~np.isfinite(mesh.vertices).all(axis=1))
    if len(broken):
        counted = f"{len(broken)} of {len(mesh.vertices)} vertices"
        raise ProblemError(f"{counted} are not finite, first that of index {broken[0]}")
    largest = float(np.abs(mesh.vertices[used]).max())
    if largest > settings.largest_coordinate:
        raise ProblemError(
            f"a coordinate is {largest:g}; expected at most {settings.largest_coordinate:g} in the mesh's unit"
        )


def _used(vertices: FloatArray, faces: IntArray) -> BoolArray:
    """Return whether each vertex is a corner of any triangle, shape (v,); unused vertices may even be NaN.

    Args:
        vertices: positions of the vertices, shape (v, 3).
        faces: vertex indices of the triangles, shape (m, 3).
    """
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    return used


_MOST_FLAT = 0.5
"""Fraction of degenerate triangles above which a mesh file is refused as damaged. Heuristic: CAD programs write about
one in a hundred where they cut curved faces."""

_MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd multipliers that hash the three coordinates of a vertex into one integer."""


def repaired_mesh(raw: RawMesh, settings: MeshSettings = MESHES) -> RawMesh:
    """Return a mesh with equal vertices merged and redundant triangles removed; its surface covers the same points.

    Repeated triangles are removed, unless two bodies touch there and each needs its own triangle to be closed. A
    degenerate triangle is removed only if it coincides with an edge or a vertex of another triangle.

    Args:
        raw: a mesh with finite coordinates.
        settings: gives the height up to which a triangle counts as degenerate.

    Raises:
        ProblemError: more than half of the triangles are degenerate.
    """
    vertices, names = _distinct_rows(raw.vertices)
    faces = names[raw.faces]
    flat = _without_area(vertices, faces, settings)
    count = int(np.count_nonzero(flat))
    if count > _MOST_FLAT * len(faces):
        raise ProblemError(f"{count} of {len(faces)} triangles have zero area; the file is damaged, or not a mesh")
    kept = faces[~flat]
    needed = faces[flat][~_on_edges(vertices, faces[flat], kept)] if count else faces[:0]
    once = kept[~find_shells(vertices, kept).copies] if repeated(kept).any() else kept
    mended = []
    if count > len(needed):
        mended.append(f"left out {counted(count - len(needed), 'triangle')} without area")
    if len(once) < len(kept):
        mended.append(f"left out {counted(len(kept) - len(once), 'repeated triangle')}")
    faces = np.concatenate((once, needed))
    used = _used(vertices, faces)
    return RawMesh(vertices[used], (np.cumsum(used) - 1)[faces].astype(np.intp), mended=tuple(mended))


def _distinct_rows(points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the distinct rows of an array of points, and for each given point the index of its distinct row.

    Args:
        points: points, shape (v, 3).

    Returns:
        Distinct points, shape (n, 3), and indices, shape (v,).
    """
    # Adding 0.0 makes zero and minus zero equal in their bits.
    points = np.ascontiguousarray(points + 0.0)
    bits = points.view(np.uint64)
    # The lower half of a single-precision number is all zeros, and a product alone would leave it so.
    bits = bits ^ (bits >> np.uint64(32))
    keys = (bits * _MIXERS).sum(axis=1, dtype=np.uint64)
    _, first, names = np.unique(keys, return_index=True, return_inverse=True)
    distinct = points[first]
    if np.array_equal(distinct[names], points):
        return distinct, names.astype(np.intp)
    # Hash collision: fall back to sorting by all three coordinates, which takes longer.
    found, slow_names = np.unique(points, axis=0, return_inverse=True)
    return found, slow_names.reshape(-1).astype(np.intp)


def _without_area(vertices: FloatArray, faces: IntArray, settings: MeshSettings) -> BoolArray:
    """Return whether each triangle is degenerate (its corners coincide or are collinear), shape (m,).

    Args:
        vertices: positions of the vertices, shape (v, 3).
        faces: vertex indices of the triangles, shape (m, 3).
        settings: gives the height up to which a triangle counts as degenerate.
    """
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.sqrt(np.einsum("fij,fij->fi", sides, sides))
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    extent = float(np.ptp(vertices[_used(vertices, faces)], axis=0).max())
    return np.asarray(doubled <= settings.least_height * extent * lengths.max(axis=1))


def _on_edges(vertices: FloatArray, flat: IntArray, others: IntArray) -> BoolArray:
    """Return whether each degenerate triangle coincides with an edge or a vertex of another triangle, shape (f,).

    Args:
        vertices: vertices of the mesh, shape (v, 3).
        flat: vertex indices of the degenerate triangles, shape (f, 3).
        others: vertex indices of the other triangles, shape (m, 3).
    """
    corners = vertices[flat]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = np.argmax(sides, axis=1)
    rows = np.arange(len(flat))
    first = flat[rows, longest]
    second = flat[rows, (longest + 1) % 3]

    def key(starts: IntArray, ends: IntArray) -> IntArray:
        """Return an integer for each edge, equal for both directions of the edge."""
        return np.minimum(starts, ends) * (len(vertices) + 1) + np.maximum(starts, ends)

    edges = np.unique(key(others, np.roll(others, -1, axis=1)))
    used = _used(vertices, others)[first]
    return np.asarray(np.where(first == second, used, np.isin(key(first, second), edges)))
