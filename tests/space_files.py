"""Problem files in space, and mesh files, for tests."""

import io
import zipfile
from pathlib import Path

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.io.raw_mesh import RawMesh
from ccm_opt.scene.bodies import BOX_FACES, box_corners
from ccm_opt.scene.shells import find_shells

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
    """Return the bytes of a binary STL file with given triangles."""
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = vertices[faces]
    return bytes(80) + len(faces).to_bytes(4, "little") + records.tobytes()


RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
CONTENT_TYPES = """<?xml version="1.0"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>"""


def is_closed(mesh: RawMesh) -> bool:
    """Return whether every edge of a mesh belongs to two triangles."""
    return bool(find_shells(mesh.vertices, mesh.faces).closed.all())


def linked(*targets: str) -> str:
    """Return an XML part of a 3MF file with relationships to models."""
    links = "".join(f'<Relationship Target="{each}" Id="r{k}" Type="{MODEL_TYPE}"/>' for k, each in enumerate(targets))
    return f'<?xml version="1.0"?><Relationships xmlns="{RELATIONS}">{links}</Relationships>'


def three_mf(model: str | bytes, **others: str | bytes) -> bytes:
    """Return the bytes of a 3MF file with a root model and further parts by path."""
    parts = {
        "[Content_Types].xml": CONTENT_TYPES,
        "_rels/.rels": linked("/3D/3dmodel.model"),
        **others,
        "3D/3dmodel.model": model,
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return packed.getvalue()


def model_3mf(resources: str, build: str, attributes: str = 'unit="millimeter"') -> str:
    """Return the XML of a 3MF model with given resources and build items."""
    space = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    return f'<model {attributes} xmlns="{space}"><resources>{resources}</resources><build>{build}</build></model>'


def object_3mf(number: int = 1, size: float = 1.0, more: str = "", attributes: str = "") -> str:
    """Return the XML of a 3MF object that is a cube, with further XML in its mesh."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in size * CUBE)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in BOX_FACES)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>{more}</mesh>"
    return f'<object id="{number}" {attributes}>{mesh}</object>'


def cube_3mf(*, transform: str = "") -> bytes:
    """Return the bytes of a 3MF file with the unit cube as a component of another object."""
    both = object_3mf() + '<object id="2"><components><component objectid="1"/></components></object>'
    return three_mf(model_3mf(both, f'<item objectid="2" {transform}/>', 'unit="meter"'))


def written(folder: Path, mesh: bytes, name: str = "part.stl", extra: str = "") -> Path:
    """Write a mesh and a problem file that refers to it, with further keys of the obstacle; return the problem file."""
    (folder / name).write_bytes(mesh)
    file = folder / "problem.toml"
    file.write_text(TEXT.replace('mesh = "part.stl"', f'mesh = "{name}"\n{extra}'), encoding="utf-8")
    return file
