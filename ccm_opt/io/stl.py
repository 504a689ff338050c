"""Reads STL and OBJ.

Both libraries that could read it lose triangles: of a file that is cut short numpy-stl gives the first ones and trimesh
none, without a word; numpy-stl reads no text with a byte-order mark or line ends of other systems, and trimesh stumbles
over what a solid may be called. So the grammar stands here, and whatever does not follow it is refused with its place.

No library at hand reads it right: trimesh counts the vertices of a second object backwards from the last of the file,
not from those that stand before the face, meshio knows no such numbers at all, and both cut faces that bend inward as
fans. So the few kinds of lines that carry a surface are read here, and the others that carry anything are told.
"""

import re
from array import array
from collections import Counter

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.io.raw_mesh import RawMesh, counted, triangles_of
from ccm_opt.io.settings import MeshSettings

_START = 84
"""Bytes of a binary file in front of its triangles: 80 of free text, and their number."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""In front of texts that some editors write."""
_FLAGS = re.IGNORECASE
# The name of a solid is free text up to the end of its line; where all is one line, up to what follows it.
_SOLID, _END = (re.compile(rb"\s*%s\b[^\r\n]*" % word, _FLAGS) for word in (b"solid", b"endsolid"))
_SOLID_OF_ONE_LINE = re.compile(rb"\s*solid\b.*?(?=\sfacet\s+normal\s|\sendsolid\b)", _FLAGS)
_END_OF_ONE_LINE = re.compile(rb"\s*endsolid\b.*?(?=\ssolid\s|\Z)", _FLAGS)
_FACET = re.compile(
    rb"\s*facet(?:\s+normal(?:\s+\S+){3})?\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop(?:\s+endfacet)?(?=\s)",
    _FLAGS,
)


def read_stl(content: bytes, settings: MeshSettings) -> RawMesh:
    """Read all solids of an STL file.

    Raises:
        ProblemError: it does not follow the format to its last byte, or has too many triangles.
    """
    text = content.removeprefix(_BYTE_ORDER_MARK).lstrip()
    # The free text of binary files may begin with ``solid`` too, but their number of triangles has a byte of zero.
    if text[:5].lower() == b"solid" and b"\0" not in content[:_START]:
        return _of_text(text, settings)
    return _of_records(content, settings)


def _of_records(content: bytes, settings: MeshSettings) -> RawMesh:
    if len(content) < _START:
        raise ProblemError(f"not readable as STL: it has {len(content)} bytes, and its header alone has {_START}")
    count = int.from_bytes(content[_START - 4 : _START], "little")
    held = (len(content) - _START) // _TRIANGLE.itemsize
    if held < count and content[:_START].isascii() and b"\0" not in content[:_START]:
        raise ProblemError("not readable as STL: it is a text of another kind, without 'solid' and 'facet' in front")
    if held < count:
        raise ProblemError(
            f"not readable as STL: its header says {count} triangles, but it ends after {held}; was it cut short, or "
            "is it of another format?"
        )
    _refuse_more(count, settings)
    behind = content[_START + count * _TRIANGLE.itemsize :]
    # Some programs fill their files up with zeros.
    if len(behind) >= _TRIANGLE.itemsize and behind.strip(b"\0"):
        raise ProblemError(
            f"not readable as STL: its header says {count} triangles, but {len(behind)} bytes more follow, as of "
            f"{held - count} that would be missing"
        )
    records = np.frombuffer(content, dtype=_TRIANGLE, count=count, offset=_START)
    # Some bytes are no number and warn when they are copied; what is no number is refused by name, later.
    with np.errstate(invalid="ignore"):
        return RawMesh.of_corners(records["corners"].astype(np.float64))


def _of_text(text: bytes, settings: MeshSettings) -> RawMesh:
    coordinates = array("d")
    text = text.rstrip()
    one_line = b"\n" not in text and b"\r" not in text
    begins, ends = (_SOLID_OF_ONE_LINE, _END_OF_ONE_LINE) if one_line else (_SOLID, _END)
    at = 0
    while at < len(text):
        solid = begins.match(text, at)
        if solid is None:
            raise ProblemError(f"not readable as STL: {_shown(text, at)} follows its solids, expected 'solid'")
        at = solid.end()
        while facet := _FACET.match(text, at):
            at = facet.end()
            try:
                coordinates.extend(map(float, facet.groups()))
            except ValueError:
                raise ProblemError(
                    f"not readable as STL: triangle {len(coordinates) // 9 + 1} has "
                    f"{b' '.join(facet.groups()).decode('latin-1')[:100]!r}, expected numbers"
                ) from None
            _refuse_more(len(coordinates) // 9, settings)
        end = ends.match(text, at)
        if end is None:
            raise ProblemError(
                f"not readable as STL: {_shown(text, at)} follows {len(coordinates) // 9} triangles, expected a facet "
                "of three vertices, or 'endsolid'; was it cut short?"
            )
        at = end.end()
    return RawMesh.of_corners(np.array(coordinates, dtype=np.float64).reshape(-1, 3, 3))


def _refuse_more(count: int, settings: MeshSettings) -> None:
    if count > settings.most_triangles:
        raise ProblemError(f"it has {count} triangles, at most {settings.most_triangles} are used; export it coarser")


def _shown(text: bytes, at: int) -> str:
    words = b" ".join(text[at : at + 200].split()).decode("latin-1")[:60]
    return repr(words) if words else "nothing"


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
        raise ValueError(f"is {_obj_shown(words)}, expected three coordinates") from None
    return [x, y, z]


def _corners(words: list[bytes], vertices: int) -> list[int]:
    """The vertices of a face, from 0; behind a slash the places of textures and normals may stand."""
    try:
        named = [int(word.partition(b"/")[0]) for word in words[1:]]
    except ValueError:
        raise ValueError(f"is {_obj_shown(words)}, expected numbers of vertices") from None
    if min(named, default=1) > 0:
        return [name - 1 for name in named]
    found = [name - 1 if name > 0 else vertices + name for name in named]
    if 0 in named or min(found) < 0:
        raise ValueError(
            f"is {_obj_shown(words)}, but {vertices} vertices stand before it; they count from 1, or from -1 backwards"
        )
    return found


def _obj_shown(words: list[bytes]) -> str:
    return repr(b" ".join(words).decode("latin-1")[:60])
