"""Reader of 3MF mesh files: core format and production extension; other extensions that define shapes are refused.

The linked parts of the archive are parsed as a stream by expat, which limits the expansion of entities and loads no
external ones. The objects are then placed as the build section of the file specifies.
"""

import io
import posixpath
import zipfile
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET
from xml.parsers import expat

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh, counted

_MICROSOFT = "http://schemas.microsoft.com/3dmanufacturing"
_CORE = f"{_MICROSOFT}/core/2015/02"
_KNOWN = frozenset(
    f"{_MICROSOFT}/{name}"
    for name in (
        "beamlattice/2017/02",
        "beamlattice/balls/2020/07",
        "core/2015/02",
        "material/2015/02",
        "production/2015/06",
        "slice/2015/07",
        "trianglesets/2021/07",
    )
) | {"http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01"}
"""XML namespaces whose elements are either read, refused by ``_OTHER_SHAPES``, or define no surfaces."""
_OTHER_SHAPES = {
    "ball": "a beam lattice",
    "beam": "a beam lattice",
    "booleanshape": "a boolean of shapes",
    "displacementmesh": "a displaced mesh",
    "levelset": "a level set",
}
"""Descriptions of unsupported shapes for error messages, by the name of the XML element that defines the shape."""
_UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""Metres per unit of length, by the name of the unit in a 3MF model."""
_BROKEN = (zipfile.BadZipFile, zlib.error, expat.ExpatError, ET.ParseError, RuntimeError, OSError, EOFError, ValueError)


def read_3mf(content: bytes, settings: MeshSettings) -> RawMesh:
    """Return all objects that a 3MF file builds, supports included, as one mesh in the unit of the file.

    Args:
        content: bytes of the file.
        settings: limits on mesh files.

    Raises:
        ProblemError: the content is not a 3MF file, is damaged, exceeds a limit, or contains an unsupported shape.
    """
    try:
        parts = _unpacked(content, settings)
        root = next(_linked(parts, "/"), "/none")
        models = {path: _Model(path, parts[path]) for path in (root, *_linked(parts, root))}
        building = _Building(models, settings)
        meshes = [mesh for use in models[root].items for mesh in building.placed(use, np.eye(4, 3), 0)]
    except KeyError as error:
        raise ProblemError(f"not readable as 3MF: {str(error)[:60]} is missing") from None
    except (*_BROKEN, OverflowError) as error:
        raise ProblemError(f"not readable as 3MF: {str(error)[:100]}") from None
    if not models[root].items:
        raise ProblemError("its build section is empty, so nothing is placed")
    units = {models[path].unit for path, _ in building.taken}
    if len(units) > 1:
        raise ProblemError(f"its parts are in different units, {', '.join(sorted(units))}; export it in one unit")
    left = sum(len(model.objects) for model in models.values()) - len(building.taken)
    passed_over = (f"{counted(left, 'object')} that the file does not build",) if left else ()
    return RawMesh.joined(meshes, _UNITS[units.pop()], passed_over)


def _unpacked(content: bytes, settings: MeshSettings) -> dict[str, bytes]:
    """Return the models and relationship files of a 3MF archive, unpacked, by path.

    Raises:
        ProblemError: they exceed the limit on unpacked bytes.
        ValueError: two parts of the archive have the same name.
    """
    found: dict[str, bytes] = {}
    left = settings.most_unpacked
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        if len(set(names)) < len(names):
            raise ValueError("two parts of the archive have the same name")
        for name in names:
            if name.lower().endswith((".model", ".rels")):
                with archive.open(name) as packed:
                    found[f"/{name}"] = packed.read(left + 1)
                left -= len(found[f"/{name}"])
                if left < 0:
                    raise ProblemError(
                        f"it has more than {settings.most_unpacked} bytes unpacked, the most that is read"
                    )
    return found


def _linked(parts: dict[str, bytes], source: str) -> Iterator[str]:
    """Yield the paths of the models to which a part of a 3MF archive, or the archive itself ("/"), is linked."""
    folder, name = posixpath.split(source)
    links = ET.fromstring(parts.get(posixpath.join(folder, "_rels", f"{name}.rels"), b"<none/>"))  # noqa: S314 - expat
    for link in links.iter("{http://schemas.openxmlformats.org/package/2006/relationships}Relationship"):
        if link.get("Type") == f"{_MICROSOFT}/2013/01/3dmodel":
            yield posixpath.normpath(posixpath.join(folder, link.attrib["Target"]))


@dataclass(frozen=True)
class _Use:
    """A placed instance of a 3MF object, in the build section or as a component of another object.

    Attributes:
        path: path of the part of the archive that defines the object.
        number: id of the object in that part of the archive.
        transform: rotation and scale in the first three rows, translation in the last, for row vectors, shape (4, 3).
    """

    path: str
    number: str
    transform: FloatArray


@dataclass
class _Object:
    """An object of a 3MF model, made of either triangles or instances of other objects.

    Attributes:
        shape: name of the element that defines the object: "mesh" or "components"; empty for neither.
        coordinates: coordinates x, y, z of all vertices, one vertex after the other.
        corners: vertex indices of all triangles, three each.
        components: placed instances of other objects.
    """

    shape: str = ""
    coordinates: "array[float]" = field(default_factory=lambda: array("d"))
    corners: "array[int]" = field(default_factory=lambda: array("q"))
    components: list[_Use] = field(default_factory=list)


class _Model:
    """A parsed model of a 3MF archive: unit of length, objects by id, and items of the build section.

    Raises:
        ProblemError: the unit is unknown, or an object or extension is not supported.
        KeyError, ValueError, OverflowError, expat.ExpatError: the text is not a 3MF model, or is damaged.
    """

    def __init__(self, path: str, text: bytes) -> None:
        self.unit = "millimeter"
        self.objects: dict[str, _Object] = {}
        self.items: list[_Use] = []
        self._path = path
        self._open: _Object | None = None
        self._prefixes: dict[str | None, str] = {}
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.StartNamespaceDeclHandler = self._prefixes.__setitem__
        parser.StartDoctypeDeclHandler = self._refuse_doctype
        parser.Parse(text, True)  # noqa: FBT003 - the parser takes no keyword

    @staticmethod
    def _refuse_doctype(*_: object) -> None:
        raise ValueError("its model has a document type, which the format forbids")

    def _start(self, name: str, given: dict[str, str]) -> None:
        space, _, kind = name.rpartition(" ")
        if kind in _OTHER_SHAPES:
            raise ProblemError(f"it has {_OTHER_SHAPES[kind]}, which is not supported; export it as plain triangles")
        if space != _CORE:
            if self._open is not None and space not in _KNOWN:
                raise ProblemError(f"an object has {kind[:40]!r} of the unknown extension {space[:80]!r}")
        elif kind == "model":
            self._head(given)
        elif kind == "object":
            self._object(given)
        elif kind == "item":
            self.items.append(self._use(given))
        elif self._open is not None:
            self._inside(self._open, kind, given)

    def _end(self, name: str) -> None:
        if name == f"{_CORE} object":
            self._open = None

    def _head(self, given: dict[str, str]) -> None:
        self.unit = given.get("unit", self.unit)
        if self.unit not in _UNITS:
            raise ProblemError(f"its unit {self.unit[:30]!r} is unknown; expected one of {', '.join(_UNITS)}")
        for prefix in given.get("requiredextensions", "").split():
            space = self._prefixes.get(prefix, prefix)
            if space not in _KNOWN:
                raise ProblemError(f"it requires the extension {space[:80]!r}, which is not supported")

    def _object(self, given: dict[str, str]) -> None:
        if self._open is not None or given["id"] in self.objects:
            raise ValueError(f"the object {given['id'][:20]!r} occurs twice")
        if any(key.endswith(" meshresolution") and value == "lowres" for key, value in given.items()):
            raise ProblemError(
                "it has slices finer than its mesh, which are not supported; export it as plain triangles"
            )
        self._open = self.objects[given["id"]] = _Object()

    def _inside(self, shape: _Object, kind: str, given: dict[str, str]) -> None:
        if kind == "vertex":
            shape.coordinates.extend([float(given[axis]) for axis in "xyz"])
        elif kind == "triangle":
            corners = [int(given[corner]) for corner in ("v1", "v2", "v3")]
            if len(set(corners)) < 3:
                raise ValueError("a triangle has one vertex twice")
            shape.corners.extend(corners)
        elif kind == "component":
            shape.components.append(self._use(given))
        elif kind in {"mesh", "components"}:
            if shape.shape:
                raise ValueError("an object has two shapes")
            shape.shape = kind

    def _use(self, given: dict[str, str]) -> _Use:
        """Return the placed instance that the attributes of an ``item`` or ``component`` element describe."""
        path = next((given[key] for key in given if key.endswith(" path")), self._path)
        transform = np.array(given.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split(), dtype=np.float64)
        if transform.shape != (12,) or not np.isfinite(transform).all():
            raise ValueError(f"it has the transform {given['transform'][:60]!r}; expected twelve numbers")
        return _Use(path, given["objectid"], transform.reshape(4, 3))


@dataclass
class _Building:
    """Assembly of placed objects from the models of a 3MF file, within limits on size and nesting.

    Attributes:
        models: models of the archive, by path.
        settings: limits on mesh files.
        taken: path and id of every object placed so far.
        visits: number of instances placed so far.
        triangles: number of triangles placed so far.
    """

    models: dict[str, _Model]
    settings: MeshSettings
    taken: set[tuple[str, str]] = field(default_factory=set)
    visits: int = 0
    triangles: int = 0

    def placed(self, use: _Use, outer: FloatArray, depth: int) -> Iterator[RawMesh]:
        """Yield the meshes of a placed object and of its components, in the coordinates of the build section.

        Raises:
            ProblemError: an object is missing, or the assembly has too many parts or triangles, or is nested too deep.
        """
        settings = self.settings
        if use.path not in self.models:
            raise ProblemError(f"{use.path[:60]!r}, which it names, is not linked from the root model; export it anew")
        shape = self.models[use.path].objects.get(use.number)
        if shape is None:
            raise ProblemError(f"an item or a component refers to an object that does not exist, {use.number[:20]!r}")
        self.taken.add((use.path, use.number))
        self.visits += 1
        self.triangles += len(shape.corners) // 3
        if self.visits > settings.most_parts:
            raise ProblemError(f"it consists of more than {settings.most_parts} parts")
        if depth > settings.deepest:
            raise ProblemError(f"its components are nested more than {settings.deepest} deep")
        if self.triangles > settings.most_triangles:
            raise ProblemError(f"it has more than {settings.most_triangles} triangles, the most that can be used")
        with np.errstate(over="ignore", invalid="ignore"):  # places beyond all measure are refused later
            place = np.vstack((use.transform[:3] @ outer[:3], use.transform[3] @ outer[:3] + outer[3]))
            if shape.corners:
                vertices = np.array(shape.coordinates).reshape(-1, 3) @ place[:3] + place[3]
                yield RawMesh(vertices, np.array(shape.corners, dtype=np.intp).reshape(-1, 3))
        for component in shape.components:
            yield from self.placed(component, place, depth + 1)
