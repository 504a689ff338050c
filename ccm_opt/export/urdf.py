"""The arm as URDF: three revolutes a ball, two massless links between, world frame (FORMATS: arm.urdf)."""

from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.export.arm_description import Revolute, number, numbers, revolutes, visual_radius
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.frames import base_position
from ccm_opt.problem import Limits

UNLIMITED_EFFORT = 1e6  # [N m]: URDF has no way to say "no limit"


def urdf_text(arm: Arm, name: str, limits: Limits) -> str:
    """URDF of the arm.

    The root link ``world`` is the world frame; base position and heading stand in the fixed joint ``base_mount``. All
    joint frames are parallel at zero angles, the straight arm along the base heading.

    Args:
        arm: the arm.
        name: of the robot.
        limits: bounds on the revolutes; without torque limits an effort of 1e6 N m is written.
    """
    robot = ET.Element("robot", name=name)
    ET.SubElement(robot, "link", name="world")
    ET.SubElement(robot, "link", name="base")
    mount = ET.SubElement(robot, "joint", name="base_mount", type="fixed")
    rotation = numbers((0.0, -arm.base_heading, 0.0))
    ET.SubElement(mount, "origin", xyz=numbers(base_position(arm)), rpy=rotation)
    ET.SubElement(mount, "parent", link="world")
    ET.SubElement(mount, "child", link="base")
    parent = "base"
    for index, revolute in enumerate(revolutes(arm)):
        child = f"link{revolute.ball:02d}" if revolute.carries_link else f"{revolute.name}_frame"
        _add_link(robot, arm, child, revolute)
        _add_joint(robot, arm, parent, child, revolute, limits, index)
        parent = child
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ET.Element, arm: Arm, name: str, revolute: Revolute) -> None:
    link = ET.SubElement(robot, "link", name=name)
    if not revolute.carries_link:
        return
    k = revolute.ball - 1
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers((0.5 * arm.link_length, 0.0, 0.0)), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(arm.masses[k]))
    axial, across = number(arm.inertia_axial[k]), number(arm.inertia_transverse[k])
    ET.SubElement(inertial, "inertia", ixx=axial, iyy=across, izz=across, ixy="0", ixz="0", iyz="0")
    for purpose in ("visual", "collision"):
        _add_capsule(link, arm, purpose)


def _add_capsule(link: ET.Element, arm: Arm, purpose: str) -> None:
    """A cylinder along the link and a sphere at either end."""
    radius = number(visual_radius(arm))
    shape = _add_shape(link, purpose, (0.5 * arm.link_length, 0.0, 0.0))
    ET.SubElement(shape, "cylinder", radius=radius, length=number(arm.link_length))
    for x in (0.0, arm.link_length):
        ET.SubElement(_add_shape(link, purpose, (x, 0.0, 0.0)), "sphere", radius=radius)


def _add_shape(link: ET.Element, purpose: str, centre: tuple[float, float, float]) -> ET.Element:
    body = ET.SubElement(link, purpose)
    ET.SubElement(body, "origin", xyz=numbers(centre), rpy=numbers((0.0, 0.5 * np.pi, 0.0)))  # z along the link
    return ET.SubElement(body, "geometry")


def _add_joint(
    robot: ET.Element, arm: Arm, parent: str, child: str, revolute: Revolute, limits: Limits, index: int
) -> None:
    joint = ET.SubElement(robot, "joint", name=revolute.name, type="revolute")
    shift = arm.link_length if revolute.starts_ball and revolute.ball > 1 else 0.0
    ET.SubElement(joint, "origin", xyz=numbers((shift, 0.0, 0.0)), rpy="0 0 0")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "axis", xyz=numbers(revolute.axis))
    ET.SubElement(
        joint,
        "limit",
        lower=number(-revolute.limit),
        upper=number(revolute.limit),
        velocity=number(limits.velocity[index]),
        effort=number(UNLIMITED_EFFORT if limits.torque is None else limits.torque[index]),
    )
