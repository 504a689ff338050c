"""Obstacles in URDF: fixed links of boxes, cylinders, and convex parts whose meshes are files beside it."""

import struct
from collections.abc import Iterator
from xml.etree import ElementTree as ET

import numpy as np

from ccm_opt.files.export.arm_description import number, numbers
from ccm_opt.files.export.scene_solids import Drum, Prism, SolidObstacle, SolidScene, prism_mesh
from ccm_opt.ground.arrays import FloatArray

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
                body = ET.SubElement(link, purpose)
                if isinstance(solid, Drum):
                    _add_drum(body, solid, scene.half_depth)
                else:
                    _add_prism(body, solid, scene.half_depth, f"{folder}/{_mesh_name(obstacle, k)}")
        joint = ET.SubElement(robot, "joint", name=f"{name}_mount", type="fixed")
        ET.SubElement(joint, "parent", link="world")
        ET.SubElement(joint, "child", link=name)


def scene_meshes(scene: SolidScene, folder: str) -> dict[str, bytes]:
    """The mesh files of a scene, in binary STL, metres, the world frame.

    Args:
        scene: the obstacles.
        folder: in front of their names.
    """
    return {f"{folder}/{name}": stl(prism, scene.half_depth) for name, prism in _meshed(scene)}


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


def _meshed(scene: SolidScene) -> Iterator[tuple[str, Prism]]:
    """The prisms that are no boxes, with the names of their files."""
    for obstacle in scene.obstacles:
        for k, solid in enumerate(obstacle.solids):
            if isinstance(solid, Prism) and solid.as_box() is None:
                yield _mesh_name(obstacle, k), solid


def _mesh_name(obstacle: SolidObstacle, k: int) -> str:
    return f"{obstacle.slug}-{k + 1}.stl"


def _add_drum(body: ET.Element, drum: Drum, half_depth: float) -> None:
    x, z = drum.center
    # Cylinders stand along their z; a quarter turn about x lays it along world y.
    ET.SubElement(body, "origin", xyz=numbers((x, 0.0, z)), rpy=numbers((0.5 * np.pi, 0.0, 0.0)))
    shape = ET.SubElement(body, "geometry")
    ET.SubElement(shape, "cylinder", radius=number(drum.radius), length=number(2.0 * half_depth))


def _add_prism(body: ET.Element, prism: Prism, half_depth: float, mesh: str) -> None:
    box = prism.as_box()
    if box is None:
        ET.SubElement(ET.SubElement(body, "geometry"), "mesh", filename=mesh)
        return
    center, heading, length, width = box
    ET.SubElement(body, "origin", xyz=numbers((center[0], 0.0, center[1])), rpy=numbers((0.0, -heading, 0.0)))
    ET.SubElement(ET.SubElement(body, "geometry"), "box", size=numbers((length, 2.0 * half_depth, width)))
