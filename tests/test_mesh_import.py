"""Meshes: every format gives the same surface, broken files get one clear error, and what is mended is told."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.mesh_obstacles import read_mesh_file, repaired_mesh
from ccm_opt.io.raw_mesh import MeshSettings, RawMesh
from ccm_opt.scene.bodies import BOX_FACES
from ccm_opt.scene.shells import repeated
from tests.space_files import CUBE, binary_stl, cube_3mf, is_closed, model_3mf, object_3mf, three_mf, written

OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in BOX_FACES)


def by_trimesh(kind: str) -> bytes:
    """The unit cube in a format, as trimesh writes it."""
    written_out = trimesh.Trimesh(CUBE, BOX_FACES, process=False).export(file_type=kind)
    return written_out.encode() if isinstance(written_out, str) else bytes(written_out)


def volume(mesh: RawMesh) -> float:
    """What the triangles enclose."""
    first, second, third = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.sum(np.einsum("ij,ij->i", first, np.cross(second, third)))) / 6.0


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cube.stl", binary_stl()),
        ("CUBE.STL", b"solid made by a program that begins binary files so"[:50].ljust(80) + binary_stl()[80:]),
        ("cube.stl", by_trimesh("stl_ascii")),
        ("cube.obj", OBJ.encode()),
        ("cube.ply", by_trimesh("ply")),
        ("cube.glb", by_trimesh("glb")),
        ("cube.3mf", cube_3mf()),
        ("cube.3mf", cube_3mf(transform='transform="0 1 0 0 0 1 1 0 0 5 6 7"')),
    ],
)
def test_every_format_gives_the_same_surface(tmp_path: Path, name: str, content: bytes) -> None:
    """A cube is a closed mesh of volume 1 in whichever format it is, and nothing of it is mended."""
    (tmp_path / name).write_bytes(content)
    mended = repaired_mesh(read_mesh_file(tmp_path / name))
    assert (len(mended.vertices), len(mended.faces)) == (8, 12)
    assert (is_closed(mended), mended.mended) == (True, ())
    assert volume(mended) == pytest.approx(1.0)


MUTATED = {
    "stl": binary_stl(),
    "obj": OBJ.encode(),
    "ply": by_trimesh("ply"),
    "glb": by_trimesh("glb"),
    "3mf": cube_3mf(),
}
PLACES = {"workspace.obstacles[0]", "workspace.obstacles[0].scale", "arm.base"}
"""Keys under which a mesh may be refused; one that has become huge or tiny, or has come to hold the base, likewise."""
NAN_STL = binary_stl(np.where(CUBE > 0.5, np.nan, CUBE))
SIGNALLING_STL = NAN_STL.replace(bytes.fromhex("0000c07f"), bytes.fromhex("0000a07f"))
"""Of numbers that are none, too, but that warn when they are computed with."""
FLAT_STL = binary_stl(np.zeros((8, 3)))
INFINITE = cube_3mf(transform='transform="0 1 0 0 0 inf 1 0 0 5 6 7"')
OVERFLOWING = cube_3mf(transform='transform="1e308 1e308 0 0 0 1 1e308 0 0 1 6 7"')
"""Moved by numbers that are finite, to where none is."""
UNKNOWN = three_mf(model_3mf("", '<item objectid="7"/>'))
ENTITIES = three_mf(
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaaaaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + k)} "{10 * f"&{chr(97 + k)};"}">' for k in range(9))
    + "]><model>&j;</model>"
)


def nested(uses: int, levels: int) -> bytes:
    """A cube that so many objects, one above the other, use so many times each."""
    used = [uses * f'<component objectid="{k}"/>' for k in range(1, levels)]
    inner = [f'<object id="{k}"><components>{each}</components></object>' for k, each in enumerate(used, 2)]
    return three_mf(model_3mf(object_3mf() + "".join(inner), f'<item objectid="{levels}"/>'))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("part.stl", b"", "part.stl is empty"),
        ("part.stl", binary_stl()[:300], "header announces 12 triangles, but it ends after 4"),
        (
            "part.stl",
            b"solid x\nfacet normal 0 0 0\nouter loop\nvertex 1",
            "follows 0 triangles; expected a facet of three vertices, or 'endsolid'",
        ),
        ("part.stl", b"just some words", "not readable as STL"),
        ("part.stl", b"v 0.0 0.0 0.0\n" * 10, "it is text"),
        ("part.stl", b"\x89PNG" + bytes(range(256)), "or of another format"),
        ("part.stl", b"part".ljust(80) + bytes(4), "it contains no triangles"),
        ("part.stl", bytes(80) + (3_000_000).to_bytes(4, "little") + bytes(50), "truncated"),
        ("part.stl", NAN_STL, "vertices are not finite"),
        ("part.stl", SIGNALLING_STL, "vertices are not finite"),
        ("part.stl", FLAT_STL, "12 of 12 triangles have zero area"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "part.obj"),
        ("part.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "part.obj"),
        ("part.obj", bytes(range(256)) * 40, "part.obj"),
        ("part.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "part.obj"),
        ("part.3mf", cube_3mf()[:-30], "not readable as 3MF"),
        ("part.ply", b"ply\nformat ascii 1.0\nelement vertex 9\nend_header\n", "not readable as PLY"),
        ("part.glb", b"glTF" + bytes(40), "not readable as GLB"),
        ("part.3mf", b"PK\3\4 and then nothing", "not readable as 3MF"),
        ("part.3mf", UNKNOWN, "refers to an object that does not exist"),
        ("part.3mf", ENTITIES, "has a document type, which the format forbids"),
        ("part.3mf", INFINITE, "not readable as 3MF"),
        ("part.3mf", OVERFLOWING, "vertices are not finite"),
        ("part.3mf", nested(1, 40), "nested more than 20 deep"),
        ("part.3mf", nested(2, 20), "consists of more than 10000 parts"),
        ("part.iges", b"ISO-10303-21;", "not a mesh of a known format; expected a name that ends in one of .stl, .obj"),
    ],
    ids=range(26),
)
def test_a_broken_mesh_is_one_clear_error(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    """A mesh that cannot be used is one defect of the file, under the key of the mesh and with its line."""
    file = written(tmp_path, content, name)
    with pytest.raises(ProblemFileError) as refused:
        ccm_opt.load_problem(file)
    (issue,) = refused.value.issues
    assert (issue.key, issue.line) == ("workspace.obstacles[0].mesh", 11)
    assert words in issue.message
    assert "Traceback" not in issue.message


def refused_keys(file: Path) -> set[str]:
    """Keys of the defects of a problem file; none where it is read."""
    try:
        ccm_opt.load_problem(file)
    except ProblemFileError as refused:
        return {issue.key.removesuffix(".mesh") for issue in refused.issues}
    return set()


@settings(max_examples=60)
@given(data=st.data(), kind=st.sampled_from(("stl", "obj", "ply", "glb", "3mf")))
def test_mutated_meshes_are_read_or_refused(
    data: st.DataObject, kind: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever a few bytes of a mesh become, it is read, or refused as a defect of the file."""
    content = bytearray(MUTATED[kind])
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(content)))
        new = data.draw(st.sampled_from((b"", b"9999999999", b"-1", b"nan", b" inf ", b"\n", b"\xff")))
        content[at : at + data.draw(st.integers(0, 8))] = new
    file = written(tmp_path_factory.mktemp("mutated"), bytes(content), f"part.{kind}")
    assert refused_keys(file) <= PLACES


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ("../part.stl", "outside the folder"),
        ("/etc/passwd.stl", "outside the folder"),
        ("link.stl", "outside the folder"),
        (".", "is a directory"),
        ("missing.stl", "does not exist"),
        ("a\\u0000b.stl", "not a valid path"),
    ],
)
def test_paths_of_meshes(tmp_path: Path, mesh: str, words: str) -> None:
    """A mesh lies in the folder of its problem file, itself and not by a link alone."""
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "part.stl").write_bytes(binary_stl())
    (folder / "link.stl").symlink_to(tmp_path / "part.stl")
    file = written(folder, binary_stl())
    file.write_text(file.read_text().replace('mesh = "part.stl"', f'mesh = "{mesh}"'))
    with pytest.raises(ProblemFileError, match=words):
        ccm_opt.load_problem(file)
    if mesh in {"../part.stl", "link.stl"}:
        ccm_opt.load_problem(file, allow_outside=True)


def test_files_beyond_the_bounds_are_not_read(tmp_path: Path) -> None:
    """A file of more bytes, or a mesh of more triangles, than is allowed is refused with both figures."""
    (tmp_path / "cube.stl").write_bytes(binary_stl())
    for bounds, words in (
        (MeshSettings(most_bytes=600), "684 bytes; at most 600"),
        (MeshSettings(most_triangles=11), "12 triangles; at most 11"),
    ):
        with pytest.raises(ccm_opt.ProblemError, match=words):
            read_mesh_file(tmp_path / "cube.stl", bounds)


def test_a_packed_bomb_does_not_fill_the_memory(tmp_path: Path) -> None:
    """Of a 3MF file that unpacks to far more than is allowed no more than that is unpacked."""
    (tmp_path / "bomb.3mf").write_bytes(three_mf("<model>" + " " * 50_000_000))
    tracemalloc.start()
    with pytest.raises(ccm_opt.ProblemError, match="more than 1000000 bytes unpacked"):
        read_mesh_file(tmp_path / "bomb.3mf", MeshSettings(most_unpacked=1_000_000))
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_other_files_are_not_read_for_a_mesh(tmp_path: Path) -> None:
    """Materials that a mesh names in other places are left alone."""
    (tmp_path / "part.obj").write_text("mtllib ../../secret.mtl\nusemtl x\n" + OBJ)
    assert len(read_mesh_file(tmp_path / "part.obj").faces) == 12


def test_parts_without_triangles_are_left_out(tmp_path: Path) -> None:
    """Vertices that belong to nothing, in a part of their own, do not keep the rest from being read."""
    (tmp_path / "part.obj").write_text(f"{OBJ}o other\nusemtl y\nv 0 0 9\nv 1 0 9\nf 9 10\n")
    assert len(read_mesh_file(tmp_path / "part.obj").faces) == 12


@pytest.mark.parametrize("far", [1e30, np.inf, np.nan])
def test_vertices_that_no_triangle_has_may_be_anywhere(far: float) -> None:
    """They are left out, and do not make the others' triangles small."""
    mended = repaired_mesh(RawMesh(np.vstack(([[0.0, far, 0.0]], CUBE)), BOX_FACES + 1))
    assert (len(mended.vertices), is_closed(mended), mended.mended) == (8, True, ())
    assert volume(mended) == pytest.approx(1.0)


def test_what_is_mended_is_told() -> None:
    """Triangles that are there twice, or are an edge of others, are left out; one that is alone stays."""
    vertices = np.concatenate((CUBE, [[0.5, 0.0, 0.0], [3.0, 0.0, 0.0]]))
    faces = np.concatenate((BOX_FACES, BOX_FACES[:2], [[0, 8, 1], [1, 1, 0]]))
    mended = repaired_mesh(RawMesh(vertices, faces))
    assert (len(mended.faces), is_closed(mended)) == (12, True)
    assert mended.mended == ("left out 2 triangles without area", "left out 2 repeated triangles")
    alone = repaired_mesh(RawMesh(vertices, np.concatenate((faces, [[0, 9, 9]]))))
    assert (len(alone.faces), is_closed(alone)) == (13, True)
    assert not is_closed(repaired_mesh(RawMesh(CUBE, BOX_FACES[1:])))


def test_repeated_triangles_among_vertices_without_end() -> None:
    """Repeated triangles are found where vertices are too many for one number to tell three of them."""
    rng = np.random.default_rng(0)
    faces = rng.choice(3_000_000, size=(1000, 3), replace=False)
    faces[-1] = [0, 1, 2_999_999]
    twice = np.concatenate((faces, faces[:10, [1, 2, 0]], faces[:10, ::-1]))
    assert np.count_nonzero(repeated(twice) == 0) == 1000
    few = rng.integers(0, 1000, (500, 3))
    expected = len(np.unique(np.sort(few, axis=1), axis=0))
    assert np.count_nonzero(repeated(np.concatenate((few, few[:, ::-1]))) == 0) == expected


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_reading_many_triangles(tmp_path: Path) -> None:
    """A million triangles without area are refused, and a mesh of a quarter million is read and is closed."""
    flat = np.zeros((1_000_000, 3), dtype=np.intp)
    (tmp_path / "flat.stl").write_bytes(binary_stl(CUBE, flat))
    with pytest.raises(ccm_opt.ProblemError, match="1000000 of 1000000 triangles have zero area"):
        repaired_mesh(read_mesh_file(tmp_path / "flat.stl"))
    around = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    big, small = (grid.ravel() for grid in np.meshgrid(around, around, indexing="ij"))
    beside = 1.0 + 0.3 * np.cos(small)
    torus = np.column_stack((beside * np.cos(big), beside * np.sin(big), 0.3 * np.sin(small)))
    cells = np.arange(360 * 360).reshape(360, 360)
    right = np.roll(cells, -1, axis=0)
    corners = [cells, right, np.roll(right, -1, axis=1), np.roll(cells, -1, axis=1)]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))
    (tmp_path / "torus.stl").write_bytes(binary_stl(torus, faces))
    mended = repaired_mesh(read_mesh_file(tmp_path / "torus.stl"))
    assert (len(mended.faces), is_closed(mended), mended.mended) == (len(faces), True, ())
