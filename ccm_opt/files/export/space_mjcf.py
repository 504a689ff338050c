"""The file ``arm.mjcf.xml`` of an arm in space, among bodies that MuJoCo meets as they are, meshes too.

MuJoCo meets a mesh as its convex hull, through which no arm would go. So a mesh is a ``flex`` of triangles whose
corners do not move; it is met triangle by triangle, grown by the flex's radius.
"""

from functools import partial
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.arm_description import number, numbers
from ccm_opt.files.export.export_settings import EXPORT, ExportSettings
from ccm_opt.files.export.mjcf import arm_mjcf
from ccm_opt.files.export.space_scene import NamedBody
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from ccm_opt.space.scene.rigid_placement import RigidPlacement

_COLOUR = "0.55 0.57 0.6 0.4"
_CONTACT = {"contype": "2", "conaffinity": "1"}
"""What the arm is made of has the bit 1 in contype alone."""


def space_mjcf(
    problem: SpaceProblem,
    bodies: tuple[NamedBody, ...],
    mesh_folder: str,
    *,
    bends_only: bool = False,
    settings: ExportSettings = EXPORT,
) -> str:
    """MJCF of an arm and of bodies, which stand still and touch the arm but not each other.

    Args:
        problem: whose arm it is.
        bodies: what it can touch; meshes are files, as ``space_meshes`` writes them.
        mesh_folder: of these, relative to the MJCF.
        bends_only: whether a link has the two hinges that bend it, in place of three.
        settings: sizes.
    """
    thinnest = settings.thin_wall * problem.arm.length
    furnish = partial(_furnish, bodies=bodies, mesh_folder=mesh_folder, thinnest=thinnest)
    return arm_mjcf(problem.arm, problem.name, problem.simulation.gravity, furnish, bends_only=bends_only)


def _furnish(
    _model: ET.Element, worldbody: ET.Element, *, bodies: tuple[NamedBody, ...], mesh_folder: str, thinnest: float
) -> None:
    for named in bodies:
        if isinstance(named.body, MeshBody):
            _add_mesh(worldbody, named, named.body, mesh_folder, thinnest)
        else:
            worldbody.append(_geom(named, named.body))


def _add_mesh(worldbody: ET.Element, named: NamedBody, body: MeshBody, folder: str, thinnest: float) -> None:
    """A mesh as triangles that do not move; a flex needs some radius, and a mass that then is of no matter."""
    flex = ET.SubElement(worldbody, "flexcomp", name=named.name, type="mesh", dim="2", rigid="true", mass="1")
    flex.set("file", f"{folder}/{named.mesh_file}")
    flex.set("radius", number(max(body.rounding, 0.5 * thinnest)))
    flex.set("rgba", _COLOUR)
    ET.SubElement(flex, "contact", _CONTACT, selfcollide="none")


def _geom(named: NamedBody, body: BoxBody | SphereBody | CylinderBody | CapsuleBody) -> ET.Element:
    geom = ET.Element("geom", _CONTACT, name=named.name, rgba=_COLOUR)
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
