"""How deep places lie inside bodies, against closed formulas."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.io.mesh_obstacles import repaired_mesh
from ccm_opt.io.raw_mesh import RawMesh
from ccm_opt.scene.bodies import (
    BOX_FACES,
    BoxBody,
    CapsuleBody,
    CylinderBody,
    MeshBody,
    RigidPlacement,
    SphereBody,
    box_corners,
)
from ccm_opt.scene.distances.enclosures import deepest_enclosure, widest_opening
from ccm_opt.scene.distances.insides import depth_inside, distance_from_triangles, encloses
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.verification.body_sides import depth_enclosed
from tests.space_files import written

PLACES = st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3).map(np.array)


def cube_depth(point: FloatArray) -> float:
    """Depth in the cube from −1 to 1."""
    beyond = np.abs(point) - 1.0
    return float(-beyond.max() if beyond.max() <= 0.0 else -np.linalg.norm(np.maximum(beyond, 0.0)))


@given(point=PLACES)
def test_boxes_and_closed_meshes(point: FloatArray) -> None:
    """A place is as deep in a box as its nearest side is far; so it is in a mesh, whichever way its triangles turn."""
    low = -np.ones(3)
    expected = pytest.approx(cube_depth(point), abs=1e-9)
    assert depth_inside(BoxBody(low, -low), point) == expected
    corners = box_corners(low, -low)
    assert depth_inside(MeshBody(corners, BOX_FACES), point) == expected
    assert depth_inside(MeshBody(corners, BOX_FACES[:, ::-1]), point) == expected
    if min(abs(abs(point) - 1.0)) > 1e-6:  # no ray may start on the surface
        mixed = np.concatenate((BOX_FACES[:5], BOX_FACES[5:, ::-1]))
        assert depth_inside(MeshBody(corners, mixed), point) == expected
    assert depth_inside(MeshBody(corners, BOX_FACES, solid=False), point) == pytest.approx(
        -abs(cube_depth(point)), abs=1e-9
    )


@given(point=PLACES)
def test_round_bodies(point: FloatArray) -> None:
    """Depths in balls and bars are those of their formulas."""
    assert depth_inside(SphereBody(np.ones(3), 0.5), point) == pytest.approx(0.5 - np.linalg.norm(point - 1.0))
    start = np.array([0.0, 0.0, -1.0])
    over_end = abs(point[2]) - 1.0
    beside = float(np.hypot(point[0], point[1]))
    capsule = 0.4 - np.hypot(beside, max(over_end, 0.0))
    assert depth_inside(CapsuleBody(start, -start, 0.4), point) == pytest.approx(capsule)
    outside = np.hypot(max(over_end, 0.0), max(beside - 0.4, 0.0))
    cylinder = -outside if outside > 0.0 else -max(over_end, beside - 0.4)
    assert depth_inside(CylinderBody(start, -start, 0.4), point) == pytest.approx(cylinder, abs=1e-12)


Inside = Callable[[FloatArray], BoolArray]
"""Which of some places, shape (k, 3), are inside of a solid, by its formula."""


def convex(rng: np.random.Generator) -> tuple[FloatArray, Inside]:
    """A box, ball or prism somewhere, and its half-spaces."""
    box = trimesh.creation.box(rng.uniform(0.2, 1.0, 3))
    ball = trimesh.creation.icosphere(int(rng.integers(0, 3)), rng.uniform(0.15, 0.5))
    prism = trimesh.creation.cylinder(rng.uniform(0.1, 0.4), rng.uniform(0.2, 1.0), sections=int(rng.integers(3, 20)))
    made = (box, ball, prism)[rng.integers(3)]
    made.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    made.apply_translation(rng.uniform(-0.3, 0.3, 3))
    normals = np.asarray(made.face_normals)
    triangles = np.asarray(made.triangles)
    heights = np.einsum("ij,ij->i", normals, triangles[:, 0])
    return triangles, lambda places: np.asarray(np.all(places @ normals.T < heights, axis=1))


def box_at(low: FloatArray, high: FloatArray) -> tuple[FloatArray, Inside]:
    """A box, its sides along the axes."""
    triangles = box_corners(low, high)[BOX_FACES]
    return triangles, lambda places: np.asarray(np.all((places > low) & (places < high), axis=1))


def crossing_bodies(rng: np.random.Generator) -> list[tuple[FloatArray, Inside]]:
    """Two or three bodies that overlap, none of them inside of another."""
    while True:
        bodies = [convex(rng) for _ in range(rng.integers(2, 4))]
        if not any(np.all(inside(t[:, 0])) for t, _ in bodies for _, inside in bodies):
            return bodies


def touching_bodies(rng: np.random.Generator) -> list[tuple[FloatArray, Inside]]:
    """Some of the eight cells of a grid: boxes with faces, edges or corners in common."""
    cells = np.argwhere(rng.random((2, 2, 2)) < 0.6)
    cells = cells if len(cells) else np.zeros((1, 3))
    return [box_at(0.5 * cell, 0.5 * cell + 0.5) for cell in cells]


def a_box_in_the_corner_of_another(rng: np.random.Generator) -> list[tuple[FloatArray, Inside]]:
    """Two boxes that have three faces in one plane each."""
    size = rng.uniform(0.5, 1.0, 3)
    return [box_at(np.zeros(3), size), box_at(np.zeros(3), rng.uniform(0.3, 0.8, 3) * size)]


def split_on_one_side(triangles: FloatArray, rng: np.random.Generator, *, flat: bool) -> FloatArray:
    """Cut some triangles at a place of one edge, which its neighbour does not know of; or joined by a flat triangle."""
    chosen = rng.random(len(triangles)) < 0.3
    a, b, c = np.moveaxis(np.roll(triangles[chosen], rng.integers(3), axis=1), 1, 0)
    cut = a + rng.uniform(0.1, 0.9, (len(a), 1)) * (b - a)
    cut = cut.astype(np.float32).astype(np.float64)
    parts = [(a, cut, c), (cut, b, c), *([(a, b, cut)] if flat else [])]
    return np.concatenate((triangles[~chosen], *(np.stack(part, axis=1) for part in parts)))


def off_by_a_bit(triangles: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Change each coordinate of each corner by the last bit of single precision, or by less where it is zero."""
    single = triangles.astype(np.float32)
    way = rng.integers(-1, 2, triangles.shape).astype(np.float32)
    moved = np.where(way == 0.0, single, np.nextafter(single, np.inf * np.where(way == 0.0, 1.0, way)))
    return np.where(single == 0.0, 6e-33 * way, moved).astype(np.float64)


def as_files_have_it(triangles: FloatArray, rng: np.random.Generator, *, may_turn: bool = True) -> FloatArray:
    """Do to a mesh, or not, each of the things that programs do to meshes."""
    triangles = triangles.astype(np.float32).astype(np.float64)
    if rng.random() < 0.5:
        triangles = split_on_one_side(triangles, rng, flat=bool(rng.random() < 0.5))
    if rng.random() < 0.5:
        triangles = off_by_a_bit(triangles, rng)
    if may_turn and rng.random() < 0.5:
        turned = rng.random(len(triangles)) < rng.uniform(0.0, 0.6)
        triangles[turned] = triangles[turned, ::-1]
    if rng.random() < 0.5:
        again = triangles[rng.random(len(triangles)) < 0.2]
        triangles = np.concatenate((triangles, again[:, ::-1] if may_turn and rng.random() < 0.5 else again))
    return triangles[rng.permutation(len(triangles))] if rng.random() < 0.3 else triangles


def as_read(triangles: FloatArray) -> MeshBody:
    """The body that a file with such triangles becomes."""
    mended = repaired_mesh(RawMesh.of_corners(triangles))
    return MeshBody(mended.vertices, mended.faces)


def asked(body: MeshBody, rng: np.random.Generator) -> FloatArray:
    """Places in and about a body that are not on its surface, shape (k, 3) [m]."""
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    places = rng.uniform(low - 0.05, high + 0.05, (20, 3))
    return places[[distance_from_triangles(place, body.triangles) > 1e-5 for place in places]]


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("made", [crossing_bodies, touching_bodies, a_box_in_the_corner_of_another])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_bodies_of_one_file_are_solid_however_they_are_turned(
    made: Callable[[np.random.Generator], list[tuple[FloatArray, Inside]]], seed: int
) -> None:
    """A place is inside of a file's mesh if it is in one of its bodies, which may touch, overlap and be inside out."""
    rng = np.random.default_rng(seed)
    bodies = made(rng)
    turned = [triangles[:, ::-1] if rng.random() < 0.4 else triangles for triangles, _ in bodies]
    body = as_read(as_files_have_it(np.concatenate(turned), rng))
    assert body.closed
    places = asked(body, rng)
    expected = np.any([inside(places) for _, inside in bodies], axis=0)
    assert [encloses(body, place) for place in places] == expected.tolist()
    by_verifier = np.array([depth_enclosed(body.triangles, place) > 0.0 for place in places])
    # Bodies that have corners in common and cancel are one to the verifier, which then says less than the planner.
    assert not np.any(by_verifier & ~expected)
    if made is not a_box_in_the_corner_of_another:
        assert by_verifier.tolist() == expected.tolist()


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_cavity_is_free_and_what_stands_in_it_is_not(seed: int) -> None:
    """Of a ball with a cavity, turned against it, and a ball in that, the walls and the inner ball are solid."""
    rng = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(2, 1.0)
    core = trimesh.creation.icosphere(1, 0.12)
    cavity, in_cavity = box_at(-rng.uniform(0.3, 0.5, 3), rng.uniform(0.3, 0.5, 3))
    triangles = np.concatenate((ball.triangles, cavity[:, ::-1], core.triangles))
    triangles = as_files_have_it(triangles[:, ::-1] if rng.random() < 0.3 else triangles, rng, may_turn=False)
    body = as_read(triangles)
    places = asked(body, rng)

    def in_ball(made: trimesh.Trimesh) -> BoolArray:
        heights = np.einsum("ij,ij->i", made.face_normals, made.triangles[:, 0])
        return np.asarray(np.all(places @ made.face_normals.T < heights, axis=1))

    expected = (in_ball(ball) & ~in_cavity(places)) | in_ball(core)
    assert [encloses(body, place) for place in places] == expected.tolist()
    assert [depth_enclosed(body.triangles, place) > 0.0 for place in places] == expected.tolist()


def test_a_body_in_another_is_solid_unless_it_is_turned_against_it_as_a_whole() -> None:
    """A box in a box is a cavity where it is turned inside out, and wholly inside; else both are solid."""
    outer, _ = box_at(-np.ones(3), np.ones(3))
    inner, _ = box_at(-0.5 * np.ones(3), 0.5 * np.ones(3))
    partly = np.concatenate((inner[:5, ::-1], inner[5:]))
    middle = np.zeros(3)
    for second, expected in ((inner, True), (inner[:, ::-1], False), (partly, True), (inner[:, ::-1] + 0.7, True)):
        body = as_read(np.concatenate((outer, second)))
        assert body.closed
        place = middle if second is not None and np.abs(second).max() < 1.0 else middle + 0.8
        assert encloses(body, place) == expected
        assert (depth_enclosed(body.triangles, place) > 0.0) == expected


@given(height=st.floats(0.02, 1.9), turned=st.lists(st.booleans(), min_size=10, max_size=10))
def test_what_an_open_mesh_goes_round_by_more_than_a_half_is_inside(height: float, turned: list[bool]) -> None:
    """Below the middle of an open box the opening fills 4 asin(a² / (a² + d²)) of 4π; less than a half: inside."""
    lid = np.all(box_corners(-np.ones(3), np.ones(3))[BOX_FACES][..., 2] > 0.0, axis=1)
    corners = box_corners(-np.ones(3), np.ones(3))
    opened = MeshBody(corners, BOX_FACES[~lid])
    mixed = MeshBody(corners, np.where(np.array(turned)[:, None], BOX_FACES[~lid][:, ::-1], BOX_FACES[~lid]))
    place = np.array([0.0, 0.0, 1.0 - height])
    missing = 4.0 * np.arcsin(1.0 / (1.0 + height**2)) / (4.0 * np.pi)
    assert not opened.closed
    assert len(opened.shells.open_edges) == 4
    assert encloses(opened, place) == encloses(mixed, place) == (missing < 0.5)
    assert (depth_enclosed(opened.triangles, place) > 0.0) == (missing < 0.5)
    assert not encloses(opened, place, closed_only=True)


def duct(sides: int, radius: float, turn: FloatArray) -> MeshBody:
    """A prism's sides about the origin, two metres long and open at both ends."""
    angles = 2.0 * np.pi / sides * np.arange(sides)
    ring = radius * np.column_stack((np.cos(angles), np.sin(angles), np.zeros(sides)))
    here, after = np.arange(sides), np.roll(np.arange(sides), -1)
    faces = np.concatenate(
        (np.column_stack((here, after, after + sides)), np.column_stack((here, after + sides, here + sides)))
    )
    up = np.array([0.0, 0.0, 1.0])
    corners = np.concatenate((ring - up, ring + up))
    return MeshBody(RigidPlacement.turned(np.zeros(3), turn).points(corners), faces)


@given(sides=st.integers(3, 40), radius=st.floats(0.05, 0.5), turn=PLACES)
def test_an_arm_may_enter_what_has_an_opening_as_wide(sides: int, radius: float, turn: FloatArray) -> None:
    """What fits into the end of a duct is not refused inside it, and what is thicker than its outer circle is."""
    body = duct(sides, radius, turn)
    inscribed = radius * np.cos(np.pi / sides)
    assert 2.0 * inscribed * (1.0 - 1e-9) <= widest_opening(body) <= 2.0 * radius * (1.0 + 1e-9)
    workspace = Workspace(obstacles=(Obstacle("duct", body),))
    middle = np.zeros((1, 3))
    assert deepest_enclosure(workspace, middle, entering=0.99 * inscribed) is None
    refused = deepest_enclosure(workspace, middle, entering=1.01 * radius)
    assert refused is not None
    assert refused.depth == pytest.approx(inscribed)


def test_a_closed_mesh_has_no_opening() -> None:
    """Nothing enters a box, however thin it is."""
    body = MeshBody(box_corners(-np.ones(3), np.ones(3)), BOX_FACES)
    assert widest_opening(body) == 0.0
    assert deepest_enclosure(Workspace(obstacles=(Obstacle("box", body),)), np.zeros((1, 3)), entering=0.0) is not None


@pytest.mark.parametrize(("width", "closed"), [(1e-8, True), (3e-7, True), (1e-5, False), (1e-3, False)])
def test_only_gaps_within_rounding_are_closed(width: float, closed: bool) -> None:
    """A slit between two halves of a box is closed up to a millionth of its size, and any wider hole stays one."""
    triangles, _ = box_at(np.zeros(3), np.ones(3))
    moved = triangles.copy()
    moved[np.all(triangles[..., 2] > 0.0, axis=1), :, 2] += width
    assert as_read(moved).closed == closed
    # A round hole whose border's vertices are each within rounding of the next is no vertex.
    around = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    rim = np.column_stack((np.cos(around), np.sin(around), np.zeros(400))) * 2e-5
    after = np.roll(rim, -1, axis=0)
    fan = np.stack((after, rim, np.tile([0.0, 0.0, -1.0], (400, 1))), axis=1)
    assert not as_read(fan).closed


def placed_in(folder: Path, triangles: FloatArray, base: str, extra: str = "") -> Path:
    """A problem file with a mesh, whose arm stands straight up at a place."""
    records = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = triangles
    file = written(folder, bytes(80) + len(triangles).to_bytes(4, "little") + records.tobytes(), extra=extra)
    text = file.read_text().replace("bounds = [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]", "")
    text = text.replace("[-1.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0]", base)
    file.write_text(text.replace("[-0.7, 0.1, 0.0]", "[0.6, 0.55, {}]".format("0.65" if "0.3]" in base else "1.45")))
    return file


UNIT, _ = box_at(np.zeros(3), np.ones(3))
BESIDE, _ = box_at(np.array([1.0, 0.0, 0.0]), np.array([2.0, 1.0, 1.0]))
KINDS = {
    "a flat triangle at a T-junction": split_on_one_side(UNIT, np.random.default_rng(3), flat=True),
    "a T-junction": split_on_one_side(UNIT, np.random.default_rng(3), flat=False),
    "the last bit": off_by_a_bit(UNIT, np.random.default_rng(0)),
    "bodies that touch": np.concatenate((UNIT, BESIDE)),
    "bodies that touch, one inside out": np.concatenate((UNIT, BESIDE[:, ::-1])),
    "bodies that overlap, one inside out": np.concatenate((UNIT, 0.8 * UNIT[:, ::-1] + [0.3, 0.15, -0.2])),
    "triangles turned at random": np.concatenate((UNIT[:5], UNIT[5:, ::-1])),
    "a triangle missing, others turned": np.concatenate((UNIT[1:6], UNIT[6:, ::-1])),
}


@pytest.mark.drawn(2)
@pytest.mark.parametrize("kind", KINDS)
def test_an_arm_inside_is_refused_by_name_and_depth(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A base inside ends with code 2, depth and key; as a surface, and from above, the same scene is planned."""
    monkeypatch.chdir(tmp_path)
    inside = "[0.5, 0.5, 0.3], direction = [0.0, 0.0, 1.0], up = [-1.0, 0.0, 0.0]"
    for base, extra, code in (
        (inside, "", 2),
        (inside, "solid = false", 0),
        (inside.replace("0.3]", "1.1]"), "", 0),
    ):
        # As a surface alone, bodies that overlap are walls in the way.
        if extra and "overlap" in kind:
            continue
        placed_in(tmp_path, KINDS[kind], base, extra)
        with pytest.raises(SystemExit) as ended:
            app(["solve", "problem.toml", "--no-pictures", "--out", "runs"])
        told = capsys.readouterr()
        assert ended.value.code == code, told
        if code:
            assert "m inside 'part'" in told.err
            assert "solid = false" in told.err
