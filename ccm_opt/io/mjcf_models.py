"""Robot models of the arm and its obstacles in the format MJCF.

MuJoCo replaces a mesh by its convex hull for collisions, which would close every opening. A mesh is therefore a rigid
``flex``, which collides triangle by triangle, each triangle thickened by the radius of the flex.
"""

from collections.abc import Iterator
from itertools import groupby
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.robot_models import (
    FEED,
    FRAME_INERTIA,
    FRAME_MASS,
    URDF_MESHES,
    ModelShape,
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
from ccm_opt.io.scene_solids import SolidObstacle, SolidScene
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import RigidBody, in_link
from ccm_opt.scene.bodies import RigidPlacement

_COLOUR = "0.55 0.57 0.6 1"
_GLASS = "0.55 0.57 0.6 0.4"
"""Colour (red, green, blue, opacity) of obstacles in space, transparent since they would otherwise hide the arm."""
_LOCKED = 1e-6
"""Limit of the angle of a locked joint in MJCF [rad], which has no joints with an empty range. Heuristic: far below the
accuracy of drives."""
_CONTACT = {"contype": "2", "conaffinity": "1"}
"""Contact bits of obstacles: the arm has contype 1 and conaffinity 0, so it collides with obstacles but not itself."""


def mjcf_text(
    arm: Arm,
    name: str,
    gravity: FloatArray,
    scene: SolidScene | None = None,
    mesh_folder: str = URDF_MESHES,
    *,
    bends_only: bool = False,
) -> str:
    """Return the MJCF model of an arm, with a motor at every revolute joint, and its obstacles as text.

    Links collide with obstacles and with anything that a user adds to the model, but not with each other; the mount
    (first part of the arm, which may touch walls) is visual only. At zero angles the arm is straight along the base
    heading. A feed axis is the slide joint ``feed`` before all others, a payload a separate body.

    Args:
        arm: the arm.
        name: name of the model.
        gravity: gravitational acceleration in the world frame, shape (3,) [m/s²].
        scene: the obstacles as solids; None writes the arm alone.
        mesh_folder: folder of the mesh files of obstacles in space, relative to the MJCF file.
        bends_only: whether a ball joint has only the hinges that bend the arm, one for a planar arm and two in space,
            instead of three.
    """
    model = ET.Element("mujoco", model=name)
    ET.SubElement(model, "compiler", angle="radian", autolimits="true")
    ET.SubElement(model, "option", gravity=numbers(gravity), timestep="0.001", integrator="RK4")
    asset = ET.SubElement(model, "asset")
    parent = ET.SubElement(model, "worldbody")
    if scene is not None:
        for obstacle in scene.obstacles:
            _add_obstacle(asset, parent, obstacle, scene, mesh_folder)
    if not len(asset):
        model.remove(asset)
    actuators = ET.SubElement(model, "actuator")
    place, turn = arm.base_position, arm.base_rotation
    if arm.carrier:
        parent = _add_carriage(parent, actuators, arm)
        place, turn = np.zeros(3), np.eye(3)
    for ball, group in groupby(revolutes(arm, bends_only=bends_only), key=lambda revolute: revolute.ball):
        parent = ET.SubElement(parent, "body", name=f"link{ball:02d}", pos=numbers(place), quat=_quaternion(turn))
        for axis in (arm.feed,) if ball == 1 and arm.feed is not None else ():
            span = numbers((axis.low, axis.high))
            ET.SubElement(parent, "joint", name=FEED, type="slide", axis="1 0 0", range=span)
            ET.SubElement(actuators, "motor", name=f"{FEED}_motor", joint=FEED)
        for revolute in group:
            # MuJoCo takes an empty range as none, and a joint without a range as free.
            limit = max(revolute.limit, _LOCKED)
            span = numbers((-limit, limit))
            given = {"name": revolute.name, "type": "hinge", "axis": numbers(revolute.axis), "range": span}
            for key, value in (("armature", revolute.rotor_inertia), ("damping", revolute.friction)):
                given |= {key: number(value)} if value else {}
            ET.SubElement(parent, "joint", given)
            ET.SubElement(actuators, "motor", name=f"{revolute.name}_motor", joint=revolute.name)
        _add_body(parent, arm, ball - 1)
        place, turn = np.array([arm.lengths[ball - 1], 0.0, 0.0]), np.eye(3)
        _add_rigid_bodies(parent, arm, ball - 1)
    _add_tip(parent, arm, place)
    if arm.payload:
        payload = ET.SubElement(parent, "body", name="payload", pos=numbers(place))
        ET.SubElement(payload, "inertial", pos="0 0 0", mass=number(arm.payload), diaginertia="0 0 0")
    ET.indent(model)
    return ET.tostring(model, encoding="unicode") + "\n"


def _add_carriage(world: ET.Element, actuators: ET.Element, arm: Arm) -> ET.Element:
    """Add the body on which the axes that carry an arm act, and their motors, to an MJCF model; return the body."""
    place, turn = numbers(arm.base_position), _quaternion(arm.base_rotation)
    # MuJoCo takes up to six joints on a body, so the arm's first link has none of these.
    carriage = ET.SubElement(world, "body", name="carriage", pos=place, quat=turn)
    inertia = " ".join([number(FRAME_INERTIA)] * 3)
    ET.SubElement(carriage, "inertial", pos="0 0 0", mass=number(FRAME_MASS), diaginertia=inertia)
    for attributes in _carrier_joints(arm):
        ET.SubElement(carriage, "joint", attributes)
        ET.SubElement(actuators, "motor", name=f"{attributes['name']}_motor", joint=attributes["name"])
    return carriage


def _carrier_joints(arm: Arm) -> Iterator[dict[str, str]]:
    """Yield the attributes of the MJCF joint of each axis that carries the arm, in the frame of its base."""
    for name, axis in zip(arm.coordinates.base_names, arm.carrier, strict=True):
        into = arm.base_rotation.T
        attributes = {
            "name": name,
            "type": "hinge" if axis.revolute else "slide",
            "axis": numbers(into @ axis.direction),
            "pos": numbers(into @ (axis.point - arm.base_position) if axis.revolute else np.zeros(3)),
            "range": numbers((axis.low, axis.high)),
        }
        yield attributes | ({"armature": number(axis.inertia)} if axis.inertia else {})


def _add_tip(body: ET.Element, arm: Arm, place: FloatArray) -> None:
    """Add the site ``tip`` to the MJCF body of the last link, and the tool, if there is one, as a body of its own.

    Args:
        body: XML element of the last link.
        arm: the arm.
        place: end of the link, shape (3,) [m].
    """
    if arm.tool is None:
        ET.SubElement(body, "site", name="tip", pos=numbers(place))
        return
    tool = _add_rigid_body(body, arm.tool, "tool", place)
    turn = _quaternion(tool_rotation(arm.tool))
    ET.SubElement(tool, "site", name="tip", pos=numbers(in_link(arm.tool.tip)), quat=turn)


def _add_rigid_bodies(body: ET.Element, arm: Arm, k: int) -> None:
    """Add the bodies on link ``k`` (from 0), but for a tool, to the MJCF body of the link."""
    for name, rigid in named_bodies(arm):
        if rigid.link % arm.links == k:
            _add_rigid_body(body, rigid, name, np.array([arm.lengths[k], 0.0, 0.0]))


def _add_rigid_body(body: ET.Element, rigid: RigidBody, name: str, place: FloatArray) -> ET.Element:
    """Add a rigid body on a link to the MJCF body of that link, whose end is at a place, shape (3,); return it."""
    child = ET.SubElement(body, "body", name=name, pos=numbers(place))
    if rigid.mass:
        moments, axes = np.linalg.eigh(np.zeros((3, 3)) if rigid.inertia is None else rigid.inertia)
        moments = np.minimum(moments, [np.inf, np.inf, moments[0] + moments[1]])  # MuJoCo checks to the last bit
        axes[:, 0] *= np.linalg.det(axes)
        given = {"pos": numbers(rigid.centre_in_space), "quat": _quaternion(axes), "mass": number(rigid.mass)}
        ET.SubElement(child, "inertial", given, diaginertia=numbers(moments))
    else:
        small = {"mass": number(FRAME_MASS), "diaginertia": numbers([FRAME_INERTIA] * 3)}
        ET.SubElement(child, "inertial", small, pos="0 0 0")
    for shape in rigid_shapes(rigid):
        _add_geom(child, shape, contype="1", conaffinity="0", mass="0")
    return child


def _quaternion(turn: FloatArray) -> str:
    return numbers(RigidPlacement(rotation=turn).quaternion)


def _add_geom(body: ET.Element, shape: ModelShape, **attributes: str) -> None:
    # MuJoCo takes half sides and half lengths, but full radii.
    size = [0.5 * side for side in shape.size]
    if shape.kind in {"sphere", "cylinder", "capsule"}:
        size[0] = shape.size[0]
    where = {"pos": numbers(shape.place), "quat": _quaternion(shape.turn)}
    given = {"type": shape.kind, **where, **({"size": numbers(size)} if size else {})}
    ET.SubElement(body, "geom", given, **attributes)


def _add_obstacle(
    asset: ET.Element, worldbody: ET.Element, obstacle: SolidObstacle, scene: SolidScene, folder: str
) -> None:
    """Add a static obstacle to an MJCF model, which collides with the arm but with no other obstacle.

    Args:
        asset: XML element that receives the meshes of extruded obstacles.
        worldbody: XML element that receives a geom for every solid, named after the obstacle, with ``/2``, ``/3``, …
            appended from the second solid on.
        obstacle: the obstacle.
        scene: all obstacles as solids.
        folder: folder of the mesh files of obstacles in space, relative to the MJCF file.
    """
    for k, solid in enumerate(obstacle.solids):
        name = obstacle.name if k == 0 else f"{obstacle.name}/{k + 1}"
        if solid.kind == "mesh" and not scene.extruded:
            # A flex must have a radius, and a mass, which does not matter for a static one.
            radius = number(max(solid.rounding, 0.5 * scene.thinnest))
            given = {"name": name, "type": "mesh", "dim": "2", "rigid": "true", "mass": "1", "radius": radius}
            flex = ET.SubElement(
                worldbody, "flexcomp", given, file=f"{folder}/{mesh_file(scene, obstacle, k)}", rgba=_GLASS
            )
            ET.SubElement(flex, "contact", _CONTACT, selfcollide="none")
            continue
        colour = _COLOUR if scene.extruded else _GLASS
        if solid.kind == "mesh":
            vertices = numbers(solid.vertices.reshape(-1))
            # As a shell a mesh may be arbitrarily thin; its inertia does not matter, since it is static.
            ET.SubElement(asset, "mesh", name=name, vertex=vertices, inertia="shell")
            ET.SubElement(worldbody, "geom", _CONTACT, name=name, rgba=colour, type="mesh", mesh=name)
        else:
            _add_geom(worldbody, body_shape(solid), name=name, rgba=colour, **_CONTACT)


def _add_body(body: ET.Element, arm: Arm, k: int) -> None:
    """Add the mass and geometry of link ``k`` (from 0) to an MJCF body; the part inside the mount is visual only."""
    across = arm.inertia_transverse[k]
    inertia = numbers((arm.inertia_axial[k], across, across))
    length = float(arm.lengths[k])
    centre = numbers((0.5 * length, 0.0, 0.0))
    ET.SubElement(body, "inertial", pos=centre, mass=number(arm.masses[k]), diaginertia=inertia)
    begin = float(arm.free_shares[k]) * length
    if begin > 0.0:
        _add_geom(body, link_capsule(arm, k, 0.0), contype="0", conaffinity="0")
    if begin < length:
        _add_geom(body, link_capsule(arm, k, begin), contype="1", conaffinity="0")
