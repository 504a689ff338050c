"""The command line: exit codes, messages, and what is left on disk."""

import json
import os
import subprocess
import sys
import types
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from ccm_opt import __version__
from ccm_opt.cli.commands import app
from ccm_opt.cli.outcome import folded, run_all
from ccm_opt.cli.output import ControllerChoice, MethodChoice
from ccm_opt.core.errors import (
    ConfigurationNotFound,
    Diagnosis,
    Finding,
    TimeLimitReached,
    UnreachableGoal,
    VerificationError,
)
from ccm_opt.core.progress import Progress
from ccm_opt.problem import ControllerName, MethodName, Problem
from ccm_opt.problem.solution import SimulationOutcome, SimulationVerdict, Solution

from .conftest import PROBLEMS, SMALL_PROBLEM, make_solution

PROOF = Finding("too short", "the goal is out of reach")


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything printed."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


def stand_in(monkeypatch: pytest.MonkeyPatch, solve: Callable[[Problem], Solution]) -> None:
    """Put a made-up solver in the place of the pipeline."""

    def staged(problem: Problem, *, progress: Callable[[Progress], None], explain: bool) -> Solution:
        del explain
        progress(Progress("thinking"))
        return solve(problem)

    module = types.ModuleType("ccm_opt.driver.pipeline")
    module.solve = staged  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ccm_opt.driver.pipeline", module)


def bend_a_little(problem: Problem) -> Solution:
    """A plan that is well-formed, though it is not what was asked."""
    return make_solution(problem, np.full(problem.arm.links, 0.3))


@pytest.fixture
def problem_path(tmp_path: Path) -> Path:
    """A sound problem file."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL_PROBLEM)
    return path


BAD = {
    "base in an obstacle": ("base = [0.0, 0.0]", "base = [0.0, 0.25]", "the base is 0.05 m inside 'post'"),
    "odd link count": ("links = 4", "links = 5", "even number"),
    "self-crossing polygon": (
        "circle = { center = [0.0, 0.3], radius = 0.1 }",
        "polygon = [[0.5, 0.5], [0.7, 0.9], [0.7, 0.5], [0.5, 0.7]]",
        "the outline crosses",
    ),
    "unknown key": ("radius = 0.02", "radius = 0.02\ncolour = 3", "unknown key 'colour'"),
    "misspelt key": ("link_length", "link_lenght", "did you mean 'link_length'?"),
    "not a number": ("radius = 0.02", "radius = nan", "finite number"),
    "wrong type": ("radius = 0.02", 'radius = "thin"', "arm.radius: expected a number, got"),
    "no such method": ("[goal]", "[planner]\nmethod = 'hill climbing'\n[goal]", "hill-climbing"),
    "limit of no feed": ("velocity = 2.0", "velocity = 2.0\nfeed_force = 3.0", "only allowed together with arm.feed"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_explained_and_nothing_is_written(problem_path: Path, tmp_path: Path, name: str) -> None:
    """A bad problem ends with exit code 2, its file's name, the reason and its line, and leaves no file behind."""
    old, new, message = BAD[name]
    problem_path.write_text(SMALL_PROBLEM.replace(old, new))
    code, output = run("solve", problem_path, "--out", tmp_path / "runs")
    assert code == 2
    assert f"{problem_path} has 1 error" in output
    assert message in output
    assert "line " in output
    assert "Traceback" not in output
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"\x7fELF\xff\x00\x01", "not a text file"),
        (b"name = ", "not valid TOML"),
        (None, "no such file"),
    ],
    ids=["empty", "binary", "syntax", "missing"],
)
def test_files_that_are_no_problems_are_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    """An empty, binary, broken or missing file ends with exit code 2 and a clear message."""
    path = tmp_path / "problem.toml"
    if content is not None:
        path.write_bytes(content)
    code, output = run("solve", path, "--out", tmp_path / "runs")
    assert (code, message in output) == (2, True)
    assert not (tmp_path / "runs").exists()


def test_a_real_process_refuses_bad_input_on_stderr(problem_path: Path, tmp_path: Path) -> None:
    """The installed command prints errors on stderr, nothing on stdout, and exits with 2."""
    problem_path.write_text(SMALL_PROBLEM.replace("links = 4", "links = 5"))
    code = "import sys; from ccm_opt.cli import main; main()"
    command = [sys.executable, "-c", code, "solve", str(problem_path), "--out", str(tmp_path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "arm.links: expected an even number" in done.stderr
    assert not (tmp_path / "runs").exists()


def test_the_version_is_the_package_version() -> None:
    """``--version`` prints the version and nothing else."""
    assert run("--version") == (0, f"ccm-opt {__version__}\n")


def test_linear_algebra_runs_on_one_thread_unless_the_user_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The entry point sets the thread variables before anything heavy loads, and respects the user's."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.setenv("MKL_NUM_THREADS", "7")
    code = """
import os
from ccm_opt.cli import main
try:
    main()
except SystemExit:
    print(os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"])
"""
    done = subprocess.run([sys.executable, "-c", code, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[1] == "1 7"


def test_a_solved_problem_is_written_and_reported(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 0, a complete folder with its picture, and a table of checks, duration, torque and times."""
    stand_in(monkeypatch, bend_a_little)
    code, output = run("solve", problem_path, "--out", tmp_path / "runs")
    assert code == 0
    names = {path.name for path in (tmp_path / "runs" / "small").iterdir()}
    assert names == {
        "solution.json",
        "solution.npz",
        "trajectory.csv",
        "trajectory.yaml",
        "arm.urdf",
        "arm.mjcf.xml",
        "plan.png",
        "motion.gif",
        "report.html",
    }
    assert (tmp_path / "runs" / "small" / "plan.png").read_bytes().startswith(b"\x89PNG")
    for piece in (
        "small: solved",
        "Tip error at the goal",
        "Gap to walls",
        "checks passed",
        "link 3, post",
        "Duration",
        "Peak torque",
        "thinking",
    ):
        assert piece in output


def test_pictures_can_be_left_out(problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``--no-pictures`` writes no picture."""
    stand_in(monkeypatch, bend_a_little)
    assert run("solve", problem_path, "--out", tmp_path, "--no-pictures")[0] == 0
    left = {path.name for path in (tmp_path / "small").iterdir()}
    assert not left & {"plan.png", "motion.gif", "report.html"}


def test_all_files_are_tried_and_the_highest_code_counts(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bad file before a good one does not keep the good one from being solved."""
    stand_in(monkeypatch, bend_a_little)
    code, output = run("solve", tmp_path / "missing.toml", problem_path, "--out", tmp_path / "runs")
    assert code == 2
    assert "no such file" in output
    assert (tmp_path / "runs" / "small" / "solution.npz").is_file()


def test_two_files_of_one_name_do_not_overwrite_each_other(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second problem of a name is refused, and that is told before the first is solved."""
    stand_in(monkeypatch, bend_a_little)
    twin = tmp_path / "twin.toml"
    twin.write_text(SMALL_PROBLEM)
    code, output = run("solve", problem_path, twin, "--out", tmp_path / "runs")
    assert (code, "the same name 'small'" in output) == (2, True)
    assert output.index("would share a folder; only one is solved") < output.index("small: ")


def failing(error: BaseException) -> Callable[[Problem], Solution]:
    """A solver that raises."""

    def solve(problem: Problem) -> Solution:
        del problem
        raise error

    return solve


def test_what_would_help_is_printed(problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What fails before the search is exit code 3 with the reason and the advice."""
    stand_in(
        monkeypatch, failing(UnreachableGoal(Diagnosis("no route is short enough", "routes", ("lengthen the arm",))))
    )
    code, output = run("solve", problem_path, "--out", tmp_path / "runs")
    assert code == 3
    assert "no route is short enough" in output
    assert "try: lengthen the arm" in output


@given(width=st.integers(1, 200), lengths=st.lists(st.floats(-2.0, 2.0), min_size=2, max_size=6))
def test_messages_are_folded_between_words(width: int, lengths: list[float]) -> None:
    """At any width every word, number with its unit and place stays whole, and no text is lost."""
    whole = [f"{1e3 * length:.1f} mm" for length in lengths] + [f"({lengths[0]:.3f}, {lengths[1]:.3f})"]
    text = "goal.position: the arm is too thick\n  solved with arm.radius ≤ 3 mm: " + " and ".join(whole)
    lines = folded(text, width).splitlines()
    assert " ".join(" ".join(lines).split()) == " ".join(text.split())
    assert all(any(each in line for line in lines) for each in whole)
    # Too long is only what cannot be folded.
    assert all(len(line) <= width or len(line.split()) <= 3 for line in lines)


@pytest.mark.parametrize(
    ("error", "code", "status"),
    [
        (ConfigurationNotFound(Diagnosis("every corridor failed", "configuration")), 3, "no plan found"),
        (UnreachableGoal(Diagnosis("no way", "necessary checks", findings=(PROOF,))), 3, "infeasible"),
        (TimeLimitReached(Diagnosis("60 s have passed", "motion", findings=(PROOF,))), 3, "infeasible"),
        (TimeLimitReached(Diagnosis("60 s have passed", "motion")), 3, "timed-out"),
        (VerificationError(["wall clearance: -1 mm"]), 3, "no plan found"),
        (KeyboardInterrupt(), 130, "cancelled"),
    ],
    ids=["no plan", "proved", "timed out but proved", "timed out", "refused", "cancelled"],
)
def test_a_search_without_a_plan_leaves_its_diagnosis(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, status: str
) -> None:
    """A failed search ends with its code and a record of why; checking that folder later says the same."""
    stand_in(monkeypatch, failing(error))
    got, output = run("solve", problem_path, "--out", tmp_path)
    assert got == code
    assert "Traceback" not in output
    # Who presses Ctrl-C does not wait for a page.
    page = set() if code == 130 else {"report.html"}
    assert {path.name for path in (tmp_path / "small").iterdir()} == {"solution.json"} | page
    record = json.loads((tmp_path / "small" / "solution.json").read_text())
    assert record["status"] == status
    assert record["diagnosis"]["reason"]
    assert "thinking" in record["timings"]
    checked, output = run("check", tmp_path / "small")
    assert (checked, "no plan to check" in output) == (3, True)


def test_a_bug_shows_its_traceback_and_exits_with_1(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that nobody foresaw is exit code 1, whatever the other files did."""
    stand_in(monkeypatch, failing(ZeroDivisionError("oops")))
    code, output = run("solve", problem_path, tmp_path / "missing.toml", "--out", tmp_path / "runs")
    assert code == 1
    assert "ZeroDivisionError: oops" in output
    assert "bug" in output
    assert not (tmp_path / "runs").exists()


def test_an_unwritable_place_is_refused_before_solving(problem_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``--out`` below a file is exit code 2, at once."""
    stand_in(monkeypatch, failing(ZeroDivisionError("should not be called")))
    code, output = run("solve", problem_path, "--out", problem_path / "runs")
    assert (code, "choose another --out" in output) == (2, True)


def test_other_methods_are_refused(problem_path: Path) -> None:
    """``--method`` takes what this version can do."""
    code, output = run("solve", problem_path, "--method", "magic")
    assert (code, "'magic'" in output) == (2, True)


def test_choices_are_those_of_the_problem_file() -> None:
    """Options that stand for a key of the problem file take what the key takes."""
    assert get_args(MethodChoice) == get_args(MethodName)
    assert get_args(ControllerChoice) == get_args(ControllerName)


def test_check_verifies_from_files_alone(problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan that misses its goal is refused with exit code 3 and a table that shows where."""
    stand_in(monkeypatch, bend_a_little)
    run("solve", problem_path, "--out", tmp_path, "--no-pictures")
    problem_path.unlink()
    code, output = run("check", tmp_path / "small")
    assert code == 3
    assert "small: refused" in output
    assert "Tip error at the goal" in output
    assert "fails" in output


@pytest.mark.parametrize("lost", ["solution.json", "solution.npz"])
def test_check_refuses_incomplete_folders(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    """A folder without one of its files is bad input."""
    stand_in(monkeypatch, bend_a_little)
    run("solve", problem_path, "--out", tmp_path, "--no-pictures")
    (tmp_path / "small" / lost).unlink()
    code, output = run("check", tmp_path / "small")
    assert (code, f"{lost}: there is no such file" in output) == (2, True)


def test_check_refuses_a_tampered_problem(problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A record whose problem no longer passes as one is bad input, with the key path."""
    stand_in(monkeypatch, bend_a_little)
    run("solve", problem_path, "--out", tmp_path, "--no-pictures")
    path = tmp_path / "small" / "solution.json"
    record = json.loads(path.read_text())
    record["problem"]["arm"]["radius"] = -1.0
    path.write_text(json.dumps(record))
    code, output = run("check", tmp_path / "small")
    assert (code, "arm.radius" in output) == (2, True)


@pytest.mark.planning
def test_the_swan_neck_is_solved_and_its_folder_checked(tmp_path: Path) -> None:
    """The paper's example (section 5) is solved through the real pipeline, and its files alone verify."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", "from ccm_opt.cli import main; main()"]
    for arguments in (
        ["solve", str(PROBLEMS / "swan-neck.toml"), "--out", str(tmp_path), "--no-pictures"],
        ["check", str(tmp_path / "swan-neck")],
    ):
        done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "swan-neck" / "solution.json").read_text())["status"] == "solved"


def reported(stdout: int | None, *arguments: object) -> subprocess.CompletedProcess[str]:
    """A real process whose stand-in solver returns at once; its standard output is given."""
    code = """
import sys, types
import numpy as np
from tests.conftest import make_solution
module = types.ModuleType("ccm_opt.driver.pipeline")
module.solve = lambda problem, **_: make_solution(problem, np.full(problem.arm.links, 0.3))
sys.modules["ccm_opt.driver.pipeline"] = module
from ccm_opt.cli import main
main()
"""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    root = PROBLEMS.parent
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False, cwd=root)


def two_problems(folder: Path) -> list[Path]:
    """Two sound problem files."""
    paths = [folder / "first.toml", folder / "second.toml"]
    for path in paths:
        path.write_text(SMALL_PROBLEM.replace('"small"', f'"{path.stem}"'))
    return paths


@pytest.mark.drawn(6, of="processes")
def test_a_reader_that_goes_away_does_not_stop_the_work(tmp_path: Path) -> None:
    """With a broken pipe as stdout both files are solved and written, quietly, with exit code 0."""
    reader, writer = os.pipe()
    os.close(reader)
    done = reported(writer, "solve", *two_problems(tmp_path), "--out", tmp_path, "--no-pictures")
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")
    assert all((tmp_path / name / "solution.npz").is_file() for name in ("first", "second"))


@pytest.mark.drawn(6, of="processes")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_device_is_no_bug(tmp_path: Path) -> None:
    """When stdout cannot be written the plans are, and one line says so; the exit code is 1."""
    with Path("/dev/full").open("w") as full:
        done = reported(full.fileno(), "solve", *two_problems(tmp_path), "--out", tmp_path, "--no-pictures")
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "the result cannot be printed" in done.stderr
    assert all((tmp_path / name / "solution.npz").is_file() for name in ("first", "second"))


def test_the_package_runs_as_a_module() -> None:
    """``python -m`` is the command line too."""
    done = subprocess.run([sys.executable, "-m", "ccm_opt", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"ccm-opt {__version__}\n"


@pytest.mark.parametrize("module", ["ccm_opt.cli.commands", "ccm_opt.cli.solving"])
def test_ctrl_c_while_modules_load_is_no_traceback(module: str) -> None:
    """An interrupt during an import ends with exit code 130 and one line."""
    code = f"""
import sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
from ccm_opt.cli import main
main()
"""
    command = [sys.executable, "-c", code, "solve", "missing.toml"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: cancelled\n")


@pytest.mark.parametrize(("outcome", "expected"), [("followed", 0), ("strayed", 4)])
def test_an_arm_that_leaves_the_plan_has_its_own_exit_code(
    problem_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, outcome: SimulationOutcome, expected: int
) -> None:
    """What the simulated arm did wrong is told on stderr with what to try; the plan stands, and is written."""
    verdict = SimulationVerdict(outcome, 1e-3, "ball01_bend is 0.11 rad off", advice=("a smaller simulation.step",))

    def solve(problem: Problem) -> Solution:
        solution = bend_a_little(problem)
        return replace(solution, simulation=replace(solution.simulation, verdict=verdict))

    stand_in(monkeypatch, solve)
    code, output = run("solve", problem_path, "--out", tmp_path, "--no-pictures")
    assert code == expected
    said = (
        "warning: small: the simulated arm does not follow its plan (strayed): ball01_bend is 0.11 rad off\n  try: a "
    )
    assert (said in output) is (expected == 4)
    assert (tmp_path / "small" / "solution.npz").exists()


@pytest.mark.parametrize(
    ("codes", "worst"),
    [((0, 4), 4), ((4, 2, 0), 2), ((3, 4, 2), 3), ((4, 1, 3), 1), ((4, 130, 3), 130), ((), 0)],
)
def test_of_several_files_the_worst_outcome_counts(codes: tuple[int, ...], worst: int) -> None:
    """A bug, then Ctrl-C, no plan, bad input, a plan that is not followed; only Ctrl-C ends the others."""
    assert run_all(codes, lambda code: code) == worst
