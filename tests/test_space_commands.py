"""The commands on problems and plans in space, through the command line."""

from pathlib import Path

import pytest

from ccm_opt.io.folder import write_solution
from ccm_opt.io.reading_back import load_any_problem
from ccm_opt.robot.frames import dh_table, frame_transforms, revolute_angles

from .command_runs import CommandLine, brightness
from .space_files import binary_stl, written
from .space_folders import solved


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The command line."""
    return CommandLine(capsys)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of a plan, without pictures."""
    return write_solution(solved(), tmp_path)


def test_describe_tells_the_arm_and_its_base_in_space(tmp_path: Path, run: CommandLine) -> None:
    """Base, direction, length, mesh and all revolutes are told, in the unit of the file."""
    done = run("describe", written(tmp_path, binary_stl()), "--set", "units=mm")
    assert done.code == 0
    assert "mesh: 4 links of 0.1 mm, 12 revolutes, axes zyx" in done.out
    assert "base at (-1, 0, 0) mm, direction (1, 0, 0), up (0, 0, 1)" in done.out
    assert "part: part.stl, 12 triangles" in done.out
    assert sum(line.startswith("ball") for line in done.out.splitlines()) == 12


def test_described_parameters_put_the_tip_where_the_arm_has_it(folder: Path, run: CommandLine, tmp_path: Path) -> None:
    """The Denavit–Hartenberg rows that are told are those whose product is the pose of the arm's own kinematics."""
    problem = load_any_problem(folder)
    assert problem.dimension == 3
    told = run("describe", written(tmp_path, binary_stl()), "--json").result
    parameters = told["link_parameters"]
    assert isinstance(parameters, list)
    assert [row["joint"].split("_")[1] for row in parameters[:3]] == ["yaw", "bend", "roll"]
    arm = problem.arm
    pose = solved().trajectory.positions[-1]
    frames = frame_transforms(arm, revolute_angles(arm, pose[: 2 * arm.links]))
    carried = pose[-1] * arm.direction
    assert len(dh_table(arm)) == 3 * arm.links
    assert frames[-1, :3, 3] + carried == pytest.approx(arm.joint_positions_at(pose)[-1], abs=1e-12)


@pytest.mark.drawn(20, of="dear tests")
def test_simulate_follows_and_draws_from_two_sides(folder: Path, run: CommandLine) -> None:
    """The simulated arm follows its plan, the table tells how near it came, and there is a picture."""
    done = run("simulate", folder)
    assert done.code == 0
    assert "simulated least wall clearance" in done.out
    assert "followed" in done.out
    assert brightness(folder / "simulation.png") > 0.02


def test_a_heavy_load_that_takes_the_arm_off_its_plan_is_a_verdict(folder: Path, run: CommandLine) -> None:
    """With a payload that nobody told the controller of the arm strays: exit code 4, the reason, and no picture."""
    done = run("simulate", folder, "--payload", "3", "--no-pictures", "--json")
    assert done.code == 4
    told = done.result
    assert told["status"] in {"strayed", "touched", "diverged", "saturated"}
    verdict = told["simulation"]
    assert isinstance(verdict, dict)
    assert verdict["reason"]
    assert not (folder / "simulation.png").exists()
