"""The output folder of a plan in space: what is in it is what was planned, for every program that reads it."""

import json
import re
import shutil
import subprocess
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import ccm_opt
from ccm_opt.cli.drawing import draw_figures, plan_pictures
from ccm_opt.cli.output import FigureName
from ccm_opt.cli.written_plans import check_folders, exported_files
from ccm_opt.core.errors import ProblemError, UnreachableGoal
from ccm_opt.io.folder import write_solution
from ccm_opt.io.glb import quaternions
from ccm_opt.io.problem_data import stored_meshes
from ccm_opt.io.raw_mesh import MeshSettings
from ccm_opt.io.reading_back import load_any_problem, load_motion
from ccm_opt.io.stl_obj_ply import read_obj
from ccm_opt.problem import TipGoal
from ccm_opt.problem.solution.solution import roll_against
from ccm_opt.robot.frames import revolute_angles
from ccm_opt.scene.bodies import BoxBody, MeshBody, SphereBody
from ccm_opt.scene.surfaces import all_within, sharp_edges, thinned
from ccm_opt.viz.failure_page import failure_html

from .space_arms import random_rotation, turned_arm
from .space_folders import solved


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a plan, with pictures."""
    solution = solved()
    return write_solution(solution, tmp_path_factory.mktemp("space"), plan_pictures(solution))


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The command line, in a process of its own."""
    command = [sys.executable, "-m", "ccm_opt", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_plan_in_space_is_verified_and_followed() -> None:
    """Every check of the verifier holds, the simulated arm follows, and the goal is met in place and direction."""
    solution = solved()
    assert all(check.passed for check in solution.checks)
    assert solution.simulation.verdict.followed
    assert solution.room is not None
    assert solution.room.nearest.gap > 0.0
    errors = solution.goal_errors
    assert errors.position is not None
    assert errors.position < 1e-6
    assert errors.direction is not None
    assert errors.direction < 1e-6


def test_arrays_have_the_shapes_of_the_format(folder: Path) -> None:
    """Bends are pairs, positions have three components, the third revolute of every ball is 0, the feed has a row."""
    links = solved().problem.arm.links
    with np.load(folder / "solution.npz", allow_pickle=False) as arrays:
        samples = len(arrays["time"])
        assert arrays["bend_angles"].shape == (samples, links, 2)
        assert arrays["joint_positions"].shape == (samples, links + 1, 3)
        assert arrays["joint_angles"].shape == (samples, 3 * links)
        assert arrays["base_feed"].shape == (samples,)
        assert arrays["keyframes"].shape[1:] == (links, 2)
        assert not np.any(arrays["joint_angles"][:, 2::3])
        assert np.array_equal(arrays["joint_angles"][:, 0::3], arrays["bend_angles"][:, :, 0])
        assert np.array_equal(arrays["joint_angles"][:, 1::3], arrays["bend_angles"][:, :, 1])
        assert np.max(np.diff(arrays["time"])) <= 5e-3 + 1e-12


def test_the_record_says_how_the_goal_is_met(folder: Path) -> None:
    """The record has the errors of place and direction, the roll that follows, and every mesh with its hash."""
    record = json.loads((folder / "solution.json").read_text())
    assert record["status"] == "solved"
    assert record["goal"]["position_error"] < 1e-6
    assert record["goal"]["direction_error"] < 1e-6
    assert abs(record["goal"]["roll"]) <= np.pi
    [mesh] = record["meshes"]
    assert (folder / mesh["kept"]).is_file()
    assert len(mesh["sha256"]) == 64


def test_a_folder_is_read_back_as_it_was(folder: Path) -> None:
    """Problem and motion come back from the folder alone: the same surfaces, limits and numbers."""
    plan = ccm_opt.load(folder)
    asked = solved().problem
    assert np.array_equal(plan.trajectory.positions, solved().trajectory.positions)
    assert np.allclose(plan.trajectory.velocities, solved().trajectory.velocities, atol=0.0)
    ours = plan.problem.workspace.triangle_soup
    theirs = asked.workspace.triangle_soup
    assert ours.names == theirs.names
    assert np.allclose(np.sort(ours.triangles.ravel()), np.sort(theirs.triangles.ravel()), atol=1e-7)
    assert np.allclose(plan.problem.arm.up, asked.arm.up, atol=1e-15)
    assert np.allclose(plan.problem.limits.velocity, asked.limits.velocity, rtol=1e-15)
    assert isinstance(plan.problem.goal, TipGoal)
    assert len(plan.problem.goal.via) == 1


def test_the_figure_in_space_is_drawn(folder: Path) -> None:
    """It is the plan's own picture under the name that was asked for; figures of the plane are refused by name."""
    (name,) = draw_figures(folder, [FigureName.SPACE], "svg")
    assert name == "space.svg"
    with pytest.raises(ProblemError, match="curves: available in the plane only"):
        draw_figures(folder, [FigureName.CURVES])


def test_check_accepts_a_folder_and_refuses_a_changed_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``ccm-opt check`` holds every file against the motion; a bend, a torque, a mesh that is another is refused."""
    assert check_folders([folder]) == 0
    for name, change in {
        "joint_torques": lambda values: values + 1e-3,
        "simulated_angles": lambda values: values + 1e-3,
        "keyframes": lambda values: values + 0.5,
    }.items():
        copy = tmp_path / name
        shutil.copytree(folder, copy)
        with np.load(copy / "solution.npz", allow_pickle=False) as arrays:
            changed = {key: arrays[key] for key in arrays.files}
        changed[name] = change(changed[name])
        np.savez(copy / "solution.npz", **changed)
        assert check_folders([copy]) == 3
    copy = tmp_path / "model"
    shutil.copytree(folder, copy)
    model = copy / "arm.mjcf.xml"
    model.write_text(model.read_text().replace('type="sphere"', 'type="box"'))
    assert check_folders([copy]) == 3
    capsys.readouterr()


def test_mujoco_replays_the_motion_without_contact(folder: Path) -> None:
    """MuJoCo puts the tip where the plan does, touches nothing on the way, and feels the mesh where it stands."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.mjcf.xml"))
    data = mujoco.MjData(model)
    solution = solved()
    addresses = [model.joint(name).qposadr[0] for name in solution.joints.names]
    feed = model.joint("feed").qposadr[0]
    tip = model.site("tip").id
    points = solution.joint_positions
    for sample in range(0, len(points), 20):
        data.qpos[addresses] = solution.joints.angles[sample]
        data.qpos[feed] = solution.trajectory.base_positions[sample, 0]
        mujoco.mj_fwdPosition(model, data)
        assert data.ncon == 0
        assert np.allclose(data.site_xpos[tip], points[sample, -1], atol=1e-12)


def test_mujoco_feels_a_mesh_through_which_the_arm_would_go(folder: Path) -> None:
    """Bent aside into the mesh, which is no convex hull but its triangles, the arm is in contact."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.mjcf.xml"))
    data = mujoco.MjData(model)
    # Straight, the arm is turned until its tip meets the side of the mesh at y = −0.7.
    data.qpos[model.joint("ball01_yaw").qposadr[0]] = -1.1
    mujoco.mj_fwdPosition(model, data)
    flexes = {int(flex) for contact in data.contact for flex in contact.flex}
    assert flexes & set(range(model.nflex))


def test_pinocchio_reads_the_arm_with_its_masses(folder: Path) -> None:
    """The URDF is the arm: its tip, its feed, and the torques that hold it still agree with the plan's."""
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(folder / "arm.urdf"))
    data = model.createData()
    solution = solved()
    q = np.zeros(model.nq)
    sample = len(solution.trajectory.time) // 2
    for name, angle in zip(solution.joints.names, solution.joints.angles[sample], strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = angle
    q[model.joints[model.getJointId("feed")].idx_q] = solution.trajectory.base_positions[sample, 0]
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[model.getFrameId("tip")].translation
    assert np.allclose(tip, solution.joint_positions[sample, -1], atol=1e-12)


def test_mujoco_loads_the_urdf_with_its_meshes(folder: Path) -> None:
    """Frames that move have an inertia, and meshes are found in their folder."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folder / "arm.urdf"))
    assert model.nv == 1 + len(solved().joints.names)
    assert model.nmesh > 0


def test_the_film_of_solids_turns_links_as_they_turn() -> None:
    """Quaternions of a film are the links' rotations, and never jump to the other side."""
    random = np.random.default_rng(3)
    arm = turned_arm(random, 4)
    path = np.linspace(-1.0, 1.0, 80)[:, None] * random.normal(0.0, 1.2, len(arm.coordinates))
    rotations = arm.link_rotations(path)[:, 3]
    found = quaternions(rotations)
    x, y, z, w = found.T
    along = np.stack((1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)), axis=1)
    assert np.allclose(along, rotations[:, :, 0], atol=1e-12)
    assert np.all(np.sum(found[1:] * found[:-1], axis=1) > 0.0)


@pytest.mark.parametrize("kind", ["urdf", "mjcf", "csv", "yaml", "npz", "glb"])
def test_every_format_is_exported(folder: Path, kind: str) -> None:
    """Each format is made anew from the folder; without rolls two revolutes a ball are left of three."""
    solution = solved()
    files = exported_files(folder, kind, bends_only=True)  # type: ignore[arg-type]
    content = files[""]
    if kind == "npz":
        with np.load(BytesIO(content), allow_pickle=False) as arrays:
            assert len(arrays["joint_names"]) == 2 * solution.problem.arm.links
    elif kind == "glb":
        assert content.startswith(b"glTF")
    else:
        assert b"ball01_yaw" in content
        assert b"ball01_bend" in content
        assert b"ball01_roll" not in content


def test_the_page_is_one_file_that_loads_nothing(folder: Path) -> None:
    """The page has its view and its data in itself, below two megabytes, and no address beyond the files beside it."""
    page = (folder / "report.html").read_text()
    assert len(page.encode()) < 2_000_000
    addresses = set(re.findall(r"https?://[^\"'\s)]+", page))
    assert addresses <= {"http://www.w3.org/2000/svg"}
    assert "getContext(" in page
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data = json.loads(found.group(1))
    assert [body["name"] for body in data["scene"]["bodies"]] == [
        each.name for each in solved().problem.workspace.obstacles
    ]


def test_pictures_show_three_sides_and_a_film(folder: Path) -> None:
    """The picture is not blank, and the film has many frames that differ."""
    with Image.open(folder / "plan.png") as picture:
        still = np.asarray(picture.convert("L"))
    assert 0.02 < np.mean(still < 200) < 0.9
    with Image.open(folder / "motion.gif") as film:
        frames = [np.asarray(frame.convert("L"), dtype=int) for frame in ImageSequence.Iterator(film)]
    assert len(frames) > 10
    assert np.mean(np.abs(frames[-1] - frames[0]) > 30) > 1e-3


def test_thinned_surfaces_stay_near() -> None:
    """No corner of a thinned ball is farther from it than the diagonal of a cell, and it has fewer triangles."""
    vertices, faces = SphereBody(np.zeros(3), 1.0).surface(48)
    corners, kept = thinned(vertices, faces, 0.2)
    assert 0 < len(kept) < len(faces) / 2
    assert np.all(np.abs(np.linalg.norm(corners, axis=1) - 1.0) < 0.2 * np.sqrt(3.0))
    assert kept.max() < len(corners)


@pytest.mark.parametrize("most", [2000, 900, 300])
def test_what_is_drawn_of_a_surface_looks_like_it(most: int) -> None:
    """A torus in fewer triangles is off it by a cell at most, and a small box beside it stays whole."""
    around, across = np.meshgrid(*2 * [2.0 * np.pi * np.arange(48) / 48], indexing="ij")
    ring = 1.0 + 0.3 * np.cos(across)
    vertices = np.stack((ring * np.cos(around), ring * np.sin(around), 0.3 * np.sin(across)), axis=-1).reshape(-1, 3)
    number = np.arange(48 * 48).reshape(48, 48)
    corners = [number, np.roll(number, -1, axis=0), np.roll(number, (-1, -1), axis=(0, 1)), np.roll(number, -1, axis=1)]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate((np.column_stack((a, b, c)), np.column_stack((a, c, d))))
    box = BoxBody(np.zeros(3), np.array([1.0, 2.0, 3.0])).surface(8)
    torus, same = all_within([(vertices, faces), box], most, 100, 0.2)
    assert same[1] is box[1]
    assert 0 < len(torus[1]) <= most - len(box[1])
    middles = torus[0][torus[1]].mean(axis=1)
    off = np.hypot(np.hypot(middles[:, 0], middles[:, 1]) - 1.0, middles[:, 2]) - 0.3
    assert np.max(np.abs(off)) < 0.2


def test_sharp_edges_of_a_box_are_its_twelve() -> None:
    """Diagonals of faces are no edges, and all twelve edges are found."""
    vertices, faces = BoxBody(np.zeros(3), np.array([1.0, 2.0, 3.0])).surface(8)
    edges = sharp_edges(vertices, faces, 0.5)
    lengths = np.sort(np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1))
    assert np.allclose(lengths, [1.0] * 4 + [2.0] * 4 + [3.0] * 4)


def test_roll_is_the_turn_about_the_tip() -> None:
    """A frame that is turned about its own x by an angle has that much more roll, and none against itself."""
    random = np.random.default_rng(8)
    base = random_rotation(random)
    end = random_rotation(random)
    before = roll_against(base, end)
    angle = 0.7
    about = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(angle), -np.sin(angle)], [0.0, np.sin(angle), np.cos(angle)]])
    turned = roll_against(base, end @ about)
    assert np.isclose(np.angle(np.exp(1j * (turned - before - angle))), 0.0, atol=1e-12)
    assert roll_against(base, base) == pytest.approx(0.0)


@pytest.mark.drawn(20, of="dear tests")
def test_a_failure_leaves_its_folder(folder: Path, tmp_path: Path) -> None:
    """A goal out of reach is a record with its reason, the meshes that the problem needs, and a page with the scene."""
    problem = load_any_problem(folder)
    assert problem.dimension == 3
    assert load_motion(folder, problem.arm).keyframes.shape[1] == len(problem.arm.coordinates)
    text = (folder / "solution.json").read_text()
    data = json.loads(text)["problem"]
    data["goal"] |= {"position": [1.5, 0.9, 0.9]}
    data["goal"].pop("via")
    file = tmp_path / "far.toml"
    file.write_text(toml_of(data | {"name": "far"}))
    shutil.copytree(folder / "meshes", tmp_path / "meshes")
    # What would help is tried by solving, which is asked of the command line beside the families of such problems.
    ended = run("solve", file, "--out", tmp_path, "--no-diagnosis")
    assert ended.returncode == 3, ended.stderr
    record = json.loads((tmp_path / "far" / "solution.json").read_text())
    assert record["status"] in {"infeasible", "no plan found"}
    assert record["diagnosis"]["reason"]
    assert list((tmp_path / "far" / "meshes").iterdir())
    assert "Why there is no plan" in (tmp_path / "far" / "report.html").read_text()


def toml_of(data: dict[str, object]) -> str:
    """Data as TOML."""
    tomlkit = pytest.importorskip("tomlkit")
    return str(tomlkit.dumps(data))


def test_what_only_the_plane_knows_is_refused_by_name() -> None:
    """A problem in space that asks for the baseline's planner is told so."""
    from dataclasses import replace

    from ccm_opt.driver.pipeline import solve

    problem = solved().problem
    with pytest.raises(ProblemError, match=r"planner\.method: .hill-climbing. .* the plane only"):
        solve(replace(problem, planner=replace(problem.planner, method="hill-climbing")))
    with pytest.raises(UnreachableGoal):
        solve(replace(problem, goal=TipGoal(np.array([1.5, 0.9, 0.9]))), explain=False)


def test_angles_of_revolutes_are_those_of_the_bends(folder: Path) -> None:
    """What the table says of every revolute is what the bends say."""
    plan = ccm_opt.load(folder)
    angles = revolute_angles(plan.problem.arm, plan.trajectory.bend_angles)
    assert np.array_equal(angles, plan.joints.angles)


def test_the_page_of_a_failure_shows_the_arm_at_its_start() -> None:
    """The page of a failure holds the scene, the start and the reason, and loads nothing."""
    from ccm_opt.core.errors import Diagnosis

    page = failure_html(solved().problem, "infeasible", Diagnosis("it is too thick", "necessary checks"))
    assert "it is too thick" in page
    assert '"start":[[' in page


def test_a_mesh_made_in_python_is_kept_with_every_digit() -> None:
    """What a folder keeps of it is read back as it was, so that what is checked again is what was certified."""
    third, seventh = 1.0 / 3.0, 1.0 / 7.0
    wedge = MeshBody.of_arrays(
        [[third, -0.2, -0.3], [third, seventh, -0.3], [third, 0.0, -0.05], [0.4, 0.0, -0.3]],
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    )
    problem = ccm_opt.make_problem(
        "wedge",
        arm={"links": 4, "link_length": 0.05, "radius": 0.02, "base": {"position": (0, 0, 0.1)}, "joint_limit_deg": 45},
        obstacles={"wedge": wedge},
        limits={"velocity": 1.0, "acceleration": 4.0},
        goal={"position": (0.15, 0.0, 0.1)},
    )
    ((name, content),) = stored_meshes(problem).items()
    mesh = read_obj(content, MeshSettings())
    assert name == "meshes/wedge.obj"
    assert np.array_equal(mesh.vertices[mesh.faces], wedge.triangles)
