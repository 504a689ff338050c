"""Robot models of the arm and its obstacles in the format URDF."""

from collections.abc import Iterable
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.robot_models import (
    FEED,
    FRAME_INERTIA,
    FRAME_MASS,
    URDF_MESHES,
    ModelShape,
    Revolute,
    body_shape,
    link_capsule,
    mesh_file,
    named_bodies,
    number,
    numbers,
    revolutes,
    rigid_shapes,
    tool_rotation,
)
from ccm_opt.io.scene_solids import SolidScene
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import RigidBody, in_link

UNLIMITED_EFFORT = 1e6
"""Effort limit written for unlimited joints, which URDF cannot express [N m] or [N]."""
UNLIMITED_VELOCITY = 1e3
"""Velocity limit written for an unlimited feed axis, which URDF cannot express [m/s]."""
_UPRIGHT = 1e-12
"""Norm of the horizontal component of a unit vector up to which the vector counts as vertical."""


def urdf_text(
    arm: Arm,
    name: str,
    limits: Limits,
    scene: SolidScene | None = None,
    mesh_folder: str = URDF_MESHES,
    *,
    bends_only: bool = False,
) -> str:
    """Return the URDF model of an arm and its obstacles as text.

    The root link ``world`` is the world frame; the fixed joint ``base_mount`` holds base position and heading. At zero
    angles all joint frames are parallel and the arm is straight along the base heading. A feed axis is the prismatic
    joint ``feed`` before all others, a payload a separate link, and the tip the massless link ``tip``. Obstacles are
    links fixed to the world. The mount (first part of the arm, which may touch walls) is visual only. URDF cannot
    express rotor inertia. Frames between joints have about the minimum mass and inertia that MuJoCo and Gazebo load.

    Args:
        arm: the arm.
        name: name of the robot.
        limits: limits of all joints; without torque limits an effort of 1e6 N m is written.
        scene: the obstacles as solids; None writes the arm alone.
        mesh_folder: folder of the obstacles' mesh files, relative to the URDF file.
        bends_only: whether a ball joint has only the revolutes that bend the arm, one for a planar arm and two in
            space, instead of three.
    """
    robot = ET.Element("robot", name=name)
    ET.SubElement(robot, "link", name="world")
    parent = _add_mount(robot, arm, limits)
    for revolute in revolutes(arm, bends_only=bends_only):
        child = f"link{revolute.ball:02d}" if revolute.carries_link else f"{revolute.name}_frame"
        _add_link(robot, arm, child, revolute)
        shift = float(arm.lengths[revolute.ball - 2]) if revolute.starts_ball and revolute.ball > 1 else 0.0
        joint = _add_joint(robot, revolute.name, "revolute", parent, child, (shift, 0.0, 0.0))
        ET.SubElement(joint, "axis", xyz=numbers(revolute.axis))
        effort = UNLIMITED_EFFORT if limits.torque is None else float(limits.torque[revolute.index])
        _add_limit(joint, (-revolute.limit, revolute.limit), float(limits.velocity[revolute.index]), effort)
        if revolute.friction:
            ET.SubElement(joint, "dynamics", damping=number(revolute.friction))
        parent = child
    for called, body in named_bodies(arm):
        _add_rigid_link(robot, body, called)
        link = body.link % arm.links
        end = (float(arm.lengths[link]), 0.0, 0.0)
        _add_joint(robot, f"{called}_mount", "fixed", f"link{link + 1:02d}", called, end)
    tip = (float(arm.lengths[-1]), 0.0, 0.0)
    angles = (0.0, 0.0, 0.0)
    if arm.tool is not None:
        _add_rigid_link(robot, arm.tool, "tool")
        _add_joint(robot, "tool_mount", "fixed", parent, "tool", tip)
        parent, tip, angles = "tool", tuple(in_link(arm.tool.tip)), roll_pitch_yaw(tool_rotation(arm.tool))
    if arm.payload:
        _add_inertia(ET.SubElement(robot, "link", name="payload"), 0.0, arm.payload, FRAME_INERTIA, FRAME_INERTIA)
        _add_joint(robot, "payload_mount", "fixed", parent, "payload", tip)
    ET.SubElement(robot, "link", name="tip")
    _add_joint(robot, "tip_mount", "fixed", parent, "tip", tip, angles)
    if scene is not None:
        _add_urdf_obstacles(robot, scene, mesh_folder)
    if robot.find(".//mesh") is not None:
        # MuJoCo 3 drops the folders of file names by default; other programs ignore this element.
        ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", strippath="false")
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_urdf_obstacles(robot: ET.Element, scene: SolidScene, folder: str) -> None:
    """Add a link for every obstacle to a URDF model, fixed to the link ``world``."""
    for obstacle in scene.obstacles:
        link_name = f"obstacle_{obstacle.slug}"
        link = ET.SubElement(robot, "link", name=link_name)
        for purpose in ("visual", "collision"):
            for k, solid in enumerate(obstacle.solids):
                _add_urdf_shapes(link, purpose, body_shape(solid), f"{folder}/{mesh_file(scene, obstacle, k)}")
        joint = ET.SubElement(robot, "joint", name=f"{link_name}_mount", type="fixed")
        ET.SubElement(joint, "parent", link="world")
        ET.SubElement(joint, "child", link=link_name)


def _add_mount(robot: ET.Element, arm: Arm, limits: Limits) -> str:
    """Add the links and joints between world and first ball joint to a URDF model; return the name of the last link."""
    if arm.carrier:
        return _add_carrier(robot, arm, limits)
    names = (*("mount" for _ in arm.base_axes), "base")
    ET.SubElement(robot, "link", name=names[0])
    _add_joint(robot, "base_mount", "fixed", "world", names[0], arm.base_position, roll_pitch_yaw(arm.base_rotation))
    for axis, carrier, carried in zip(arm.base_axes, names[:-1], names[1:], strict=True):
        _add_inertia(ET.SubElement(robot, "link", name=carried), 0.0, FRAME_MASS, FRAME_INERTIA, FRAME_INERTIA)
        slide = _add_joint(robot, FEED, "prismatic", carrier, carried)
        ET.SubElement(slide, "axis", xyz=numbers((1.0, 0.0, 0.0)))
        effort = UNLIMITED_EFFORT if limits.feed_force is None else limits.feed_force
        _add_limit(slide, (axis.low, axis.high), limits.feed_velocity or UNLIMITED_VELOCITY, effort)
    return "base"


def _add_carrier(robot: ET.Element, arm: Arm, limits: Limits) -> str:
    """Add the axes that carry an arm to a URDF model; return the name of the base's link, the last one.

    Where all axes are at zero, the frames of their links are parallel to the world's.
    """
    bounds = limits.of_drives(arm.coordinates)
    parent, place = "world", np.zeros(3)
    for index, (name, axis) in enumerate(zip(arm.coordinates.base_names, arm.carrier, strict=True)):
        drive = arm.coordinates.revolutes + index
        child = f"{name}_carriage"
        _add_inertia(ET.SubElement(robot, "link", name=child), 0.0, FRAME_MASS, FRAME_INERTIA, FRAME_INERTIA)
        kind, at = ("revolute", axis.point) if axis.revolute else ("prismatic", place)
        joint = _add_joint(robot, name, kind, parent, child, at - place)
        ET.SubElement(joint, "axis", xyz=numbers(axis.direction))
        effort = float(bounds.effort[drive])
        effort = effort if np.isfinite(effort) else UNLIMITED_EFFORT
        _add_limit(joint, (axis.low, axis.high), float(bounds.velocity[drive]), effort)
        parent, place = child, at
    _add_inertia(ET.SubElement(robot, "link", name="base"), 0.0, FRAME_MASS, FRAME_INERTIA, FRAME_INERTIA)
    away = arm.base_position - place
    _add_joint(robot, "base_mount", "fixed", parent, "base", away, roll_pitch_yaw(arm.base_rotation))
    return "base"


def _add_joint(
    robot: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: Iterable[float] = (0.0, 0.0, 0.0),
    angles: Iterable[float] = (0.0, 0.0, 0.0),
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    _add_origin(joint, place, angles)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _add_limit(joint: ET.Element, span: tuple[float, float], velocity: float, effort: float) -> None:
    low, high = span
    bounds = {"lower": number(low), "upper": number(high)}
    ET.SubElement(joint, "limit", bounds, velocity=number(velocity), effort=number(effort))


def _add_link(robot: ET.Element, arm: Arm, name: str, revolute: Revolute) -> None:
    link = ET.SubElement(robot, "link", name=name)
    if not revolute.carries_link:
        _add_inertia(link, 0.0, FRAME_MASS, FRAME_INERTIA, FRAME_INERTIA)
        return
    k = revolute.ball - 1
    length = float(arm.lengths[k])
    _add_inertia(link, 0.5 * length, arm.masses[k], arm.inertia_axial[k], arm.inertia_transverse[k])
    _add_urdf_shapes(link, "visual", link_capsule(arm, k, 0.0))
    begin = float(arm.free_shares[k]) * length
    if begin < length:
        _add_urdf_shapes(link, "collision", link_capsule(arm, k, begin))


def _add_rigid_link(robot: ET.Element, rigid: RigidBody, name: str) -> None:
    """Add a link for a rigid body to a URDF model, with its frame at the end of the link that carries it."""
    link = ET.SubElement(robot, "link", name=name)
    if rigid.mass:
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, rigid.centre_in_space)
        ET.SubElement(inertial, "mass", value=number(rigid.mass))
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), rigid.moments, strict=True)
        ET.SubElement(inertial, "inertia", {name: number(value) for name, value in moments})
    for shape in rigid_shapes(rigid):
        for purpose in ("visual", "collision"):
            _add_urdf_shapes(link, purpose, shape)


def _add_inertia(link: ET.Element, centre: float, mass: float, axial: float, across: float) -> None:
    """Add the mass and inertia of a body that is rotationally symmetric about x to a URDF link.

    Args:
        link: XML element of the link.
        centre: x coordinate of the centre of mass [m].
        mass: mass [kg].
        axial: moment of inertia about x [kg m²].
        across: moment of inertia about y and z [kg m²].
    """
    inertial = ET.SubElement(link, "inertial")
    _add_origin(inertial, (centre, 0.0, 0.0))
    ET.SubElement(inertial, "mass", value=number(mass))
    sides = {"iyy": number(across), "izz": number(across), "ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(inertial, "inertia", {"ixx": number(axial), **sides})


def _add_urdf_shapes(link: ET.Element, purpose: str, shape: ModelShape, mesh: str = "") -> None:
    """Add a geometry to a link of a URDF model; a capsule is written as a cylinder and two spheres, as URDF has none.

    Args:
        link: XML element of the link.
        purpose: "visual" or "collision".
        shape: the geometry.
        mesh: path of the mesh file, for a mesh.
    """
    parts = [shape]
    if shape.kind == "capsule":
        half = 0.5 * shape.size[1] * shape.turn[:, 2]
        ends = [replace(shape, kind="sphere", place=shape.place + end) for end in (-half, half)]
        parts = [replace(shape, kind="cylinder"), *ends]
    for part in parts:
        body = ET.SubElement(link, purpose)
        _add_origin(body, part.place, roll_pitch_yaw(part.turn))
        measures = {
            "box": {"size": numbers(part.size)},
            "mesh": {"filename": mesh},
            "sphere": {"radius": number(part.size[0]) if part.size else ""},
        }
        round_bar = dict(zip(("radius", "length"), map(number, part.size), strict=False))
        ET.SubElement(ET.SubElement(body, "geometry"), part.kind, measures.get(part.kind, round_bar))


def _add_origin(element: ET.Element, place: Iterable[float], angles: Iterable[float] = (0.0, 0.0, 0.0)) -> None:
    ET.SubElement(element, "origin", xyz=numbers(place), rpy=numbers(angles))


def roll_pitch_yaw(turn: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a rotation matrix, shape (3, 3), about the fixed axes x, y, z in turn."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = float(np.arctan2(-turn[2, 0], level))
    if level < _UPRIGHT:
        # Gimbal lock, x straight up or down: roll and yaw turn about the same line, so all of it goes into roll.
        return float(np.arctan2(-turn[1, 2], turn[1, 1])), pitch, 0.0
    return float(np.arctan2(turn[2, 1], turn[2, 2])), pitch, float(np.arctan2(turn[1, 0], turn[0, 0]))
