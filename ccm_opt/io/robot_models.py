"""Robot models of the arm and its obstacles for other programs, in the formats URDF and MJCF.

MuJoCo replaces a mesh by its convex hull for collisions, which would close every opening. In MJCF a mesh is therefore
a rigid ``flex``, which collides triangle by triangle, each triangle thickened by the radius of the flex.
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.scene_solids import SolidObstacle, SolidScene
from ccm_opt.problem import Limits
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.frames import joint_names
from ccm_opt.robot.tool import RigidBody, Tool, in_link
from ccm_opt.scene.bodies import Body, CapsuleBody, RigidPlacement, rotation_to_axis

FEED = "feed"
"""Name of the prismatic joint of the feed axis, which precedes all other joints of an arm on a feed axis."""
Axis = tuple[float, float, float]
_UPRIGHT = 1e-12
"""Norm of the horizontal component of a unit vector up to which the vector counts as vertical."""
_X = (1.0, 0.0, 0.0)
_Y = (0.0, 1.0, 0.0)
_Z = (0.0, 0.0, 1.0)
REVOLUTE_AXES: dict[Axes, tuple[Axis, Axis, Axis]] = {"zyx": (_Z, _Y, _X), "zyz": (_Z, _Y, _Z)}


@dataclass(frozen=True)
class Revolute:
    """One of the three revolute joints that make up a ball joint of the arm.

    Attributes:
        name: name, as in ``joint_names``.
        index: index among all revolutes of the arm, from 0.
        ball: number of the ball joint, from 1.
        axis: axis of rotation, a unit vector in the joint's frame, x along the link, shape (3,).
        limit: limit of the absolute angle [rad]: the joint limit for a revolute that bends the arm, else half a turn.
        starts_ball: whether the revolute is the first one written of its ball joint.
        carries_link: whether the revolute is the last one written of its ball joint, which carries the link.
        rotor_inertia: rotor inertia of the drive, reflected to the joint [kg m²].
        friction: viscous friction [N m s/rad].
    """

    name: str
    index: int
    ball: int
    axis: Axis
    limit: float
    starts_ball: bool
    carries_link: bool
    rotor_inertia: float
    friction: float


def revolutes(arm: Arm, *, bends_only: bool = False) -> Iterator[Revolute]:
    """Yield the revolute joints of an arm from the base outward.

    Args:
        arm: the arm.
        bends_only: whether to yield only the revolutes that bend the arm: one per ball joint of a planar arm, which
            then stays in its plane, and two in space, so that links do not roll.
    """
    axes = REVOLUTE_AXES[arm.axes]
    coordinates = arm.coordinates
    bends = dict(zip(coordinates.drives[: coordinates.joints], arm.bend_limits, strict=True))
    first = coordinates.drives[0]
    last = coordinates.drives[coordinates.joints - 1] % 3
    rotors = np.broadcast_to(arm.rotor_inertia, (3 * arm.links,))
    friction = np.broadcast_to(arm.friction, (3 * arm.links,))
    for index, name in enumerate(joint_names(arm)):
        ball, place = divmod(index, 3)
        if bends_only and index not in bends:
            continue
        yield Revolute(
            name=name,
            index=index,
            ball=ball + 1,
            axis=axes[place],
            limit=float(bends.get(index, np.pi)),
            starts_ball=place == (first if bends_only else 0),
            carries_link=place == (last if bends_only else 2),
            rotor_inertia=float(rotors[index]),
            friction=float(friction[index]),
        )


def visual_radius(arm: Arm, k: int) -> float:
    """Return the radius with which link ``k`` (from 0) is displayed [m]: its own, or a small one if that is 0."""
    return float(arm.radii[k]) or 0.02 * arm.link_length


def checked_share(arm: Arm, k: int) -> float:
    """Return the fraction of link ``k`` (from 0) inside the mount, whose contacts with obstacles are not checked."""
    return float(arm.free_shares[k])


def roll_pitch_yaw(turn: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a rotation matrix, shape (3, 3), about the fixed axes x, y, z in turn."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = float(np.arctan2(-turn[2, 0], level))
    if level < _UPRIGHT:
        # Gimbal lock, x straight up or down: roll and yaw turn about the same line, so all of it goes into roll.
        return float(np.arctan2(-turn[1, 2], turn[1, 1])), pitch, 0.0
    return float(np.arctan2(turn[2, 1], turn[2, 2])), pitch, float(np.arctan2(turn[1, 0], turn[0, 0]))


def number(value: float) -> str:
    """Return the text of a number with as many digits as are needed to read the number back exactly."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Return the exact texts of several numbers, separated by blanks."""
    return " ".join(number(value) for value in values)


MESHES = ".meshes"
"""Suffix that, appended to the name of a URDF file, gives the name of the folder of its mesh files."""
URDF_MESHES = f"arm.urdf{MESHES}"
"""Name of the folder of the URDF's mesh files in an output folder."""
_Z_ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation that takes the z axis to the x axis."""


@dataclass(frozen=True)
class _Shape:
    """The geometry of a link or an obstacle in a robot model.

    Attributes:
        kind: "box", "sphere", "cylinder", "capsule" or "mesh"; the axis of round shapes is z.
        size: sides of a box; radius, and length along the axis without caps, of a round shape [m]; empty for a mesh.
        place: position of the centre in the frame of the link or the world, shape (3,) [m].
        turn: rotation from the shape's axes to that frame, shape (3, 3).
    """

    kind: str
    size: tuple[float, ...]
    place: FloatArray
    turn: FloatArray


def _geometry_element(body: Body) -> _Shape:
    if body.kind == "mesh":
        return _Shape("mesh", (), np.zeros(3), np.eye(3))
    if body.kind == "box":
        place = body.placement.points(0.5 * (body.low + body.high))
        return _Shape("box", tuple(body.high - body.low), place, body.placement.rotation)
    if body.kind == "sphere":
        return _Shape("sphere", (body.radius,), body.center, np.eye(3))
    axis = body.end - body.start
    size = (body.radius, float(np.linalg.norm(axis)))
    return _Shape(body.kind, size, 0.5 * (body.start + body.end), np.roll(rotation_to_axis(axis), -1, axis=1))


def _capsule(arm: Arm, k: int, begin: float) -> _Shape:
    """Return link ``k`` (from 0), from ``begin`` [m] beyond its joint to its end, as a capsule in the link's frame."""
    length = float(arm.lengths[k])
    size = (visual_radius(arm, k), length - begin)
    return _Shape("capsule", size, np.array([0.5 * (begin + length), 0.0, 0.0]), _Z_ALONG_X)


def named_bodies(arm: Arm) -> list[tuple[str, RigidBody]]:
    """Return the bodies on links of an arm but its tool, with the name of each in models for other programs."""
    return [(f"body{number:02d}", body) for number, body in enumerate(arm.bodies, start=1)]


def _rigid_shapes(rigid: RigidBody) -> list[_Shape]:
    """Return the capsules of a rigid body as capsules, or spheres, in its frame."""
    shapes = []
    for body in rigid.bodies:
        start, end = in_link(body.start), in_link(body.end)
        if np.array_equal(start, end):
            shapes.append(_Shape("sphere", (body.radius,), start, np.eye(3)))
        else:
            shapes.append(_geometry_element(CapsuleBody(start, end, body.radius)))
    return shapes


def _pointing(tool: Tool) -> FloatArray:
    """Return a rotation whose x axis is the direction of a tool, shape (3, 3)."""
    return rotation_to_axis(in_link(tool.direction))


def scene_meshes(scene: SolidScene, folder: str) -> dict[str, bytes]:
    """Return the mesh files of all obstacles as binary STL, in metres and world coordinates, by path.

    Args:
        scene: the obstacles as solids.
        folder: folder of the files.
    """
    return {
        f"{folder}/{mesh_file(scene, obstacle, k)}": triangles_stl(solid.triangles)
        for obstacle in scene.obstacles
        for k, solid in enumerate(obstacle.solids)
        if solid.kind == "mesh"
    }


def mesh_file(scene: SolidScene, obstacle: SolidObstacle, k: int) -> str:
    """Return the name of the mesh file of one solid of an obstacle; unused if the solid is not a mesh.

    Args:
        scene: the obstacles as solids.
        obstacle: the obstacle.
        k: index of the solid within the obstacle.
    """
    return f"{obstacle.slug}-{k + 1}.stl" if scene.extruded else f"{obstacle.slug}.stl"


def triangles_stl(corners: FloatArray) -> bytes:
    """Return m triangles, given by their corners, shape (m, 3, 3) [m], as the bytes of a binary STL file."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    rows = np.zeros(len(corners), dtype=[("numbers", "<f4", (4, 3)), ("attributes", "<u2")])
    rows["numbers"][:, 0] = normals
    rows["numbers"][:, 1:] = corners
    return b"ccm_opt".ljust(80) + struct.pack("<I", len(corners)) + rows.tobytes()


def _add_urdf_shapes(link: ET.Element, purpose: str, shape: _Shape, mesh: str = "") -> None:
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


UNLIMITED_EFFORT = 1e6
"""Effort limit written for unlimited joints, which URDF cannot express [N m] or [N]."""
UNLIMITED_VELOCITY = 1e3
"""Velocity limit written for an unlimited feed axis, which URDF cannot express [m/s]."""
FRAME_MASS = 2e-15
"""Mass given to moving frames that have no mass of their own [kg].

Derived: twice the minimum that MuJoCo loads; Gazebo requires a mass too. Torques change by less than their twelfth
digit.
"""
FRAME_INERTIA = 2e-14
"""Moment of inertia given to moving frames that have none of their own, about every axis [kg m²]."""


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
        parent, tip, angles = "tool", tuple(in_link(arm.tool.tip)), roll_pitch_yaw(_pointing(arm.tool))
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
                _add_urdf_shapes(link, purpose, _geometry_element(solid), f"{folder}/{mesh_file(scene, obstacle, k)}")
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
    for number, (name, axis) in enumerate(zip(arm.coordinates.base_names, arm.carrier, strict=True)):
        drive = arm.coordinates.revolutes + number
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
    _add_urdf_shapes(link, "visual", _capsule(arm, k, 0.0))
    begin = checked_share(arm, k) * length
    if begin < length:
        _add_urdf_shapes(link, "collision", _capsule(arm, k, begin))


def _add_rigid_link(robot: ET.Element, rigid: RigidBody, name: str) -> None:
    """Add a link for a rigid body to a URDF model, with its frame at the end of the link that carries it."""
    link = ET.SubElement(robot, "link", name=name)
    if rigid.mass:
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, rigid.centre_in_space)
        ET.SubElement(inertial, "mass", value=number(rigid.mass))
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), rigid.moments, strict=True)
        ET.SubElement(inertial, "inertia", {name: number(value) for name, value in moments})
    for shape in _rigid_shapes(rigid):
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
    turn = _quaternion(_pointing(arm.tool))
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
    for shape in _rigid_shapes(rigid):
        _add_geom(child, shape, contype="1", conaffinity="0", mass="0")
    return child


def _quaternion(turn: FloatArray) -> str:
    return numbers(RigidPlacement(rotation=turn).quaternion)


def _add_geom(body: ET.Element, shape: _Shape, **attributes: str) -> None:
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
            _add_geom(worldbody, _geometry_element(solid), name=name, rgba=colour, **_CONTACT)


def _add_body(body: ET.Element, arm: Arm, k: int) -> None:
    """Add the mass and geometry of link ``k`` (from 0) to an MJCF body; the part inside the mount is visual only."""
    across = arm.inertia_transverse[k]
    inertia = numbers((arm.inertia_axial[k], across, across))
    length = float(arm.lengths[k])
    centre = numbers((0.5 * length, 0.0, 0.0))
    ET.SubElement(body, "inertial", pos=centre, mass=number(arm.masses[k]), diaginertia=inertia)
    begin = checked_share(arm, k) * length
    if begin > 0.0:
        _add_geom(body, _capsule(arm, k, 0.0), contype="0", conaffinity="0")
    if begin < length:
        _add_geom(body, _capsule(arm, k, begin), contype="1", conaffinity="0")
