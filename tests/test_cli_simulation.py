"""The commands describe, simulate and export, on one folder that solve wrote."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from ccm_opt.cli.commands import app

PROBLEM = """
schema = 1
name = "reach"
[workspace]
bounds = [-0.5, -0.5, 0.5, 0.5]
[[workspace.obstacles]]
name = "post"
circle = { center = [0.29, -0.0615], radius = 0.05 }
[arm]
links = 6
link_length = 0.05
radius = 0.01
base = [0.0, 0.0]
joint_limit_deg = 60.0
payload = 0.02
[limits]
velocity = 2.0
acceleration = 10.0
torque = 4.0
[start]
shape = "straight"
[goal]
joints_deg = [20, 10, 10, 10, 10, 10]
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that solve wrote."""
    root = tmp_path_factory.mktemp("runs")
    file = root / "reach.toml"
    file.write_text(PROBLEM, encoding="utf-8")
    assert run("solve", str(file), "--out", str(root), "--no-pictures")[0] == 0
    return root / "reach"


def run(*arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout, result.stderr


def metrics_of(out: str) -> dict[str, float]:
    """Figures of merit in the one document that a command prints for programs."""
    figures: dict[str, float] = json.loads(out)["results"][0]["metrics"]
    return figures


def test_describe_prints_the_link_parameter_table(solved: Path) -> None:
    """Every revolute stands in the table with its Denavit–Hartenberg row, and every link with its mass."""
    code, out, _ = run("describe", str(solved.parent / "reach.toml"))
    assert code == 0
    row = next(line.split() for line in out.splitlines() if line.startswith("ball02_roll"))
    assert row[1:5] == ["-90", "0.05", "0", "90"]
    assert len(re.findall(r"^ball\d\d_", out, re.MULTILINE)) == 18
    assert len(re.findall(r"^link\d\d ", out, re.MULTILINE)) == 6
    assert "payload 0.02 kg" in out


@pytest.mark.drawn(20, of="dear tests")
def test_retarget_leaves_the_plan_for_a_new_goal(solved: Path, tmp_path: Path) -> None:
    """The new folder passes ``check`` and keeps the plan up to that time, told by time or by the joints there."""
    with np.load(solved / "solution.npz") as arrays:
        time, angles = arrays["time"], arrays["bend_angles"]
    sample = len(time) // 2
    measured = ",".join(str(each) for each in np.rad2deg(angles[sample]).ravel())
    for when in (("--time", str(time[sample])), ("--joints-deg", measured)):
        moved = ("retarget", str(solved), "--position", "0.2,0.15", *when, "--no-pictures", "--out", str(tmp_path))
        assert run(*moved)[0] == 0
        assert run("check", str(tmp_path / "reach"))[0] == 0
        with np.load(tmp_path / "reach" / "solution.npz") as arrays:
            before = np.stack([np.interp(time[:sample], arrays["time"], line) for line in arrays["bend_angles"].T], 1)
            assert np.allclose(before, angles[:sample], atol=1e-3)
            assert np.allclose(arrays["joint_positions"][-1, -1], (0.2, 0.15), atol=2e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "give one of --time and --joints-deg"),
        (("--time", "0.1", "--feed", "0.1"), "--feed has no effect without --joints-deg"),
        (("--joints-deg", "1,2"), "--joints-deg: expected 6 numbers"),
        (("--joints-deg", "0,0,0,0,0,0", "--feed", "0.1"), "the arm has no feed axis"),
        (("--time", "0.1", "--direction", "0,0"), "--direction must be nonzero"),
    ],
)
def test_retarget_refuses_options_without_meaning(solved: Path, options: tuple[str, ...], words: str) -> None:
    """What is missing, malformed or without effect is named, and nothing is planned."""
    code, _, err = run("retarget", str(solved), "--position", "0.2,0.15", *options)
    assert code == 2
    assert words in " ".join(err.split())


def test_pd_follows_without_being_tuned(solved: Path) -> None:
    """With gains that come from the arm ``--controller pd`` follows the plan, also with a load unknown to it."""
    for load in ((), ("--payload", "0.05")):
        code, out, _ = run("simulate", str(solved), "--controller", "pd", "--no-pictures", *load, "--json")
        assert code == 0
        assert metrics_of(out)["tracking_error_rad"] < 0.05
    table = run("simulate", str(solved), "--controller", "pd", "--no-pictures")[1]
    assert re.search(r"gains +[\d.]+ to [\d.]+ N m/rad +tuned for 50 1/s", table)


def test_simulate_repeats_what_was_recorded(solved: Path) -> None:
    """Without options the simulation tracks as it did, draws a picture, and ends with 0."""
    code, out, _ = run("simulate", str(solved), "--json")
    assert code == 0
    assert metrics_of(out)["tracking_error_rad"] < 1e-3
    assert metrics_of(out)["simulated_least_wall_clearance_m"] > 0.0
    with Image.open(solved / "simulation.png") as picture:
        assert picture.size[0] > 600


def test_disturbances_leave_the_plan(solved: Path) -> None:
    """An unknown payload makes the error grow with it; the options are told apart from the plan's in the table."""
    errors = [
        metrics_of(run("simulate", str(solved), "--no-pictures", "--payload", mass, "--json")[1])["tracking_error_rad"]
        for mass in ("0.0", "0.01", "0.02")
    ]
    assert errors[0] < 0.1 * errors[1] < 0.1 * errors[2]
    _, out, _ = run("simulate", str(solved), "--no-pictures", "--start-delay", "0.1", "--mass-error", "-0.1")
    assert "unknown to the controller" in out


def test_a_simulated_arm_that_touches_is_reported(solved: Path) -> None:
    """Pressed down by its payload the arm meets the post: link, wall and time are named, and the exit code is 4."""
    code, out, err = run("simulate", str(solved), "--no-pictures", "--payload", "0.5")
    assert code == 4
    assert re.search(r"\(touched\): .*link \d touches 'post' at 0\.\d+ s", err)
    assert re.search(r"^simulation +touched", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("option", "value", "code", "words"),
    [
        ("--controller", "pid", 2, "'pid'"),
        ("--payload", "-1", 2, "--payload must be at least 0"),
        ("--bandwidth", "2000", 2, "unstable"),
    ],
)
def test_impossible_settings_are_refused(solved: Path, option: str, value: str, code: int, words: str) -> None:
    """A setting that cannot be is refused with its name."""
    got, _, err = run("simulate", str(solved), "--no-pictures", option, value)
    assert got == code
    assert words in err


def test_exports_equal_the_files_of_the_folder(solved: Path, tmp_path: Path) -> None:
    """Each format is the folder's own file, written again."""
    names = {"urdf": "arm.urdf", "mjcf": "arm.mjcf.xml", "yaml": "trajectory.yaml", "csv": "trajectory.csv"}
    for kind, name in names.items():
        out = tmp_path / "made" / name
        assert run("export", str(solved), "--format", kind, "--out", str(out))[0] == 0
        assert out.read_text(encoding="utf-8") == (solved / name).read_text(encoding="utf-8")
    rows = list(csv.reader(run("export", str(solved), "--format", "csv")[1].splitlines()))
    assert np.isfinite(np.array(rows[1:], dtype=float)).all()


def test_an_unknown_format_is_refused(solved: Path) -> None:
    """A format that is not known is refused by its name."""
    code, _, err = run("export", str(solved), "--format", "step")
    assert code == 2
    assert "'step'" in err
