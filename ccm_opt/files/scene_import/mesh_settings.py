"""Bounds and tolerances of reading meshes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MeshSettings:
    """Bounds on mesh files and what counts as a defect of a mesh, the same for all formats.

    Attributes:
        most_bytes: of a file; larger ones are refused unread. Taste: two million triangles as text.
        most_triangles: of a mesh, or of all meshes of a problem together; more are refused. Taste: distances would take
            gigabytes of memory.
        most_unpacked: bytes of the model inside a 3MF file, which is packed. Taste: as many triangles as text.
        deepest: components of components in a 3MF file. Taste: programs nest two or three deep.
        deepest_nodes: nodes below nodes in a GLB file. Taste: robots nest a few dozen deep.
        most_parts: parts that a 3MF or GLB file is put together from, each counted as often as it is used. Taste.
        least_height: triangles lower than this share of the mesh's extent have no area. Derived: some roundings of a
            vertex in double precision.
        most_flat: share of triangles without area from which on a mesh is refused, since its file must be broken.
            Taste: programs write one in a hundred where they cut curved faces.
        largest_coordinate: in the mesh's own unit. Derived: beyond it double precision no longer resolves a millionth.
    """

    most_bytes: int = 256 * 2**20
    most_triangles: int = 2_000_000
    most_unpacked: int = 512 * 2**20
    deepest: int = 20
    deepest_nodes: int = 200
    most_parts: int = 10_000
    least_height: float = 1e-13
    most_flat: float = 0.5
    largest_coordinate: float = 1e9


MESHES = MeshSettings()
"""Used where no other settings are given."""
