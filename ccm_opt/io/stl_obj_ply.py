"""Readers of meshes in the formats STL, OBJ and PLY, written here because available libraries are unsuitable.

STL: libraries silently lose triangles. From a truncated file numpy-stl returns the first ones and trimesh none;
numpy-stl reads no text with a byte-order mark or foreign line ends, and trimesh fails on some names of solids. The
grammar is therefore implemented here, and anything that does not follow it is refused with its position.

OBJ: trimesh counts negative vertex numbers backwards from the end of the file instead of from the face, meshio does
not support them, and both triangulate non-convex faces as fans. The few kinds of lines that define a surface are
therefore read here; lines with other geometry are reported or refused.

PLY: plyfile, the one complete library, is under the GPL, which a package under the BSD licence cannot impose on its
users; trimesh and meshio refuse files whose vertices or faces have lists of different lengths.
"""

import re
import warnings
from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh, counted, triangulate_faces

_START = 84
"""Size of the header of a binary STL file: 80 bytes of free text and the number of triangles [bytes]."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8 byte-order mark that some editors write at the start of a text."""
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


def read_stl(content: bytes, _settings: MeshSettings) -> RawMesh:
    """Return all solids of an STL file, text or binary, as one mesh in the unit of the file.

    Raises:
        ProblemError: the content does not follow the format up to its last byte.
    """
    text = content.removeprefix(_BYTE_ORDER_MARK).lstrip()
    # The free text of binary files may begin with ``solid`` too, but their number of triangles has a byte of zero.
    if text[:5].lower() == b"solid" and b"\0" not in content[:_START]:
        return _of_text(text)
    return _of_records(content)


def _of_records(content: bytes) -> RawMesh:
    if len(content) < _START:
        raise ProblemError(f"not readable as STL: it has {len(content)} bytes, fewer than the {_START} of a header")
    count = int.from_bytes(content[_START - 4 : _START], "little")
    held = (len(content) - _START) // _TRIANGLE.itemsize
    if held < count and content[:_START].isascii() and b"\0" not in content[:_START]:
        raise ProblemError("not readable as STL: it is text, but does not begin with 'solid' and 'facet'")
    if held < count:
        raise ProblemError(
            f"not readable as STL: its header announces {count} triangles, but it ends after {held}; it is "
            "truncated, or of another format"
        )
    behind = content[_START + count * _TRIANGLE.itemsize :]
    # Some programs fill their files up with zeros.
    if len(behind) >= _TRIANGLE.itemsize and behind.strip(b"\0"):
        raise ProblemError(
            f"not readable as STL: its header announces {count} triangles, but {len(behind)} more bytes "
            f"follow, those of {held - count} further triangles"
        )
    records = np.frombuffer(content, dtype=_TRIANGLE, count=count, offset=_START)
    # Some bytes are no number and warn when they are copied; what is no number is refused by name, later.
    with np.errstate(invalid="ignore"):
        return RawMesh.of_corners(records["corners"].astype(np.float64))


def _of_text(text: bytes) -> RawMesh:
    coordinates = array("d")
    text = text.rstrip()
    one_line = b"\n" not in text and b"\r" not in text
    begins, ends = (_SOLID_OF_ONE_LINE, _END_OF_ONE_LINE) if one_line else (_SOLID, _END)
    at = 0
    while at < len(text):
        solid = begins.match(text, at)
        if solid is None:
            raise ProblemError(f"not readable as STL: {_shown(text, at)} follows its solids; expected 'solid'")
        at = solid.end()
        while facet := _FACET.match(text, at):
            at = facet.end()
            try:
                coordinates.extend(map(float, facet.groups()))
            except ValueError:
                raise ProblemError(
                    f"not readable as STL: triangle {len(coordinates) // 9 + 1} has "
                    f"{b' '.join(facet.groups()).decode('latin-1')[:100]!r}; expected numbers"
                ) from None
        end = ends.match(text, at)
        if end is None:
            raise ProblemError(
                f"not readable as STL: {_shown(text, at)} follows {len(coordinates) // 9} triangles; "
                "expected a facet of three vertices, or 'endsolid'; the file may be truncated"
            )
        at = end.end()
    return RawMesh.of_corners(np.array(coordinates, dtype=np.float64).reshape(-1, 3, 3))


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
"""Descriptions of unsupported OBJ content, by the keyword of its line; refused, since surfaces would be missing."""
_NO_SURFACE = {b"p": "point element", b"l": "line element", b"curv": "curve", b"curv2": "curve"}
"""Names of OBJ content without surface, by the keyword of its line; ignored and reported."""


def read_obj(content: bytes, _settings: MeshSettings) -> RawMesh:
    """Return all objects and groups of an OBJ file as one mesh; materials, which are in other files, are not read.

    Raises:
        ProblemError: a line cannot be read.
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
                raise ValueError(f"has {_NOT_READ[kind]}, which is not supported")  # noqa: TRY301 - told with the line
        except (ValueError, OverflowError) as error:
            raise ProblemError(f"not readable as OBJ: its line {number} {error}") from None
    vertices = np.array(coordinates, dtype=np.float64).reshape(-1, 3)
    faces = triangulate_faces(vertices, np.array(corners, dtype=np.intp), np.array(counts, dtype=np.intp))
    skipped = tuple(counted(number, what) for what, number in passed_over.items() if number)
    return RawMesh(vertices, faces, passed_over=skipped)


def _place(words: list[bytes]) -> list[float]:
    """Return the coordinates x, y, z in a vertex line of an OBJ file; a weight or colour after them is ignored.

    Raises:
        ValueError: the line has fewer than three numbers.
    """
    try:
        x, y, z = map(float, words[1:4])
    except ValueError:
        raise ValueError(f"is {_quoted(words)}; expected three coordinates") from None
    return [x, y, z]


def _corners(words: list[bytes], vertices: int) -> list[int]:
    """Return the vertex indices, from 0, in a face line of an OBJ file; texture and normal indices are ignored.

    Args:
        words: words of the line.
        vertices: number of vertices before this line; negative vertex numbers count backwards from the last of these.

    Raises:
        ValueError: an entry is not a vertex number, or refers to a vertex that does not exist.
    """
    try:
        named = [int(word.partition(b"/")[0]) for word in words[1:]]
    except ValueError:
        raise ValueError(f"is {_quoted(words)}; expected vertex numbers") from None
    if min(named, default=1) > 0:
        return [name - 1 for name in named]
    found = [name - 1 if name > 0 else vertices + name for name in named]
    if 0 in named or min(found) < 0:
        raise ValueError(
            f"is {_quoted(words)}, but only {vertices} vertices precede it; they count from 1, or from -1 backwards"
        )
    return found


def _quoted(words: list[bytes]) -> str:
    return repr(b" ".join(words).decode("latin-1")[:60])


_PLY_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)", re.MULTILINE)
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_CORNERS = ("vertex_indices", "vertex_index")
"""Names that PLY files use for the list of a face's vertex indices."""


@dataclass
class _Element:
    """An element declared in a PLY header: name, number of rows, and types of each property and its list length."""

    name: str
    count: int
    properties: dict[str, tuple[np.dtype[Any], np.dtype[Any] | None]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Rows:
    """Data of a PLY element of n rows.

    Attributes:
        values: values of each property, by name; lists of all rows are concatenated.
        lengths: length of the list in each row, by name of the property, shape (n,).
    """

    values: dict[str, npt.NDArray[Any]]
    lengths: dict[str, IntArray]


def read_ply(content: bytes, _settings: MeshSettings) -> RawMesh:
    """Return the mesh in a PLY file, text or binary; colours and other properties are ignored.

    Raises:
        ProblemError: the content is not PLY, is truncated, or contains something unsupported.
    """
    try:
        elements, body = _opened(content)
        read: dict[str, _Rows] = {}
        end = 0
        for element in elements:
            read[element.name], end = _element(element, body, end)
        behind = body[end:].strip(b"\0 \t\r\n")
        return _mesh(read, behind)
    except ValueError as error:
        raise ProblemError(f"not readable as PLY: {error}") from None


def _opened(content: bytes) -> tuple[list[_Element], bytes]:
    """Return the elements declared in a PLY header, and the body as bytes, with a text body converted to binary.

    Raises:
        ValueError: the header is missing or invalid.
    """
    end = _PLY_END.search(content)
    if not content.startswith(b"ply") or end is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    lines = [line.split() for line in content[: end.start()].decode("latin-1").splitlines()[1:]]
    order = next((words[1] for words in lines if words[:1] == ["format"] and len(words) > 1), "none")
    if order not in _ORDERS:
        raise ValueError(f"its format is {order[:30]!r}; expected one of {', '.join(_ORDERS)}")
    elements = _announced(lines, _ORDERS[order])
    body = content[end.end() :]
    return elements, body if _ORDERS[order] else _numbers(body).tobytes()


def _announced(lines: list[list[str]], order: str) -> list[_Element]:
    """Return the elements declared in the lines of a PLY header.

    Args:
        lines: words of each line.
        order: byte order of the body, "<" or ">"; empty for text, whose numbers are all read in double precision.

    Raises:
        ValueError: a declaration is invalid.
    """
    elements: list[_Element] = []
    for words in lines:
        match words:
            case ["element", name, count] if count.isdecimal():
                if any(name == known.name for known in elements):
                    raise ValueError(f"its header announces {name[:30]!r} twice")
                elements.append(_Element(name, int(count)))
            case ["property", *_, name] if elements and name in elements[-1].properties:
                raise ValueError(f"its header gives {name[:30]!r} of {elements[-1].name[:30]!r} twice")
            case ["property", "list", length, kind, name] if elements:
                elements[-1].properties[name] = (_type(kind, order), _type(length, order))
            case ["property", kind, name] if elements:
                elements[-1].properties[name] = (_type(kind, order), None)
            case ["element" | "property", *_]:
                raise ValueError(f"its header contains {' '.join(words)[:60]!r}, which is not valid PLY")
    return elements


def _type(name: str, order: str) -> np.dtype[Any]:
    if name not in _TYPES:
        raise ValueError(f"its header has the unknown type {name[:30]!r}")
    return np.dtype(order + _TYPES[name] if order else "f8")


def _numbers(text: bytes) -> FloatArray:
    """Return the numbers in a text, which are separated by blanks, shape (n,).

    Raises:
        ValueError: the text contains anything else.
    """
    try:
        with warnings.catch_warnings():
            # What is no number ends the reading with a warning in some versions of numpy.
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        raise ValueError("its data contain something that is not a number") from None


def _element(element: _Element, body: bytes, start: int) -> tuple[_Rows, int]:
    """Return the data of one PLY element, and the offset in the body at which the next element begins.

    Args:
        element: declaration of the element.
        body: body of the file in binary form.
        start: offset of the element in the body [bytes].

    Raises:
        ValueError: the body ends too early.
    """
    least = sum((length or kind).itemsize for kind, length in element.properties.values())
    if element.count and not least:
        raise ValueError(f"its header gives no property of {element.name[:30]!r}")
    if element.count * least > len(body) - start:
        raise _too_short(element)
    alike = _rows_alike(element, body, start)
    return alike if alike is not None else _rows_one_by_one(element, body, start)


def _too_short(element: _Element) -> ValueError:
    what = f"{element.count} elements {element.name[:30]!r}"
    return ValueError(f"its header announces {what}, but the file ends before; it is truncated")


def _rows_alike(element: _Element, body: bytes, start: int) -> tuple[_Rows, int] | None:
    """Return the data and end of a PLY element whose rows are all equally long; None if lists differ in length.

    Arguments are those of ``_element``. All rows are read at once, which is much faster.
    """
    fields: list[tuple[str, np.dtype[Any], tuple[int, ...]]] = []
    counted: dict[str, int] = {}
    for number, (name, (kind, length)) in enumerate(element.properties.items()):
        if length is not None:
            at = start + np.dtype(fields).itemsize
            if element.count == 0:
                counted[name] = 0
            elif at + length.itemsize > len(body):
                return None
            else:
                counted[name] = _length(np.frombuffer(body, length, 1, at)[0])
                if counted[name] * kind.itemsize > len(body):
                    raise _too_short(element)
            fields.append((f"length {number}", length, ()))
        fields.append((f"value {number}", kind, (counted.get(name, 1),)))
    row = np.dtype(fields)
    end = start + element.count * row.itemsize
    if end > len(body):
        return None
    rows = np.frombuffer(body, row, element.count, start)
    numbers = {name: number for number, name in enumerate(element.properties)}
    if any(np.any(rows[f"length {numbers[name]}"] != size) for name, size in counted.items()):
        return None
    values = {name: rows[f"value {number}"].reshape(-1) for name, number in numbers.items()}
    return _Rows(values, {name: np.full(element.count, size, dtype=np.intp) for name, size in counted.items()}), end


def _rows_one_by_one(element: _Element, body: bytes, start: int) -> tuple[_Rows, int]:
    """Return the data and end of a PLY element whose lists differ in length; arguments are those of ``_element``."""
    pieces: dict[str, list[bytes]] = {name: [] for name in element.properties}
    lengths: dict[str, list[int]] = {name: [] for name, (_, length) in element.properties.items() if length is not None}
    at = start
    for _ in range(element.count):
        for name, (kind, length) in element.properties.items():
            size = kind.itemsize
            if length is not None:
                found = body[at : at + length.itemsize]
                if len(found) < length.itemsize:
                    raise _too_short(element)
                lengths[name].append(_length(np.frombuffer(found, length)[0]))
                at += length.itemsize
                size *= lengths[name][-1]
            pieces[name].append(body[at : at + size])
            at += size
        if at > len(body):
            raise _too_short(element)
    values = {name: np.frombuffer(b"".join(found), element.properties[name][0]) for name, found in pieces.items()}
    return _Rows(values, {name: np.array(found, dtype=np.intp) for name, found in lengths.items()}), at


def _length(number: np.float64) -> int:
    """Return the length of a PLY list as an integer; a text file may give invalid lengths, which are refused.

    Raises:
        ValueError: the value is not an integer from 0 to 2³² − 1.
    """
    value = float(number)
    if not 0.0 <= value < 2.0**32 or value != int(value):
        raise ValueError(f"a list has the length {value:g}")
    return int(value)


def _mesh(read: dict[str, _Rows], behind: bytes) -> RawMesh:
    """Return the mesh that the elements of a PLY file describe.

    Args:
        read: data of the elements, by name.
        behind: bytes after the last element, which must be empty.

    Raises:
        ValueError: bytes follow the last element, coordinates or vertex indices are missing or invalid, or faces are in
            unsupported elements.
    """
    if behind:
        raise ValueError("more data follow than its header announces")
    for kind, rows in read.items():
        if kind not in {"vertex", "face"} and any(name in rows.lengths for name in _CORNERS):
            what = "strips of triangles" if kind == "tristrips" else f"faces in elements {kind[:30]!r}"
            raise ValueError(f"it has {what}, which are not supported; export triangles")
    places = read["vertex"].values if "vertex" in read else {}
    missing = [axis for axis in "xyz" if axis not in places]
    if missing:
        raise ValueError(f"its vertices have no {missing[0]}")
    with np.errstate(invalid="ignore"):  # of signalling numbers, which are refused later
        vertices = np.column_stack([places[axis].astype(np.float64) for axis in "xyz"])
    faces = read.get("face", _Rows({}, {}))
    name = next((name for name in _CORNERS if name in faces.lengths), None)
    if name is None:
        if faces.values:
            raise ValueError(f"its faces have no list {_CORNERS[0]!r}")
        return RawMesh(vertices, np.zeros((0, 3), dtype=np.intp))
    corners = faces.values[name]
    with np.errstate(invalid="ignore"):
        whole = corners.astype(np.intp)
    if not np.array_equal(whole, corners):
        raise ValueError("a face has a vertex index that is not a whole number")
    counts = faces.lengths[name]
    few = int(np.count_nonzero(counts < 3))
    edges = max((len(rows) for rows in read["edge"].values.values()), default=0) if "edge" in read else 0
    skipped = ((few, "two-corner face"), (edges, "edge"))
    passed_over = tuple(counted(number, what) for number, what in skipped if number)
    return RawMesh(vertices, triangulate_faces(vertices, whole, counts), passed_over=passed_over)
