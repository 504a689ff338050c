"""3MF: a ZIP archive with a model in XML, objects of triangles or of other objects, and which of them are built."""

import io
import struct
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from xml.parsers import expat  # bounds how entities multiply, and loads no external ones

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.mesh_settings import MeshSettings
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.ground.arrays import FloatArray

_MODEL = ".model"
"""How the name of the model ends in the archive."""


def read_3mf(content: bytes, settings: MeshSettings) -> RawMesh:
    """The mesh of everything that a 3MF file builds, in the unit of the file.

    Raises:
        ProblemError: it is no 3MF file, is damaged, or exceeds a bound.
    """
    model = _parsed(_model_text(content, settings))
    parts = _Parts(settings)
    try:
        # Numbers beyond all measure may become infinite, or none at all, on the way: such vertices are refused later.
        with np.errstate(over="ignore", invalid="ignore"):
            for number, transform in model.built or [(number, np.eye(4)[:, :3]) for number in model.objects]:
                _collect(model, number, transform, parts, 0)
    except (KeyError, ValueError, IndexError, OverflowError) as error:
        raise ProblemError(f"not readable as 3MF: its model refers to something that is not there ({error})") from None
    return RawMesh.joined(parts.meshes)


def _model_text(content: bytes, settings: MeshSettings) -> bytes:
    """The model in the archive, unpacked no further than is allowed."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            models = [item for item in archive.infolist() if PurePosixPath(item.filename).suffix.lower() == _MODEL]
            if not models:
                raise ProblemError("not readable as 3MF: the archive holds no model")
            # The one at the top of the archive is what is built; others are parts that it may name.
            first = min(models, key=lambda item: item.filename.count("/"))
            with archive.open(first) as packed:
                text = packed.read(settings.most_unpacked + 1)
    except (zipfile.BadZipFile, zlib.error, struct.error, RuntimeError, OSError, EOFError, ValueError) as error:
        raise ProblemError(f"not readable as 3MF: {error}") from None
    if len(text) > settings.most_unpacked:
        raise ProblemError(f"its model has more than {settings.most_unpacked} bytes unpacked, the most that is read")
    return text


@dataclass
class _Shape:
    """An object: triangles of its own, and other objects by number, each moved."""

    vertices: list[tuple[float, float, float]] = field(default_factory=list)
    triangles: list[tuple[int, int, int]] = field(default_factory=list)
    components: list[tuple[str, FloatArray]] = field(default_factory=list)


@dataclass
class _Model:
    """The objects of a model by number, and which are built, where."""

    objects: dict[str, _Shape] = field(default_factory=dict)
    built: list[tuple[str, FloatArray]] = field(default_factory=list)
    current: _Shape = field(default_factory=_Shape)

    def start(self, name: str, given: dict[str, str]) -> None:
        """Take in an element; names are looked at without their namespace."""
        kind = name.rpartition(" ")[2]
        if kind == "vertex":
            self.current.vertices.append((float(given["x"]), float(given["y"]), float(given["z"])))
        elif kind == "triangle":
            self.current.triangles.append((int(given["v1"]), int(given["v2"]), int(given["v3"])))
        elif kind == "object":
            self.current = self.objects.setdefault(given["id"], _Shape())
        elif kind == "component":
            if elsewhere := next((given[key] for key in given if key.endswith(" path")), None):
                raise ProblemError(
                    f"a component lies in another part of the archive, {elsewhere[:60]!r}, which is not read; export "
                    "it as one model"
                )
            self.current.components.append((given["objectid"], _transform(given.get("transform"))))
        elif kind == "item":
            self.built.append((given["objectid"], _transform(given.get("transform"))))


def _parsed(text: bytes) -> _Model:
    model = _Model()
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = model.start
    try:
        parser.Parse(text, True)  # noqa: FBT003 - the parser takes no keyword
    except KeyError as error:
        raise ProblemError(f"not readable as 3MF: an element lacks its attribute {error}") from None
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise ProblemError(f"not readable as 3MF: {error}") from None
    return model


def _transform(text: str | None) -> FloatArray:
    """Three columns of the first three rows turn, the last row moves, shape (4, 3)."""
    if text is None:
        return np.eye(4)[:, :3]
    values = np.array(text.split(), dtype=np.float64)
    if values.shape != (12,):
        raise ValueError(f"a transform has {len(values)} numbers, expected 12")
    return values.reshape(4, 3)


@dataclass
class _Parts:
    """What a file is put together from, within the bounds."""

    settings: MeshSettings
    meshes: list[RawMesh] = field(default_factory=list)
    triangles: int = 0
    visits: int = 0

    def refuse_deeper(self, depth: int) -> None:
        """Refuse components that are nested too deep, or used too often."""
        self.visits += 1
        if depth > self.settings.deepest:
            raise ProblemError(f"its components are nested more than {self.settings.deepest} deep")
        if self.visits > self.settings.most_parts:
            raise ProblemError(f"it is put together from more than {self.settings.most_parts} parts")

    def add(self, mesh: RawMesh) -> None:
        """Add a part."""
        self.meshes.append(mesh)
        self.triangles += len(mesh.faces)
        most = self.settings.most_triangles
        if self.triangles > most:
            raise ProblemError(f"it has more than {most} triangles, the most that can be used")


def _collect(model: _Model, number: str, transform: FloatArray, parts: _Parts, depth: int) -> None:
    """Add an object, and those that it is put together from, where they come to lie."""
    parts.refuse_deeper(depth)
    shape = model.objects[number]
    if shape.triangles:
        vertices = np.array(shape.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.array(shape.triangles, dtype=np.intp)
        parts.add(RawMesh(vertices @ transform[:3] + transform[3], faces))
    for inner, moved in shape.components:
        both = np.vstack((moved[:3] @ transform[:3], moved[3] @ transform[:3] + transform[3]))
        _collect(model, inner, both, parts, depth + 1)
