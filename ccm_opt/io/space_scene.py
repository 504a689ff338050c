"""The scene in space as it is written."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.arm_description import number, numbers, roll_pitch_yaw
from ccm_opt.io.problem_data import kept_names
from ccm_opt.io.scene_solids import told_apart
from ccm_opt.io.settings import EXPORT, ExportSettings
from ccm_opt.io.urdf import arm_urdf, triangles_stl, urdf_of
from ccm_opt.problem import Problem
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from ccm_opt.scene.surfaces import turned_to
from ccm_opt.scene.workspace import ROOM_NAME


@dataclass(frozen=True)
class NamedBody:
    """A body that the arm can touch.

    Attributes:
        name: printable and unlike that of any other.
        slug: the same with letters, digits and underscores alone.
        body: its shape, where it stands.
    """

    name: str
    slug: str
    body: Body

    @property
    def mesh_file(self) -> str:
        """Name of the file of its mesh; of no matter where it is no mesh."""
        return f"{self.slug}.stl"


def named_bodies(problem: Problem, settings: ExportSettings = EXPORT) -> tuple[NamedBody, ...]:
    """All obstacles, then the sides of the room where there is one."""
    workspace = problem.workspace
    bodies: list[tuple[str, Body]] = [(each.name, each.body) for each in workspace.obstacles]
    if workspace.bounds is not None:
        thickness = settings.room_wall * problem.arm.length
        bodies += [(ROOM_NAME, slab) for slab in _slabs(workspace.bounds, thickness)]
    names = told_apart(name for name, _ in bodies)
    return tuple(NamedBody(*name, body) for name, (_, body) in zip(names, bodies, strict=True))


def space_meshes(bodies: tuple[NamedBody, ...], folder: str) -> dict[str, bytes]:
    """The mesh files of a scene in binary STL, metres, as they stand in the world; ``folder`` is before their names."""
    return {
        f"{folder}/{named.mesh_file}": triangles_stl(named.body.triangles)
        for named in bodies
        if isinstance(named.body, MeshBody)
    }


def kept_meshes(problem: Problem) -> dict[str, bytes]:
    """The mesh files that a problem was read with, byte for byte, so that a folder can be verified by itself; in space.

    Meshes that were made in Python are written as they stand.
    """
    if problem.dimension == 2:
        return {}
    return {
        name: obstacle.body.content or triangles_stl(obstacle.body.triangles)
        for obstacle, name in zip(problem.workspace.obstacles, kept_names(problem), strict=True)
        if isinstance(obstacle.body, MeshBody)
    }


def _slabs(bounds: FloatArray, thickness: float) -> Iterator[BoxBody]:
    """The six sides of a room, outside it."""
    low, high = bounds
    for axis in range(3):
        # Each reaches past the room by the thickness all round, so that the corners are closed.
        own = np.arange(3) == axis
        yield BoxBody(low - thickness, np.where(own, low, high + thickness))
        yield BoxBody(np.where(own, high, low - thickness), high + thickness)


def mesh_data(problem: Problem) -> list[dict[str, object]]:
    """Of every mesh where it is from, what it was, and where it is kept."""
    kept = kept_meshes(problem)
    return [
        {
            "obstacle": obstacle.name,
            "file": obstacle.body.file,
            "kept": name,
            "sha256": hashlib.sha256(kept[name]).hexdigest(),
            "triangles": len(obstacle.body.faces),
            "closed": obstacle.body.closed,
        }
        for obstacle, name in zip(problem.workspace.obstacles, kept_names(problem), strict=True)
        if isinstance(obstacle.body, MeshBody)
    ]


def space_urdf(problem: Problem, bodies: tuple[NamedBody, ...], mesh_folder: str, *, bends_only: bool = False) -> str:
    """URDF of an arm and of bodies, which are links that are fixed to the world.

    Args:
        problem: whose arm it is.
        bodies: what it can touch; meshes are files, as ``space_meshes`` writes them.
        mesh_folder: of these, relative to the URDF.
        bends_only: whether a link has the two revolutes that bend it, in place of three.
    """
    robot = arm_urdf(problem.arm, problem.name, problem.limits, bends_only=bends_only)
    for named in bodies:
        name = f"obstacle_{named.slug}"
        link = ET.SubElement(robot, "link", name=name)
        for purpose in ("visual", "collision"):
            _add_body(link, purpose, named, mesh_folder)
        joint = ET.SubElement(robot, "joint", name=f"{name}_mount", type="fixed")
        ET.SubElement(joint, "parent", link="world")
        ET.SubElement(joint, "child", link=name)
    return urdf_of(robot)


def _add_body(link: ET.Element, purpose: str, named: NamedBody, mesh_folder: str) -> None:
    body = named.body
    if isinstance(body, BoxBody):
        place = body.placement.points(0.5 * (body.low + body.high))
        shape = _add_shape(link, purpose, place, body.placement.rotation)
        ET.SubElement(shape, "box", size=numbers(body.high - body.low))
    elif isinstance(body, SphereBody):
        shape = _add_shape(link, purpose, body.center, np.eye(3))
        ET.SubElement(shape, "sphere", radius=number(body.radius))
    elif isinstance(body, (CylinderBody, CapsuleBody)):
        _add_bar(link, purpose, body)
    else:
        shape = _add_shape(link, purpose, np.zeros(3), np.eye(3))
        ET.SubElement(shape, "mesh", filename=f"{mesh_folder}/{named.mesh_file}")


def _add_bar(link: ET.Element, purpose: str, body: CylinderBody | CapsuleBody) -> None:
    """A cylinder along z, turned to its axis; URDF has no capsules, which get a ball at either end."""
    axis = body.end - body.start
    # Cylinders stand along their z: the columns of the rotation that turns x to the axis, moved on by one.
    turn = np.roll(turned_to(axis), -1, axis=1)
    shape = _add_shape(link, purpose, 0.5 * (body.start + body.end), turn)
    ET.SubElement(shape, "cylinder", radius=number(body.radius), length=number(float(np.linalg.norm(axis))))
    for end in (body.start, body.end) if isinstance(body, CapsuleBody) else ():
        ET.SubElement(_add_shape(link, purpose, end, turn), "sphere", radius=number(body.radius))


def _add_shape(link: ET.Element, purpose: str, place: Iterable[float], turn: FloatArray) -> ET.Element:
    element = ET.SubElement(link, purpose)
    ET.SubElement(element, "origin", xyz=numbers(place), rpy=numbers(roll_pitch_yaw(turn)))
    return ET.SubElement(element, "geometry")
