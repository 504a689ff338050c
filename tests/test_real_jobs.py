"""The real jobs: those that can be done are, through the command line; the others say truly why not, and what helps."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.files.scene_import import ImportOptions, import_scene

from .conftest import PROBLEMS
from .test_user_terms_examples import residuals
from .test_user_terms_examples import run as run_example

JOBS = PROBLEMS / "jobs"
EXAMPLES = PROBLEMS.parent / "examples"
POSSIBLE = ("wing-box", "hot-cell", "turbine-stages", "five-views", "tank-baffles")
IMPOSSIBLE = ("wing-box-too-thick", "hot-cell-out-of-reach", "tank-baffles-too-weak", "tank-baffles-closed")


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and what is printed on standard output."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout


def solved(name: str, out: Path, *options: object) -> tuple[int, dict[str, object]]:
    """Exit code of solving a job without pictures, and its record."""
    code, text = run("solve", JOBS / f"{name}.toml", "--out", out, "--no-pictures", "--json", *options)
    return code, json.loads(text)["results"][0]


def test_every_job_is_tested() -> None:
    """The jobs that these tests know are the files in their folder."""
    assert {file.stem for file in JOBS.glob("*.toml")} == {*POSSIBLE, *IMPOSSIBLE}


@pytest.mark.parametrize("name", POSSIBLE)
def test_jobs_are_solved(name: str, tmp_path: Path) -> None:
    """The plan is followed by the simulated arm; that of the drawing is verified again from its folder alone."""
    assert solved(name, tmp_path)[0] == 0
    if name == "turbine-stages":
        assert run("check", tmp_path / name)[0] == 0


@pytest.mark.parametrize(
    ("name", "kind", "words", "change"),
    [
        ("wing-box-too-thick", "too thick", ("gap of 150.0 mm", "rib 2, below its hole", "160.0 mm"), "arm.radius"),
        ("hot-cell-out-of-reach", "too short", ("'vessel'", "0.071 m too short"), "arm.link_length"),
        ("tank-baffles-too-weak", "torque", ("joint 1", "335.8 N m", "250 N m"), "limits.torque"),
        ("tank-baffles-closed", "blocked", ("'cover of the second manway'",), "goal.position"),
    ],
)
def test_impossible_jobs_say_why_and_the_change_that_they_propose_helps(
    name: str, kind: str, words: tuple[str, ...], change: str, tmp_path: Path
) -> None:
    """The reason names obstacle or limit, and by how much; the proposed value, set alone, makes the job solvable."""
    code, record = solved(name, tmp_path / "asked")
    assert (code, record["status"]) == (3, "no plan found" if kind == "torque" else "infeasible")
    diagnosis = record["diagnosis"]
    assert isinstance(diagnosis, dict)
    assert all(word in diagnosis["reason"] for word in words)
    assert kind in {finding["kind"] for finding in diagnosis["findings"]}
    [value] = [found["value"] for found in diagnosis["relaxations"] if found["key"] == change]
    assert solved(name, tmp_path / "changed", "--set", f"{change}={in_file(name, change, value)}")[0] == 0


def in_file(name: str, change: str, value: float) -> object:
    """A proposed value as it stands in a problem file in millimetres."""
    if change == "goal.position":
        # Of the goal, the value is how far it moves: here straight back, before the cover.
        assert name == "tank-baffles-closed"
        return [2850.0 - 1e3 * value, -1000.0]
    return 1e3 * value if change.startswith("arm.") else value


def test_the_hole_is_as_wide_as_the_reason_says(tmp_path: Path) -> None:
    """An arm of half the hole less the clearance, 70 mm, and 1 mm more is too thick still."""
    code, record = solved("wing-box-too-thick", tmp_path, "--set", "arm.radius=71", "--no-diagnosis")
    assert (code, record["status"]) == (3, "infeasible")


def test_the_drawing_is_the_one_that_its_example_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Shipped and freshly drawn aerofoils have the same names and outlines; the job's copy brings its drawing along."""
    monkeypatch.setattr("sys.argv", ["draw", str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "09_draw_turbine_stages.py"), run_name="__main__")
    assert "12 aerofoils in 2 rows" in capsys.readouterr().out
    shipped = import_scene(JOBS / "turbine-stages.dxf", ImportOptions(), set()).obstacles
    drawn = import_scene(tmp_path / "turbine-stages.dxf", ImportOptions(), set()).obstacles
    assert [each.name for each in shipped] == [each.name for each in drawn]
    assert all(shapely.equals_exact(a.core, b.core, 1e-6) for a, b in zip(shipped, drawn, strict=True))
    assert run("problems", "turbine-stages", "--out", tmp_path / "copy")[0] == 0
    assert {file.name for file in (tmp_path / "copy").iterdir()} == {"turbine-stages.toml", "turbine-stages.dxf"}


def test_the_camera_looks_at_the_weld(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The constraints of the example hold, and the pipe does not stand between camera and weld."""
    output = run_example("10_look_at_a_weld.py", tmp_path / "look.png", monkeypatch, capsys)
    assert len(residuals(output)) == 2
    assert max(residuals(output)) <= 1e-6
    heading = np.deg2rad(float(output.split("looks along ")[1].split("°")[0]))
    way = np.array([-1.15, -0.75]) - (-1.4, -1.0)
    assert way @ (np.cos(heading), np.sin(heading)) > 0.99 * np.hypot(*way)


def test_the_tour_with_a_cost_bends_the_mast_less(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The moment falls by a fifth at least, and the tour takes at most a tenth longer."""
    output = run_example("11_tour_easy_on_the_mast.py", tmp_path / "tour.png", monkeypatch, capsys)
    plain, eased = (line for line in output.splitlines() if "the cost" in line)
    moments = [float(line.split("moment ")[1].split()[0]) for line in (plain, eased)]
    durations = [float(line.split(", ")[-1].split()[0]) for line in (plain, eased)]
    assert moments[1] < 0.8 * moments[0]
    assert durations[1] < 1.1 * durations[0]
