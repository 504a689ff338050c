"""Problem files in space and meshes for the tests."""

import io
import zipfile
from pathlib import Path

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.scene.bodies import BOX_FACES, box_corners

CUBE = box_corners(np.zeros(3), np.ones(3))
"""Corners of the unit cube."""

TEXT = """
schema = 1
space = 3
name = "mesh"

[workspace]
bounds = [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]

[[workspace.obstacles]]
name = "part"
mesh = "part.stl"

[arm]
links = 4
link_length = 0.1
radius = 0.01
base = { position = [-1.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0] }
joint_limit_deg = 45.0

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
position = [-0.7, 0.1, 0.0]
"""


def binary_stl(vertices: FloatArray = CUBE, faces: IntArray = BOX_FACES) -> bytes:
    """A binary STL file."""
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = vertices[faces]
    return bytes(80) + len(faces).to_bytes(4, "little") + records.tobytes()


def three_mf(model: str | bytes) -> bytes:
    """A 3MF file with a model."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return packed.getvalue()


def cube_3mf(*, transform: str = "") -> bytes:
    """The unit cube as 3MF, built of a component."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CUBE)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in BOX_FACES)
    return three_mf(
        '<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1"><mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh></object>'
        '<object id="2"><components><component objectid="1"/></components></object>'
        f'</resources><build><item objectid="2" {transform}/></build></model>'
    )


def written(folder: Path, mesh: bytes, name: str = "part.stl", extra: str = "") -> Path:
    """A problem file beside a mesh, with further keys of its obstacle."""
    (folder / name).write_bytes(mesh)
    file = folder / "problem.toml"
    file.write_text(TEXT.replace('mesh = "part.stl"', f'mesh = "{name}"\n{extra}'), encoding="utf-8")
    return file
