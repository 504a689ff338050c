"""Motions as GLB."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.io.arm_description import visual_radius
from ccm_opt.io.scene_solids import Drum, Prism, Solid, prism_mesh, solid_scene
from ccm_opt.io.settings import EXPORT, ExportSettings
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.space_kinematics import joint_positions, link_rotations
from ccm_opt.scene.round_bodies import capsule_surface, seen_triangles
from ccm_opt.scene.workspace import BOUNDARY_NAME
from ccm_opt.solution import JointTrajectory

_FILM_RATE = 30.0
"""Keyframes of films a second [1/s]; between them players interpolate."""

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


GREY = (0.55, 0.57, 0.6)
ARM = (0.9, 0.45, 0.1)
TIP = (0.75, 0.1, 0.1)


def motion_glb(problem: Problem, trajectory: JointTrajectory, settings: ExportSettings = EXPORT) -> bytes:
    """A plan as a film; the walls around the room are left out, or they would hide it.

    Args:
        problem: arm and obstacles.
        trajectory: the motion; keyframes are taken from it at ``film_rate``, its ends included.
        settings: sizes.
    """
    arm = problem.arm
    writer = GlbWriter()
    grey = writer.add_material("obstacle", GREY)
    scene = solid_scene(problem.workspace, arm, settings)
    nodes = []
    for obstacle in scene.obstacles:
        if obstacle.solids and not obstacle.name.startswith(BOUNDARY_NAME):
            mesh = _joined([_mesh(solid, scene.half_depth, settings) for solid in obstacle.solids])
            nodes.append(MovingNode(obstacle.name, writer.add_mesh(*mesh, grey)))

    times, samples = film_times(trajectory.time)
    positions = arm.joint_positions_at(trajectory.positions[samples])
    capsule = capsule_surface(arm.link_length, visual_radius(arm), settings.round_sides)
    link_mesh = writer.add_mesh(*capsule, writer.add_material("arm", ARM))
    tip_mesh = writer.add_mesh(*capsule, writer.add_material("last link", TIP))
    for k in range(arm.links):
        mesh_number = tip_mesh if k == arm.links - 1 else link_mesh
        nodes.append(MovingNode(f"link{k + 1:02d}", mesh_number, *_motion_of(positions[:, k : k + 2])))
    return writer.written(nodes, times)


def film_times(time: FloatArray) -> tuple[FloatArray, IntArray]:
    """Times of a film, and the samples nearest to them."""
    count = max(2, int(np.ceil((time[-1] - time[0]) * _FILM_RATE)) + 1)
    wanted = np.linspace(time[0], time[-1], min(count, len(time)))
    samples = np.unique(np.clip(np.searchsorted(time, wanted), 0, len(time) - 1))
    return time[samples], samples


def _motion_of(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and turns of a link over time from both its ends in the plane, shape (T, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    # Players take the short way between two quaternions of opposite sign; an unwrapped heading has no jump at all.
    half = 0.5 * np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    zero = np.zeros(len(ends))
    places = np.column_stack((ends[:, 0, 0], zero, ends[:, 0, 1]))
    return places, np.column_stack((zero, -np.sin(half), zero, np.cos(half)))


def _mesh(solid: Solid, half_depth: float, settings: ExportSettings) -> tuple[FloatArray, IntArray]:
    if isinstance(solid, Drum):
        angles = np.linspace(0.0, 2.0 * np.pi, 2 * settings.round_sides, endpoint=False)
        ring = solid.center + solid.radius * np.column_stack((np.cos(angles), np.sin(angles)))
        return prism_mesh(Prism(ring), half_depth)
    return prism_mesh(solid, half_depth)


def _joined(meshes: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=True)]
    return np.vstack([vertices for vertices, _ in meshes]), np.vstack(faces)


def space_motion_glb(problem: SpaceProblem, trajectory: JointTrajectory, settings: ExportSettings = EXPORT) -> bytes:
    """A plan as a film; the sides of the room are left out, or they would hide it.

    Args:
        problem: arm and obstacles.
        trajectory: the motion; keyframes are taken from it at ``film_rate``, its ends included.
        settings: sizes.
    """
    arm = problem.arm
    writer = GlbWriter()
    glass = writer.add_material("obstacle", GREY, settings.glass)
    nodes = [
        MovingNode(each.name, writer.add_mesh(*seen_triangles(each.body, settings.round_sides), glass))
        for each in problem.workspace.obstacles
    ]
    times, samples = film_times(trajectory.time)
    q = trajectory.positions[samples]
    positions = joint_positions(arm, q)
    rotations = link_rotations(arm, q)
    capsule = capsule_surface(arm.link_length, visual_radius(arm), settings.round_sides)
    link_mesh = writer.add_mesh(*capsule, writer.add_material("arm", ARM))
    tip_mesh = writer.add_mesh(*capsule, writer.add_material("last link", TIP))
    for k in range(arm.links):
        mesh_number = tip_mesh if k == arm.links - 1 else link_mesh
        turns = quaternions(rotations[:, k])
        nodes.append(MovingNode(f"link{k + 1:02d}", mesh_number, positions[:, k], turns))
    return writer.written(nodes, times)


def quaternions(rotations: FloatArray) -> FloatArray:
    """Rotations over time, shape (T, 3, 3), as quaternions x, y, z, w without jumps of sign, shape (T, 4)."""
    # Each row of this symmetric matrix is the quaternion times one of its own numbers; the largest row is exact.
    r = rotations
    matrix = np.empty((len(r), 4, 4))
    matrix[:, 3, 3] = 1.0 + r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        matrix[:, i, i] = 1.0 + r[:, i, i] - r[:, j, j] - r[:, k, k]
        matrix[:, i, j] = matrix[:, j, i] = r[:, i, j] + r[:, j, i]
        matrix[:, i, 3] = matrix[:, 3, i] = r[:, k, j] - r[:, j, k]
    largest = np.argmax(np.diagonal(matrix, axis1=1, axis2=2), axis=1)
    found = matrix[np.arange(len(r)), largest]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    # Players take the short way between two quaternions only where these are on the same side.
    flips = np.where(np.sum(found[1:] * found[:-1], axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(found * np.concatenate(([1.0], np.cumprod(flips)))[:, None])
