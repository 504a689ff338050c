"""Obstacles in MJCF: boxes, cylinders, and meshes of convex parts whose corners stand in the file itself."""

from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.arm_description import number, numbers
from ccm_opt.files.export.scene_solids import Drum, Prism, Solid, SolidScene, prism_mesh

_COLOUR = "0.55 0.57 0.6 1"


def add_scene(model: ET.Element, worldbody: ET.Element, scene: SolidScene) -> None:
    """Add the obstacles of a scene, which stand still and touch the arm but not each other.

    Args:
        model: the element ``mujoco``; meshes go into an element ``asset`` of it.
        worldbody: receives a geom for every solid, named by its obstacle; further ones have ``/2`` and so on behind.
        scene: the obstacles.
    """
    asset = ET.Element("asset")
    for obstacle in scene.obstacles:
        for k, solid in enumerate(obstacle.solids, start=1):
            name = obstacle.name if k == 1 else f"{obstacle.name}/{k}"
            geom = _geom(solid, scene.half_depth, name, asset)
            worldbody.append(geom)
    if len(asset):
        model.insert(list(model).index(worldbody), asset)


def _geom(solid: Solid, half_depth: float, name: str, asset: ET.Element) -> ET.Element:
    # What the arm is made of has the bit 1 in contype alone.
    geom = ET.Element("geom", name=name, contype="2", conaffinity="1", rgba=_COLOUR)
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
        # Any solid may be this thin, and nothing here has a mass.
        ET.SubElement(asset, "mesh", name=name, vertex=_vertices(solid, half_depth), inertia="shell")
        return geom
    center, heading, length, width = box
    geom.set("type", "box")
    geom.set("pos", numbers((center[0], 0.0, center[1])))
    geom.set("quat", numbers((np.cos(0.5 * heading), 0.0, -np.sin(0.5 * heading), 0.0)))
    geom.set("size", numbers((0.5 * length, half_depth, 0.5 * width)))
    return geom


def _vertices(prism: Prism, half_depth: float) -> str:
    return numbers(prism_mesh(prism, half_depth)[0].reshape(-1))
