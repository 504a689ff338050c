"""PLY: a header that says which elements follow and what each has, as text or as bytes of either order.

The library that reads all of it, plyfile, has a licence (GPL) that a package under BSD cannot ask of its users; trimesh
refuses files whose vertices or faces have lists of different lengths, and meshio likewise.
"""

import re
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.errors import ProblemError
from ccm_opt.io.raw_mesh import RawMesh, counted, triangles_of
from ccm_opt.io.settings import MeshSettings

_END = re.compile(rb"^end_header[ \t]*(\r\n|\n|\r)", re.MULTILINE)
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
"""How the list of a face's corners is called."""


@dataclass
class _Element:
    """What of one kind follows: its properties by name, the type of each, and for a list the type of its length."""

    name: str
    count: int
    properties: dict[str, tuple[np.dtype[Any], np.dtype[Any] | None]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Rows:
    """What is known of an element: numbers of each property, shape (n,), of a list all in one with their lengths."""

    values: dict[str, npt.NDArray[Any]]
    lengths: dict[str, IntArray]


def read_ply(content: bytes, settings: MeshSettings) -> RawMesh:
    """The mesh of a PLY file; colours and whatever else there is are passed over.

    Raises:
        ProblemError: the file cannot be read, is cut short, or has too many faces.
    """
    try:
        elements, body = _opened(content)
        read: dict[str, _Rows] = {}
        end = 0
        for element in elements:
            most = settings.most_triangles
            if element.name == "face" and element.count > most:
                raise ProblemError(f"it has {element.count} faces, at most {most} are used; export it coarser")
            read[element.name], end = _element(element, body, end)
        _refuse_more(body[end:])
        return _mesh(read)
    except ValueError as error:
        raise ProblemError(f"not readable as PLY: {error}") from None


def _refuse_more(behind: bytes) -> None:
    """Refuse a file in which more than blanks and zeros follows."""
    if behind.strip(b"\0 \t\r\n"):
        raise ValueError("more follows than its header says")


def _opened(content: bytes) -> tuple[list[_Element], bytes]:
    """The elements that the header announces, and the bytes behind it; numbers that are text become bytes."""
    end = _END.search(content)
    if not content.startswith(b"ply") or end is None:
        raise ValueError("it has no header from 'ply' to 'end_header'")
    lines = [line.split() for line in content[: end.start()].decode("latin-1").splitlines()[1:]]
    order = next((words[1] for words in lines if words[:1] == ["format"] and len(words) > 1), "none")
    if order not in _ORDERS:
        raise ValueError(f"its format is {order[:30]!r}, expected one of {', '.join(_ORDERS)}")
    elements = _announced(lines, _ORDERS[order])
    body = content[end.end() :]
    return elements, body if _ORDERS[order] else _numbers(body).tobytes()


def _announced(lines: list[list[str]], order: str) -> list[_Element]:
    """The elements of a header; a text is read as numbers of double precision throughout."""
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
                raise ValueError(f"its header says {' '.join(words)[:60]!r}, which is not understood")
    return elements


def _type(name: str, order: str) -> np.dtype[Any]:
    if name not in _TYPES:
        raise ValueError(f"its header has the type {name[:30]!r}, which is not known")
    return np.dtype(order + _TYPES[name] if order else "f8")


def _numbers(text: bytes) -> FloatArray:
    """The numbers of a text."""
    try:
        with warnings.catch_warnings():
            # What is no number ends the reading with a warning in some versions of numpy.
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        raise ValueError("not everything behind its header is a number") from None


def _element(element: _Element, body: bytes, start: int) -> tuple[_Rows, int]:
    """What there is of an element, and where the next begins.

    Raises:
        ValueError: the body ends before.
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
    return ValueError(f"its header says {what}, but the file ends before; was it cut short?")


def _rows_alike(element: _Element, body: bytes, start: int) -> tuple[_Rows, int] | None:
    """An element whose lists are as long in every row as in the first, read at once; none where they are not."""
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
    """An element whose lists have different lengths."""
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
    """The length of a list, which a text gives as any number."""
    value = float(number)
    if not 0.0 <= value < 2.0**32 or value != int(value):
        raise ValueError(f"a list has the length {value:g}")
    return int(value)


def _mesh(read: dict[str, _Rows]) -> RawMesh:
    """The faces of what was read."""
    for kind, rows in read.items():
        if kind not in {"vertex", "face"} and any(name in rows.lengths for name in _CORNERS):
            what = "strips of triangles" if kind == "tristrips" else f"faces in elements {kind[:30]!r}"
            raise ValueError(f"it has {what}, which are not read; export triangles")
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
        raise ValueError("a face has a corner that is no whole number")
    counts = faces.lengths[name]
    few = int(np.count_nonzero(counts < 3))
    edges = max((len(rows) for rows in read["edge"].values.values()), default=0) if "edge" in read else 0
    told = ((few, "two-corner face"), (edges, "edge"))
    passed_over = tuple(counted(number, what) for number, what in told if number)
    return RawMesh(vertices, triangles_of(vertices, whole, counts), passed_over=passed_over)
