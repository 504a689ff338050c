"""Meshes as they are read, and faces of more than three corners."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import ProblemError


@dataclass(frozen=True)
class MeshSettings:
    """Bounds on mesh files and what counts as a defect of a mesh, the same for all formats.

    Attributes:
        most_bytes: of a file; larger ones are refused unread. Taste: two million triangles as text.
        most_triangles: of a mesh, or of all meshes of a problem together; more are refused. Taste: distances would take
            gigabytes of memory.
        most_unpacked: bytes of the model inside a 3MF file, which is packed. Taste: as many triangles as text.
        deepest: components of components in a 3MF file. Taste: programs nest two or three deep.
        most_parts: parts that a 3MF or GLB file is put together from, each counted as often as it is used. Taste.
        least_height: triangles lower than this share of the mesh's extent have no area. Derived: some roundings of a
            vertex in double precision.
        largest_coordinate: in the mesh's own unit. Derived: beyond it double precision no longer resolves a millionth.
    """

    most_bytes: int = 256 * 2**20
    most_triangles: int = 2_000_000
    most_unpacked: int = 512 * 2**20
    deepest: int = 20
    most_parts: int = 10_000
    least_height: float = 1e-13
    largest_coordinate: float = 1e9


MESHES = MeshSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True, eq=False)
class RawMesh:
    """Vertices and triangles in the unit of the file.

    Raises:
        ProblemError: a triangle has a vertex that is not there.

    Attributes:
        vertices: shape (v, 3).
        faces: vertices of each triangle, shape (m, 3).
        metres: length of one unit, where the file says it itself [m].
        passed_over: what else the file holds, which is no surface, in words.
        content: the bytes of the file.
        mended: what was put right, in words.
    """

    vertices: FloatArray
    faces: IntArray
    metres: float | None = None
    passed_over: tuple[str, ...] = ()
    content: bytes = b""
    mended: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.vertices.shape[1:] != (3,) or self.faces.shape[1:] != (3,):
            raise ProblemError("its vertices have not three coordinates each, or its faces are no triangles")
        if self.faces.min(initial=0) < 0 or self.faces.max(initial=-1) >= len(self.vertices):
            raise ProblemError(f"a triangle has a vertex that is not there; there are {len(self.vertices)} vertices")

    @classmethod
    def of_corners(cls, corners: FloatArray) -> "RawMesh":
        """Return the mesh of triangles that share nothing, shape (m, 3, 3)."""
        return cls(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.intp).reshape(-1, 3))

    @classmethod
    def joined(
        cls, meshes: list["RawMesh"], metres: float | None = None, passed_over: tuple[str, ...] = ()
    ) -> "RawMesh":
        """Join several meshes to one, whose unit and whose other contents are given."""
        if not meshes:
            return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp), metres, passed_over)
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        return cls(vertices, np.concatenate(faces), metres, passed_over)


def counted(number: int, what: str) -> str:
    """Return a number of things in words, for example ``2 lines``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


_TRIANGLE = 3
_QUADRANGLE = 4


def triangulate_faces(vertices: FloatArray, corners: IntArray, counts: IntArray) -> IntArray:
    """Cut faces into triangles that cover them and, where a face is flat and does not cross itself, nothing else.

    Args:
        vertices: shape (v, 3).
        corners: the vertices of all faces, one face after the other.
        counts: how many corners each face has; one of fewer than three is no surface.

    Returns:
        Vertices of each triangle, shape (m, 3), those of one face together.
    """
    starts = np.cumsum(counts) - counts
    found = []
    places = []
    for count in np.unique(counts[counts >= _TRIANGLE]):
        chosen = np.flatnonzero(counts == count)
        faces = corners[starts[chosen, None] + np.arange(count)]
        with np.errstate(invalid="ignore", over="ignore"):  # of what is no number or no place, and is refused later
            found.append(_cut(vertices, faces).reshape(-1, 3))
        places.append(np.repeat(chosen, count - 2))
    if not found:
        return np.zeros((0, 3), dtype=np.intp)
    return np.concatenate(found)[np.argsort(np.concatenate(places), kind="stable")]


def _cut(vertices: FloatArray, faces: IntArray) -> IntArray:
    """Return the faces of c corners, shape (f, c), as triangles, shape (f, c - 2, 3)."""
    count = faces.shape[1]
    along = np.arange(1, count - 1)
    fans = faces[:, np.column_stack((np.zeros_like(along), along, along + 1))]
    if count == _TRIANGLE or len(vertices) == 0 or faces.min() < 0 or faces.max() >= len(vertices):
        return fans  # vertices that are not there are refused later, by name
    inward = _bends_inward(vertices[faces])
    if count == _QUADRANGLE:
        # One of its diagonals runs inside; from the first corner it does unless the second or the last bends inward.
        other = inward[:, 1] | inward[:, 3]
        return np.where(other[:, None, None], faces[:, [[1, 2, 3], [1, 3, 0]]], fans)
    for number in np.flatnonzero(inward.any(axis=1)):
        cut = _cut_flat(vertices[faces[number]])
        if cut is not None:
            fans[number] = faces[number][cut]
    return fans


def _normals(corners: FloatArray) -> FloatArray:
    """Along the normals of faces, twice as long as their areas, shape (f, 3); corners of shape (f, c, 3)."""
    spokes = corners - corners[:, :1]
    return np.asarray(np.cross(spokes[:, 1:-1], spokes[:, 2:]).sum(axis=1))


def _bends_inward(corners: FloatArray) -> BoolArray:
    """Return which corners of faces bend inward, shape (f, c)."""
    edges = np.roll(corners, -1, axis=1) - corners
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    return np.asarray(np.einsum("fci,fi->fc", turns, _normals(corners)) < 0.0)


def _cut_flat(corners: FloatArray) -> IntArray | None:
    """Return a face of corners of shape (c, 3), as triangles of their numbers; none where there are no such."""
    import shapely  # noqa: PLC0415 - few meshes have such faces

    normal = _normals(corners[None])[0]
    if not np.isfinite(normal).all():
        return None
    # Seen along the axis to which the face is squarest it is widest.
    flat = np.delete(corners, int(np.argmax(np.abs(normal))), axis=1)
    ring = shapely.Polygon(flat)
    if not ring.is_valid:
        return None
    numbers = {tuple(place): number for number, place in enumerate(flat)}
    try:
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(ring))
    except shapely.errors.GEOSException:  # of corners so far apart that GEOS loses them
        return None
    if len(pieces) != len(corners) - 2:
        return None
    # Of a ring of three corners the last place is the first again.
    places = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    cut = np.array([[numbers[tuple(place)] for place in piece] for piece in places])
    backward = _normals(corners[cut]) @ normal < 0.0
    cut[backward] = cut[backward, ::-1]
    return cut
