"""Arms and scenes as MJCF.

MuJoCo meets a mesh as its convex hull, through which no arm would go. So a mesh is a ``flex`` of triangles whose
corners do not move; it is met triangle by triangle, grown by the flex's radius.
"""

from itertools import groupby
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.arm_description import FEED, Revolute, checked_share, number, numbers, revolutes, visual_radius
from ccm_opt.io.scene_solids import Drum, Prism, SolidScene, prism_mesh
from ccm_opt.io.urdf import URDF_MESHES, mesh_file
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import BoxBody, CapsuleBody, CylinderBody, MeshBody, RigidPlacement, SphereBody

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
        parent = _add_body(parent, arm, ball)
        for axis in arm.base_axes if ball == 1 else ():
            span = numbers((axis.low, axis.high))
            ET.SubElement(parent, "joint", name=FEED, type="slide", axis="1 0 0", range=span)
            ET.SubElement(actuators, "motor", name=f"{FEED}_motor", joint=FEED)
        for revolute in group:
            _add_hinge(parent, revolute)
            ET.SubElement(actuators, "motor", name=f"{revolute.name}_motor", joint=revolute.name)
        _add_link(parent, arm, ball - 1)
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


def _add_body(parent: ET.Element, arm: Arm, ball: int) -> ET.Element:
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


def _add_link(body: ET.Element, arm: Arm, k: int) -> None:
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
        _add_capsule(body, arm, (0.0, arm.link_length), "0")
    if begin < arm.link_length:
        _add_capsule(body, arm, (begin, arm.link_length), "1")


def _add_capsule(body: ET.Element, arm: Arm, span: tuple[float, float], contype: str) -> None:
    ends = numbers((span[0], 0.0, 0.0, span[1], 0.0, 0.0))
    size = number(visual_radius(arm))
    ET.SubElement(body, "geom", type="capsule", fromto=ends, size=size, contype=contype, conaffinity="0")
