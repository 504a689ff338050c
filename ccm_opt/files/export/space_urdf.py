"""The file ``arm.urdf`` of an arm in space, among bodies that are boxes, cylinders, balls and meshes."""

from collections.abc import Iterable
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.arm_description import number, numbers, roll_pitch_yaw
from ccm_opt.files.export.space_scene import NamedBody
from ccm_opt.files.export.urdf import arm_urdf, urdf_of
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import BoxBody, CapsuleBody, CylinderBody, SphereBody
from ccm_opt.space.scene.round_bodies import turned_to


def space_urdf(
    problem: SpaceProblem, bodies: tuple[NamedBody, ...], mesh_folder: str, *, bends_only: bool = False
) -> str:
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
