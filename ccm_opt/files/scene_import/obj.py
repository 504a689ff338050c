"""OBJ: lines of vertices and of faces, with the numbers of their vertices, from 1 or back from the last.

No library at hand reads it right: trimesh counts the vertices of a second object backwards from the last of the file,
not from those that stand before the face, meshio knows no such numbers at all, and both cut faces that bend inward as
fans. So the few kinds of lines that carry a surface are read here, and the others that carry anything are told.
"""

from array import array
from collections import Counter

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.mesh_settings import MeshSettings
from ccm_opt.files.scene_import.polygons import triangles_of
from ccm_opt.files.scene_import.raw_mesh import RawMesh, counted

_NOT_READ = {
    b"surf": "free-form surfaces",
    b"call": "another file",
    b"csh": "another program",
    b"bzp": "patches of older versions",
    b"bsp": "patches of older versions",
    b"cdp": "patches of older versions",
    b"cdc": "curves of older versions",
}
"""What would be missing from the obstacle, by the word in front of its line."""
_NO_SURFACE = {b"p": "point element", b"l": "line element", b"curv": "curve", b"curv2": "curve"}
"""What is told and passed over, by the word in front of its line."""
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""In front of texts that some editors write."""


def read_obj(content: bytes, settings: MeshSettings) -> RawMesh:
    """The mesh of all objects and groups of an OBJ file; materials are not read, so that no other file is.

    Raises:
        ProblemError: a line cannot be read, or there are too many faces.
    """
    coordinates = array("d")
    corners = array("q")
    counts = array("q")
    passed_over: Counter[str] = Counter()
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):  # UTF-16
        content = content.decode("utf-16", "replace").encode()
    content = content.removeprefix(_BYTE_ORDER_MARK)
    # A line goes on behind a backslash at its end.
    lines = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, line in enumerate(lines, 1):
        words = line.partition(b"#")[0].split()
        kind = words[0] if words else b""
        try:
            if kind == b"v":
                coordinates.extend(_place(words))
            elif kind == b"f":
                face = _corners(words, len(coordinates) // 3)
                corners.extend(face)
                counts.append(len(face))
                passed_over["two-corner face"] += len(face) < 3
            elif kind in _NO_SURFACE:
                passed_over[_NO_SURFACE[kind]] += 1
            elif kind in _NOT_READ:
                raise ValueError(f"names {_NOT_READ[kind]}, which is not read")  # noqa: TRY301 - told with the line
        except (ValueError, OverflowError) as error:
            raise ProblemError(f"not readable as OBJ: its line {number} {error}") from None
        if len(counts) > settings.most_triangles:
            raise ProblemError(f"it has more than {settings.most_triangles} triangles, the most that can be used")
    vertices = np.array(coordinates, dtype=np.float64).reshape(-1, 3)
    faces = triangles_of(vertices, np.array(corners, dtype=np.intp), np.array(counts, dtype=np.intp))
    told = tuple(counted(number, what) for what, number in passed_over.items() if number)
    return RawMesh(vertices, faces, passed_over=told)


def _place(words: list[bytes]) -> list[float]:
    """Three numbers; behind them a weight or a colour may stand."""
    try:
        x, y, z = map(float, words[1:4])
    except ValueError:
        raise ValueError(f"is {_shown(words)}, expected three coordinates") from None
    return [x, y, z]


def _corners(words: list[bytes], vertices: int) -> list[int]:
    """The vertices of a face, from 0; behind a slash the places of textures and normals may stand."""
    try:
        named = [int(word.partition(b"/")[0]) for word in words[1:]]
    except ValueError:
        raise ValueError(f"is {_shown(words)}, expected numbers of vertices") from None
    if min(named, default=1) > 0:
        return [name - 1 for name in named]
    found = [name - 1 if name > 0 else vertices + name for name in named]
    if 0 in named or min(found) < 0:
        raise ValueError(
            f"is {_shown(words)}, but {vertices} vertices stand before it; they count from 1, or from -1 backwards"
        )
    return found


def _shown(words: list[bytes]) -> str:
    return repr(b" ".join(words).decode("latin-1")[:60])
