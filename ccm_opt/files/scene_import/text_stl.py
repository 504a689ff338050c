"""STL as text: of every triangle the three lines of its vertices."""

from array import array

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.mesh_settings import MeshSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""In front of texts that some editors write."""
_BINARY_START = 84
"""Bytes of a binary file in front of its triangles; the last of them is zero, as the number of triangles is small."""


def is_text_stl(content: bytes) -> bool:
    """Whether an STL file is of the kind that is text; the free text of binary ones may begin with ``solid`` too."""
    return _without_mark(content)[:5].lower() == b"solid" and b"\0" not in content[:_BINARY_START]


def read_text_stl(content: bytes, settings: MeshSettings) -> RawMesh:
    """The mesh of an STL file that is text.

    Raises:
        ProblemError: a triangle is not whole, the file ends without its last line, or has too many triangles.
    """
    *triangles, rest = _without_mark(content).lower().split(b"endloop")
    if len(triangles) > settings.most_triangles:
        raise ProblemError(f"it has {len(triangles)} triangles, at most {settings.most_triangles} can be used")
    coordinates = array("d")
    for number, text in enumerate(triangles, 1):
        # What is in front of the loop, the name of the solid among it, is free text.
        words = text.split()
        if words[-12::4] != [b"vertex"] * 3 or words.count(b"vertex") != len(words[-12::4]):
            raise ProblemError(f"not readable as STL: triangle {number} has not three vertices of three numbers each")
        try:
            for first in (-11, -7, -3):
                coordinates.extend(map(float, words[first : first + 3 or None]))
        except ValueError:
            numbers = b" ".join(words[-12:]).decode("latin-1")[:100]
            raise ProblemError(f"not readable as STL: triangle {number} has {numbers!r}, expected numbers") from None
    if b"endsolid" not in rest:
        raise ProblemError(
            f"not readable as STL: it ends after {len(triangles)} triangles without 'endsolid'; was it cut short?"
        )
    return RawMesh.of_corners(np.array(coordinates, dtype=np.float64).reshape(-1, 3, 3))


def _without_mark(content: bytes) -> bytes:
    return content.removeprefix(_BYTE_ORDER_MARK).lstrip()
