"""Scans as obstacles: points of files are read, thinned without losing any, and kept clear of."""

import io
import struct
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import ccm_opt
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import load_problem, problem_from_mapping
from ccm_opt.io.scans import read_scan
from ccm_opt.scene.bodies import MeshBody
from ccm_opt.scene.point_clouds import ball_surfaces, thin_points
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.wall_clearance import edges_of

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 0.125, -4.5], [1e-3, 7.0, 0.0], [0.5, -1.25, 2.5]])
_HEAD = "FIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA {}\n"


def npy(points: FloatArray) -> bytes:
    """Return points as the bytes of an NPY file."""
    file = io.BytesIO()
    np.save(file, points)
    return file.getvalue()


def pcd(kind: str) -> bytes:
    """Return the points with an intensity as the bytes of a PCD file, text or binary."""
    rows = np.column_stack((POINTS, np.arange(4.0)))
    head = ("# .PCD v0.7\nVERSION 0.7\n" + _HEAD.format(kind)).encode()
    if kind == "ascii":
        return head + "\n".join(" ".join(map(repr, row)) for row in rows.tolist()).encode()
    return head + b"".join(struct.pack("<4f", *row) for row in rows.tolist())


def ply(encoding: str) -> bytes:
    """Return the points as the bytes of a PLY file as trimesh writes it."""
    cloud: Any = trimesh.PointCloud(POINTS)  # type: ignore[no-untyped-call]
    return bytes(cloud.export(file_type="ply", encoding=encoding))


def rows(separator: str) -> bytes:
    """Return the points with a colour as lines of text."""
    return ("# x y z r\n" + "\n".join(separator.join(map(repr, [*row, 255])) for row in POINTS.tolist())).encode()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.npy", npy(POINTS)),
        ("a.xyz", rows(" ")),
        ("a.csv", rows(",")),
        ("a.txt", rows("; ")),
        ("a.ply", ply("binary")),
        ("a.PLY", ply("ascii")),
        ("a.pcd", pcd("ascii")),
        ("a.pcd", pcd("binary")),
    ],
)
def test_every_format_gives_the_same_points(name: str, content: bytes, tmp_path: Path) -> None:
    """The points are read in their order, whatever else the rows have."""
    (tmp_path / name).write_bytes(content)
    scan = read_scan(tmp_path / name)
    np.testing.assert_allclose(scan.points, POINTS, rtol=1e-6)
    assert scan.spacing == pytest.approx(2.55, abs=2.1)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.npy", b"\x93NUMPY", "NPY"),
        ("a.npy", npy(POINTS[:, :2]), "at least three numbers"),
        ("a.xyz", b"1 2\n3 4\n", "at least three numbers"),
        ("a.npy", npy(POINTS[:0]), "no points"),
        ("a.npy", npy(np.array([[0.0, np.nan, 1.0]])), "not finite"),
        ("a.npy", npy(np.array([[0.0, 1e12, 1.0]])), "at most 1e"),
        ("a.npy", npy(np.array([["a", "b", "c"]])), "array of numbers"),
        ("a.xyz", b"1 2 3\n3 4\n", "rows of numbers"),
        ("a.xyz", b"one two three\n", "rows of numbers"),
        ("a.csv", b"0,4512;0,05;0,1\n", "decimal commas"),
        ("a.csv", b"# x y z\n0,4512 0,05 0,1\n", "decimal commas"),
        ("a.npy", npy(np.ones((3, 40))), "transpose it"),
        ("a.pcd", b"VERSION 0.7\n", "header"),
        ("a.pcd", pcd("binary")[:-3], "truncated"),
        ("a.pcd", pcd("ascii").replace(b"POINTS 4", b"POINTS 5"), "announces 5"),
        ("a.pcd", _HEAD.format("binary_compressed").encode(), "save it as binary"),
        ("a.pcd", pcd("ascii").replace(b"DATA", b"VIEWPOINT 0 0 1 1 0 0 0\nDATA"), "VIEWPOINT is 0 0 1 1 0 0 0"),
        ("a.pcd", pcd("ascii").replace(b"FIELDS x y z", b"FIELDS u v w"), "fields x, y and z"),
        ("a.las", b"LASF", "las"),
    ],
)
def test_a_broken_scan_is_one_clear_error(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    """The file is named with what is wrong."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ProblemError, match=words) as refusal:
        read_scan(tmp_path / name)
    assert name in str(refusal.value)


@pytest.mark.parametrize("content", [pcd("ascii").replace(b"DATA", b"VIEWPOINT 0 0 0 1.0 0 0 0\nDATA")])
def test_a_viewpoint_that_changes_nothing_is_read(content: bytes, tmp_path: Path) -> None:
    """Most programs write the identity."""
    (tmp_path / "a.pcd").write_bytes(content)
    np.testing.assert_allclose(read_scan(tmp_path / "a.pcd").points, POINTS, rtol=1e-6)


LEVEL = POINTS * [1.0, 1.0, 0.0]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.npy", npy(LEVEL[:, :2])),
        ("a.npy", npy(LEVEL + np.array([0.0, 0.0, 1.5]))),
        ("a.csv", b"# x,y\n" + b"\n".join(b"%r,%r" % (x, y) for x, y, _ in LEVEL.tolist())),
    ],
)
def test_points_in_the_plane_are_pairs_or_of_one_height(name: str, content: bytes, tmp_path: Path) -> None:
    """A height that all points share is dropped."""
    (tmp_path / name).write_bytes(content)
    np.testing.assert_array_equal(read_scan(tmp_path / name, 2).points, LEVEL[:, :2])


def test_points_of_several_heights_are_not_flattened(tmp_path: Path) -> None:
    """A scan in space is no scan in the plane: the heights are told."""
    (tmp_path / "a.npy").write_bytes(npy(POINTS))
    with pytest.raises(ProblemError, match=r"-4\.5 to 2\.5 high"):
        read_scan(tmp_path / "a.npy", 2)


@given(
    points=st.integers(2, 3).flatmap(
        lambda d: arrays(np.float64, st.tuples(st.integers(1, 60), st.just(d)), elements=st.floats(-10.0, 10.0))
    ),
    spread=st.floats(1e-3, 20.0) | st.just(0.0) | st.just(1e-8),
)
def test_thinned_points_cover_all(points: FloatArray, spread: float) -> None:
    """Every point is within the stated distance of one that stays, and that is no more than was allowed."""
    kept, covered = thin_points(points, spread)
    apart = np.linalg.norm(points[:, None] - kept[None], axis=2).min(axis=1)
    assert covered <= spread
    assert apart.max() <= covered * (1.0 + 1e-12) + 1e-15
    assert len(kept) <= len(points)


@given(points=arrays(np.float64, st.tuples(st.integers(1, 8), st.just(3)), elements=st.floats(-10.0, 10.0)))
def test_balls_are_drawn_within_themselves(points: FloatArray) -> None:
    """The octahedron of every ball lies in the ball and has its volume of 4/3 r³."""
    vertices, faces = ball_surfaces(points, 0.5)
    apart = np.linalg.norm(vertices.reshape(-1, 6, 3) - points[:, None], axis=2)
    np.testing.assert_allclose(apart, 0.5, rtol=1e-9)
    corners = vertices[faces].reshape(len(points), 8, 3, 3) - points[:, None, None]
    np.testing.assert_allclose(np.linalg.det(corners).sum(axis=1) / 6.0, 4.0 / 3.0 * 0.125, rtol=1e-6)


PROBLEM = """\
schema = 1
space = 3
name = "scanned"
units = "mm"

[workspace]
bounds = [[-300, -500, -500], [900, 500, 500]]
clearance = 2

[[workspace.obstacles]]
name = "gallery"
points = "gallery.npy"
point_radius = 6
error = 1
scale = 1000
pose = { position = [20, 0, 0] }

[arm]
links = 12
link_length = 50
radius = 10
base = { position = [0, 0, 0], direction = [1, 0, 0], up = [0, 0, 1] }
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
position = [330, 290, 40]
"""


def gallery() -> FloatArray:
    """Return points sampled from the surface of two posts [m]."""
    posts = [trimesh.creation.box((0.1, 0.1, 0.4)), trimesh.creation.cylinder(0.06, 0.5)]
    posts[0].apply_translation((0.3, 0.12, 0.0))
    posts[1].apply_translation((0.25, -0.2, 0.1))
    return np.concatenate([trimesh.sample.sample_surface(post, 8000, seed=3)[0] for post in posts])


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_a_plan_keeps_clear_of_every_point_of_a_scan(tmp_path: Path) -> None:
    """Solved, swept by all points that were read, and checked from the folder alone, which has a copy of the scan."""
    (tmp_path / "gallery.npy").write_bytes(npy(gallery()))
    (tmp_path / "problem.toml").write_text(PROBLEM)
    problem = load_problem(tmp_path / "problem.toml")
    ((_, _, body),) = problem.workspace.meshes
    assert body.balls is not None
    assert body.triangles_read == 16000
    assert body.balls.error == pytest.approx(1e-3)
    assert 0.0 < body.balls.spread <= 3e-3
    plan = ccm_opt.solve(problem)
    points = gallery() + np.array([0.02, 0.0, 0.0])
    for joints in problem.arm.joint_positions_at(plan.trajectory.positions[::5]):
        axis = np.diff(joints, axis=0)
        apart = points[:, None] - joints[:-1]
        share = np.clip(np.einsum("pkd,kd->pk", apart, axis) / np.sum(axis**2, axis=1), 0.0, 1.0)
        nearest = np.linalg.norm(apart - share[..., None] * axis, axis=2).min()
        assert nearest >= 0.010 + 0.006 + 0.001 + 0.002 - 1e-6
    ccm_opt.save(plan, tmp_path / "out")
    (tmp_path / "gallery.npy").unlink()
    assert check_folders([tmp_path / "out"]) == 0


def test_points_that_are_far_apart_are_reported(tmp_path: Path) -> None:
    """Balls that leave gaps between the points of a surface are noted, since a thin arm would pass through it."""
    (tmp_path / "gallery.npy").write_bytes(npy(gallery()))
    (tmp_path / "problem.toml").write_text(PROBLEM.replace("point_radius = 6\nerror = 1", "point_radius = 0.2"))
    ((_, _, body),) = load_problem(tmp_path / "problem.toml").workspace.meshes
    assert "raise point_radius" in body.notes[0]
    assert " mm apart" in body.notes[0]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("point_radius = 6\n", "", "point_radius"),
        ("point_radius = 6", "point_radius = 0", "greater than 0"),
        ("error = 1", "error = -1", "error"),
        ("error = 1", "solid = true", "solid"),
        ("points = ", "mesh = ", "point_radius"),
        ("[20, 0, 0]", "[5000, 0, 0]", "points"),
    ],
)
def test_keys_of_scans_are_checked(before: str, after: str, words: str, tmp_path: Path) -> None:
    """A scan needs a radius, and has no inside; other bodies have no radius of points."""
    (tmp_path / "gallery.npy").write_bytes(npy(gallery()))
    (tmp_path / "problem.toml").write_text(PROBLEM.replace(before, after))
    with pytest.raises(ProblemError, match=words):
        load_problem(tmp_path / "problem.toml")


@settings(max_examples=20)
@given(points=arrays(np.float64, (5, 3), elements=st.floats(-1.0, 1.0)), radius=st.floats(0.01, 0.1))
def test_a_scan_made_in_python_is_that_of_its_file(points: FloatArray, radius: float) -> None:
    """The bytes kept with the body are those of an NPY file with the points."""
    body = MeshBody.of_points(points, radius=radius)
    np.testing.assert_array_equal(np.load(io.BytesIO(body.content)), points)
    assert body.rounding <= 1.5 * radius + 1e-12
    with pytest.raises(ProblemError, match="radius"):
        MeshBody.of_points(points, radius=0.0)


PLANE = """\
schema = 1
name = "scanned floor"
units = "mm"

[workspace]
bounds = [-300, -500, 900, 500]
clearance = 2

[[workspace.obstacles]]
name = "gallery"
points = "gallery.npy"
point_radius = 6
error = 1
scale = 1000
pose = { position = [20, 0], rotation_deg = 90 }

[arm]
links = 8
link_length = 60
radius = 10
base = [0, 0]
joint_limit_deg = 60

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
position = [300, 290]
"""


def floor() -> FloatArray:
    """Return points on the outlines of a post and a wall, turned by minus 90 degrees [m]."""
    turns = np.linspace(0.0, 2.0 * np.pi, 200)
    post = [0.24, 0.17] + 0.06 * np.column_stack((np.cos(turns), np.sin(turns)))
    wall = np.column_stack((np.linspace(0.3, 0.7, 300), np.full(300, -0.2)))
    return np.asarray(np.concatenate((post, wall)) @ np.array([[0.0, -1.0], [1.0, 0.0]]))


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_a_plan_keeps_clear_of_every_point_of_a_scan_in_the_plane(tmp_path: Path) -> None:
    """Solved, swept by all points that were read, and checked from the folder alone."""
    (tmp_path / "gallery.npy").write_bytes(npy(floor()))
    (tmp_path / "problem.toml").write_text(PLANE)
    problem = load_problem(tmp_path / "problem.toml")
    plan = ccm_opt.solve(problem)
    points = shapely.points(floor() @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [0.02, 0.0])
    for joints in problem.arm.joint_positions_at(plan.trajectory.positions[::5]):
        nearest = shapely.distance(points, shapely.LineString(joints)).min()
        assert nearest >= 0.010 + 0.006 + 0.001 + 0.002 - 1e-6
    ccm_opt.save(plan, tmp_path / "out")
    (tmp_path / "gallery.npy").unlink()
    assert check_folders([tmp_path / "out"]) == 0


TENTHS_OF_MILLIMETRES = st.integers(-10_000, 10_000).map(lambda number: 1e-4 * number)
"""Coordinates between -1 and 1 m; distances of lines that are nearly points make shapely divide by zero."""


@given(
    points=arrays(np.float64, st.tuples(st.integers(1, 12), st.just(2)), elements=TENTHS_OF_MILLIMETRES, unique=True),
    radius=st.floats(1e-3, 0.3),
    line=arrays(np.float64, (2, 2), elements=TENTHS_OF_MILLIMETRES, unique=True),
)
def test_points_are_as_near_as_circles(points: FloatArray, radius: float, line: FloatArray) -> None:
    """Planner, verifier and shapely measure several points as they measure circles, one by one."""
    room = shapely.box(-3.0, -3.0, 3.0, 3.0)
    cloud = Workspace(room, (Obstacle("scan", PlaneShape(shapely.MultiPoint(points), radius)),))
    discs = Workspace(room, tuple(Obstacle(f"{k}", PlaneShape(shapely.Point(p), radius)) for k, p in enumerate(points)))
    one, other = cloud.flat_walls, discs.flat_walls
    np.testing.assert_array_equal(one.edges, other.edges)
    np.testing.assert_array_equal(np.unique(one.vertices, axis=0), np.unique(other.vertices, axis=0))
    np.testing.assert_array_equal(edges_of(cloud)[0], edges_of(discs)[0])
    np.testing.assert_array_equal(edges_of(cloud)[1], edges_of(discs)[1])
    chord = shapely.LineString(line)
    assert cloud.apart(chord)[0] == discs.apart(chord)[:-1].min()
    around = cloud.obstacles[0].outline(0.01)
    assert all(shapely.covers(around, shapely.buffer(shapely.Point(p), radius + 0.01)) for p in points)


def test_a_scan_in_the_plane_is_written_and_read_again(tmp_path: Path) -> None:
    """The record of a plan has the discs themselves, which are not thinned once more; the user is told what was."""
    (tmp_path / "gallery.npy").write_bytes(npy(floor()))
    (tmp_path / "problem.toml").write_text(PLANE)
    problem = load_problem(tmp_path / "problem.toml")
    (obstacle,) = problem.workspace.obstacles
    scan = cast("PlaneShape", obstacle.shape).scan
    assert scan is not None
    assert scan.points_read == 500 > shapely.get_num_geometries(obstacle.core)
    assert obstacle.rounding == pytest.approx(0.007 + scan.radii.spread)
    data = problem_data(problem)
    assert problem_data(problem_from_mapping(data)) == data


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("point_radius = 6\n", "", "point_radius"),
        ('"gallery.npy"', "[[1, 2], [3]]", "a point .x, y.; .1."),
        ('"gallery.npy"', "[]", "path of a scan"),
        ('"gallery.npy"', "[[1, 2], [3, 4]]", "scale or move the points themselves"),
        ('"gallery.npy"', '"none.npy"', "does not exist"),
        ("points = ", "mesh = ", "mesh"),
        ("[20, 0]", "[5000, 0]", "outside the workspace.*pose.position"),
        ("[20, 0]", "[-300, -170]", "inside 'gallery'"),
    ],
)
def test_keys_of_scans_in_the_plane_are_checked(before: str, after: str, words: str, tmp_path: Path) -> None:
    """Points need a radius; those in the problem file are taken as they are; the base is clear of them."""
    (tmp_path / "gallery.npy").write_bytes(npy(floor()))
    (tmp_path / "problem.toml").write_text(PLANE.replace(before, after))
    with pytest.raises(ProblemError, match=words):
        load_problem(tmp_path / "problem.toml")
