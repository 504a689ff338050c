"""Comparison of planners: suites, methods, resuming, failures, files, and the command line."""

import csv
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ccm_opt.cli import comparing
from ccm_opt.cli.compare import methods as method_code
from ccm_opt.cli.compare import running
from ccm_opt.cli.compare.comparison_files import comparison_json, runs_csv, write_problems
from ccm_opt.cli.compare.comparison_page import comparison_page
from ccm_opt.cli.compare.methods import METHODS, check_methods, code_of, method_named
from ccm_opt.cli.compare.running import Comparison, compare
from ccm_opt.cli.compare.runs import Run, Task, execute, failed_run, open_journal
from ccm_opt.cli.compare.space_clutter import KEPT_OFF, links_apart
from ccm_opt.cli.compare.suites import SUITES, Case, cases_from_files, distinct, shared_folder, suite_cases
from ccm_opt.cli.comparing import compare_methods
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.reading import load_problem

from .conftest import PROBLEMS, SMALL_PROBLEM

STRAIGHT = "tests.comparison_tasks:StraightPlanner"
BROKEN = "tests.comparison_tasks:BrokenPlanner"
TO_JOINTS = SMALL_PROBLEM.replace("position = [0.3, 0.1]", "joints_deg = [0.0, 10.0, 10.0, 10.0]")


class InThread:
    """Executes in a thread of this process, and counts how often an executor is opened."""

    def __init__(self) -> None:
        self.opened = 0

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor with one thread."""
        self.opened += 1
        with ThreadPoolExecutor(1) as executor:
            yield executor, 2


def small_cases(tmp_path: Path, count: int = 3) -> tuple[Case, ...]:
    """Copies of the small problem with a goal for the joints, and one with a goal for the tip."""
    for k in range(count):
        (tmp_path / f"p{k}.toml").write_text(TO_JOINTS.replace('"small"', f'"small-{k}"'))
    (tmp_path / "tip.toml").write_text(SMALL_PROBLEM.replace('"small"', '"tip"'))
    return cases_from_files(sorted(tmp_path.glob("*.toml")))


def wanted(tmp_path: Path, **changes: object) -> dict[str, Any]:
    """Options of the command line."""
    values = {
        "files": sorted(tmp_path.glob("*.toml")), "suites": (), "count": None, "seed": 0, "methods": (STRAIGHT,),
        "planners": (), "workers": 1, "dask": None, "out": tmp_path / "out", "time_limit": None, "page": False,
    }  # fmt: skip
    return {**values, **changes}


@pytest.fixture
def in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command's workers are threads, where what is told of runs counts and not who makes them."""
    monkeypatch.setattr(comparing, "LocalWorkers", lambda _: InThread())


# ---------------------------------------------------------------- suites


@pytest.mark.parametrize("suite", [*SUITES, "clutter-3"])
def test_a_seed_gives_the_same_problem_everywhere(suite: str) -> None:
    """Two makings of one case agree in every number; another seed differs."""
    first, again = (suite_cases(suite, 2, first_seed=7) for _ in range(2))
    assert first == again
    one, two, other = first[0].problem(), again[0].problem(), first[1].problem()
    assert one.name == f"{suite}-7"
    np.testing.assert_array_equal(one.start.bends, two.start.bends)  # type: ignore[union-attr]
    np.testing.assert_array_equal(one.goal.position, two.goal.position)  # type: ignore[union-attr]
    assert [wall.core for wall in one.workspace.walls] == [wall.core for wall in two.workspace.walls]
    assert not np.array_equal(one.goal.position, other.goal.position)  # type: ignore[union-attr]


@pytest.mark.parametrize("suite", ["open-space", "clutter-20", "clutter-80"])
def test_starts_and_goals_of_random_problems_touch_nothing(suite: str) -> None:
    """Both poses keep off every obstacle and off themselves, and obey the joint limits."""
    for seed in range(4):
        scene = SUITES[suite](seed)
        for pose in (scene.start, scene.goal):
            points = scene.arm.joint_positions(pose)
            line = shapely.LineString(points[1:])
            assert links_apart(scene.arm, points, KEPT_OFF)
            assert all(line.distance(wall.core) > scene.arm.radius for wall in scene.workspace.walls)
            assert np.all(np.abs(scene.arm.bends(pose)) <= scene.arm.bend_limits)
        assert len(scene.workspace.obstacles) == int(suite.partition("clutter-")[2] or 0)


def test_the_shared_suite_is_the_problem_files() -> None:
    """All files of the folder with a fixed base, in the order of their names; fewer when asked."""
    cases = suite_cases("shared")
    fixed = [path.stem for path in PROBLEMS.glob("*.toml") if not path.stem.startswith("feed-")]
    assert [case.name for case in cases] == sorted(fixed)
    assert suite_cases("shared", 2) == cases[:2]
    assert shared_folder() == PROBLEMS


def test_what_is_no_suite_is_refused_with_the_names() -> None:
    """An unknown name, and more shared problems than there are, say what to try."""
    with pytest.raises(ProblemError, match="shared, open-space, clutter-20"):
        suite_cases("open-sapce")
    count = len(suite_cases("shared"))
    with pytest.raises(ProblemError, match=f"has {count} problems"):
        suite_cases("shared", count + 1)


def test_two_problems_of_one_name_are_refused(tmp_path: Path) -> None:
    """The same problem twice counts once; another one of the same name is refused."""
    cases = small_cases(tmp_path, 1)
    assert distinct((*cases, *cases)) == cases
    (tmp_path / "p0.toml").write_text(TO_JOINTS.replace('"small"', '"small-0"') + "\nheading_tolerance_deg = 2.0\n")
    with pytest.raises(ProblemError, match="'small-0'"):
        distinct((*cases, *small_problem_again(tmp_path)))


def small_problem_again(tmp_path: Path) -> tuple[Case, ...]:
    """The first file, read again."""
    return cases_from_files([tmp_path / "p0.toml"])


# ---------------------------------------------------------------- methods


@pytest.mark.parametrize("name", METHODS)
def test_every_method_of_the_table_makes_a_planner(name: str) -> None:
    """Each method makes something with a ``plan``, and its options are options of a problem."""
    if name == "ompl":
        pytest.importorskip("ompl.geometric")
    problem = method_named(name).prepared(suite_cases("open-space", 1)[0].problem(), 3.0)
    assert callable(method_named(name).planner(problem).plan)
    prepared = problem.planner
    assert prepared.time_limit == 3.0
    assert all(getattr(prepared, key) == value for key, value in method_named(name).options.items())


@pytest.mark.parametrize("file", ["feed-s-duct.toml", "space/elbow.toml"])
def test_the_sampler_alone_refuses_a_feed_axis(file: str) -> None:
    """What cannot be planned by RRT-Connect alone is said before any search."""
    problem = load_problem(PROBLEMS / file)
    with pytest.raises(ProblemError, match="does not support a feed axis"):
        method_named("rrt-connect").planner(problem).plan(problem)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nlpp", "expected one of nlp"),
        ("no_such_module:Planner", "No module named"),
        ("tests.comparison_tasks:Missing", "loading the planner .*Missing"),
        ("tests.comparison_tasks:leave", "SystemExit"),
        ("tests.comparison_tasks:NOT_A_PLANNER", "without a method 'plan'"),
    ],
)
def test_what_is_no_planner_is_refused_before_any_work(name: str, message: str) -> None:
    """A method that cannot be had is told with its name."""
    with pytest.raises(ProblemError, match=message):
        check_methods([name])


def test_methods_count_once() -> None:
    """A method named twice is run once."""
    assert check_methods([STRAIGHT, STRAIGHT]) == (STRAIGHT,)


# ---------------------------------------------------------------- runs


def test_a_run_holds_every_figure_of_a_verified_motion(tmp_path: Path) -> None:
    """What is solved has been timed and verified by the driver; CPU time is there, and no reason."""
    run = execute(Task(small_cases(tmp_path)[0], STRAIGHT))
    assert (run.outcome, run.reason, run.tactic) == ("solved", "", "straight")
    length = np.deg2rad(10.0) * np.sqrt(3.0)
    assert run.figure("joint_path_length_rad") == pytest.approx(length, rel=1e-6)
    assert run.figure("duration_s") > 0.0
    assert 0.0 <= run.figure("planning_cpu_s") <= run.figure("cpu_s")


def test_every_way_to_fail_is_an_outcome_with_a_reason(tmp_path: Path) -> None:
    """No plan, a refused motion, and a defect of a planner each end as a record, not as an exception."""
    cases = small_cases(tmp_path)
    no_plan = execute(Task(cases[-1], STRAIGHT))
    crash = execute(Task(cases[0], BROKEN))
    assert (no_plan.outcome, no_plan.reason) == ("no plan", "MotionNotFound: this planner goes to joint poses only")
    assert crash.outcome == "crashed"
    assert "ZeroDivisionError: no plan for small-0 (comparison_tasks.py, line" in crash.reason
    blocked = tmp_path / "blocked.toml"
    blocked.write_text(TO_JOINTS.replace("[0.0, 10.0, 10.0, 10.0]", "[120.0, 0.0, 0.0, 0.0]"))
    refused = execute(Task(cases_from_files([blocked])[0], STRAIGHT))
    assert refused.outcome == "refused"
    assert "wall clearance" in refused.reason


def test_keys_tell_runs_apart(tmp_path: Path) -> None:
    """Another problem, content, method or time limit is another run; the same is the same."""
    cases = small_cases(tmp_path)
    changed = Case(cases[0].name, "files", 0, cases[0].given, "other content")
    tasks = [Task(cases[0], STRAIGHT), Task(cases[1], STRAIGHT), Task(changed, STRAIGHT)]
    tasks += [Task(cases[0], "nlp"), Task(cases[0], STRAIGHT, 1.0)]
    assert len({task.key for task in tasks}) == len(tasks)
    assert Task(cases[0], STRAIGHT).key == tasks[0].key


# ---------------------------------------------------------------- code


def forget_code() -> None:
    """Forget digests of planners' code, and end the process that has loaded it."""
    code_of.cache_clear()
    method_code._package_digest.cache_clear()
    running._end_kept()


@pytest.fixture
def own_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package with a planner beside the user, whose module imports another."""
    folder = tmp_path / "my_planners"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "numbers.py").write_text("SPEED = 1\n")
    (folder / "mine.py").write_text("from tests.comparison_tasks import StraightPlanner\n")
    monkeypatch.syspath_prepend(tmp_path)
    forget_code()
    yield folder
    forget_code()
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_planners"]:
        del sys.modules[name]


@pytest.mark.drawn(2, of="comparisons")
@pytest.mark.usefixtures("in_threads")
def test_a_planner_that_was_changed_is_run_anew_and_said_so(
    tmp_path: Path, own_package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A changed file anywhere in a planner's package makes its runs anew, with a warning; others keep theirs."""
    small_cases(tmp_path, 1)
    method = "my_planners.mine:StraightPlanner"
    options = wanted(tmp_path, planners=(method,))
    journal = tmp_path / "out" / "journal.jsonl"
    assert compare_methods(**options) == 0
    before = journal.read_text().splitlines()
    assert "other code" not in capsys.readouterr().err

    (own_package / "numbers.py").write_text("SPEED = 2\n")
    forget_code()
    assert compare_methods(**options) == 0
    # Words may be broken into lines anywhere.
    err = " ".join(capsys.readouterr().err.split())
    assert f"2 runs of {method} in" in err
    assert "come from other code and are repeated" in err
    after = [json.loads(line) for line in journal.read_text().splitlines()]
    assert len(after) == len(before) + 2
    assert {run["method"] for run in after[len(before) :]} == {method}
    assert compare_methods(**options) == 0
    assert len(journal.read_text().splitlines()) == len(after)


def test_our_own_code_counts_but_for_pictures_and_tables() -> None:
    """Each source of planning, timing and verification is in the digest; what no run meets is not."""
    places = [place for place, _ in method_code._sources("ccm_opt")]
    met = [place for place in places if not place.startswith(method_code.NOT_MET)]
    assert "planning/search.py" in met
    assert "scene/pair_proofs.c" in met
    assert "verification/verifier.py" in met
    assert set(method_code.NOT_MET) <= {f"{place.partition('/')[0]}/" for place in places}
    assert code_of("nlp") == code_of("hill-climbing") != code_of(STRAIGHT)


def test_a_worker_with_other_code_makes_no_run(tmp_path: Path) -> None:
    """What a worker of another version would find is no result: it says which code it has, and is asked again later."""
    run = execute(Task(small_cases(tmp_path)[0], STRAIGHT, code="0" * 16))
    assert run.outcome == "crashed"
    assert "this worker's code of" in run.reason


# ---------------------------------------------------------------- problems as files


def test_problems_are_written_as_files_that_say_the_same(tmp_path: Path) -> None:
    """Random problems and those of files can be loaded again; nothing that says something else is replaced."""
    cases = (*suite_cases("clutter-20", 2), *suite_cases("duct", 1), *small_cases(tmp_path))
    files = write_problems(cases, tmp_path / "problems")
    assert [file.stem for file in files] == [case.name for case in cases]
    for case, file in zip(cases, files, strict=True):
        given, read = case.problem(), load_problem(file)
        np.testing.assert_allclose(read.start.bends, given.start.bends, atol=1e-12)
        np.testing.assert_allclose(read.limits.velocity, given.limits.velocity)
        assert len(read.workspace.obstacles) == len(given.workspace.obstacles)
        for one, other in zip(read.workspace.obstacles, given.workspace.obstacles, strict=True):
            assert one.core.equals_exact(other.core, 1e-12)
        assert read.tolerances == given.tolerances
    # Written again, all is well; changed by hand, it stays as it is.
    write_problems(cases, tmp_path / "problems")
    files[0].write_text("# mine\n")
    with pytest.raises(ProblemError, match="exists with other contents"):
        write_problems(cases, tmp_path / "problems")
    assert files[0].read_text() == "# mine\n"


# ---------------------------------------------------------------- comparing


def test_a_comparison_goes_on_where_it_stopped(tmp_path: Path) -> None:
    """Only missing runs are made; the whole is the same as without the stop, and no executor is opened for nothing."""
    cases, path = small_cases(tmp_path), tmp_path / "journal.jsonl"
    workers, made = InThread(), []
    with open_journal(path) as journal:
        compare(cases[:2], (STRAIGHT,), workers, journal)
    with open_journal(path) as journal:
        whole = compare(cases, (STRAIGHT,), workers, journal, progress=lambda run: made.append(run.problem))
        assert sorted(made) == sorted(case.name for case in cases[2:])
        assert compare(cases, (STRAIGHT,), workers, journal) == whole
    assert workers.opened == 2
    assert [run.problem for run in whole.method_runs(STRAIGHT)] == [case.name for case in cases]
    assert len(path.read_text().splitlines()) == len(cases)


def test_what_crashed_is_run_again(tmp_path: Path) -> None:
    """A defect may have been mended since, so a crash in the journal does not count as done."""
    cases, path = small_cases(tmp_path, 1)[:1], tmp_path / "journal.jsonl"
    with open_journal(path) as journal:
        journal.append(failed_run(Task(cases[0], STRAIGHT), RuntimeError("worker died")))
    with open_journal(path) as journal:
        assert compare(cases, (STRAIGHT,), InThread(), journal).method_runs(STRAIGHT)[0].solved


def made_comparison() -> Comparison:
    """A comparison nobody ran: two problems, two methods, one failure with an awkward reason."""

    def run(problem: str, method: str, outcome: str, reason: str, **figures: float) -> Run:
        return Run(f"{problem}{method}", problem, method, outcome, reason, figures)  # type: ignore[arg-type]

    rows = (
        (run("a", "nlp", "solved", "", duration_s=1.0), run("a", "nlp-paul", "solved", "", duration_s=2.0)),
        (run("b", "nlp", "solved", "", duration_s=3.0), run("b", "nlp-paul", "no plan", 'a "reason",\nin two lines')),
    )
    return Comparison(("a", "b"), ("nlp", "nlp-paul"), rows)


def test_files_hold_every_run_and_every_failure() -> None:
    """The CSV has a row a run that a reader splits again; the JSON has shares, pairs and failures, and no NaN."""
    rows = list(csv.DictReader(runs_csv(made_comparison()).splitlines(keepends=True)))
    assert [(row["problem"], row["method"], row["duration_s"]) for row in rows] == [
        ("a", "nlp", "1.0"), ("a", "nlp-paul", "2.0"), ("b", "nlp", "3.0"), ("b", "nlp-paul", ""),
    ]  # fmt: skip
    assert rows[-1]["reason"] == 'a "reason",\nin two lines'
    data = json.loads(comparison_json(made_comparison()), parse_constant=pytest.fail)
    assert [(method["name"], method["solved"]) for method in data["methods"]] == [("nlp", 2), ("nlp-paul", 1)]
    assert data["pairs"][0]["success"]["first_only"] == 1
    assert data["pairs"][0]["figures"]["duration_s"]["median_ratio"] == pytest.approx(0.5)
    assert data["pairs"][0]["figures"]["duration_s"]["interval"] == [0.0, None]
    assert [failure["problem"] for failure in data["failures"]] == ["b"]


def test_the_page_holds_every_run_and_every_pair() -> None:
    """Its data have the figures of every run, its tables every outcome and reason, escaped."""
    made = made_comparison()
    nasty = replace(made.runs[1][1], reason="</script><i>why</i>")
    page = comparison_page(replace(made, runs=(made.runs[0], (made.runs[1][0], nasty))))
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    runs = [(run["problem"], run["method"], run["solved"], run["figures"]) for run in data["runs"]]
    assert runs == [
        ("a", "nlp", True, {"duration_s": 1.0}),
        ("a", "nlp-paul", True, {"duration_s": 2.0}),
        ("b", "nlp", True, {"duration_s": 3.0}),
        ("b", "nlp-paul", False, {}),
    ]
    assert data["pairs"] == [["nlp", "nlp-paul"]]
    assert data["methods"][0]["interval"] == pytest.approx([made.solved("nlp")[1].low, 1.0])
    assert "2 of 2" in page
    assert "1 of 2" in page
    assert "<i>why" not in page
    assert "&lt;i&gt;why" in page


# ---------------------------------------------------------------- command line


@pytest.mark.drawn(2, of="comparisons")
def test_the_command_tells_and_writes_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Tables by method and by pairs, every failure with its reason, CSV, JSON, the page; exit code 0."""
    small_cases(tmp_path, 1)
    options = wanted(tmp_path, methods=(STRAIGHT, "nlp"), page=True)
    assert compare_methods(**options) == 0
    out = capsys.readouterr().out
    assert "medians of the methods, 2 problems" in out
    assert f"{STRAIGHT} against nlp" in out
    assert f"tip, {STRAIGHT}: no plan. MotionNotFound: this planner goes to joint poses only" in out
    files = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert sorted(files) == [
        "comparison.html",
        "comparison.json",
        "journal.jsonl",
        "runs.csv",
    ]
    assert len(files["journal.jsonl"].splitlines()) == 4


@pytest.mark.usefixtures("in_threads")
def test_a_crash_is_a_bug_and_the_rest_is_still_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A planner with a defect gives exit code 1 after all runs are made."""
    small_cases(tmp_path)
    assert compare_methods(**wanted(tmp_path, planners=(BROKEN,))) == 1
    out = capsys.readouterr().out
    assert out.count("crashed. ZeroDivisionError") == 4
    assert STRAIGHT in out


def test_bad_input_ends_before_any_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown suite or method gives exit code 2, and nothing is written."""
    assert compare_methods(**wanted(tmp_path, suites=("nothing",))) == 2
    assert compare_methods(**wanted(tmp_path, methods=("nothing",))) == 2
    assert "there is no suite 'nothing'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.drawn(2, of="comparisons")
@pytest.mark.planning
def test_an_interrupt_leaves_what_is_done(tmp_path: Path) -> None:
    """Ctrl-C in the middle ends the workers, gives exit code 130, and the next run goes on from the journal."""
    journal = tmp_path / "journal.jsonl"
    command = [sys.executable, "-m", "ccm_opt", "compare", "--suite", "open-space", "--method", "nlp", "--no-pictures"]
    command += ["--out", str(tmp_path), "--count"]
    process = subprocess.Popen([*command, "60"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not (journal.exists() and journal.read_text().count("\n") >= 2):
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "repeat the command to continue" in errors
    before = journal.read_text()
    done = subprocess.run([*command, "2"], capture_output=True, text=True, check=True)
    assert "nlp solved 2, 100 %" in " ".join(done.stdout.split())
    assert journal.read_text() == before
