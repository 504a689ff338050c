"""Binary STL, the commonest format of meshes, which needs no library: a count, and fifty bytes a triangle."""

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.mesh_settings import MeshSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh

_HEADER = 80
"""Bytes of free text in front."""
_COUNT = 4
"""Bytes of the number of triangles behind it."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_binary_stl(content: bytes, settings: MeshSettings) -> RawMesh:
    """The mesh of a binary STL file.

    Raises:
        ProblemError: the file holds fewer triangles than it says, or more, or too many.
    """
    start = _HEADER + _COUNT
    if len(content) < start:
        raise ProblemError(f"not readable as STL: it has {len(content)} bytes, and its header alone has {start}")
    count = int.from_bytes(content[_HEADER:start], "little")
    held = (len(content) - start) // _TRIANGLE.itemsize
    if held < count and content[:start].isascii() and b"\0" not in content[:start]:
        raise ProblemError("not readable as STL: it is a text of another kind, without 'solid' and 'facet' in front")
    if held < count:
        raise ProblemError(
            f"not readable as STL: its header says {count} triangles, but it ends after {held}; was it cut short, or "
            "is it of another format?"
        )
    if count > settings.most_triangles:
        raise ProblemError(f"it has {count} triangles, at most {settings.most_triangles} are used; export it coarser")
    behind = content[start + count * _TRIANGLE.itemsize :]
    # Some programs fill their files up with zeros.
    if len(behind) >= _TRIANGLE.itemsize and behind.strip(b"\0"):
        raise ProblemError(
            f"not readable as STL: its header says {count} triangles, but {len(behind)} bytes more follow, as of "
            f"{held - count} that would be missing"
        )
    records = np.frombuffer(content, dtype=_TRIANGLE, count=count, offset=start)
    # Some bytes are no number and warn when they are copied; what is no number is refused by name, later.
    with np.errstate(invalid="ignore"):
        corners = records["corners"].astype(np.float64)
    return RawMesh.of_corners(corners)
