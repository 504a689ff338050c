"""Meshes and polygons as bodies on links: capsules that contain them, what they weigh, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.body_covers import Cover, mesh_cover, region_cover
from ccm_opt.io.reading import load_problem
from ccm_opt.robot.link_bodies import SolidMoments

FILE = """
schema = 1
space = 3
name = "camera"
units = "mm"
[workspace]
[arm]
links = 6
link_length = 80
radius = 20
base = { position = [0, 0, 0] }
joint_limit_deg = 60.0
[arm.tool]
tip = [100, 0, 0]
bodies = [{ mesh = "camera.stl", scale = 1.0, pose = { position = [35, 0, 0], rotation_deg = [0, 0, 90] } }]
mass = 0.2
[limits]
velocity = 1.0
acceleration = 2.0
[start]
shape = "straight"
[goal]
position = [400, 200, 100]
"""


def _away(cover: Cover, places: FloatArray) -> float:
    """Greatest distance of places from the capsules of a cover."""
    found = np.full(len(places), np.inf)
    for capsule in cover.capsules:
        line = capsule.end - capsule.start
        share = np.clip((places - capsule.start) @ line / max(line @ line, 1e-300), 0.0, 1.0)
        found = np.minimum(
            found, np.linalg.norm(places - capsule.start - share[:, None] * line, axis=1) - capsule.radius
        )
    return float(found.max())


def _boxes(rng: np.random.Generator) -> tuple[trimesh.Trimesh, FloatArray]:
    """Boxes that overlap, turned as one, and places in them."""
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    boxes, places = [], []
    for _ in range(rng.integers(1, 4)):
        sides, middle = rng.uniform(0.1, 2.0, 3), rng.uniform(-0.5, 0.5, 3)
        boxes.append(trimesh.creation.box(sides).apply_translation(middle).apply_transform(turn))
        inside = np.concatenate((rng.uniform(-0.5, 0.5, (200, 3)), np.zeros((1, 3)))) * sides + middle
        places.append(inside @ turn[:3, :3].T)
    return trimesh.util.concatenate(boxes), np.concatenate(places)


@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_capsules_contain_a_mesh_and_what_it_encloses(seed: int) -> None:
    """Corners of overlapping boxes, and places deep in them, are in the capsules, and so is a margin about them."""
    rng = np.random.default_rng(seed)
    mesh, places = _boxes(rng)
    margin = float(rng.uniform(0.0, 0.1))
    cover = mesh_cover(mesh.vertices, mesh.faces, np.eye(3), margin)
    assert 1 <= len(cover.capsules) <= 8
    assert _away(cover, np.concatenate((mesh.vertices, places))) <= -margin
    assert cover.stands_out >= margin


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_capsules_contain_a_polygon(seed: int) -> None:
    """Corners of a star-shaped polygon, and places in it, are in the capsules."""
    rng = np.random.default_rng(seed)
    count = rng.integers(4, 12)
    # Less than half a turn apart, so that the polygon is simple.
    angles = 2.0 * np.pi / count * (np.arange(count) + rng.uniform(0.0, 0.9, count))
    corners = rng.uniform(0.2, 1.0, (len(angles), 1)) * np.column_stack((np.cos(angles), np.sin(angles)))
    shape = shapely.Polygon(corners)
    places = rng.uniform(-1.0, 1.0, (300, 2))
    cover = region_cover(corners)
    assert _away(cover, np.concatenate((corners, places[shapely.contains_xy(shape, places)]))) <= 0.0


def test_a_disc_takes_one_capsule_hardly_larger_than_itself() -> None:
    """What no cut makes smaller is not cut."""
    disc = region_cover(shapely.get_coordinates(shapely.Point(0.3, 0.2).buffer(1.0, 64))[:-1])
    assert len(disc.capsules) == 1
    assert disc.stands_out < 2e-3


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_moments_of_meshes_and_polygons(seed: int) -> None:
    """Meshes weigh as trimesh says, whichever way they face, and polygons like the boxes that make them up."""
    rng = np.random.default_rng(seed)
    box = trimesh.creation.box(rng.uniform(0.1, 2.0, 3))
    box.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    box.apply_translation(rng.uniform(-1.0, 1.0, 3))
    faces = box.faces[:, ::-1] if rng.random() < 0.5 else box.faces
    found = SolidMoments.of_mesh(box.vertices, faces)
    assert found.volume == pytest.approx(box.volume)
    assert found.centre == pytest.approx(box.center_mass, abs=1e-9)
    assert found.inertia == pytest.approx(box.moment_inertia, abs=1e-9)
    # An angle of two boxes, as deep as the root of its area.
    a, b, c, d = rng.uniform(0.2, 1.0, 4)
    corners = np.array([(0.0, 0.0), (a + c, 0.0), (a + c, b), (a, b), (a, b + d), (0.0, b + d)])
    deep = np.array([0.0, 0.5 * np.sqrt(b * (a + c) + a * d), 0.0])
    parts = [((0.0, 0.0), (a + c, b)), ((0.0, b), (a, b + d))]
    boxes = [SolidMoments.of_box(np.insert(p, 1, 0.0) - deep, np.insert(q, 1, 0.0) + deep) for p, q in parts]
    prism, whole = SolidMoments.of_prism(corners[:: rng.choice((-1, 1))]), SolidMoments.of_all(boxes)
    assert prism.volume == pytest.approx(whole.volume)
    assert prism.centre == pytest.approx(whole.centre, abs=1e-12)
    assert prism.inertia == pytest.approx(whole.inertia, abs=1e-12)


def _camera(folder: Path, text: str = FILE, *, closed: bool = True) -> Path:
    mesh = trimesh.creation.box((40.0, 60.0, 30.0))
    if not closed:
        mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    mesh.export(folder / "camera.stl")
    file = folder / "camera.toml"
    file.write_text(text)
    return file


def test_a_mesh_of_a_tool_is_covered_weighs_and_is_told_of(tmp_path: Path) -> None:
    """Placed, scaled and covered; its moments are those of the solid; a remark says by how much capsules are larger."""
    tool = load_problem(_camera(tmp_path)).arm.tool
    assert tool is not None
    corners = np.array(np.meshgrid((0.005, 0.065), (-0.02, 0.02), (-0.015, 0.015))).reshape(3, -1).T
    assert _away(Cover(tool.bodies, 0.0), corners) <= 0.0
    assert tool.centre == pytest.approx([0.035, 0.0, 0.0])
    sides = np.array([0.06, 0.04, 0.03])
    assert tool.inertia == pytest.approx(0.2 / 12.0 * np.diag((sides**2).sum() - sides**2))
    (words,) = tool.notes
    assert words.startswith("camera.stl, 12 triangles, is covered by ")
    assert words.endswith(" mm")


@pytest.mark.parametrize(
    ("old", "new", "closed", "key"),
    [
        ("mass = 0.2", "mass = 0.2", False, "arm.tool.bodies[0].mesh"),
        ('"camera.stl"', '"lens.stl"', True, "arm.tool.bodies[0].mesh"),
        ('"camera.stl"', '"../camera.stl"', True, "arm.tool.bodies[0].mesh"),
        ('mesh = "camera.stl"', "sphere = { center = [0, 0, 0], radius = 9 }", True, "arm.tool.bodies[0].scale"),
        ("[35, 0, 0]", "[-120, 0, 0]", True, "arm.tool.bodies[0]"),
        ("rotation_deg = [0, 0, 90]", "rotation_deg = [0, 0, 90], quaternion = [1, 0, 0, 0]", True, "quaternion"),
    ],
)
def test_meshes_that_do_not_do_are_refused_by_key(tmp_path: Path, old: str, new: str, closed: bool, key: str) -> None:
    """Open ones that weigh, missing ones, ones elsewhere, keys without a mesh, and ones that touch the arm at rest."""
    file = _camera(tmp_path, FILE.replace(old, new), closed=closed)
    with pytest.raises(ProblemFileError, match=key.replace("[", r"\[").replace("]", r"\]")):
        load_problem(file)


@pytest.mark.planning
def test_a_plan_with_a_mesh_is_checked_without_its_file(tmp_path: Path) -> None:
    """The folder keeps the capsules, the mass and the remark."""
    file = _camera(tmp_path)
    asked = load_problem(file).arm.tool
    solved = CliRunner().invoke(app, ["solve", str(file), "--out", str(tmp_path), "--no-pictures"])
    assert solved.exit_code == 0, solved.output
    assert "arm.tool: camera.stl, 12 triangles, is covered by" in solved.output
    (tmp_path / "camera.stl").unlink()
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "camera")])
    assert checked.exit_code == 0, checked.output
    record = json.loads((tmp_path / "camera" / "solution.json").read_text())
    kept = record["problem"]["arm"]["tool"]
    assert asked is not None
    assert [1e-3 * row["capsule"]["radius"] for row in kept["bodies"]] == pytest.approx(
        [c.radius for c in asked.bodies]
    )
    assert record["covers"][0].startswith("arm.tool: camera.stl")
