"""What the command line tells of meshes, and that nothing is written where one cannot be used."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.cli.compare.suites import shared_folder
from ccm_opt.cli.loading import mesh_data, mesh_lines
from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.problem import Problem
from ccm_opt.scene.bodies import BOX_FACES, MeshBody
from tests.space_files import CUBE, binary_stl, model_3mf, object_3mf, three_mf, written


def read(file: Path) -> tuple[Problem, MeshBody]:
    """A problem and its mesh."""
    problem = ccm_opt.load_problem(file)
    assert problem.dimension == 3
    body = problem.workspace.obstacles[0].body
    assert isinstance(body, MeshBody)
    return problem, body


def test_what_is_told_of_a_mesh(tmp_path: Path) -> None:
    """Triangles, size, place, whether it is closed and what was mended, in the file's unit."""
    faces = np.concatenate((BOX_FACES, BOX_FACES[:1]))
    file = written(tmp_path, binary_stl(faces=faces), extra="scale = 500")
    file.write_text(file.read_text().replace("space = 3", 'space = 3\nunits = "mm"').replace("2.0", "2e3"))
    problem, body = read(file)
    assert list(mesh_lines("part", body, problem)) == [
        "part: part.stl, 13 triangles, 500 × 500 × 500 mm, from (0, 0, 0) to (500, 500, 500) mm, closed",  # noqa: RUF001
        "  repaired: left out 1 repeated triangle",
    ]
    told = mesh_data("part", body)
    assert (told["triangles_read"], told["triangles"], told["closed"]) == (13, 12, True)
    json.dumps(told)


def test_a_mesh_with_a_hole_is_told_to_be_open(tmp_path: Path) -> None:
    """Of a mesh that is not closed the open edges are told, and of one that is no solid that its surface counts."""
    content = binary_stl(faces=BOX_FACES[1:])
    problem, body = read(written(tmp_path, content))
    told = next(iter(mesh_lines("part", body, problem)))
    assert "not closed: it has 3 open edges, one near (0.000, 0.500, 0.000) m" in told
    problem, body = read(written(tmp_path, content, extra="solid = false"))
    assert "surface only (solid = false)" in next(iter(mesh_lines("part", body, problem)))


def in_millimetres(folder: Path, name: str, content: bytes, extra: str = "") -> tuple[list[str], FloatArray]:
    """What is told of a mesh in a problem of millimetres besides its first line, and its size in metres."""
    file = written(folder, content, name, extra)
    file.write_text(file.read_text().replace("space = 3", 'space = 3\nunits = "mm"').replace("2.0", "2e3"))
    problem, body = read(file)
    data = problem_data(problem, [name])
    again = problem_from_mapping(data, folder=folder)
    assert again.dimension == 3
    assert np.allclose(again.workspace.triangle_soup.triangles, problem.workspace.triangle_soup.triangles, rtol=1e-12)
    return list(mesh_lines("part", body, problem))[1:], np.ptp(body.vertices, axis=0)


def test_the_unit_of_3mf_is_used_and_told(tmp_path: Path) -> None:
    """Without a scale a cube of one inch has 25.4 mm; with another scale both are told, with its own nothing."""
    cube = three_mf(model_3mf(object_3mf(), '<item objectid="1"/>', 'unit="inch"'))
    told, size = in_millimetres(tmp_path, "part.3mf", cube)
    assert (told, size.tolist()) == (["  one unit of the file is 25.4 mm"], pytest.approx([0.0254] * 3))
    told, size = in_millimetres(tmp_path, "part.3mf", cube, "scale = 1")
    assert told == ["  one unit of the file is 25.4 mm, but scale = 1 sets it to 1 mm"]
    assert size == pytest.approx([0.001] * 3)
    assert in_millimetres(tmp_path, "part.3mf", cube, "scale = 25.4")[0] == []


def test_unit_and_axes_of_glb_are_told(tmp_path: Path) -> None:
    """GLB counts in metres with y up; it is taken as it stands, which is told until keys say what is meant."""
    bar = bytes(trimesh.Trimesh(CUBE * [0.5, 1.0, 1.5], BOX_FACES, process=False).export(file_type="glb"))
    told, size = in_millimetres(tmp_path, "part.glb", bar)
    assert [line.split(",")[0] for line in told] == ["  GLB files are in metres", "  GLB files have y up"]
    assert size == pytest.approx([5e-4, 1e-3, 1.5e-3])
    told, size = in_millimetres(tmp_path, "part.glb", bar, 'scale = 1000\nup = "y"')
    assert (told, size.tolist()) == ([], pytest.approx([0.5, 1.5, 1.0]))
    assert in_millimetres(tmp_path, "part.glb", bar, 'scale = 1000\nup = "z"')[0] == []


@pytest.mark.parametrize("name", ["part.obj", "part.stl"])
def test_up_turns_y_to_z(tmp_path: Path, name: str) -> None:
    """Of whichever format, the top of a mesh whose y is up is the top of the obstacle, and no corner is mirrored."""
    cube = trimesh.Trimesh(CUBE * [1.0, 2.0, 3.0], BOX_FACES, process=False).export(file_type=name[-3:])
    _, body = read(written(tmp_path, cube.encode() if isinstance(cube, str) else bytes(cube), name, 'up = "y"'))
    assert body.vertices.min(axis=0) == pytest.approx([0.0, -3.0, 0.0])
    assert body.vertices.max(axis=0) == pytest.approx([1.0, 0.0, 2.0])
    assert trimesh.Trimesh(body.vertices, body.faces).volume == pytest.approx(6.0)


@pytest.mark.parametrize("command", ["solve", "pose", "reach", "describe"])
def test_a_broken_mesh_ends_every_command_without_a_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    """Exit code 2, one line with key and line of the file, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, binary_stl(np.where(CUBE > 0.5, np.nan, CUBE)))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        app([command, "problem.toml"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert "line 11: workspace.obstacles[0].mesh: part.stl:" in told
    assert "Traceback" not in told
    assert sorted(tmp_path.rglob("*")) == before


def test_problems_in_space_are_copied_with_their_meshes(tmp_path: Path) -> None:
    """A problem in space that comes along is copied with its meshes, byte for byte, and the copy is read."""
    with pytest.raises(SystemExit) as ended:
        app(["problems", "space/wing-box", "--out", str(tmp_path)])
    assert not ended.value.code
    names = {"wing-box.toml", "wing-lower-skin.stl", "wing-rib-1.stl", "wing-rib-2.stl"}
    assert {file.name for file in tmp_path.iterdir()} == names
    problem = ccm_opt.load_problem(tmp_path / "wing-box.toml")
    assert problem.dimension == 3
    original = ccm_opt.load_problem(shared_folder() / "space" / "wing-box.toml")
    assert original.dimension == 3
    assert np.array_equal(problem.workspace.triangle_soup.triangles, original.workspace.triangle_soup.triangles)
