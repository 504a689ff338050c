"""Parts of robot models of the arm and its obstacles for other programs, common to the formats URDF and MJCF."""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.scene_solids import SolidObstacle, SolidScene
from ccm_opt.robot.arm import Arm, Axes
from ccm_opt.robot.frames import joint_names
from ccm_opt.robot.tool import RigidBody, Tool, in_link
from ccm_opt.scene.bodies import Body, CapsuleBody, rotation_to_axis

FEED = "feed"
"""Name of the prismatic joint of the feed axis, which precedes all other joints of an arm on a feed axis."""
Axis = tuple[float, float, float]
FRAME_MASS = 2e-15
"""Mass given to moving frames that have no mass of their own [kg].

Derived: twice the minimum that MuJoCo loads; Gazebo requires a mass too. Torques change by less than their twelfth
digit.
"""
FRAME_INERTIA = 2e-14
"""Moment of inertia given to moving frames that have none of their own, about every axis [kg m²]."""
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
class ModelShape:
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


def body_shape(body: Body) -> ModelShape:
    """Return the geometry of a body in space, placed as the body is; of a mesh the kind alone."""
    if body.kind == "mesh":
        return ModelShape("mesh", (), np.zeros(3), np.eye(3))
    if body.kind == "box":
        place = body.placement.points(0.5 * (body.low + body.high))
        return ModelShape("box", tuple(body.high - body.low), place, body.placement.rotation)
    if body.kind == "sphere":
        return ModelShape("sphere", (body.radius,), body.center, np.eye(3))
    axis = body.end - body.start
    size = (body.radius, float(np.linalg.norm(axis)))
    return ModelShape(body.kind, size, 0.5 * (body.start + body.end), np.roll(rotation_to_axis(axis), -1, axis=1))


def link_capsule(arm: Arm, k: int, begin: float) -> ModelShape:
    """Return link ``k`` (from 0), from ``begin`` [m] beyond its joint to its end, as a capsule in the link's frame."""
    length = float(arm.lengths[k])
    size = (visual_radius(arm, k), length - begin)
    return ModelShape("capsule", size, np.array([0.5 * (begin + length), 0.0, 0.0]), _Z_ALONG_X)


def named_bodies(arm: Arm) -> list[tuple[str, RigidBody]]:
    """Return the bodies on links of an arm but its tool, with the name of each in models for other programs."""
    return [(f"body{number:02d}", body) for number, body in enumerate(arm.bodies, start=1)]


def rigid_shapes(rigid: RigidBody) -> list[ModelShape]:
    """Return the capsules of a rigid body as capsules, or spheres, in its frame."""
    shapes = []
    for body in rigid.bodies:
        start, end = in_link(body.start), in_link(body.end)
        if np.array_equal(start, end):
            shapes.append(ModelShape("sphere", (body.radius,), start, np.eye(3)))
        else:
            shapes.append(body_shape(CapsuleBody(start, end, body.radius)))
    return shapes


def tool_rotation(tool: Tool) -> FloatArray:
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
