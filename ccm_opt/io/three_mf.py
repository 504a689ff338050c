"""3MF, read by the format's own library; what it would pass over in silence is refused by name.

``lib3mf`` follows relationships, parts, components and transforms. Before that every model in the archive is looked
through once by expat, which bounds what is unpacked, names what the library does not know (boolean and displaced
shapes, extensions that a file requires), and counts the vertices and triangles that the library must give back.
"""

import ctypes
import io
import struct
import zipfile
import zlib
from collections import Counter
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any
from xml.parsers import expat  # bounds how entities multiply, and loads no external ones

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh, counted

_MICROSOFT = "http://schemas.microsoft.com/3dmanufacturing"
_CORE = f"{_MICROSOFT}/core/2015/02"
_KNOWN = frozenset(
    {
        _CORE,
        f"{_MICROSOFT}/beamlattice/2017/02",
        f"{_MICROSOFT}/beamlattice/balls/2020/07",
        f"{_MICROSOFT}/material/2015/02",
        f"{_MICROSOFT}/production/2015/06",
        f"{_MICROSOFT}/securecontent/2019/04",
        f"{_MICROSOFT}/slice/2015/07",
        f"{_MICROSOFT}/trianglesets/2021/07",
        "http://schemas.3mf.io/3dmanufacturing/implicit/2023/12",
        "http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01",
    }
)
"""Namespaces that lib3mf reads (those in its library, version 2.5)."""
_UNITS = MappingProxyType(
    {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
)
"""Metres in the units of a model; without a word it is the millimetre."""
_REASONS = MappingProxyType(
    {
        "Could not find Object": "an item or a component names an object that is not there, or not before it",
        "Could not get XML Namespace": "a namespace is declared below the model element, which lib3mf does not read",
        "Invalid Model Coordinate Indices": "a triangle has one vertex twice",
        "Invalid Model Coordinates": "a coordinate is no number, or beyond all measure",
        "Invalid model node index": "a triangle has a vertex that is not there",
    }
)
"""What lib3mf means, by what it says."""
_BROKEN = (zipfile.BadZipFile, zlib.error, struct.error, RuntimeError, OSError, EOFError, ValueError)


def read_3mf(content: bytes, settings: MeshSettings) -> RawMesh:
    """Read everything that a 3MF file builds, supports included, in the unit of the file.

    Raises:
        ProblemError: it is no 3MF file, is damaged, exceeds a bound, or holds a shape that is not read.
    """
    announced = _announced(content, settings)
    _refuse_nested(announced, settings)
    library = _library()
    try:
        model = _model(library, content)
        _hold_counts(model, announced)
        parts = _Parts(library, settings)
        items = model.GetBuildItems()
        with np.errstate(over="ignore", invalid="ignore"):  # places beyond all measure are refused later
            while items.MoveNext():
                item = items.GetCurrent()
                parts.collect(item.GetObjectResource(), _matrix(item.GetObjectTransform()))
        objects = model.GetObjects().Count()
        root = model.RootModelPart().GetPath()
    except library.ELib3MFException as error:
        told = str(error).partition(": ")[2].strip() or str(error)
        reason = next((words for start, words in _REASONS.items() if told.startswith(start)), f"{told[:100]} (lib3mf)")
        elsewhere = sorted(set().union(*(each.elsewhere for each in announced.values())))
        if elsewhere:
            reason += f"; {elsewhere[0][:60]!r}, which it names, counts only if the root model is linked to it"
        raise ProblemError(f"not readable as 3MF: {reason}") from None
    if not parts.taken:
        raise ProblemError("it builds nothing: its build section has no item that would say what stands where")
    units = {announced[path].unit for path in (root, *parts.paths) if path in announced}
    if len(units) > 1:
        raise ProblemError(f"its parts are in different units, {', '.join(sorted(units))}; export it in one")
    left = objects - len(parts.taken)
    passed_over = (f"{counted(left, 'object')} that the file does not build",) if left else ()
    return RawMesh.joined(parts.meshes, _UNITS[units.pop()], passed_over)


@dataclass
class _Announced:
    """What a model in the archive holds, as expat meets it.

    Attributes:
        counts: of elements of the core, by name.
        unit: of its lengths.
        inside: number of the object that is open.
        components: of each object by its number, by the part of the archive and the number there.
        prefixes: namespaces by prefix.
        elsewhere: other parts of the archive that it names.
    """

    most: int
    counts: Counter[str] = field(default_factory=Counter)
    unit: str = "millimeter"
    inside: str | None = None
    components: dict[str, list[tuple[str | None, str]]] = field(default_factory=dict)
    prefixes: dict[str | None, str] = field(default_factory=dict)
    elsewhere: set[str] = field(default_factory=set)

    def parse(self, text: bytes) -> None:
        """Look through a model.

        Raises:
            ProblemError: it holds what is not read.
            expat.ExpatError: it is no XML.
        """
        if text.startswith((b"\xfe\xff", b"\xff\xfe")):
            raise ProblemError("its model is written in UTF-16, and lib3mf reads UTF-8 alone")
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.StartNamespaceDeclHandler = self._name_space
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        parser.Parse(text, True)  # noqa: FBT003 - the parser takes no keyword

    def _name_space(self, prefix: str | None, uri: str) -> None:
        self.prefixes[prefix] = uri

    @staticmethod
    def _refuse_doctype(*_: object) -> None:
        raise ProblemError("not readable as 3MF: its model has a document type, which the format forbids")

    def start(self, name: str, given: dict[str, str]) -> None:
        """Count an element, and refuse one that would be passed over."""
        space, _, kind = name.rpartition(" ")
        if kind in {"booleanshape", "displacementmesh"}:
            what = "a boolean of shapes" if kind == "booleanshape" else "a displaced mesh"
            raise ProblemError(f"it has {what}, which is not read; export it as plain triangles")
        if space == _CORE:
            self.counts[kind] += 1
            if kind == "object":
                self.inside = given.get("id", "")
                self.components[self.inside] = []
            elif kind == "model":
                self._model(given)
            elif kind in {"item", "component"}:
                path = next((given[key] for key in given if key.endswith(" path")), None)
                self.elsewhere.update(() if path is None else (path,))
                if kind == "component" and self.inside is not None:
                    self.components[self.inside].append((path, given.get("objectid", "")))
            elif kind == "triangle" and self.counts[kind] > self.most:
                raise ProblemError(f"it has more than {self.most} triangles, the most that can be used")
        elif self.inside is not None and space not in _KNOWN:
            raise ProblemError(f"an object has {kind[:40]!r} of an extension that is not known, {space[:80]!r}")

    def end(self, name: str) -> None:
        """Leave an element."""
        if name == f"{_CORE} object":
            self.inside = None

    def _model(self, given: dict[str, str]) -> None:
        self.unit = given.get("unit", self.unit)
        if self.unit not in _UNITS:
            raise ProblemError(f"its unit {self.unit[:30]!r} is not known; the format has {', '.join(_UNITS)}")
        for prefix in given.get("requiredextensions", "").split():
            space = self.prefixes.get(prefix, prefix)
            if space not in _KNOWN:
                raise ProblemError(f"it requires the extension {space[:80]!r}, which is not read")


def _announced(content: bytes, settings: MeshSettings) -> dict[str, _Announced]:
    """What every model in the archive holds, by its path; nothing is unpacked further than is allowed."""
    found: dict[str, _Announced] = {}
    left = settings.most_unpacked
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = archive.namelist()
            for needed in ("[Content_Types].xml", "_rels/.rels"):
                if needed not in names:
                    raise ProblemError(f"not readable as 3MF: the archive has no {needed}")
            if len(set(names)) < len(names):
                raise ProblemError("not readable as 3MF: two parts of the archive have one name")
            for name in names:
                with archive.open(name) as packed:
                    part = packed.read(left + 1)
                left -= len(part)
                if left < 0:
                    raise ProblemError(
                        f"it has more than {settings.most_unpacked} bytes unpacked, the most that is read"
                    )
                if name.lower().endswith(".model"):
                    announced = found[f"/{name}"] = _Announced(settings.most_triangles)
                    announced.parse(part)
    except expat.ExpatError as error:
        raise ProblemError(f"not readable as 3MF: its model is no XML ({error})") from None
    except _BROKEN as error:
        raise ProblemError(f"not readable as 3MF: {error}") from None
    return found


def _refuse_nested(announced: dict[str, _Announced], settings: MeshSettings) -> None:
    """Refuse objects that are put together too deep or of too many: the library would never come to their end."""
    sizes: dict[tuple[str, str], tuple[int, int]] = {}

    def size(path: str, number: str, above: int) -> tuple[int, int]:
        """How many objects one is put together from, each counted as often as it is used, and how deep."""
        if (path, number) not in sizes:
            if above > settings.deepest:
                raise ProblemError(f"its components are nested more than {settings.deepest} deep")
            inner = announced[path].components.get(number, []) if path in announced else []
            found = [size(elsewhere or path, other, above + 1) for elsewhere, other in inner]
            sizes[path, number] = (
                1 + sum(parts for parts, _ in found),
                1 + max((deep for _, deep in found), default=-1),
            )
        parts, depth = sizes[path, number]
        if depth > settings.deepest:
            raise ProblemError(f"its components are nested more than {settings.deepest} deep")
        if parts > settings.most_parts:
            raise ProblemError(f"it is put together from more than {settings.most_parts} parts")
        return parts, depth

    for path, each in announced.items():
        for number in each.components:
            size(path, number, 0)


def _library() -> Any:
    """The library, loaded when the first 3MF file is read."""
    try:
        import lib3mf  # noqa: PLC0415 - takes memory that few problems need
    except (ImportError, OSError):
        raise ProblemError(
            "3MF is read by lib3mf, which is not installed here (it has no wheel for some machines); export it as STL"
        ) from None
    return lib3mf


def _model(library: Any, content: bytes) -> Any:
    """The model of an archive; the library asks for its bytes, as lists of them would take eight times the memory."""
    at = 0

    def read(place: int, size: int, _: object) -> None:
        nonlocal at
        chunk = content[at : at + size]
        ctypes.memmove(place, chunk, len(chunk))
        at += len(chunk)

    def seek(place: int, _: object) -> None:
        nonlocal at
        at = place

    model = library.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.ReadFromCallback(library.ReadCallback(read), len(content), library.SeekCallback(seek), None)
    return model


def _hold_counts(model: Any, announced: dict[str, _Announced]) -> None:
    """Refuse a file of which the library has not read every vertex and triangle."""
    read: dict[str, Counter[str]] = {}
    shapes = model.GetMeshObjects()
    while shapes.MoveNext():
        shape = shapes.GetCurrent()
        counts = read.setdefault(shape.PackagePart().GetPath(), Counter())
        counts["vertex"] += shape.GetVertexCount()
        counts["triangle"] += shape.GetTriangleCount()
    for path, counts in read.items():
        for kind, number in counts.items():
            wanted = announced[path].counts[kind] if path in announced else 0
            if number != wanted:
                raise ProblemError(f"{path} has {wanted} elements '{kind}', but lib3mf reads {number} of them")


def _matrix(transform: Any) -> FloatArray:
    """Three rows turn, the last moves, shape (4, 3)."""
    return np.array([list(row) for row in transform.Fields], dtype=np.float64)


@dataclass
class _Parts:
    """What a file is put together from, within the bounds.

    Attributes:
        library: that reads it.
        settings: the bounds.
        meshes: where they come to lie.
        taken: numbers of the objects that are built.
        paths: parts of the archive in which these are.
    """

    library: Any
    settings: MeshSettings
    meshes: list[RawMesh] = field(default_factory=list)
    taken: set[int] = field(default_factory=set)
    paths: set[str] = field(default_factory=set)
    _own: dict[int, RawMesh] = field(default_factory=dict)
    _triangles: int = 0
    _visits: int = 0

    def collect(self, shape: Any, transform: FloatArray) -> None:
        """Add an object, and those that it is put together from, where they come to lie.

        Raises:
            ProblemError: it is put together from too many, too large, or of a kind that is not read.
        """
        self._visits += 1
        if self._visits > self.settings.most_parts:
            raise ProblemError(f"it is put together from more than {self.settings.most_parts} parts")
        number = shape.GetUniqueResourceID()
        self.taken.add(number)
        if shape.IsComponentsObject():
            for k in range(shape.GetComponentCount()):
                inner = shape.GetComponent(k)
                moved = _matrix(inner.GetTransform())
                both = np.vstack((moved[:3] @ transform[:3], moved[3] @ transform[:3] + transform[3]))
                self.collect(inner.GetObjectResource(), both)
            return
        if number not in self._own:
            self._own[number] = self._mesh(shape)
            self.paths.add(shape.PackagePart().GetPath())
        mesh = self._own[number]
        self._triangles += len(mesh.faces)
        if self._triangles > self.settings.most_triangles:
            raise ProblemError(f"it has more than {self.settings.most_triangles} triangles, the most that can be used")
        self.meshes.append(RawMesh(mesh.vertices @ transform[:3] + transform[3], mesh.faces))

    def _mesh(self, shape: Any) -> RawMesh:
        """The triangles of an object that has no other kind of shape."""
        refused = ""
        if not shape.IsMeshObject():
            refused = "a shape that is a field, no mesh (a level set)"
        elif shape.BeamLattice().GetBeamCount() or shape.BeamLattice().GetBallCount():
            refused = f"a beam lattice of {counted(shape.BeamLattice().GetBeamCount(), 'beam')}"
        elif shape.HasSlices(False) and shape.GetSlicesMeshResolution() == self.library.SlicesMeshResolution.Lowres:  # noqa: FBT003
            refused = "slices that are finer than its mesh"
        if refused:
            raise ProblemError(f"it has {refused}, which is not read; export it as plain triangles")
        places = _array(self.library.Position, shape.GetVertices(), "<f4").astype(np.float64)
        return RawMesh(places, _array(self.library.Triangle, shape.GetTriangleIndices(), "<u4").astype(np.intp))


def _array(kind: Any, rows: list[Any], number: str) -> Any:
    """Rows of three numbers as an array, shape (n, 3)."""
    return np.frombuffer((kind * len(rows))(*rows), dtype=number).reshape(-1, 3)
