"""The real jobs: those that can be done are, through the command line; the others say truly why not, and what helps."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.io.drawing import ImportOptions, import_scene
from ccm_opt.io.reading import load_problem
from ccm_opt.io.scans import read_scan

from .conftest import PROBLEMS
from .test_user_terms_examples import residuals
from .test_user_terms_examples import run as run_example

JOBS = PROBLEMS / "jobs"
EXAMPLES = PROBLEMS.parent / "examples"
POSSIBLE = (
    *("wing-box", "hot-cell", "turbine-stages", "tank-baffles", "tank-looks", "tank-coverage", "floor-plan"),
    "pipe-gallery",
)
BY_EXAMPLE = "five-views"
"""That is solved with a cost and without in an example, below."""
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
    assert {file.stem for file in JOBS.glob("*.toml")} == {*POSSIBLE, BY_EXAMPLE, *IMPOSSIBLE}


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", POSSIBLE)
def test_jobs_are_solved(name: str, tmp_path: Path) -> None:
    """The plan is followed by the simulated arm; that of the drawing is verified again from its folder alone."""
    assert solved(name, tmp_path)[0] == 0
    if name == "turbine-stages":
        assert run("check", tmp_path / name)[0] == 0


@pytest.mark.drawn(1, of="impossible jobs")
@pytest.mark.parametrize(
    ("name", "words", "short_of", "enough"),
    [
        ("hot-cell-out-of-reach", ("'vessel'", "71 mm too short"), "arm.link_length=85", "arm.link_length=91.9333"),
        ("tank-baffles-too-weak", ("joint 1", "limit is 250 N m"), "limits.torque=310", "limits.torque=350.9"),
    ],
)
def test_impossible_jobs_say_why_and_by_how_much(
    name: str, words: tuple[str, ...], short_of: str, enough: str, tmp_path: Path
) -> None:
    """The reason names obstacle or limit; what the docs say helps does so alone, and a change short of it does not."""
    code, record = solved(name, tmp_path, "--no-diagnosis")
    assert code == 3
    assert all(word in reason(record) for word in words)
    assert solved(name, tmp_path, "--no-diagnosis", "--set", short_of)[0] == 3
    assert solved(name, tmp_path, "--no-diagnosis", "--set", enough)[0] == 0


def reason(record: dict[str, object]) -> str:
    """Why there is no plan."""
    diagnosis = record["diagnosis"]
    assert isinstance(diagnosis, dict)
    return str(diagnosis["reason"])


@pytest.mark.drawn(1, of="impossible jobs")
def test_the_change_that_is_proposed_helps(tmp_path: Path) -> None:
    """The arm that is too thick is told a radius; with it alone the job is solved, above the hole's own it is not."""
    code, record = solved("wing-box-too-thick", tmp_path)
    diagnosis = record["diagnosis"]
    assert isinstance(diagnosis, dict)
    assert (code, record["status"]) == (3, "infeasible")
    [found] = [change for change in diagnosis["relaxations"] if change["key"] == "arm.radius"]
    assert all(word in reason(record) for word in ("gap of 150.0 mm", "'rib 2, below its hole'", "diameter 160.0 mm"))
    # Half the hole less the clearance.
    assert found["bound"] == pytest.approx(0.07, rel=1e-3)
    assert solved("wing-box-too-thick", tmp_path, "--set", "arm.radius=71", "--no-diagnosis")[0] == 3
    assert solved("wing-box-too-thick", tmp_path, "--set", f"arm.radius={1e3 * found['value']}")[0] == 0


def test_what_closes_the_way_is_named_first_and_is_all_that_does(tmp_path: Path) -> None:
    """The cover left on the manway; but for it the scene is that of the job which is solved."""
    code, record = solved("tank-baffles-closed", tmp_path, "--no-diagnosis")
    diagnosis = record["diagnosis"]
    assert isinstance(diagnosis, dict)
    assert (code, record["status"]) == (3, "infeasible")
    assert diagnosis["findings"][0]["obstacles"][0] == "cover of the second manway"
    closed, free = (load_problem(JOBS / f"{name}.toml") for name in ("tank-baffles-closed", "tank-baffles"))
    *others, cover = closed.workspace.obstacles
    assert cover.name == "cover of the second manway"
    assert [wall.core for wall in others] == [wall.core for wall in free.workspace.obstacles]


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


def test_the_scan_is_the_one_that_its_example_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shipped and freshly made points are equal but for rounding."""
    monkeypatch.setattr("sys.argv", ["scan", str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "15_scan_a_pipe_gallery.py"), run_name="__main__")
    shipped, made = (read_scan(folder / "pipe-gallery.ply").points for folder in (JOBS, tmp_path))
    assert cKDTree(shipped).query(made)[0].max() < 1e-3
    assert abs(len(shipped) - len(made)) < 10


@pytest.mark.drawn(2, of="examples")
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


@pytest.mark.drawn(2, of="examples")
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
