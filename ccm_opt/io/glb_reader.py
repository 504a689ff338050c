"""GLB, read by trimesh; what of its document that would pass over, or place elsewhere, is refused by name.

The document is looked through first: of every node of the scene the triangles are counted, which trimesh must give
back. Cameras are taken out of it, since trimesh leaves out what stands below one. Materials are not read, so that no
other file is.
"""

import io
import json
import logging
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ccm_opt.errors import ProblemError
from ccm_opt.io.raw_mesh import RawMesh
from ccm_opt.io.settings import MeshSettings

_DEEPEST_NODES = 200
"""Nodes below nodes in a GLB file. Taste: robots nest a few dozen deep."""

_HEADER = struct.Struct("<4sII")
"""A magic word, a version, the length of the file; the first chunk follows."""
_CHUNK = struct.Struct("<I4s")
"""The length of a chunk, and its kind."""
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_mesh_quantization")
"""How extensions begin that say nothing of where surfaces are, or nothing that is not looked at in another place."""
_SHAPING = ("EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression", "EXT_meshopt_compression")
"""Extensions that hold surfaces or places, whether a file says that they are required or not."""
_MODES = (
    "a list of points",
    "a list of lines",
    "a loop of lines",
    "a strip of lines",
    "triangles",
    "a strip of triangles",
    "a fan of triangles",
)
"""What a primitive is, by its mode."""
_LARGEST_DOCUMENT = 2**25
"""Bytes of text in front of the numbers; parsed it takes ten times the memory, and programs write some kilobytes."""
_TRIANGLES = 4
_STRIP = 5
_LONGEST_REASON = 100
"""Characters of what trimesh says that are shown."""


def read_glb(content: bytes, settings: MeshSettings) -> RawMesh:
    """Read the scene of a GLB file, every node where the file places it.

    Raises:
        ProblemError: the file cannot be read, or has something that is not.
    """
    import trimesh  # noqa: PLC0415 - takes a second to load

    document, rest = _opened(content)
    try:
        wanted = _Scene(document, settings).triangles()
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        body = _CHUNK.pack(len(text), b"JSON") + text + rest
        plain = _HEADER.pack(b"glTF", 2, _HEADER.size + len(body)) + body
        with _quiet():
            scene = trimesh.load_scene(io.BytesIO(plain), file_type="glb", skip_materials=True, process=False)
            parts = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
            found = [RawMesh(np.asarray(each.vertices, np.float64), np.asarray(each.faces, np.intp)) for each in parts]
    except ProblemError:
        raise
    # Whatever a broken file leads a reader of a dozen formats into, to people it is a broken file.
    except Exception as error:  # noqa: BLE001
        missing = " is missing" if isinstance(error, KeyError) else ""
        reason = f"{' '.join(str(error).split())[:_LONGEST_REASON] or type(error).__name__}{missing}"
        raise ProblemError(f"not readable as GLB: the file is damaged or cut short ({reason})") from None
    mesh = RawMesh.joined(found)
    if len(mesh.faces) != wanted:
        raise ProblemError(f"its scene has {wanted} triangles, but trimesh reads {len(mesh.faces)} of them")
    return mesh


def _opened(content: bytes) -> tuple[Any, bytes]:
    """The document of a file without its cameras, and the chunks behind it."""
    start = _HEADER.size + _CHUNK.size
    if len(content) < start or content[:4] != b"glTF":
        raise ProblemError("not readable as GLB: it does not begin as such a file does")
    _, version, length = _HEADER.unpack_from(content)
    if version != 2:
        raise ProblemError(f"not readable as GLB: it is of version {version}, and only 2 is read; export it anew")
    if length > len(content):
        raise ProblemError(f"not readable as GLB: its header says {length} bytes, but it has {len(content)}")
    size, _ = _CHUNK.unpack_from(content, _HEADER.size)
    if size > _LARGEST_DOCUMENT:
        raise ProblemError(f"its document has {size} bytes, at most {_LARGEST_DOCUMENT} are read; export it coarser")
    try:
        document = json.loads(content[start : start + size])
    except (ValueError, RecursionError) as error:
        raise ProblemError(f"not readable as GLB: its document is damaged ({str(error)[:_LONGEST_REASON]})") from None
    if not isinstance(document, dict):
        raise ProblemError("not readable as GLB: its document is no table")
    for node in _tables(document, "nodes"):
        node.pop("camera", None)
    return document, content[start + size : length]


def _tables(parent: Any, key: str) -> list[dict[str, Any]]:
    """The tables of a list in a document, whatever else it holds."""
    found = parent.get(key) if isinstance(parent, dict) else None
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


class _Scene:
    """The scene of a document, of which the triangles are counted.

    Args:
        document: of the file; broken ones raise anything.
        settings: bounds.
    """

    def __init__(self, document: Any, settings: MeshSettings) -> None:
        self.document = document
        self.settings = settings
        self._counts: dict[int, int] = {}
        self._visits = 0

    def triangles(self) -> int:
        """Count the triangles of all nodes.

        Raises:
            ProblemError: something is not read.
        """
        for what in self._refused():
            raise ProblemError(f"it has {what}, which is not read; export it as plain triangles")
        scenes = _tables(self.document, "scenes")
        if len(scenes) > 1 and "scene" not in self.document:
            raise ProblemError(f"it has {len(scenes)} scenes, and does not say which of them is meant")
        if not scenes:
            return 0
        count = sum(self._below(node, 0) for node in scenes[self.document.get("scene", 0)].get("nodes", []))
        # Before any is placed: a few bytes may use one mesh ten thousand times.
        most = self.settings.most_triangles
        if count > most:
            raise ProblemError(f"it has {count} triangles, at most {most} are used; export it coarser")
        return count

    def _below(self, number: int, depth: int) -> int:
        """Triangles of a node and of all below it."""
        self._visits += 1
        if self._visits > self.settings.most_parts or depth > _DEEPEST_NODES:
            raise ProblemError("its nodes are too many, or nested too deep or within themselves")
        node = self.document["nodes"][number]
        own = 0 if "mesh" not in node else self._of_mesh(node["mesh"])
        return own + sum(self._below(child, depth + 1) for child in node.get("children", []))

    def _of_mesh(self, number: int) -> int:
        if number not in self._counts:
            primitives = self.document["meshes"][number]["primitives"]
            self._counts[number] = sum(self._of_primitive(primitive) for primitive in primitives)
        return self._counts[number]

    def _of_primitive(self, primitive: dict[str, Any]) -> int:
        """Triangles of a primitive."""
        accessors = self.document["accessors"]
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in {_TRIANGLES, _STRIP}:
            what = _MODES[mode] if mode in range(len(_MODES)) else f"of the mode {str(mode)[:20]}"
            raise ProblemError(f"a mesh is {what}, which is not read; export it as plain triangles")
        places = accessors[primitive["attributes"]["POSITION"]]
        corners = accessors[primitive["indices"]] if "indices" in primitive else places
        for accessor in (places, corners):
            if "sparse" in accessor:
                raise ProblemError("it has a sparse list of numbers, which is not read; export it as plain triangles")
        if places.get("normalized"):
            raise ProblemError(
                "it has places as shares of a whole number, which is not read; export it as plain triangles"
            )
        count = int(corners["count"])
        if mode == _TRIANGLES and count % 3:
            raise ProblemError(f"a mesh of triangles has {count} corners, which is no multiple of three")
        return max(count - 2, 0) if mode == _STRIP else count // 3

    def _refused(self) -> Iterator[str]:
        """What is not read wherever it stands, in words."""
        required = self.document.get("extensionsRequired")
        text = json.dumps(self.document)
        for name in (*(required if isinstance(required, list) else []), *_SHAPING):
            if not str(name).startswith(_HARMLESS) and (name not in _SHAPING or f'"{name}"' in text):
                yield f"the extension {str(name)[:60]!r}"
        for buffer in _tables(self.document, "buffers"):
            if not str(buffer.get("uri", "data:")).startswith("data:"):
                yield f"its numbers in another file, {str(buffer['uri'])[:60]!r}"
        for table in (*_tables(self.document, "nodes"), *_tables(self.document, "meshes")):
            weights = table.get("weights")
            if any(weights) if isinstance(weights, list) else weights:
                yield "a mesh that is morphed"
            if "skin" in table:
                yield "a skin that bones move"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep trimesh from telling of a broken file in its own words, tracebacks among them."""
    # What its modules log goes up to here, and no further.
    logger = logging.getLogger("trimesh")
    propagated = logger.propagate
    nowhere = logging.NullHandler()
    logger.propagate = False
    logger.addHandler(nowhere)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.propagate = propagated
        logger.removeHandler(nowhere)
