"""GLB: what of its document is not read, and would be missing from the obstacle or stand elsewhere, is refused."""

import json
import struct
from collections.abc import Iterator
from typing import Any

from ccm_opt.errors import ProblemError
from ccm_opt.files.scene_import.raw_mesh import RawMesh
from ccm_opt.files.scene_import.trimesh_reading import read_by_trimesh

_HEADER = struct.Struct("<4s4xI")
"""A magic word, a version, the length of the file; the first chunk follows."""
_CHUNK = struct.Struct("<II")
"""The length of a chunk, and its kind."""
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_mesh_quantization")
"""How extensions begin that say nothing of where surfaces are, or nothing that is not looked at in another place."""
_TRIANGLE_FAN = 6
"""The mode of a primitive."""


def read_glb(content: bytes) -> RawMesh:
    """The mesh of the scene of a GLB file, every node where the file places it.

    Raises:
        ProblemError: the file cannot be read, or has something that is not.
    """
    document = _document(content)
    for what in _not_read(document):
        raise ProblemError(f"it has {what}, which is not read; export it as plain triangles")
    return read_by_trimesh(content, "glb")


def _document(content: bytes) -> Any:
    """The document of a file; none where there is none, which the reader says in its own words."""
    start = _HEADER.size + _CHUNK.size
    if len(content) < start or content[:4] != b"glTF":
        return None
    length, _ = _CHUNK.unpack_from(content, _HEADER.size)
    try:
        return json.loads(content[start : start + length])
    except ValueError:
        return None


def _tables(parent: Any, key: str) -> list[dict[str, Any]]:
    """The tables of a list in a document, whatever else it holds."""
    found = parent.get(key) if isinstance(parent, dict) else None
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


def _not_read(document: Any) -> Iterator[str]:
    """What in a document is not read, in words."""
    required = document.get("extensionsRequired") if isinstance(document, dict) else None
    for name in required if isinstance(required, list) else []:
        if not str(name).startswith(_HARMLESS):
            yield f"the extension {str(name)[:60]!r}"
    for buffer in _tables(document, "buffers"):
        if not str(buffer.get("uri", "data:")).startswith("data:"):
            yield f"its numbers in another file, {str(buffer['uri'])[:60]!r}"
    for node in _tables(document, "nodes"):
        yield from _not_read_of_node(node)
    for mesh in _tables(document, "meshes"):
        yield from _morphed(mesh)
        for primitive in _tables(mesh, "primitives"):
            yield from _not_read_of_triangles(primitive, _tables(document, "accessors"))


def _not_read_of_node(node: dict[str, Any]) -> Iterator[str]:
    """What of where a mesh stands is not read."""
    if "skin" in node:
        yield "a skin that bones move"
    if "EXT_mesh_gpu_instancing" in str(node.get("extensions", "")):
        yield "the extension 'EXT_mesh_gpu_instancing'"
    yield from _morphed(node)


def _morphed(table: dict[str, Any]) -> Iterator[str]:
    weights = table.get("weights")
    if any(weights) if isinstance(weights, list) else weights:
        yield "a mesh that is morphed"


def _not_read_of_triangles(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> Iterator[str]:
    """What of the places and corners of triangles is not read."""
    if primitive.get("mode") == _TRIANGLE_FAN:
        yield "a fan of triangles"
    attributes = primitive.get("attributes")
    places = attributes.get("POSITION") if isinstance(attributes, dict) else None
    for number in (places, primitive.get("indices")):
        accessor = accessors[number] if isinstance(number, int) and 0 <= number < len(accessors) else {}
        if "sparse" in accessor:
            yield "a sparse list of numbers"
        if number == places and accessor.get("normalized"):
            yield "places as shares of a whole number"
