"""Solids of STEP files as obstacles: places and sizes, parts by name, and what their triangles leave out."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.problem_data import problem_data, stored_meshes
from ccm_opt.io.reading import load_problem, problem_from_mapping
from ccm_opt.io.step import step_parts
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.distances.insides import depth_inside

pytest.importorskip("cascadio")
STAND = Path(__file__).parent / "data" / "stand.step"
"""A plate of 200 by 20 by 20 mm, on it a post of radius 15 mm, and about it two rings, of radii 60 and 8 mm."""
PROBLEM = """\
schema = 1
space = 3
name = "stand"
units = "mm"

[workspace]

[[workspace.obstacles]]
name = "rings"
mesh = "stand.step"
parts = ["ring"]
curve_tolerance = 0.5

[[workspace.obstacles]]
name = "the rest"
mesh = "stand.step"
parts = ["plate", "post"]
error = 1

[arm]
links = 4
link_length = 60
radius = 5
base = { position = [-300, 0, 0] }
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
position = [-80, 50, 0]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the stand and a problem that has it."""
    (tmp_path / "stand.step").write_bytes(STAND.read_bytes())
    (tmp_path / "problem.toml").write_text(PROBLEM)
    return tmp_path


def distances(name: str, points: FloatArray) -> FloatArray:
    """Distances of points, shape (n, 3) [m], from the true surface of a part of the stand, negative inside."""
    if name == "plate":
        apart = np.abs(points - [0.0, 0.0, -0.09]) - [0.1, 0.01, 0.01]
        return np.asarray(np.max(apart, axis=1))
    across = np.hypot(points[:, 0], points[:, 1])
    if name == "post":
        return np.maximum(across - 0.015, np.abs(points[:, 2]) - 0.08)
    height = np.minimum(np.abs(points[:, 2]), np.abs(points[:, 2] - 0.05))
    return np.hypot(across - 0.06, height) - 0.008


@settings(max_examples=5, deadline=None)
@given(tolerance=st.floats(2e-4, 4e-3), weights=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
def test_triangles_are_within_the_tolerance_of_the_solids(tolerance: float, weights: list[float]) -> None:
    """Any point of any triangle of every part is near the surface that the solid is known to have."""
    shares = (np.array(weights) + 1e-9) / (np.sum(weights) + 3e-9)
    parts = step_parts(STAND.read_bytes(), tolerance)
    assert sorted(part.name for part in parts) == ["plate", "post", "ring", "ring"]
    for part in parts:
        points = np.einsum("fij,i->fj", part.mesh.vertices[part.mesh.faces], shares)
        assert np.abs(distances(part.name, points)).max() <= tolerance


def test_parts_named_like_numbered_ones_keep_their_names() -> None:
    """Two parts "bolt" are told apart from parts "bolt_1"."""
    content = STAND.read_bytes()
    for name, other in ((b"'plate'", b"'bolt'"), (b"'post'", b"'bolt'"), (b"'ring'", b"'bolt_1'")):
        content = content.replace(name, other)
    parts = step_parts(content, 1e-3)
    rings = [part.name for part in parts if np.abs(distances("ring", part.mesh.vertices)).max() <= 1e-3]
    assert rings == ["bolt_1", "bolt_1"]
    assert [part.name for part in parts].count("bolt") == 2


def test_parts_are_obstacles_that_grow_by_what_may_be_missing(folder: Path) -> None:
    """Each table has its parts, closed, in metres, with tolerance and error as margin, and says what it leaves out."""
    problem = load_problem(folder / "problem.toml")
    rings, rest = (body for _, _, body in problem.workspace.meshes)
    assert rings.closed
    assert rest.closed
    assert len(rings.shells.closed) == 2
    np.testing.assert_allclose(np.ptp(rings.vertices, axis=0), [0.136, 0.136, 0.066], atol=1e-3)
    assert rings.rounding == pytest.approx(5e-4)
    assert rest.rounding == pytest.approx(1.25e-3)
    assert any("'plate', 'post'" in note for note in rings.notes)
    assert depth_inside(rest, np.array([0.0, 0.0, 0.0])) == pytest.approx(0.015 + 1.25e-3, abs=2.5e-4)


def test_a_plan_is_checked_with_the_triangles_that_it_was_made_with(folder: Path) -> None:
    """The record has the triangles and their margin, needs no STEP reader, and gives exactly the same obstacles."""
    problem = load_problem(folder / "problem.toml")
    data = problem_data(problem)
    for name, content in stored_meshes(problem).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    again = problem_from_mapping(data, folder=folder)
    for (_, _, one), (_, _, other) in zip(problem.workspace.meshes, again.workspace.meshes, strict=True):
        np.testing.assert_array_equal(_sorted(one), _sorted(other))
        assert one.rounding == pytest.approx(other.rounding, rel=1e-12)


def _sorted(body: MeshBody) -> Any:
    rows = body.triangles.reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('["ring"]', '["rim"]', "it has no part 'rim'; its parts are 'plate', 'post', 'ring'"),
        ("error = 1", "scale = 2", "whose unit is known"),
        ('"stand.step"\nparts = ["ring"]', '"stand.stl"\nparts = ["ring"]', "only allowed with a STEP file"),
        ('"stand.step"\nparts = ["ring"]', '"broken.step"', "broken.step: not readable as STEP"),
        ("[-300, 0, 0]", "[0, 0, 0]", r"16\.\d+ mm inside 'the rest'"),
    ],
)
def test_defects_are_named(
    before: str, after: str, words: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Unknown parts, keys of other formats and damaged files are errors of one line each."""
    (folder / "broken.step").write_bytes(STAND.read_bytes()[:3000])
    (folder / "problem.toml").write_text(PROBLEM.replace(before, after))
    with pytest.raises(ProblemError, match=words):
        load_problem(folder / "problem.toml")
    assert capfd.readouterr() == ("", "")


def test_a_missing_reader_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the extra, the message says what to install."""
    step_parts.cache_clear()
    monkeypatch.setitem(sys.modules, "cascadio", None)
    with pytest.raises(ProblemError, match="pip install cascadio"):
        load_problem(folder / "problem.toml")
