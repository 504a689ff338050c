"""Problem files and output folders of arms whose sections bend evenly, and the lengths of their tendons."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.folder import model_texts, write_solution
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.io.reading_back import load_any_problem, load_motion
from ccm_opt.io.record_reading import recorded_nearest
from ccm_opt.robot.arc_sections import ArcSections, Tendons, arc_deviation, fitting_arcs
from ccm_opt.robot.arm import Arm

from .command_runs import CommandLine
from .test_arc_sections import tip_of_arcs

TEXT = """
schema = 1
space = 3
name = "tendons"
units = "mm"

[workspace]
bounds = [[-100.0, -400.0, -400.0], [600.0, 400.0, 400.0]]

[[workspace.obstacles]]
name = "wall"
box = [[180.0, -300.0, -300.0], [200.0, 300.0, -30.0]]

[arm]
base = { position = [0.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0] }

[[arm.sections]]
drive = "section"
length = 150.0
radius = 12.0
bend_limit_deg = 120.0
tendons = { radius = 9.0, number = 3 }

[[arm.sections]]
drive = "section"
links = 8
link_length = 20.0
radius = [12.0, 8.0]
joint_limit_deg = 14.0

[limits]
velocity = 0.5
acceleration = [1.0, 2.0]

[start]
joints_deg = [[10.0, 0.0], [0.0, -20.0]]

[goal]
position = [220.0, -60.0, 120.0]
"""


LIMIT = "joint_limit_deg = 14.0"
LAMPS = """
[[arm.bodies]]
section = 1
at = 0.5
bodies = [{ capsule = { from = [0.0, 12.0, 0.0], to = [0.0, 35.0, 0.0], radius = 10.0 } }]

[[arm.bodies]]
section = 1
mass = 0.05
bodies = [{ sphere = { center = [0.0, 0.0, 18.0], radius = 10.0 } }]

[[arm.bodies]]
section = 2
at = 0.75
bodies = [{ capsule = { from = [0.0, -10.0, 0.0], to = [0.0, -30.0, 0.0], radius = 5.0 } }]
"""


def read(text: str = TEXT) -> ccm_opt.Problem:
    """The problem of a file."""
    return parse_problem(text, "arm.toml")


def test_sections_are_read_as_arcs() -> None:
    """Lengths, limits, start and speeds are those of whole sections, each link's a share of them."""
    problem = read()
    sections = problem.arm.sections
    assert sections is not None
    np.testing.assert_allclose(sections.lengths, [0.15, 0.16])
    np.testing.assert_allclose(np.rad2deg(sections.limits), [120.0, 112.0])
    np.testing.assert_allclose(
        np.rad2deg(sections.drives(problem.start.bends.ravel())), [10.0, 0.0, 0.0, -20.0], atol=1e-9
    )
    np.testing.assert_allclose(problem.limits.velocity[-3:], 0.5 / 8)
    np.testing.assert_allclose(problem.limits.acceleration[:3], 1.0 / sections.counts[0])
    assert np.all(problem.arm.radii >= sections.link_radii)


def test_problem_is_written_as_it_was_read() -> None:
    """The data of a problem give the same arm, limits and start again."""
    problem = read(TEXT + LAMPS)
    again = problem_from_mapping(problem_data(problem), "written")
    assert [body.link for body in again.arm.bodies] == [body.link for body in problem.arm.bodies]
    for name in ("lengths", "radii", "bend_limits", "arcs"):
        np.testing.assert_allclose(getattr(again.arm, name), getattr(problem.arm, name), rtol=1e-12)
    np.testing.assert_allclose(again.start.bends, problem.start.bends, atol=1e-14)
    np.testing.assert_allclose(again.limits.velocity, problem.limits.velocity, rtol=1e-12)
    assert again.arm.sections is not None
    first, second = again.arm.sections.tendons
    assert first is not None
    assert second is None
    assert (first.radius, first.number, first.angle) == pytest.approx((0.009, 3, 0.0))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("space = 3", "space = 3\n[tolerance]\njoint_error_deg = 1.0", "tolerance.joint_error_deg"),
        ("velocity = 0.5", "velocity = 0.5\ntip_velocity = 1.0", "limits.tip_velocity: not supported"),
        (LIMIT, f"{LIMIT}\nlocked = [2]", r"arm.sections\[1\].locked: joints of a section"),
        (LIMIT, f"{LIMIT}\nmass = 0.1", r"arm.sections\[0\]: mass is missing"),
        ("velocity = 0.5", "velocity = 0.5\ntorque = 9", r"arm.sections\[0\].mass: missing; limits.torque needs"),
        (LIMIT, f"{LIMIT}{LAMPS.replace('section = 2', 'link = 2').replace('at = 0.75', '')}", "expected section and"),
        (LIMIT, f"{LIMIT}{LAMPS.replace('section = 2', 'section = 3')}", r"bodies\[2\].section: expected a section f"),
        (LIMIT, f"{LIMIT}{LAMPS.replace('0.75', '0.7')}", r"bodies\[2\].at: no arc of the section, of 8, ends there"),
        ("velocity = 0.5", "velocity = 0.5\ntorque = [1, 2, 3]", "expected one value per section or revol"),
        (LIMIT, "joint_limit_deg = [14.0, 2.0]", r"sections\[1\].joint_limit_deg: expected one"),
        (LIMIT, "joint_limit_deg = 80.0", r"arm.sections\[1\].links: links turn by up to 113°; expected 11"),
        ("radius = 9.0", "radius = 12.1", r"sections\[0\].tendons.radius: expected at most 12 mm"),
        ("number = 3", "number = 3, travel = 1.0", r"start.joints_deg: takes 157.1 % of the travel of a tendon"),
        ("link_length = 20.0", "link_length = 20.0\nlength = 160.0", r"arm.sections\[1\].length"),
        ("links = 8", 'links = 8\ndrive = "joints"', "drive"),
        ("acceleration = [1.0, 2.0]", "acceleration = [1.0, 2.0, 3.0]", "expected one value per section or revol"),
        ("[[10.0, 0.0], [0.0, -20.0]]", "[[130.0, 0.0], [0.0, 0.0]]", r"start.joints_deg\[0\]: 130° exceeds 120°"),
    ],
)  # fmt: skip
def test_what_is_not_supported_is_refused_by_its_key(old: str, new: str, words: str) -> None:
    """Each defect of a file is named with its key."""
    if new.startswith("links = 8\n"):
        text = TEXT.replace('drive = "section"\nlinks = 8', 'drive = "joints"\nlinks = 8')
    else:
        text = TEXT.replace(old, new, 1) if old != "space = 3" else TEXT + new.removeprefix("space = 3")
    with pytest.raises(ProblemFileError, match=words):
        read(text)


def test_folder_holds_drives_and_tendons(tmp_path: Path) -> None:
    """Arrays of drives agree with the bends, bodies are clear, the nearest section is named; no models are written."""
    solution = ccm_opt.solve(read(TEXT + LAMPS), explain=False)
    assert all(check.passed for check in solution.checks)
    assert least_gap_of_lamps(solution.problem.arm, solution.trajectory.positions) > 0.0
    folder = write_solution(solution, tmp_path)
    assert solution.room is not None
    assert "section" in solution.room.nearest.pair
    assert "link" not in solution.room.nearest.pair
    assert recorded_nearest(folder) == solution.room.nearest
    arrays = dict(np.load(folder / "solution.npz"))
    assert arrays["drive_names"].tolist() == ["section1_a", "section1_b", "section2_a", "section2_b"]
    assert solution.problem.arm.sections is not None
    still = [0, *solution.problem.arm.sections.straight]
    assert len(still) == 4
    sums = np.delete(arrays["bend_angles"], still, axis=1).reshape(len(arrays["time"]), -1)
    count = (len(sums[0]) - 16) // 2
    np.testing.assert_allclose(arrays["drive_values"][:, 0], sums[:, : 2 * count : 2].sum(axis=1), atol=1e-12)
    assert arrays["tendon_lengths"].shape == (len(arrays["time"]), 3)
    assert solution.metrics["peak_torque_Nm"] == np.max(np.abs(arrays["drive_torques"]))
    assert not (folder / "arm.urdf").exists()
    table = np.genfromtxt(folder / "trajectory.csv", delimiter=",", names=True)
    at = np.searchsorted(arrays["time"], table["time"] - 1e-6)
    columns = {"section2_b_angle": "drive_values", "section2_b_torque": "drive_torques"}
    columns |= {"section2_curvature": "section_curvatures", "section1_tendon3_length": "tendon_lengths"}
    for name, array in columns.items():
        np.testing.assert_allclose(table[name], arrays[array][at, -1], rtol=1e-9, atol=1e-9)
    load_motion(folder, load_any_problem(folder).arm)
    arrays["tendon_lengths"][0, 0] += 1e-4
    np.savez(folder / "solution.npz", **arrays)
    with pytest.raises(ccm_opt.ProblemError, match="tendon_lengths"):
        load_motion(folder, solution.problem.arm)


def least_gap_of_lamps(arm: Arm, positions: FloatArray) -> float:
    """Least distance of points in the bodies of ``LAMPS`` from the wall, over poses, less their radii [m]."""
    assert arm.sections is not None
    low, high = 1e-3 * np.array([[180.0, -300.0, -300.0], [200.0, 300.0, -30.0]])
    gaps = []
    for q in positions[:: max(len(positions) // 60, 1)]:
        for body, until in zip(arm.bodies, (0.075, 0.15, 0.27), strict=True):
            frame = tip_of_arcs(arm, arm.sections.drives(q), until)
            axis = np.linspace(body.bodies[0].start, body.bodies[0].end, 20) @ frame[:3, :3].T + frame[:3, 3]
            beyond = np.maximum(np.maximum(low - axis, axis - high), 0.0)
            gaps.append(np.min(np.linalg.norm(beyond, axis=1)) - body.bodies[0].radius)
    return float(min(gaps))


def tendon_points(sections: ArcSections, bends: FloatArray, side: FloatArray, last: int, each: int) -> FloatArray:
    """Points of a tendon up to the end of a section, ``each`` in every section, (m, 3) [m]."""
    pose, points = np.eye(4), [np.array([0.0, *side])]
    for k in range(last + 1):
        a, b = bends[2 * k : 2 * k + 2]
        twist = np.array([[0.0, -a, b, sections.lengths[k]], [a, 0, 0, 0], [-b, 0, 0, 0], [0, 0, 0, 0]]) / each
        for _ in range(each):
            pose = pose @ expm(twist)
            points.append((pose @ [0.0, *side, 1.0])[:3])
    return np.stack(points)


def mujoco_length(points: FloatArray) -> float:
    """Length of a spatial tendon of MuJoCo through sites at points, shape (m, 3) [m]."""
    mujoco = pytest.importorskip("mujoco")
    sites = "".join(f'<site name="s{k}" pos="{x!r} {y!r} {z!r}"/>' for k, (x, y, z) in enumerate(points.tolist()))
    through = "".join(f'<site site="s{k}"/>' for k in range(len(points)))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{sites}</worldbody><tendon><spatial name="t">{through}</spatial></tendon></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(data.ten_length[0])


def test_tendon_lengths_are_those_of_mujoco() -> None:
    """Closed forms agree to 1e-9 m with MuJoCo's tendons through ever more sites, extrapolated to infinitely many."""
    tendons = (Tendons(0.009, 3, 0.2), None, Tendons(0.006, 4, 1.0))
    lengths, ones = np.array([0.15, 0.1, 0.2]), np.ones(3)
    sections = ArcSections(np.array([4, 4, 4]), lengths, 2.0 * ones, np.full((3, 2), 0.01), tendons)
    bends = np.array([0.9, -0.4, -1.2, 0.3, 0.5, 1.6])
    expected = []
    for k, each in enumerate(tendons):
        for side in () if each is None else each.sides:
            rough, fine, finest = (mujoco_length(tendon_points(sections, bends, side, k, n)) for n in (20, 40, 80))
            once = (4.0 * fine - rough) / 3.0, (4.0 * finest - fine) / 3.0
            expected.append((16.0 * once[1] - once[0]) / 15.0)
    np.testing.assert_allclose(sections.tendon_lengths(bends), expected, atol=1e-9)


def test_sections_are_divided_as_finely_as_their_radius_asks() -> None:
    """By default no arc is farther from its links than a tenth of the radius, and one link fewer would be too few."""
    length, turn, radius = 0.25, 2.1, 0.01
    count = fitting_arcs(length, turn, radius)
    assert arc_deviation(length / count, turn / count) <= 0.1 * radius
    assert arc_deviation(length / (count - 1), turn / (count - 1)) > 0.1 * radius


def test_describe_tells_sections_with_the_figures_of_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Limits, torque, inertia and friction of the bends of whole sections are told, and the tool."""
    tool = "arm.tool={tip=[30,0,0],direction=[1,0,0],mass=0.1,bodies=[{sphere={center=[0,0,0],radius=5}}]}"
    of_drives = ("limits.torque=[2,3]", "arm.friction=0.1", "arm.rotor_inertia=[0.01,0.02]", tool)
    file = tmp_path / "tendons.toml"
    file.write_text(TEXT.replace("drive =", "mass = 0.2\ndrive ="))
    done = CommandLine(capsys)("describe", file, *(part for change in of_drives for part in ("--set", change)))
    assert done.code == 0, done.err
    rows = {" ".join(row.split()) for row in done.out.splitlines() if row.startswith("section ")}
    assert "section 2 160 12, 8 8 none 112 0.5 2 3 0.02 0.1" in rows
    assert any(row.endswith("3 at 9 mm 120 0.5 1 2 0.01 0.1") for row in rows)
    assert "tool: 0.1 kg, covered by 1 capsule, tip at (30, 0, 0) mm" in done.out


def test_what_needs_independent_joints_is_refused() -> None:
    """Constraints of the user and robot models name the sections."""
    problem = read()
    floor = ccm_opt.Constraint("above", lambda q: q.tip[2], lower=-1.0)
    for call in (
        lambda: ccm_opt.solve(problem, constraints=[floor]),
        lambda: model_texts(problem),
    ):
        with pytest.raises(ccm_opt.ProblemError, match="sections"):
            call()
