"""What is put right in a mesh before it is used; every change is counted and told."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.raw_mesh import RawMesh
from ccm_opt.io.settings import MESHES, MeshSettings
from ccm_opt.scene.shells import find_shells, repeated

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
        mended.append(f"left out {_counted(count - len(needed), 'triangle')} without area")
    if len(once) < len(kept):
        mended.append(f"left out {_counted(len(kept) - len(once), 'repeated triangle')}")
    return MendedMesh(_with_used_vertices(vertices, np.concatenate((once, needed))), tuple(mended))


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


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
