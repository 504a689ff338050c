"""Writer of motions as animations, and reader of meshes, in binary glTF 2.0 (GLB).

Before trimesh reads a file, the triangles of all nodes of the scene are counted in the file's JSON document, and
trimesh must return equally many. Cameras are removed first, because trimesh drops the children of camera nodes.
Materials are not read, so that no other file is opened.
"""

import io
import json
import struct
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.issues import collected_warnings
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh
from ccm_opt.io.robot_models import named_bodies, visual_radius
from ccm_opt.io.scene_solids import solid_scene
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import in_link
from ccm_opt.scene.bodies import capsule_surface, rotation_to_axis

_FILM_RATE = 30.0
"""Number of animation keyframes per second of the motion; players interpolate between them [1/s]."""

_ROUND_SIDES = 16
"""Number of flat sides that approximate cylinders and half spheres. Heuristic."""
_GLASS = 0.35
"""Opacity of obstacles in space, which would otherwise hide the arm. Heuristic."""

_FLOATS = 5126
_WHOLE_NUMBERS = 5125
"""Component types of glTF for 32-bit floats and unsigned integers (glTF 2.0, section 3.6.2.2)."""
_ROTATION_FROM_Z_UP = (-0.7071067811865476, 0.0, 0.0, 0.7071067811865476)
"""Quaternion x, y, z, w of the rotation about x from z-up coordinates to the y-up coordinates of glTF."""


@dataclass(frozen=True)
class MovingNode:
    """A node of a glTF scene: one mesh, either fixed or animated.

    Attributes:
        name: name of the node, which viewers show.
        mesh: index of the mesh, as returned by ``GlbWriter.add_mesh``.
        places: positions of the mesh's origin at T keyframes, shape (T, 3) [m]; None for a node fixed at the origin.
        turns: orientations at the keyframes as quaternions x, y, z, w, shape (T, 4); None for a fixed node.
    """

    name: str
    mesh: int
    places: FloatArray | None = None
    turns: FloatArray | None = None


@dataclass
class GlbWriter:
    """Builder of a GLB file: ``add_material`` and ``add_mesh`` collect the content, ``written`` returns the file."""

    buffer: bytearray = field(default_factory=bytearray)
    views: list[dict[str, object]] = field(default_factory=list)
    accessors: list[dict[str, object]] = field(default_factory=list)
    meshes: list[dict[str, object]] = field(default_factory=list)
    materials: list[dict[str, object]] = field(default_factory=list)

    def add_material(self, name: str, colour: tuple[float, float, float], opacity: float = 1.0) -> int:
        """Add a matt material of one colour, transparent if its opacity is below 1, and return its index.

        Args:
            name: name of the material.
            colour: red, green and blue, each from 0 to 1.
            opacity: opacity, from 0 to 1.

        Returns:
            Index of the material, for ``add_mesh``.
        """
        surface = {"baseColorFactor": [*colour, opacity], "metallicFactor": 0.0, "roughnessFactor": 0.8}
        blend = {"alphaMode": "BLEND"} if opacity < 1.0 else {}
        self.materials.append({"name": name, "pbrMetallicRoughness": surface, "doubleSided": True, **blend})
        return len(self.materials) - 1

    def add_mesh(self, vertices: FloatArray, faces: IntArray, material: int) -> int:
        """Add a triangle mesh and return its index; vertices are repeated per triangle, so that viewers shade it flat.

        Args:
            vertices: positions of the vertices, shape (v, 3) [m].
            faces: vertex indices of the triangles, shape (m, 3).
            material: index of the material.
        """
        corners = vertices[faces].reshape(-1, 3)
        attributes = {"POSITION": self._accessor(corners.astype("<f4"), bounded=True)}
        indices = self._accessor(np.arange(len(corners), dtype="<u4"))
        self.meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
        return len(self.meshes) - 1

    def written(self, nodes: Sequence[MovingNode], times: FloatArray) -> bytes:
        """Return the bytes of the GLB file with the given nodes and one animation.

        Args:
            nodes: nodes of the scene.
            times: times of the T keyframes, for all moving nodes, shape (T,) [s].
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
        """Append an array to the binary buffer and return the index of its glTF accessor.

        Args:
            values: numbers of 32 bits, shape (n,), (n, 3) or (n, 4).
            bounded: whether the accessor states minimum and maximum, which glTF requires of positions and times.
        """
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


GREY = (0.55, 0.57, 0.6)
ARM = (0.9, 0.45, 0.1)
TIP = (0.75, 0.1, 0.1)


def motion_glb(problem: Problem, trajectory: JointTrajectory) -> bytes:
    """Return a planned motion as the bytes of an animated GLB file.

    The walls of the workspace bounds are left out, since they would hide the arm.

    Args:
        problem: the problem, which gives arm and obstacles.
        trajectory: the motion; keyframes are taken 30 times per second, and at its start and end.
    """
    arm = problem.arm
    writer = GlbWriter()
    in_space = problem.dimension == 3
    grey = writer.add_material("obstacle", GREY, *((_GLASS,) if in_space else ()))
    nodes = [MovingNode(name, writer.add_mesh(*mesh, grey)) for name, mesh in _obstacles(problem)]
    times, samples = film_times(trajectory.time)
    q = trajectory.positions[samples]
    colours = {name: writer.add_material(name, colour) for name, colour in (("arm", ARM), ("last link", TIP))}
    meshes: dict[tuple[float, float, str], int] = {}
    motions = tuple(_motions(arm, q))
    for k, motion in enumerate(motions):
        kind = (float(arm.lengths[k]), visual_radius(arm, k), "last link" if k == arm.links - 1 else "arm")
        if kind not in meshes:
            meshes[kind] = writer.add_mesh(*capsule_surface(kind[0], kind[1], _ROUND_SIDES), colours[kind[2]])
        nodes.append(MovingNode(f"link{k + 1:02d}", meshes[kind], *motion))
    for name, body in (*named_bodies(arm), *(() if arm.tool is None else (("tool", arm.tool),))):
        for number, capsule in enumerate(body.bodies, start=1):
            start, end = in_link(capsule.start), in_link(capsule.end)
            places, faces = capsule_surface(float(np.linalg.norm(end - start)), capsule.radius, _ROUND_SIDES)
            # From the end of the link, whose node is at its joint.
            places = places @ rotation_to_axis(end - start).T + start + np.array([arm.lengths[body.link], 0.0, 0.0])
            mesh = writer.add_mesh(places, faces, colours["last link"])
            nodes.append(MovingNode(f"{name}{number:02d}", mesh, *motions[body.link]))
    return writer.written(nodes, times)


def _obstacles(problem: Problem) -> Iterator[tuple[str, tuple[FloatArray, IntArray]]]:
    """Yield the name and the surface mesh of each obstacle, without the workspace bounds.

    A mesh consists of vertices, shape (v, 3) [m], and vertex indices of triangles, shape (m, 3).
    """
    scene = solid_scene(problem.workspace, problem.arm)
    # What is outside the room comes behind its obstacles, and would hide them.
    for obstacle in scene.obstacles[: len(problem.workspace.obstacles)]:
        if obstacle.solids:
            yield obstacle.name, _joined([solid.surface(_ROUND_SIDES) for solid in obstacle.solids])


def _motions(arm: Arm, q: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the motion of each link: T positions, shape (T, 3) [m], and quaternions x, y, z, w, shape (T, 4).

    Args:
        arm: the arm.
        q: configurations at T times, one column per coordinate, shape (T, c) [rad, m].
    """
    positions, turns = arm.embedded(arm.joint_positions_at(q)), arm.link_rotations(q)
    if arm.dimension == 2:
        flat, turns = turns, np.broadcast_to(np.eye(3), (*turns.shape[:2], 3, 3)).copy()
        turns[..., ::2, ::2] = flat
    yield from ((positions[:, k], quaternions(turns[:, k])) for k in range(arm.links))


def film_times(time: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the times of animation keyframes, shape (K,) [s], and the indices of the motion's samples at these times.

    Args:
        time: times of all samples of the motion, shape (T,) [s].
    """
    count = max(2, int(np.ceil((time[-1] - time[0]) * _FILM_RATE)) + 1)
    wanted = np.linspace(time[0], time[-1], min(count, len(time)))
    samples = np.unique(np.clip(np.searchsorted(time, wanted), 0, len(time) - 1))
    return time[samples], samples


def _joined(meshes: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=True)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return quaternions x, y, z, w, shape (T, 4), of rotation matrices over time, shape (T, 3, 3).

    Signs are chosen so that successive quaternions do not change sign.
    """
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - loaded only where a film is written

    found = Rotation.from_matrix(rotations).as_quat()
    # Players take the short way between two quaternions only where these are on the same side.
    flips = np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(found * np.concatenate(([1.0], np.cumprod(flips)))[:, None])


_DEEPEST_NODES = 200
"""Maximum nesting depth of nodes in a GLB file. Heuristic: robot models nest a few dozen deep."""

_HEADER = struct.Struct("<4sII")
"""Header of a GLB file: magic word, version, and length of the file; the first chunk follows."""
_CHUNK = struct.Struct("<I4s")
"""Header of a chunk of a GLB file: its length and its type."""
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_mesh_quantization")
"""Prefixes of glTF extensions that do not change the positions of surfaces, or whose effect is checked elsewhere."""
_SHAPING = ("EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression", "EXT_meshopt_compression")
"""Extensions of glTF that contain surfaces or positions, refused even if a file does not declare them required."""
_MODES = (
    "a list of points",
    "a list of lines",
    "a loop of lines",
    "a strip of lines",
    "triangles",
    "a strip of triangles",
    "a fan of triangles",
)
"""Descriptions of glTF primitives for messages, by mode."""
_LARGEST_DOCUMENT = 2**25
"""Maximum size of the JSON document of a GLB file, which takes ten times the memory when parsed [bytes]."""
_TRIANGLES = 4
_STRIP = 5
_LONGEST_REASON = 100
"""Maximum length of an error message of trimesh that is shown [characters]."""


def read_glb(content: bytes, settings: MeshSettings) -> RawMesh:
    """Return all meshes in the default scene of a GLB file as one mesh, each transformed by its nodes.

    Raises:
        ProblemError: the file cannot be read, exceeds a limit, or uses an unsupported feature.
    """
    import trimesh  # noqa: PLC0415 - takes a second to load

    document, rest = _opened(content)
    try:
        wanted = _Scene(document, settings).triangles()
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        body = _CHUNK.pack(len(text), b"JSON") + text + rest
        plain = _HEADER.pack(b"glTF", 2, _HEADER.size + len(body)) + body
        with collected_warnings("trimesh"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(plain), file_type="glb", skip_materials=True, process=False)
            parts = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
            found = [RawMesh(np.asarray(each.vertices, np.float64), np.asarray(each.faces, np.intp)) for each in parts]
    except ProblemError:
        raise
    # A broken file may raise any exception in trimesh; to the user it is a broken file.
    except Exception as error:  # noqa: BLE001
        missing = " is missing" if isinstance(error, KeyError) else ""
        reason = f"{' '.join(str(error).split())[:_LONGEST_REASON] or type(error).__name__}{missing}"
        raise ProblemError(f"not readable as GLB: the file is damaged or truncated ({reason})") from None
    mesh = RawMesh.joined(found)
    if len(mesh.faces) != wanted:
        raise ProblemError(f"its scene has {wanted} triangles, but trimesh reads only {len(mesh.faces)} of them")
    return mesh


def _opened(content: bytes) -> tuple[Any, bytes]:
    """Return the parsed JSON document of a GLB file, without its cameras, and the bytes of the following chunks.

    Raises:
        ProblemError: the content is not a GLB of version 2, or is damaged.
    """
    start = _HEADER.size + _CHUNK.size
    if len(content) < start or content[:4] != b"glTF":
        raise ProblemError("not readable as GLB: the file signature is missing")
    _, version, length = _HEADER.unpack_from(content)
    if version != 2:
        raise ProblemError(f"not readable as GLB: its version is {version}; only version 2 is read; export it anew")
    if length > len(content):
        raise ProblemError(f"not readable as GLB: its header announces {length} bytes, but the file has {len(content)}")
    size, _ = _CHUNK.unpack_from(content, _HEADER.size)
    if size > _LARGEST_DOCUMENT:
        raise ProblemError(
            f"its JSON document has {size} bytes; at most {_LARGEST_DOCUMENT} are read; export it coarser"
        )
    try:
        document = json.loads(content[start : start + size])
    except (ValueError, RecursionError) as error:
        raise ProblemError(
            f"not readable as GLB: its JSON document is damaged ({str(error)[:_LONGEST_REASON]})"
        ) from None
    if not isinstance(document, dict):
        raise ProblemError("not readable as GLB: its JSON document is not an object")
    for node in _tables(document, "nodes"):
        node.pop("camera", None)
    return document, content[start + size : length]


def _tables(parent: Any, key: str) -> list[dict[str, Any]]:
    """Return the JSON objects in the list ``parent[key]``, without other entries; empty if there is no such list."""
    found = parent.get(key) if isinstance(parent, dict) else None
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


class _Scene:
    """Counter of the triangles in the default scene of a GLB file.

    Args:
        document: parsed JSON document of the file; for a damaged document the methods may raise any exception.
        settings: limits on mesh files.
    """

    def __init__(self, document: Any, settings: MeshSettings) -> None:
        self.document = document
        self.settings = settings
        self._counts: dict[int, int] = {}
        self._visits = 0

    def triangles(self) -> int:
        """Return the number of triangles in all nodes of the default scene, counted at each use of a mesh.

        Raises:
            ProblemError: the document uses an unsupported feature, or exceeds a limit.
        """
        for what in self._refused():
            raise ProblemError(f"it has {what}, which is not supported; export it as plain triangles")
        scenes = _tables(self.document, "scenes")
        if len(scenes) > 1 and "scene" not in self.document:
            raise ProblemError(f"it has {len(scenes)} scenes, and none is marked as the default; export only one")
        if not scenes:
            return 0
        count = sum(self._below(node, 0) for node in scenes[self.document.get("scene", 0)].get("nodes", []))
        # Before any is placed: a few bytes may use one mesh ten thousand times.
        most = self.settings.most_triangles
        if count > most:
            raise ProblemError(f"it has {count} triangles; at most {most} can be used; export it coarser")
        return count

    def _below(self, number: int, depth: int) -> int:
        """Return the number of triangles in a node and all its descendants.

        Args:
            number: index of the node.
            depth: number of nodes above it.
        """
        self._visits += 1
        if self._visits > self.settings.most_parts or depth > _DEEPEST_NODES:
            raise ProblemError("it has too many nodes, or they are nested too deeply or in a cycle")
        node = self.document["nodes"][number]
        count = 0 if "mesh" not in node else self._of_mesh(node["mesh"])
        return count + sum(self._below(child, depth + 1) for child in node.get("children", []))

    def _of_mesh(self, number: int) -> int:
        if number not in self._counts:
            primitives = self.document["meshes"][number]["primitives"]
            self._counts[number] = sum(self._of_primitive(primitive) for primitive in primitives)
        return self._counts[number]

    def _of_primitive(self, primitive: dict[str, Any]) -> int:
        """Return the number of triangles in a glTF primitive.

        Raises:
            ProblemError: the primitive consists of anything but plain triangles or triangle strips.
        """
        accessors = self.document["accessors"]
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in {_TRIANGLES, _STRIP}:
            what = _MODES[mode] if mode in range(len(_MODES)) else f"of the mode {str(mode)[:20]}"
            raise ProblemError(f"a mesh is {what}, which is not supported; export it as plain triangles")
        places = accessors[primitive["attributes"]["POSITION"]]
        corners = accessors[primitive["indices"]] if "indices" in primitive else places
        for accessor in (places, corners):
            if "sparse" in accessor:
                raise ProblemError("it has a sparse accessor, which is not supported; export it as plain triangles")
        if places.get("normalized"):
            raise ProblemError(
                "it has normalised integer positions, which are not supported; export it as plain triangles"
            )
        count = int(corners["count"])
        if mode == _TRIANGLES and count % 3:
            raise ProblemError(f"a mesh of triangles has {count} corners, not a multiple of three")
        return max(count - 2, 0) if mode == _STRIP else count // 3

    def _refused(self) -> Iterator[str]:
        """Yield a phrase, for messages, about each unsupported feature anywhere in the document."""
        required = self.document.get("extensionsRequired")
        text = json.dumps(self.document)
        for name in (*(required if isinstance(required, list) else []), *_SHAPING):
            if not str(name).startswith(_HARMLESS) and (name not in _SHAPING or f'"{name}"' in text):
                yield f"the extension {str(name)[:60]!r}"
        for buffer in _tables(self.document, "buffers"):
            if not str(buffer.get("uri", "data:")).startswith("data:"):
                yield f"a buffer in another file, {str(buffer['uri'])[:60]!r}"
        for table in (*_tables(self.document, "nodes"), *_tables(self.document, "meshes")):
            weights = table.get("weights")
            if any(weights) if isinstance(weights, list) else weights:
                yield "a morph target"
            if "skin" in table:
                yield "a skinned mesh"
