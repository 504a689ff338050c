"""A scene of triangle meshes as binary glTF (glTF 2.0, sections 3 and 4): nodes that stand still or move with time."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ccm_opt.ground.arrays import FloatArray, IntArray

_FLOATS = 5126
_WHOLE_NUMBERS = 5125
"""Types of numbers, 32 bits each (table 3.6.2.2)."""
_ROTATION_FROM_Z_UP = (-0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
"""A quarter turn about x, as x, y, z, w: glTF calls y what we call z, up."""


@dataclass(frozen=True)
class MovingNode:
    """A mesh at one place, or at places over time.

    Attributes:
        name: shown by programs.
        mesh: number of its mesh.
        places: of its origin, shape (T, 3) [m]; None for a node that stands at the origin.
        turns: quaternions x, y, z, w, shape (T, 4).
    """

    name: str
    mesh: int
    places: FloatArray | None = None
    turns: FloatArray | None = None


@dataclass
class GlbWriter:
    """Gathers meshes; ``written`` gives the file."""

    buffer: bytearray = field(default_factory=bytearray)
    views: list[dict[str, object]] = field(default_factory=list)
    accessors: list[dict[str, object]] = field(default_factory=list)
    meshes: list[dict[str, object]] = field(default_factory=list)
    materials: list[dict[str, object]] = field(default_factory=list)

    def add_material(self, name: str, colour: tuple[float, float, float], opacity: float = 1.0) -> int:
        """Add a dull colour, red, green and blue from 0 to 1, which is seen through below an opacity of 1.

        Returns:
            Its number.
        """
        surface = {"baseColorFactor": [*colour, opacity], "metallicFactor": 0.0, "roughnessFactor": 0.8}
        blend = {"alphaMode": "BLEND"} if opacity < 1.0 else {}
        self.materials.append({"name": name, "pbrMetallicRoughness": surface, "doubleSided": True, **blend})
        return len(self.materials) - 1

    def add_mesh(self, vertices: FloatArray, faces: IntArray, material: int) -> int:
        """Add a mesh without shared corners, so that its faces are lit flat; returns its number."""
        corners = vertices[faces].reshape(-1, 3)
        attributes = {"POSITION": self._accessor(corners.astype("<f4"), bounded=True)}
        indices = self._accessor(np.arange(len(corners), dtype="<u4"))
        self.meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
        return len(self.meshes) - 1

    def written(self, nodes: Sequence[MovingNode], times: FloatArray) -> bytes:
        """The file.

        Args:
            nodes: what is seen.
            times: of the places of all moving nodes, shape (T,) [s].
        """
        samplers: list[dict[str, object]] = []
        channels: list[dict[str, object]] = []
        clock = self._accessor(times.astype("<f4"), bounded=True)
        for number, node in enumerate(nodes, start=1):
            for path, values in (("translation", node.places), ("rotation", node.turns)):
                if values is not None:
                    channels.append({"sampler": len(samplers), "target": {"node": number, "path": path}})
                    samplers.append({"input": clock, "output": self._accessor(values.astype("<f4"))})
        root = {"name": "world", "rotation": list(_ROTATION_FROM_Z_UP), "children": list(range(1, len(nodes) + 1))}
        document = {
            "asset": {"version": "2.0", "generator": "ccm_opt"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [root, *({"name": node.name, "mesh": node.mesh} for node in nodes)],
            "meshes": self.meshes,
            "materials": self.materials,
            "animations": [{"name": "motion", "samplers": samplers, "channels": channels}],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.buffer)}],
        }
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        whole = 12 + 8 + len(text) + 8 + len(self.buffer)
        header = struct.pack("<4sII", b"glTF", 2, whole)
        chunks = ((b"JSON", text), (b"BIN\0", bytes(self.buffer)))
        return header + b"".join(struct.pack("<I4s", len(content), kind) + content for kind, content in chunks)

    def _accessor(self, values: npt.NDArray[np.generic], *, bounded: bool = False) -> int:
        """Put numbers into the buffer; returns the number of their description."""
        content = values.tobytes()  # of four bytes each, so that what follows is aligned
        self.views.append({"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(content)})
        self.buffer += content
        kinds = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
        table = values.reshape(len(values), -1)
        accessor: dict[str, object] = {
            "bufferView": len(self.views) - 1,
            "componentType": _FLOATS if values.dtype.kind == "f" else _WHOLE_NUMBERS,
            "count": len(values),
            "type": kinds[table.shape[1]],
        }
        if bounded:
            accessor |= {"min": np.min(table, axis=0).tolist(), "max": np.max(table, axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1
