"""Triangle meshes as read from files, size limits of mesh files, and triangulation of polygonal faces."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import ProblemError


@dataclass(frozen=True)
class MeshSettings:
    """Limits on the size of mesh files of every supported format.

    Attributes:
        most_bytes: maximum size of a file [bytes]. Heuristic: two million triangles as text.
        most_triangles: maximum number of triangles of one mesh, and of all meshes of a problem together. Heuristic:
            with more, distance queries would take gigabytes of memory.
        most_unpacked: maximum unpacked size of the models in a 3MF file [bytes]. Heuristic: about
            ``most_triangles`` triangles as text.
        deepest: maximum nesting depth of components in a 3MF file. Heuristic: CAD programs nest two or three deep.
        most_parts: maximum number of part instances in a 3MF or GLB file. Heuristic.
        least_height: height up to which a triangle counts as degenerate, as a fraction of the mesh's extent. Derived: a
            few rounding errors of a vertex in double precision.
        largest_coordinate: maximum absolute coordinate, in the unit of the file. Derived: double precision no longer
            resolves a millionth of a unit beyond this value.
    """

    most_bytes: int = 256 * 2**20
    most_triangles: int = 2_000_000
    most_unpacked: int = 512 * 2**20
    deepest: int = 20
    most_parts: int = 10_000
    least_height: float = 1e-13
    largest_coordinate: float = 1e9


MESHES = MeshSettings()
"""Default limits on mesh files."""
STEP_SUFFIXES = (".step", ".stp")
"""Suffixes of files of solids, which become meshes."""


@dataclass(frozen=True, eq=False)
class RawMesh:
    """A triangle mesh as read from a file, with coordinates in the unit of that file.

    Raises:
        ProblemError: an array has the wrong shape, or a triangle refers to a vertex that does not exist.

    Attributes:
        vertices: positions of the vertices, shape (v, 3).
        faces: indices of the vertices of each triangle, shape (m, 3).
        metres: metres per unit, if the file states the unit; else None.
        passed_over: contents of the file that were ignored because they are not surfaces, in words for the user.
        content: bytes of the file.
        mended: repairs made to the mesh, in words for the user.
    """

    vertices: FloatArray
    faces: IntArray
    metres: float | None = None
    passed_over: tuple[str, ...] = ()
    content: bytes = b""
    mended: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.vertices.shape[1:] != (3,) or self.faces.shape[1:] != (3,):
            raise ProblemError("its vertices do not have three coordinates each, or its faces are not triangles")
        if self.faces.min(initial=0) < 0 or self.faces.max(initial=-1) >= len(self.vertices):
            raise ProblemError(f"a triangle refers to a vertex beyond the {len(self.vertices)} of the mesh")

    @classmethod
    def of_corners(cls, corners: FloatArray) -> "RawMesh":
        """Return a mesh of m separate triangles, which share no vertices, from corner positions of shape (m, 3, 3)."""
        return cls(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.intp).reshape(-1, 3))

    @classmethod
    def joined(
        cls, meshes: list["RawMesh"], metres: float | None = None, passed_over: tuple[str, ...] = ()
    ) -> "RawMesh":
        """Return the concatenation of several meshes, with the given unit and record of ignored contents."""
        if not meshes:
            return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp), metres, passed_over)
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        return cls(vertices, np.concatenate(faces), metres, passed_over)


def counted(number: int, what: str) -> str:
    """Return a number with its noun in the singular or the plural, for example ``2 lines``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


_TRIANGLE = 3
_QUADRANGLE = 4


def triangulate_faces(vertices: FloatArray, corners: IntArray, counts: IntArray) -> IntArray:
    """Triangulate polygonal faces of a mesh; planar faces that do not cross themselves are covered exactly.

    Args:
        vertices: positions of the vertices, shape (v, 3).
        corners: vertex indices of all faces, one face after the other, shape (sum of ``counts``,).
        counts: number of corners of each face, shape (f,); faces with fewer than three are ignored.

    Returns:
        Vertex indices of each triangle, shape (m, 3), in the order of the faces.
    """
    starts = np.cumsum(counts) - counts
    found = []
    places = []
    for count in np.unique(counts[counts >= _TRIANGLE]):
        chosen = np.flatnonzero(counts == count)
        faces = corners[starts[chosen, None] + np.arange(count)]
        with np.errstate(invalid="ignore", over="ignore"):  # such vertices are refused later
            found.append(_cut(vertices, faces).reshape(-1, 3))
        places.append(np.repeat(chosen, count - 2))
    if not found:
        return np.zeros((0, 3), dtype=np.intp)
    return np.concatenate(found)[np.argsort(np.concatenate(places), kind="stable")]


def _cut(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the triangulation of f polygons with c corners each, as vertex indices, shape (f, c - 2, 3).

    Args:
        vertices: positions of the vertices, shape (v, 3).
        faces: vertex indices of the polygons, shape (f, c).
    """
    count = faces.shape[1]
    along = np.arange(1, count - 1)
    fans = faces[:, np.column_stack((np.zeros_like(along), along, along + 1))]
    if count == _TRIANGLE or len(vertices) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        return fans  # vertices that do not exist are refused later, with a message
    inward = _bends_inward(vertices[faces])
    if count == _QUADRANGLE:
        # One diagonal runs inside: that from the first corner, unless the second or the last corner is reflex.
        other = inward[:, 1] | inward[:, 3]
        return np.where(other[:, None, None], faces[:, [[1, 2, 3], [1, 3, 0]]], fans)
    for number in np.flatnonzero(inward.any(axis=1)):
        cut = _cut_flat(vertices[faces[number]])
        if cut is not None:
            fans[number] = faces[number][cut]
    return fans


def _normals(corners: FloatArray) -> FloatArray:
    """Return normals of polygons, shape (f, 3), whose norm is twice the area, from corners of shape (f, c, 3)."""
    spokes = corners - corners[:, :1]
    return np.asarray(np.cross(spokes[:, 1:-1], spokes[:, 2:]).sum(axis=1))


def _bends_inward(corners: FloatArray) -> BoolArray:
    """Return whether each corner of each polygon is reflex, shape (f, c), from corner positions, shape (f, c, 3)."""
    edges = np.roll(corners, -1, axis=1) - corners
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    return np.asarray(np.einsum("fci,fi->fc", turns, _normals(corners)) < 0.0)


def _cut_flat(corners: FloatArray) -> IntArray | None:
    """Return the constrained Delaunay triangulation of one polygon in space, as corner indices of shape (c - 2, 3).

    Args:
        corners: positions of the polygon's corners, shape (c, 3).

    Returns:
        The corner indices; None if the polygon, projected along a coordinate axis, crosses itself or cannot be
        triangulated.
    """
    import shapely  # noqa: PLC0415 - few meshes have such faces

    normal = _normals(corners[None])[0]
    if not np.isfinite(normal).all():
        return None
    # Project along the axis closest to the normal, where the face has its largest area.
    flat = np.delete(corners, int(np.argmax(np.abs(normal))), axis=1)
    ring = shapely.Polygon(flat)
    if not ring.is_valid:
        return None
    numbers = {tuple(place): number for number, place in enumerate(flat)}
    try:
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(ring))
    except shapely.errors.GEOSException:  # corners so far apart that GEOS fails
        return None
    if len(pieces) != len(corners) - 2:
        return None
    # The ring of a triangle has four points; the last repeats the first.
    places = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    cut = np.array([[numbers[tuple(place)] for place in piece] for piece in places])
    backward = _normals(corners[cut]) @ normal < 0.0
    cut[backward] = cut[backward, ::-1]
    return cut
