"""Models of the arm and its scene for other programs: URDF and MJCF.

MuJoCo meets a mesh as its convex hull, through which no arm would go. So a mesh is a ``flex`` of triangles whose
corners do not move; it is met triangle by triangle, grown by the flex's radius.
"""

import struct
from collections.abc import Iterable
from itertools import groupby
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.arm_description import (
    FEED,
    Revolute,
    checked_share,
    number,
    numbers,
    revolutes,
    roll_pitch_yaw,
    visual_radius,
)
from ccm_opt.io.scene_solids import Drum, Prism, SolidObstacle, SolidScene, prism_mesh
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, RigidPlacement, SphereBody
from ccm_opt.scene.surfaces import turned_to

MESHES = ".meshes"
"""Added to the name of a URDF file for that of the folder of its meshes."""
URDF_MESHES = f"arm.urdf{MESHES}"
"""That folder in an output folder."""


def add_obstacles(robot: ET.Element, scene: SolidScene, folder: str) -> None:
    """Add a link for every obstacle, fixed to the link ``world``.

    Args:
        robot: the element ``robot``.
        scene: the obstacles.
        folder: of the meshes, relative to the URDF.
    """
    for obstacle in scene.obstacles:
        name = f"obstacle_{obstacle.slug}"
        link = ET.SubElement(robot, "link", name=name)
        for purpose in ("visual", "collision"):
            for k, solid in enumerate(obstacle.solids):
                mesh = f"{folder}/{mesh_file(obstacle, k)}"
                if isinstance(solid, (Drum, Prism)):
                    _add_extruded(ET.SubElement(link, purpose), solid, scene.half_depth, mesh)
                else:
                    _add_body(link, purpose, solid, mesh)
        joint = ET.SubElement(robot, "joint", name=f"{name}_mount", type="fixed")
        ET.SubElement(joint, "parent", link="world")
        ET.SubElement(joint, "child", link=name)


def scene_meshes(scene: SolidScene, folder: str) -> dict[str, bytes]:
    """The mesh files of a scene, in binary STL, metres, the world frame.

    Args:
        scene: the obstacles.
        folder: in front of their names.
    """
    found = {}
    for obstacle in scene.obstacles:
        for k, solid in enumerate(obstacle.solids):
            name = f"{folder}/{mesh_file(obstacle, k)}"
            if isinstance(solid, MeshBody):
                found[name] = triangles_stl(solid.triangles)
            elif isinstance(solid, Prism) and solid.as_box() is None:
                found[name] = stl(solid, scene.half_depth)
    return found


def mesh_file(obstacle: SolidObstacle, k: int) -> str:
    """Name of the file of a solid's mesh; of no matter where it has none."""
    extruded = isinstance(obstacle.solids[k], (Prism, Drum))
    return f"{obstacle.slug}-{k + 1}.stl" if extruded else f"{obstacle.slug}.stl"


def stl(prism: Prism, half_depth: float) -> bytes:
    """The surface of a prism in binary STL."""
    vertices, faces = prism_mesh(prism, half_depth)
    return triangles_stl(vertices[faces])


def triangles_stl(corners: FloatArray) -> bytes:
    """Triangles, shape (m, 3, 3) [m], in binary STL."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    rows = np.zeros(len(corners), dtype=[("numbers", "<f4", (4, 3)), ("attributes", "<u2")])
    rows["numbers"][:, 0] = normals
    rows["numbers"][:, 1:] = corners
    return b"ccm_opt".ljust(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def _add_extruded(purpose: ET.Element, solid: Drum | Prism, half_depth: float, mesh: str) -> None:
    """A solid of the plane: a cylinder, a box, or a mesh."""
    if isinstance(solid, Drum):
        x, z = solid.center
        # Cylinders stand along their z; a quarter turn about x lays it along world y.
        ET.SubElement(purpose, "origin", xyz=numbers((x, 0.0, z)), rpy=numbers((0.5 * np.pi, 0.0, 0.0)))
        shape = ET.SubElement(purpose, "geometry")
        ET.SubElement(shape, "cylinder", radius=number(solid.radius), length=number(2.0 * half_depth))
        return
    box = solid.as_box()
    if box is None:
        ET.SubElement(ET.SubElement(purpose, "geometry"), "mesh", filename=mesh)
        return
    center, heading, length, width = box
    ET.SubElement(purpose, "origin", xyz=numbers((center[0], 0.0, center[1])), rpy=numbers((0.0, -heading, 0.0)))
    ET.SubElement(ET.SubElement(purpose, "geometry"), "box", size=numbers((length, 2.0 * half_depth, width)))


def _add_body(link: ET.Element, purpose: str, body: Body, mesh: str) -> None:
    """A body of space."""
    upright = roll_pitch_yaw(np.eye(3))
    if isinstance(body, BoxBody):
        place = body.placement.points(0.5 * (body.low + body.high))
        shape = _add_shape(link, purpose, place, roll_pitch_yaw(body.placement.rotation))
        ET.SubElement(shape, "box", size=numbers(body.high - body.low))
    elif isinstance(body, SphereBody):
        ET.SubElement(_add_shape(link, purpose, body.center, upright), "sphere", radius=number(body.radius))
    elif isinstance(body, (CylinderBody, CapsuleBody)):
        _add_bar(link, purpose, body)
    else:
        ET.SubElement(_add_shape(link, purpose, np.zeros(3), upright), "mesh", filename=mesh)


def _add_bar(link: ET.Element, purpose: str, body: CylinderBody | CapsuleBody) -> None:
    """A cylinder along z, turned to its axis; URDF has no capsules, which get a ball at either end."""
    axis = body.end - body.start
    # Cylinders stand along their z: the columns of the rotation that turns x to the axis, moved on by one.
    turn = roll_pitch_yaw(np.roll(turned_to(axis), -1, axis=1))
    shape = _add_shape(link, purpose, 0.5 * (body.start + body.end), turn)
    ET.SubElement(shape, "cylinder", radius=number(body.radius), length=number(float(np.linalg.norm(axis))))
    for end in (body.start, body.end) if isinstance(body, CapsuleBody) else ():
        ET.SubElement(_add_shape(link, purpose, end, turn), "sphere", radius=number(body.radius))


UNLIMITED_EFFORT = 1e6
"""Written where there is no limit, since URDF has no way to say so [N m] or [N]."""
UNLIMITED_VELOCITY = 1e3
"""Likewise [m/s]."""
FRAME_MASS = 2e-15
"""Of frames that move and carry nothing themselves [kg].

Derived: twice the least that MuJoCo loads; Gazebo wants some, too. Torques change by less than their twelve digits.
"""
FRAME_INERTIA = 2e-14
"""Likewise, about every axis [kg m²]."""


def urdf_text(
    arm: Arm,
    name: str,
    limits: Limits,
    scene: SolidScene | None = None,
    mesh_folder: str = URDF_MESHES,
    *,
    bends_only: bool = False,
) -> str:
    """URDF of the arm, and of the obstacles around it.

    The root link ``world`` is the world frame; base position and heading stand in the fixed joint ``base_mount``. All
    joint frames are parallel at zero angles, the straight arm along the base heading. A feed axis is the prismatic
    joint ``feed`` before all others, a payload a link of its own, and the tip a link without mass, ``tip``. Obstacles
    are links that are fixed to the world. Of the mount, which may touch walls, there is only the look. URDF has no
    place for rotor inertia. Frames between joints have the least mass and inertia that MuJoCo and Gazebo load.

    Args:
        arm: the arm.
        name: of the robot.
        limits: bounds on the revolutes; without torque limits an effort of 1e6 N m is written.
        scene: the obstacles; None writes the arm alone.
        mesh_folder: of the meshes of obstacles, relative to the file.
        bends_only: whether a link has one revolute, which bends in the plane, or the two that bend it in space, in
            place of three.
    """
    robot = arm_urdf(arm, name, limits, bends_only=bends_only)
    if scene is not None:
        add_obstacles(robot, scene, mesh_folder)
    return urdf_of(robot)


def arm_urdf(arm: Arm, name: str, limits: Limits, *, bends_only: bool = False) -> ET.Element:
    """The element ``robot`` of an arm alone; arguments as for ``urdf_text``."""
    robot = ET.Element("robot", name=name)
    ET.SubElement(robot, "link", name="world")
    parent = _add_mount(robot, arm, limits)
    for revolute in revolutes(arm, bends_only=bends_only):
        child = f"link{revolute.ball:02d}" if revolute.carries_link else f"{revolute.name}_frame"
        _add_link(robot, arm, child, revolute)
        _add_joint(robot, arm, parent, child, revolute, limits)
        parent = child
    if arm.payload:
        _add_payload(robot, arm, parent)
    ET.SubElement(robot, "link", name="tip")
    _place(ET.SubElement(robot, "joint", name="tip_mount", type="fixed"), parent, "tip", (arm.link_length, 0.0, 0.0))
    return robot


def urdf_of(robot: ET.Element) -> str:
    """The text of the file of an element ``robot``."""
    if robot.find(".//mesh") is not None:
        # MuJoCo 3 takes the last part of a name alone if not told so; others pass over what they do not know.
        ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", strippath="false")
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_mount(robot: ET.Element, arm: Arm, limits: Limits) -> str:
    """What is between the world and the first ball; returns the link that carries it."""
    names = (*("mount" for _ in arm.base_axes), "base")
    ET.SubElement(robot, "link", name=names[0])
    mount = ET.SubElement(robot, "joint", name="base_mount", type="fixed")
    _place(mount, "world", names[0], arm.base_position, _base_angles(arm))
    for axis, carrier, carried in zip(arm.base_axes, names[:-1], names[1:], strict=True):
        _add_inertia(ET.SubElement(robot, "link", name=carried), 0.0, FRAME_MASS, FRAME_INERTIA, FRAME_INERTIA)
        slide = ET.SubElement(robot, "joint", name=FEED, type="prismatic")
        _place(slide, carrier, carried, (0.0, 0.0, 0.0))
        ET.SubElement(slide, "axis", xyz=numbers((1.0, 0.0, 0.0)))
        effort = UNLIMITED_EFFORT if limits.feed_force is None else limits.feed_force
        _add_limit(slide, (axis.low, axis.high), limits.feed_velocity or UNLIMITED_VELOCITY, effort)
    return "base"


def _base_angles(arm: Arm) -> tuple[float, float, float]:
    """How the base is turned in the world: about its x, then the world's y, then the world's z [rad]."""
    if arm.dimension == 2:
        return 0.0, -arm.base_heading, 0.0
    return roll_pitch_yaw(arm.base_rotation)


def _add_payload(robot: ET.Element, arm: Arm, last: str) -> None:
    """A point mass at the tip."""
    _add_inertia(ET.SubElement(robot, "link", name="payload"), 0.0, arm.payload, FRAME_INERTIA, FRAME_INERTIA)
    joint = ET.SubElement(robot, "joint", name="payload_mount", type="fixed")
    _place(joint, last, "payload", (arm.link_length, 0.0, 0.0))


def _place(
    joint: ET.Element, parent: str, child: str, position: Iterable[float], rotation: Iterable[float] = (0.0, 0.0, 0.0)
) -> None:
    ET.SubElement(joint, "origin", xyz=numbers(position), rpy=numbers(rotation))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


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
    _add_inertia(link, 0.5 * arm.link_length, arm.masses[k], arm.inertia_axial[k], arm.inertia_transverse[k])
    _add_capsule(link, arm, "visual", 0.0)
    begin = checked_share(arm, k) * arm.link_length
    if begin < arm.link_length:
        _add_capsule(link, arm, "collision", begin)


def _add_inertia(link: ET.Element, centre: float, mass: float, axial: float, across: float) -> None:
    """Mass and inertia of a body of revolution about x, its centre at this x."""
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers((centre, 0.0, 0.0)), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(mass))
    sides = {"iyy": number(across), "izz": number(across), "ixy": "0", "ixz": "0", "iyz": "0"}
    ET.SubElement(inertial, "inertia", {"ixx": number(axial), **sides})


def _add_capsule(link: ET.Element, arm: Arm, purpose: str, begin: float) -> None:
    """A cylinder along the link, from ``begin`` to its end, and a sphere at either end."""
    radius = number(visual_radius(arm))
    shape = _add_shape(link, purpose, (0.5 * (begin + arm.link_length), 0.0, 0.0))
    ET.SubElement(shape, "cylinder", radius=radius, length=number(arm.link_length - begin))
    for x in (begin, arm.link_length):
        ET.SubElement(_add_shape(link, purpose, (x, 0.0, 0.0)), "sphere", radius=radius)


def _add_shape(
    link: ET.Element, purpose: str, centre: Iterable[float], angles: Iterable[float] = (0.0, 0.5 * np.pi, 0.0)
) -> ET.Element:
    """What a link looks like or is met as, and where; turned so that z is along the link unless it is said."""
    body = ET.SubElement(link, purpose)
    ET.SubElement(body, "origin", xyz=numbers(centre), rpy=numbers(angles))
    return ET.SubElement(body, "geometry")


def _add_joint(robot: ET.Element, arm: Arm, parent: str, child: str, revolute: Revolute, limits: Limits) -> None:
    joint = ET.SubElement(robot, "joint", name=revolute.name, type="revolute")
    shift = arm.link_length if revolute.starts_ball and revolute.ball > 1 else 0.0
    _place(joint, parent, child, (shift, 0.0, 0.0))
    ET.SubElement(joint, "axis", xyz=numbers(revolute.axis))
    effort = UNLIMITED_EFFORT if limits.torque is None else float(limits.torque[revolute.index])
    _add_limit(joint, (-revolute.limit, revolute.limit), float(limits.velocity[revolute.index]), effort)
    if revolute.friction:
        ET.SubElement(joint, "dynamics", damping=number(revolute.friction))


_COLOUR = "0.55 0.57 0.6 1"
_GLASS = "0.55 0.57 0.6 0.4"
"""Of bodies in space, which would hide the arm."""
_CONTACT = {"contype": "2", "conaffinity": "1"}
"""What the arm is made of has the bit 1 in contype alone."""


def add_scene(model: ET.Element, worldbody: ET.Element, scene: SolidScene, folder: str) -> None:
    """Add the obstacles of a scene, which stand still and touch the arm but not each other.

    Args:
        model: the element ``mujoco``; meshes of solids of the plane go into an element ``asset`` of it.
        worldbody: receives a geom for every solid, named by its obstacle; further ones have ``/2`` and so on behind.
        scene: the obstacles.
        folder: of the meshes of space, as ``scene_meshes`` writes them, relative to the MJCF.
    """
    asset = ET.Element("asset")
    for obstacle in scene.obstacles:
        for k, solid in enumerate(obstacle.solids):
            name = obstacle.name if k == 0 else f"{obstacle.name}/{k + 1}"
            if isinstance(solid, MeshBody):
                _add_mesh(
                    worldbody, name, max(solid.rounding, 0.5 * scene.thinnest), f"{folder}/{mesh_file(obstacle, k)}"
                )
            elif isinstance(solid, (Drum, Prism)):
                worldbody.append(_extruded_geom(solid, scene.half_depth, name, asset))
            else:
                worldbody.append(_body_geom(solid, name))
    if len(asset):
        model.insert(list(model).index(worldbody), asset)


def _extruded_geom(solid: Drum | Prism, half_depth: float, name: str, asset: ET.Element) -> ET.Element:
    geom = ET.Element("geom", {"name": name, **_CONTACT, "rgba": _COLOUR})
    if isinstance(solid, Drum):
        x, z = solid.center
        geom.set("type", "cylinder")
        geom.set("fromto", numbers((x, -half_depth, z, x, half_depth, z)))
        geom.set("size", number(solid.radius))
        return geom
    box = solid.as_box()
    if box is None:
        geom.set("type", "mesh")
        geom.set("mesh", name)
        vertices = numbers(prism_mesh(solid, half_depth)[0].reshape(-1))
        # Any solid may be this thin, and nothing here has a mass.
        ET.SubElement(asset, "mesh", name=name, vertex=vertices, inertia="shell")
        return geom
    center, heading, length, width = box
    geom.set("type", "box")
    geom.set("pos", numbers((center[0], 0.0, center[1])))
    geom.set("quat", numbers((np.cos(0.5 * heading), 0.0, -np.sin(0.5 * heading), 0.0)))
    geom.set("size", numbers((0.5 * length, half_depth, 0.5 * width)))
    return geom


def _body_geom(body: BoxBody | SphereBody | CylinderBody | CapsuleBody, name: str) -> ET.Element:
    geom = ET.Element("geom", _CONTACT, name=name, rgba=_GLASS)
    if isinstance(body, BoxBody):
        geom.set("type", "box")
        geom.set("pos", numbers(body.placement.points(0.5 * (body.low + body.high))))
        geom.set("quat", numbers(RigidPlacement(rotation=body.placement.rotation).quaternion))
        geom.set("size", numbers(0.5 * (body.high - body.low)))
    elif isinstance(body, SphereBody):
        geom.set("type", "sphere")
        geom.set("pos", numbers(body.center))
        geom.set("size", number(body.radius))
    else:
        geom.set("type", "capsule" if isinstance(body, CapsuleBody) else "cylinder")
        geom.set("fromto", numbers(np.concatenate((body.start, body.end))))
        geom.set("size", number(body.radius))
    return geom


def _add_mesh(worldbody: ET.Element, name: str, radius: float, file: str) -> None:
    """A mesh as triangles that do not move; a flex needs some radius, and a mass that then is of no matter."""
    flex = ET.SubElement(worldbody, "flexcomp", name=name, type="mesh", dim="2", rigid="true", mass="1")
    flex.set("file", file)
    flex.set("radius", number(radius))
    flex.set("rgba", _GLASS)
    ET.SubElement(flex, "contact", _CONTACT, selfcollide="none")


def mjcf_text(
    arm: Arm,
    name: str,
    gravity: FloatArray,
    scene: SolidScene | None = None,
    mesh_folder: str = URDF_MESHES,
    *,
    bends_only: bool = False,
) -> str:
    """MJCF of the arm, with a motor at every revolute, and of the obstacles around it.

    Links collide with obstacles and whatever else a scene adds, not with each other; of the mount, which may touch
    walls, there is only the look. Zero angles are the straight arm along the base
    heading. A feed axis is the slide joint ``feed`` before all others, a payload a body of its own.

    Args:
        arm: the arm.
        name: of the model.
        gravity: in the world, shape (3,) [m/s²].
        scene: the obstacles; None writes the arm alone.
        mesh_folder: of the meshes of obstacles in space, relative to the file.
        bends_only: whether a link has one hinge, which bends in the plane, or the two that bend it in space, in place
            of three.
    """
    model = ET.Element("mujoco", model=name)
    ET.SubElement(model, "compiler", angle="radian", autolimits="true")
    ET.SubElement(model, "option", gravity=numbers(gravity), timestep="0.001", integrator="RK4")
    parent = ET.SubElement(model, "worldbody")
    if scene is not None:
        add_scene(model, parent, scene, mesh_folder)
    actuators = ET.SubElement(model, "actuator")
    for ball, group in groupby(revolutes(arm, bends_only=bends_only), key=lambda revolute: revolute.ball):
        parent = _mjcf_add_body(parent, arm, ball)
        for axis in arm.base_axes if ball == 1 else ():
            span = numbers((axis.low, axis.high))
            ET.SubElement(parent, "joint", name=FEED, type="slide", axis="1 0 0", range=span)
            ET.SubElement(actuators, "motor", name=f"{FEED}_motor", joint=FEED)
        for revolute in group:
            _add_hinge(parent, revolute)
            ET.SubElement(actuators, "motor", name=f"{revolute.name}_motor", joint=revolute.name)
        _mjcf_add_link(parent, arm, ball - 1)
    tip = numbers((arm.link_length, 0.0, 0.0))
    ET.SubElement(parent, "site", name="tip", pos=tip)
    if arm.payload:
        payload = ET.SubElement(parent, "body", name="payload", pos=tip)
        ET.SubElement(payload, "inertial", pos="0 0 0", mass=number(arm.payload), diaginertia="0 0 0")
    ET.indent(model)
    return ET.tostring(model, encoding="unicode") + "\n"


def _add_hinge(body: ET.Element, revolute: Revolute) -> None:
    span = numbers((-revolute.limit, revolute.limit))
    hinge = ET.SubElement(body, "joint", name=revolute.name, type="hinge", axis=numbers(revolute.axis), range=span)
    if revolute.rotor_inertia:
        hinge.set("armature", number(revolute.rotor_inertia))
    if revolute.friction:
        hinge.set("damping", number(revolute.friction))


def _mjcf_add_body(parent: ET.Element, arm: Arm, ball: int) -> ET.Element:
    """The body of a link, at the tip of the one before; the first stands at the base, turned by the base heading."""
    body = ET.SubElement(parent, "body", name=f"link{ball:02d}")
    if ball > 1:
        body.set("pos", numbers((arm.link_length, 0.0, 0.0)))
        return body
    body.set("pos", numbers(arm.base_position))
    if arm.dimension == 3:
        body.set("quat", numbers(RigidPlacement(rotation=arm.base_rotation).quaternion))
        return body
    half = -0.5 * arm.base_heading  # about world +y, which turns x towards -z
    body.set("quat", numbers((np.cos(half), 0.0, np.sin(half), 0.0)))
    return body


def _mjcf_add_link(body: ET.Element, arm: Arm, k: int) -> None:
    across = arm.inertia_transverse[k]
    ET.SubElement(
        body,
        "inertial",
        pos=numbers((0.5 * arm.link_length, 0.0, 0.0)),
        mass=number(arm.masses[k]),
        diaginertia=numbers((arm.inertia_axial[k], across, across)),
    )
    begin = checked_share(arm, k) * arm.link_length
    if begin > 0.0:  # seen and not felt
        _mjcf_add_capsule(body, arm, (0.0, arm.link_length), "0")
    if begin < arm.link_length:
        _mjcf_add_capsule(body, arm, (begin, arm.link_length), "1")


def _mjcf_add_capsule(body: ET.Element, arm: Arm, span: tuple[float, float], contype: str) -> None:
    ends = numbers((span[0], 0.0, 0.0, span[1], 0.0, 0.0))
    size = number(visual_radius(arm))
    ET.SubElement(body, "geom", type="capsule", fromto=ends, size=size, contype=contype, conaffinity="0")
