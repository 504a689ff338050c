"""What commands print for programs, when asked to be quiet or to tell more, and how far a solve has come."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from ccm_opt.cli import stage_clock
from ccm_opt.cli.commands import app
from ccm_opt.cli.outcome import report_reason
from ccm_opt.cli.output import Output, printing
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.core.errors import Diagnosis, Finding, Relaxation
from ccm_opt.core.length_words import words_for_unit
from ccm_opt.core.progress import Progress, listening, report_candidate

from .conftest import SMALL_PROBLEM
from .test_cli import bend_a_little, stand_in


def run(*arguments: object, text: str | None = None) -> Result:
    """Run a command, standard output and standard error apart."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=text)


@pytest.fixture
def problem_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A sound problem file, which a stand-in solves."""
    stand_in(monkeypatch, bend_a_little)
    path = tmp_path / "small.toml"
    path.write_text(SMALL_PROBLEM)
    return path


def test_one_document_tells_of_every_file(problem_path: Path, tmp_path: Path) -> None:
    """It has status, exit code and folder of each file, defects with their lines, and nothing else is on stdout."""
    bad = tmp_path / "bad.toml"
    bad.write_text(SMALL_PROBLEM.replace("radius = 0.02", "radius = -1"))
    done = run("solve", problem_path, bad, "--out", tmp_path / "runs", "--no-pictures", "--json")
    document = json.loads(done.stdout)
    assert (document["command"], document["exit_code"], done.exit_code) == ("solve", 2, 2)
    solved, refused = document["results"]
    assert (solved["item"], solved["status"], solved["exit_code"]) == (str(problem_path), "solved", 0)
    assert json.loads((Path(solved["folder"]) / "solution.json").read_text())["metrics"] == solved["metrics"]
    assert (refused["status"], refused["exit_code"]) == ("bad input", 2)
    line = 1 + bad.read_text().splitlines().index("radius = -1")
    assert [(defect["line"], defect["key"]) for defect in refused["defects"]] == [(line, "arm.radius")]
    assert "arm.radius" in done.stderr


def test_other_commands_tell_programs_too(problem_path: Path, tmp_path: Path) -> None:
    """A refused plan lists its checks, an arm its link parameters, an exported text stands in the document."""
    run("solve", problem_path, "--out", tmp_path, "--no-pictures")
    folder = tmp_path / "small"
    checked = json.loads(run("check", folder, "--json").stdout)
    assert checked["exit_code"] == 3
    assert checked["results"][0]["status"] == "refused"
    assert any(not check["passed"] for check in checked["results"][0]["checks"])
    described = json.loads(run("describe", problem_path, "--json").stdout)["results"][0]
    assert len(described["link_parameters"]) == 3 * described["arm"]["links"]
    exported = json.loads(run("export", folder, "--format", "csv", "--json").stdout)["results"][0]
    assert exported["text"] == (folder / "trajectory.csv").read_text()


def test_quiet_says_only_what_is_wrong(problem_path: Path, tmp_path: Path) -> None:
    """A solved problem is silent; a refused one has its message on standard error."""
    done = run("solve", problem_path, "--out", tmp_path / "runs", "--no-pictures", "-q")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "")
    done = run("solve", tmp_path / "missing.toml", "-q")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "there is no such file" in done.stderr


def test_verbose_tells_every_stage(problem_path: Path, tmp_path: Path) -> None:
    """Every stage has a line on standard error, and the closing tables show every check."""
    done = run("solve", problem_path, "--out", tmp_path / "runs", "--no-pictures", "-v")
    assert done.stderr.splitlines() == ["small: loading", "small: thinking", "small: writing"]
    assert len(done.stdout.splitlines()) >= len(
        run("solve", problem_path, "--out", tmp_path / "runs").stdout.splitlines()
    )


def test_a_problem_comes_from_standard_input(problem_path: Path, tmp_path: Path) -> None:
    """``-`` reads it there, and its folder is named after the problem; defects name their place."""
    text = problem_path.read_text()
    done = run("solve", "-", "--out", tmp_path / "runs", "--no-pictures", "--set", "name=piped", text=text)
    assert done.exit_code == 0
    assert (tmp_path / "runs" / "piped" / "solution.json").is_file()
    done = run("solve", "-", text="name = 3")
    assert (done.exit_code, "standard input has" in done.stderr) == (2, True)


@pytest.mark.parametrize("method", ["nlp", "hill-climbing"])
def test_options_of_the_planner_are_keys_of_the_file(problem_path: Path, tmp_path: Path, method: str) -> None:
    """Method, time limit, seed and other keys of the command line stand in the record of the plan."""
    # The paper's planner draws nothing, and refuses a seed.
    seed = ("--seed", "3") if method == "nlp" else ()
    options = ("--method", method, "--time-limit", "7", *seed, "--set", "arm.radius=0.015")
    done = run("solve", problem_path, "--out", tmp_path / "runs", "--no-pictures", *options)
    assert done.exit_code == 0
    recorded = json.loads((tmp_path / "runs" / "small" / "solution.json").read_text())["problem"]
    planner = recorded["planner"]
    assert planner == {"method": method, "time_limit": 7.0} | ({"seed": 3} if seed else {})
    assert recorded["arm"]["radius"] == 0.015


@pytest.mark.parametrize(("after", "quiet", "told"), [(0.0, False, 1), (1e3, False, 0), (0.0, True, 0)])
def test_long_work_is_told_on_a_pipe(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], after: float, quiet: bool, told: int
) -> None:
    """Nothing for quick work; later a line now and then, with time, candidate and the least distance."""
    monkeypatch.setattr(stage_clock, "FIRST_LINE_AFTER", after)
    monkeypatch.setattr(stage_clock, "LINE_EVERY", 1e3)
    with printing(Output(quiet=quiet)), stage_display("room") as display:
        for candidate in (2, 3):
            display(Progress("motion", 1.5, 60.0, candidate, "tip-led", 0.0425))
    line = "room: motion, 1.5 of 60 s, candidate 2 (tip-led), closest so far 42.5 mm from the goal"
    assert capsys.readouterr().err.splitlines() == told * [line]


def test_every_line_of_a_reason_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    """Later news says what is new: a reason that says more, what helps; advice comes last, programs get all."""
    way = Output()
    far = Finding("too short", "out of reach; it is 2 m away")
    way_round = Finding("too short", "the way is 3 m long; round 'wall'")
    helps = Relaxation("length ≥ 3.1 m", "arm.link_length", 0.31)
    news = (
        Diagnosis(far.reason, "checks", ("soon",), findings=(far,)),
        Diagnosis(way_round.reason, "checks", ("soon",), findings=(way_round, far)),
        Diagnosis(way_round.reason, "checks", ("soon",), findings=(way_round, far), relaxations=(helps,)),
    )
    with printing(way):
        way.begin("small.toml")
        for each in news:
            report_reason(each)
        report_reason(news[-1], last=True)
    assert capsys.readouterr().err.splitlines() == [
        "error: small.toml: out of reach",
        "    it is 2 m away",
        "  more precisely: the way is 3 m long",
        "    round 'wall'",
        "  solved with length ≥ 3.1 m",
        "  try: soon",
    ]
    assert way.results[-1]["errors"] == [f"small.toml: {news[-1]}"]


def test_candidates_are_told_in_metres_to_who_listens() -> None:
    """Whatever unit the planner counts in; and nobody hears what is told when the work is over."""
    heard: list[float] = []
    with listening(lambda *news: heard.append(news[2])), words_for_unit(2.0):
        report_candidate(1, "tip-led", 0.25)
    report_candidate(2, "tip-led", 0.25)
    assert heard == [0.5]
