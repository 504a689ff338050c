"""The file ``arm.mjcf.xml``: the arm for MuJoCo, three hinges a body, in the world frame."""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.arm_description import (
    FEED,
    Revolute,
    checked_share,
    number,
    numbers,
    revolutes,
    visual_radius,
)
from ccm_opt.files.export.scene_mjcf import add_scene
from ccm_opt.files.export.scene_solids import SolidScene
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.scene.rigid_placement import RigidPlacement


def mjcf_text(
    arm: DrivenArm, name: str, gravity: FloatArray, scene: SolidScene | None = None, *, bends_only: bool = False
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
        bends_only: whether a link has one hinge, which bends in the plane, in place of three.
    """
    furnish = None if scene is None else partial(add_scene, scene=scene)
    return arm_mjcf(arm, name, gravity, furnish, bends_only=bends_only)


def arm_mjcf(
    arm: DrivenArm,
    name: str,
    gravity: FloatArray,
    furnish: Callable[[ET.Element, ET.Element], None] | None,
    *,
    bends_only: bool = False,
) -> str:
    """The text of the file of an arm among whatever ``furnish`` adds to the elements ``mujoco`` and ``worldbody``."""
    model = ET.Element("mujoco", model=name)
    ET.SubElement(model, "compiler", angle="radian", autolimits="true")
    ET.SubElement(model, "option", gravity=numbers(gravity), timestep="0.001", integrator="RK4")
    parent = ET.SubElement(model, "worldbody")
    if furnish is not None:
        furnish(model, parent)
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


def _add_body(parent: ET.Element, arm: DrivenArm, ball: int) -> ET.Element:
    """The body of a link, at the tip of the one before; the first stands at the base, turned by the base heading."""
    body = ET.SubElement(parent, "body", name=f"link{ball:02d}")
    if ball > 1:
        body.set("pos", numbers((arm.link_length, 0.0, 0.0)))
        return body
    body.set("pos", numbers(arm.base_position))
    if isinstance(arm, SpaceArm):
        body.set("quat", numbers(RigidPlacement(rotation=arm.base_rotation).quaternion))
        return body
    half = -0.5 * arm.base_heading  # about world +y, which turns x towards -z
    body.set("quat", numbers((np.cos(half), 0.0, np.sin(half), 0.0)))
    return body


def _add_link(body: ET.Element, arm: DrivenArm, k: int) -> None:
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


def _add_capsule(body: ET.Element, arm: DrivenArm, span: tuple[float, float], contype: str) -> None:
    ends = numbers((span[0], 0.0, 0.0, span[1], 0.0, 0.0))
    size = number(visual_radius(arm))
    ET.SubElement(body, "geom", type="capsule", fromto=ends, size=size, contype=contype, conaffinity="0")
