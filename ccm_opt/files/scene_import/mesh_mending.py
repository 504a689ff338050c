"""What is put right in a mesh before it is used, and whether it is closed; every change is counted and told."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.mesh_settings import MESHES, MeshSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.space.scene.closed_surfaces import edge_keys, is_closed

_MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""Odd numbers without a pattern, by which the three coordinates of a vertex become one number."""
_WHOLE_NUMBERS = 2**64
"""That many fit into 64 bits."""


@dataclass(frozen=True, eq=False)
class MendedMesh:
    """A mesh whose triangles share their vertices.

    Attributes:
        mesh: vertices, each once, and triangles.
        closed: whether every edge is one of an even number of triangles, so that the mesh has an inside.
        mended: what was put right, in words.
    """

    mesh: RawMesh
    closed: bool
    mended: tuple[str, ...]


def mended_mesh(raw: RawMesh, settings: MeshSettings = MESHES) -> MendedMesh:
    """Join equal vertices, and leave out what is there twice or has no area and is the edge of another triangle.

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
    if count > settings.most_flat * len(faces):
        raise ProblemError(f"{count} of {len(faces)} triangles have no area; the file is broken, or no mesh")
    kept = faces[~flat]
    needed = faces[flat][~_on_edges(vertices, faces[flat], kept)] if count else faces[:0]
    once = _distinct_faces(kept)
    mended = []
    if count > len(needed):
        mended.append(f"left out {_counted(count - len(needed), 'triangle')} without area")
    if len(once) < len(kept):
        mended.append(f"left out {_counted(len(kept) - len(once), 'repeated triangle')}")
    closed = len(needed) == 0 and is_closed(once)
    mesh = _with_used_vertices(vertices, np.concatenate((once, needed)))
    return MendedMesh(mesh, closed, tuple(mended))


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
    edges = np.unique(edge_keys(others, int(base)))
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[others] = True
    return np.asarray(np.where(low == high, used[first], np.isin(low * base + high, edges)))


def _distinct_faces(faces: IntArray) -> IntArray:
    """Each triangle once, in order, whichever vertex it begins with and whichever way it turns."""
    if len(faces) == 0:
        return faces
    ordered = np.sort(faces, axis=1)
    low, middle, high = ordered.T.astype(np.uint64)
    count = int(faces.max()) + 1
    if count**3 < _WHOLE_NUMBERS:
        # Three small numbers make one, which is sorted far faster.
        step = np.uint64(count)
        _, first = np.unique((low * step + middle) * step + high, return_index=True)
    else:
        _, first = np.unique(ordered, axis=0, return_index=True)
    return faces if len(first) == len(faces) else faces[np.sort(first)]


def _with_used_vertices(vertices: FloatArray, faces: IntArray) -> RawMesh:
    """The mesh without vertices that no triangle has."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    names = np.cumsum(used) - 1
    return RawMesh(vertices[used], names[faces].astype(np.intp))
