"""Formats of meshes: whatever a file may say is read as it is meant, or refused; nothing of an obstacle is lost."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.mesh_obstacles import read_mesh_file, repaired_mesh
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh, triangulate_faces
from ccm_opt.scene.bodies import BOX_FACES
from tests.space_files import CUBE, binary_stl, is_closed, linked, model_3mf, object_3mf, three_mf

QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
"""The faces of the cube whose corners count x in fours, y in twos."""
GRID = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
MIXED = [*QUADS[:5], [1, 5, 7], [1, 7, 3]]


def read(folder: Path, name: str, content: bytes) -> RawMesh:
    """A mesh from a file."""
    (folder / name).write_bytes(content)
    return read_mesh_file(folder / name)


def area(mesh: RawMesh) -> float:
    """Of all triangles."""
    return float(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area)


def obj(faces: list[list[int]], *, vertices: FloatArray = GRID, first: int = 1) -> str:
    """An OBJ file in which vertices are counted from ``first``, or from -8 backwards."""
    places = "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
    return places + "".join(f"f {' '.join(str(corner + first) for corner in face)}\n" for face in faces)


def text_stl(name: str = "part") -> bytes:
    """The cube as STL in text."""
    loops = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.6e} {y:.6e} {z:.6e}\n" for x, y, z in CUBE[face])
        + "endloop\nendfacet\n"
        for face in BOX_FACES
    )
    return f"solid {name}\n{loops}endsolid {name}\n".encode()


def ply(faces: list[list[int]], *, order: str, wide: bool = False, faces_first: bool = False) -> bytes:
    """The cube as PLY, with a list at every vertex that is as long as its number where it is wide."""
    number, index = ("double", "ushort") if wide else ("float", "int")
    more = "property list uchar short more\nproperty uchar red\n" if wide else ""
    vertex = f"element vertex 8\nproperty {number} x\nproperty {number} y\n{more}property {number} z\n"
    face = f"element face {len(faces)}\nproperty list uchar {index} vertex_indices\nproperty uchar flags\n"
    header = f"ply\nformat {order} 1.0\ncomment <b>\n{face + vertex if faces_first else vertex + face}end_header\n"
    end = "<" if "little" in order else ">"
    text = order == "ascii"
    rows: list[tuple[str, list[float]]] = []
    for place, (x, y, z) in enumerate(GRID.tolist()):
        letter = number[0]
        listed = [place, *range(place), 255] if wide else []
        rows.append((f"{letter}{letter}" + (f"B{place}hB" if wide else "") + letter, [x, y, *listed, z]))
    corners: list[tuple[str, list[float]]] = [
        (f"B{len(each)}{'H' if wide else 'i'}B", [len(each), *each, 7]) for each in faces
    ]
    rows = corners + rows if faces_first else rows + corners
    if text:
        return header.encode() + "".join(" ".join(f"{value:g}" for value in row) + "\n" for _, row in rows).encode()
    packed = (
        struct.pack(end + kinds, *(value if kinds[0] in "fd" and not wide else _fitting(value) for value in row))
        for kinds, row in rows
    )
    return header.encode() + b"".join(packed)


def _fitting(value: float) -> float:
    """A whole number as such, which is packed as either kind."""
    return int(value) if value == int(value) else value


def glb(*, matrix: list[float] | None = None, **changes: Any) -> bytes:
    """The cube as GLB, with changes of its document by the places of what is changed."""
    places = CUBE.astype("<f4").tobytes()
    corners = BOX_FACES.astype("<u2").tobytes()
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **({"matrix": matrix} if matrix else {})}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(places) + len(corners)}],
    }
    for key, value in changes.items():
        if isinstance(value, dict):
            document[key][0].update(value)
        else:
            document[key] = value
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", len(places + corners), 0x004E4942) + places + corners
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


CAMERA = {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}
COMMENTED = (
    obj(QUADS)
    .replace("f ", "g other # group\nusemtl none\nf \\\n", 1)
    .replace("f 2", "f 2/1/1")
    .replace("v 1.0 0.0 0.0", "v\t1.0 0.0 0.0 0.5 0.5 0.5 # grey")
)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("part.stl", text_stl()),
        ("part.stl", b"\xef\xbb\xbf" + text_stl().replace(b"\n", b"\r\n")),
        ("part.stl", text_stl().replace(b"\n", b"\r").upper()),
        ("part.stl", text_stl("outer loop <b>\u2028</b> " + 3000 * "n")),
        *(("part.stl", text_stl(name)) for name in ("", "vertex", "facet", "endsolid", "endloop", "vertex 1 2 3")),
        ("part.stl", text_stl().replace(b"\n", b" ")),
        ("part.stl", b"solid facet".ljust(80) + binary_stl()[80:]),
        ("part.stl", binary_stl() + bytes(500)),
        ("part.obj", obj(QUADS).encode()),
        ("part.obj", COMMENTED.encode()),
        ("part.obj", b"\xef\xbb\xbf" + obj(QUADS).encode()),
        ("part.obj", obj(QUADS).encode("utf-16")),
        ("part.obj", obj(MIXED, first=-8).encode()),
        *(
            (f"{order}.ply", ply(faces, order=order, wide=wide, faces_first=first))
            for order in ("ascii", "binary_little_endian", "binary_big_endian")
            for faces, wide, first in ((QUADS, False, True), (MIXED, True, False), (MIXED, False, True))
        ),
        ("part.glb", glb()),
        ("part.glb", glb(matrix=[0, -1, 0, 0, 1, 0, 0, 0, 0, 0, -1, 0, 5, 6, 7, 1])),
        ("part.glb", glb(nodes=[{"camera": 0, "children": [1]}, {"mesh": 0}], cameras=[CAMERA])),
        ("part.glb", glb(nodes=[{"camera": 0, "mesh": 0}], cameras=[CAMERA])),
        ("part.glb", glb(extensionsRequired=["KHR_materials_unlit"], meshes={"weights": [0.0]})),
    ],
)
def test_what_a_format_allows_is_read(tmp_path: Path, name: str, content: bytes) -> None:
    """However a cube is written down, it is a closed cube."""
    mended = repaired_mesh(read(tmp_path, name, content))
    assert (len(mended.vertices), is_closed(mended)) == (8, True)
    assert area(mended) == pytest.approx(6.0)


def test_vertices_told_backwards_belong_to_what_stands_before_them(tmp_path: Path) -> None:
    """In a second object of an OBJ file -1 is its own last vertex: two cubes are two cubes."""
    both = obj(QUADS, first=-8) + "o second\n" + obj(QUADS, vertices=GRID + 3.0, first=-8)
    mesh = repaired_mesh(read(tmp_path, "part.obj", both.encode()))
    assert (len(mesh.faces), is_closed(mesh), mesh.mended) == (24, True, ())
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([4.0, 4.0, 4.0])


def test_several_solids_of_one_file(tmp_path: Path) -> None:
    """All solids of an STL file are read, whatever they are called."""
    both = text_stl("vertex") + text_stl("solid 2").replace(b"vertex 0", b"vertex 5")
    assert len(read(tmp_path, "part.stl", both).faces) == 24


PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
LATTICE = (
    '<b:beamlattice minlength="0.1" radius="3"><b:beams><b:beam v1="0" v2="1"/></b:beams></b:beamlattice>',
    'xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"',
)
BOOLEAN = (
    '<object id="2"><o:booleanshape objectid="1"><o:boolean objectid="1"/></o:booleanshape></object>',
    'xmlns:o="http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07"',
)
SLICES = 'xmlns:s="http://schemas.microsoft.com/3dmanufacturing/slice/2015/07"'
ITEM = '<item objectid="1"/>'
ELSEWHERE = model_3mf(object_3mf(), f'{ITEM}<item objectid="1" p:path="/3D/part.model"/>', f'xmlns:p="{PRODUCTION}"')
PART = {"3D/part.model": model_3mf(object_3mf(size=3.0), "")}
LINKED = {"3D/_rels/3dmodel.model.rels": linked("/3D/part.model")}


@pytest.mark.parametrize(
    ("content", "triangles", "size", "metres"),
    [
        (three_mf(model_3mf(object_3mf(), ITEM)), 12, 1.0, 1e-3),
        (three_mf(model_3mf(object_3mf(), ITEM, 'unit="inch"')), 12, 1.0, 0.0254),
        (three_mf(model_3mf(object_3mf(), ITEM, "")), 12, 1.0, 1e-3),
        (three_mf(model_3mf(object_3mf(), ITEM, "").encode("utf-16")), 12, 1.0, 1e-3),
        (three_mf(model_3mf(object_3mf(attributes='type="support"'), ITEM)), 12, 1.0, 1e-3),
        (three_mf(ELSEWHERE, **PART, **LINKED), 24, 3.0, 1e-3),
        (three_mf(model_3mf(object_3mf(size=2.0), ITEM), **{"a.model": PART["3D/part.model"]}), 12, 2.0, 1e-3),
        (
            three_mf(
                PART["3D/part.model"], **{"b.model": model_3mf(object_3mf(), ITEM), "_rels/.rels": linked("/b.model")}
            ),
            12,
            1.0,
            1e-3,
        ),
    ],
    ids=["plain", "inch", "no unit", "wide letters", "support", "other part", "not linked", "root elsewhere"],
)
def test_3mf_is_read_as_the_format_says(
    tmp_path: Path, content: bytes, triangles: int, size: float, metres: float
) -> None:
    """Relationships name the root model, items and components what stands where, and the unit is the file's."""
    mesh = read(tmp_path, "part.3mf", content)
    assert (len(mesh.faces), mesh.metres) == (triangles, metres)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([size] * 3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (three_mf(model_3mf(object_3mf(more=LATTICE[0]), ITEM, LATTICE[1])), "a beam lattice, which is not supported"),
        (
            three_mf(model_3mf(object_3mf() + BOOLEAN[0], ITEM, BOOLEAN[1])),
            "a boolean of shapes, which is not supported",
        ),
        (three_mf(model_3mf(object_3mf(), ITEM, 'requiredextensions="q" xmlns:q="http://q"')), "extension 'http://q'"),
        (
            three_mf(model_3mf(object_3mf(more='<q:surface xmlns:q="http://q"/>'), ITEM)),
            "has 'surface' of the unknown extension",
        ),
        (three_mf(model_3mf(object_3mf(), ITEM, 'unit="parsec"')), "its unit 'parsec' is unknown"),
        (three_mf(model_3mf(object_3mf(), "")), "its build section is empty"),
        (
            three_mf(ELSEWHERE.replace("<model ", '<model unit="inch" '), **PART, **LINKED),
            "different units, inch, milli",
        ),
        (three_mf(ELSEWHERE, **PART), "'/3D/part.model', which it names, is not linked from the root model"),
        (three_mf(model_3mf(object_3mf() + object_3mf(), ITEM)), "the object '1' occurs twice"),
        (three_mf(model_3mf(object_3mf(more="</mesh><mesh>"), ITEM)), "an object has two shapes"),
        (
            three_mf(model_3mf(object_3mf(attributes='s:meshresolution="lowres"'), ITEM, SLICES)),
            "slices finer",
        ),
        (three_mf(model_3mf(object_3mf().replace('v1="0" v2="2"', 'v1="0" v2="0"'), ITEM)), "one vertex twice"),
    ],
    ids=range(12),
)
def test_3mf_that_is_not_read_is_refused_by_name(tmp_path: Path, content: bytes, words: str) -> None:
    """A shape that would be missing, or an item that would be another, is refused with what it is."""
    with pytest.raises(ProblemError) as refused:
        read(tmp_path, "part.3mf", content)
    assert words in str(refused.value)


def test_a_mesh_that_is_used_often_is_counted_before_it_is_placed(tmp_path: Path) -> None:
    """A GLB file of a thousand nodes with one cube is refused by the number of triangles that it would have."""
    content = glb(nodes=[{"mesh": 0}] * 1000, scenes=[{"nodes": list(range(1000))}])
    (tmp_path / "many.glb").write_bytes(content)
    with pytest.raises(ProblemError, match="12000 triangles; at most 11999"):
        read_mesh_file(tmp_path / "many.glb", MeshSettings(most_triangles=11_999))
    assert len(read(tmp_path, "many.glb", content).faces) == 12_000


def test_what_is_no_surface_is_told(tmp_path: Path) -> None:
    """Lines and points of OBJ and objects that a 3MF file does not build are counted."""
    assert read(tmp_path, "part.obj", f"{obj(QUADS)}l 1 2 3\nl 1 2\np 1\n".encode()).passed_over == (
        "2 line elements",
        "1 point element",
    )
    both = three_mf(model_3mf(object_3mf() + object_3mf(2), ITEM))
    assert read(tmp_path, "part.3mf", both).passed_over == ("1 object that the file does not build",)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), kind=st.sampled_from(("stl", "stl_ascii", "obj", "ply", "ply_ascii", "glb", "3mf")))
def test_meshes_of_independent_writers_come_back_exactly(
    seed: int, kind: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Every triangle of a random mesh is read with its corners in order, to the last bit of single precision."""
    rng = np.random.default_rng(seed)
    vertices = (rng.normal(size=(rng.integers(3, 40), 3)) * 10.0 ** rng.integers(-6, 6)).astype(np.float32)
    faces = np.array([rng.choice(len(vertices), 3, replace=False) for _ in range(rng.integers(1, 60))])
    mesh = trimesh.Trimesh(vertices.astype(np.float64), faces, process=False)
    if kind == "3mf":
        places = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in vertices.tolist())
        corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
        inner = f"<mesh><vertices>{places}</vertices><triangles>{corners}</triangles></mesh>"
        content: str | bytes = three_mf(model_3mf(f'<object id="1">{inner}</object>', ITEM))
    elif kind == "ply_ascii":  # trimesh writes eight digits of nine
        numbers = "".join(f"property float {axis}\n" for axis in "xyz")
        header = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n{numbers}element face {len(faces)}\n"
        rows = [f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in vertices.tolist()]
        rows += [f"3 {a} {b} {c}\n" for a, b, c in faces.tolist()]
        content = f"{header}property list uchar int vertex_index\nend_header\n{''.join(rows)}"
    else:
        content = mesh.export(file_type=kind, **({"digits": 17} if kind == "obj" else {}))
    name = f"part.{kind.removesuffix('_ascii')}"
    found = read(tmp_path_factory.mktemp("law"), name, content.encode() if isinstance(content, str) else content)
    if kind == "obj":  # written with 17 decimals
        np.testing.assert_allclose(found.vertices[found.faces], vertices[faces], rtol=0.0, atol=1e-17)
    else:
        assert np.array_equal(found.vertices[found.faces].astype(np.float32), vertices[faces])


SPARSE = {"sparse": {"count": 1}}
INSTANCES = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}
ASCII = ply(QUADS, order="ascii")
LITTLE = ply(MIXED, order="binary_little_endian")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.stl", text_stl()[:-60], "follows 11 triangles; expected a facet of three vertices, or 'endsolid'"),
        (
            "part.stl",
            text_stl().replace(b"endloop", b"vertex 0 0 0\nendloop", 1),
            "follows 0 triangles",
        ),
        ("part.stl", text_stl().replace(b".", b","), "expected numbers"),
        ("part.stl", binary_stl()[:80] + (5).to_bytes(4, "little") + binary_stl()[84:], "those of 7 further triangles"),
        ("part.obj", (obj(QUADS) + "f 0 1 2\n").encode(), "line 15 is 'f 0 1 2', but only 8 vertices precede it"),
        ("part.obj", (obj(QUADS) + "f -9 1 2\n").encode(), "line 15 is"),
        ("part.obj", (obj(QUADS) + "f 1 2 x\n").encode(), "line 15 is 'f 1 2 x'; expected vertex numbers"),
        ("part.obj", (obj(QUADS) + "surf 0 1 0 1 1 2\n").encode(), "line 15 has free-form surfaces"),
        ("part.ply", ASCII[:-20], "announces 6 elements 'face', but the file ends before"),
        ("part.ply", LITTLE[:-9], "announces 7 elements 'face', but the file ends before"),
        ("part.ply", LITTLE.replace(b"face 7", b"face 6"), "more data follow than its header announces"),
        ("part.ply", LITTLE.replace(b"vertex 8", b"vertex 4000000000"), "ends before"),
        (
            "part.ply",
            LITTLE.replace(b"face 7", b"face 4000000000"),
            "announces 4000000000 elements 'face', but the file ends before",
        ),
        ("part.ply", LITTLE.replace(b"uchar int", b"uchar oint"), "unknown type 'oint'"),
        ("part.ply", LITTLE.replace(b"float z", b"float w"), "its vertices have no z"),
        ("part.ply", ASCII.replace(b"4 0 1", b"4 0.5 1", 1), "not a whole number"),
        ("part.ply", ASCII.replace(b"4 0 1", b"-4 0 1", 1), "a list has the length -4"),
        ("part.ply", ASCII.replace(b"4 0 1", b"4 x 1", 1), "is not a number"),
        ("part.ply", ASCII.replace(b"element face", b"element tristrips"), "strips of triangles"),
        ("part.glb", glb(accessors=SPARSE), "it has a sparse accessor, which is not supported"),
        ("part.glb", glb(accessors={"normalized": True}), "normalised integer positions"),
        ("part.glb", glb(nodes=INSTANCES), "'EXT_mesh_gpu_instancing', which is not supported"),
        ("part.glb", glb(nodes={"skin": 0}), "a skinned mesh"),
        ("part.glb", glb(meshes={"weights": [0.0, 1.0]}), "a morph target"),
        ("part.glb", glb(meshes={"primitives": [{"attributes": {"POSITION": 0}, "mode": 6}]}), "a fan of triangles"),
        ("part.glb", glb(extensionsRequired=["KHR_draco_mesh_compression"]), "'KHR_draco_mesh_compression'"),
        ("part.glb", glb(buffers={"uri": "../other.bin"}), "another file, '../other.bin'"),
    ],
    ids=range(27),
)
def test_what_is_not_read_is_refused(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    """Where some of a mesh would be missing from the obstacle, or stand elsewhere, the file is refused."""
    with pytest.raises(ProblemError) as refused:
        read(tmp_path, name, content)
    assert words in str(refused.value)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32), count=st.integers(4, 30))
def test_a_flat_face_is_cut_into_triangles_that_cover_it(seed: int, count: int) -> None:
    """Of a jagged face, turned anyhow, the triangles have its area, look its way, and are two fewer than corners."""
    rng = np.random.default_rng(seed)
    angles = (np.arange(count) + rng.uniform(0.1, 0.9, count)) * 2.0 * np.pi / count
    radii = rng.uniform(0.2, 1.0, count)
    flat = np.column_stack((radii * np.cos(angles), radii * np.sin(angles), np.zeros(count)))
    following = np.roll(flat, -1, axis=0)
    size = 0.5 * np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    vertices = np.vstack((rng.normal(size=(2, 3)), flat @ turn.T + rng.normal(size=3)))
    cut = triangulate_faces(vertices, np.arange(2, count + 2), np.array([count]))
    sides = vertices[cut[:, 1:]] - vertices[cut[:, :1]]
    along = np.cross(sides[:, 0], sides[:, 1]) @ np.cross(turn[:, 0], turn[:, 1])
    assert len(cut) == count - 2
    assert np.all(along > -1e-12)
    assert 0.5 * along.sum() == pytest.approx(size)


def test_faces_that_cross_themselves_are_covered() -> None:
    """Of a star drawn in one line no place within its tips is left open, and faces stay in their order."""
    points = np.exp(0.8j * np.pi * np.arange(5))
    vertices = np.column_stack((points.real, points.imag, np.zeros(5)))
    cut = triangulate_faces(vertices, np.array([0, 1, 2, 3, 4, 0, 1, 2, 3, 0, 4]), np.array([5, 0, 4, 2]))
    assert cut.tolist()[:3] == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert len(cut) == 5


@pytest.mark.parametrize("odd", [1e308, -np.inf, np.nan])
def test_places_that_are_none_are_no_warning(odd: float) -> None:
    """Faces of any number of corners are cut without a warning; what is no place is refused after that, by name."""
    vertices = np.vstack((GRID, [[0.0, odd, 0.0], [1.01, 3.0, 4.0]]))
    for face in ([4, 9, 6, 8, 9, 3], [4, 7, 6, 8, 5, 3], [8, 0, 9, 5]):
        assert len(triangulate_faces(vertices, np.array(face), np.array([len(face)]))) == len(face) - 2


def test_a_face_that_cannot_be_cut_flat_is_cut_as_a_fan() -> None:
    """Where one corner lies so far out that the others are one to it, GEOS finds no corner to begin with."""
    far = 1e308
    places = [[0, 0, 0], [0, far, 1], [1, 1, -far], [1e-320, 0, 0], [0, -far, 0], [0, -far, 0]]
    vertices = np.array(places, dtype=np.float64)
    face = np.array([0, 3, 1, 4, 4, 5])
    assert len(triangulate_faces(vertices, face, np.array([6]))) == 4


def test_signalling_numbers_of_a_ply_file_are_no_warning(tmp_path: Path) -> None:
    """A number of single precision that is none, at which numpy warns when it is made one of double precision."""
    content = ply(QUADS, order="binary_little_endian")
    place = content.index(b"end_header\n") + len(b"end_header\n")
    signalling = content[:place] + b"\x01\x00\xa0\x7f" + content[place + 4 :]
    with pytest.raises(ProblemError, match="1 of 8 vertices are not finite"):
        read(tmp_path, "part.ply", signalling)
