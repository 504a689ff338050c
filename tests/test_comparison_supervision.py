"""Whatever a planner does, its run ends as a record that says what happened, and the others are made."""

import multiprocessing
import subprocess
import sys
import time
from pathlib import Path
from uuid import uuid4

import pytest

from ccm_opt.cli.compare.running import RunProcess, SupervisionSettings, compare, run_apart, wall_limit
from ccm_opt.cli.compare.runs import Run, Task, open_journal
from ccm_opt.core.executors import LocalWorkers

from .test_comparison import STRAIGHT, small_cases

ROOT = Path(__file__).parent.parent
IMPATIENT = SupervisionSettings(time_factor=1.0, spare_time=1.5)
SPARING = SupervisionSettings(most_memory=700 << 20)


def run_of(tmp_path: Path, planner: str, settings: SupervisionSettings) -> Run:
    """What comes of a planner of the tests on a small problem."""
    case = small_cases(tmp_path, 1)[0]
    return run_apart(Task(case, f"tests.comparison_tasks:{planner}", time_limit=1.0), settings)


@pytest.mark.drawn(2)
@pytest.mark.parametrize(
    ("planner", "outcome", "words"),
    [
        ("HangingPlanner", "timed out", "exceeded 2.5 s of wall time and was stopped"),
        ("GreedyPlanner", "crashed", "exceeded 0.684 GiB of memory and was stopped"),
        ("DyingPlanner", "crashed", "the planner's process died: signal SIGSEGV"),
        ("LeavingPlanner", "crashed", "SystemExit: 3"),
        ("RubbishPlanner", "crashed", "TypeError: the planner returned"),
        ("BrokenPlanner", "crashed", "ZeroDivisionError: no plan for small-0"),
    ],
)
def test_what_a_planner_does_is_the_result_of_its_run(tmp_path: Path, planner: str, outcome: str, words: str) -> None:
    """Hanging, eating memory, dying, leaving, rubbish and errors are each told; the next run is made as ever."""
    # The first run of a process loads libraries, which takes its time on a busy machine.
    assert run_of(tmp_path, "StraightPlanner", SupervisionSettings()).solved
    run = run_of(tmp_path, planner, IMPATIENT if outcome == "timed out" else SPARING)
    assert run.outcome == outcome, run.reason
    assert words in run.reason
    assert run_of(tmp_path, "StraightPlanner", SupervisionSettings()).solved


def test_a_path_of_no_numbers_is_no_solution(tmp_path: Path) -> None:
    """A path that is not finite ends as a record, never as solved."""
    run = run_of(tmp_path, "NowherePlanner", SupervisionSettings())
    assert run.outcome in {"refused", "crashed", "no plan", "unusable"}
    assert run.reason


@pytest.mark.drawn(2, of="comparisons")
def test_a_suite_with_every_kind_of_planner_ends(tmp_path: Path) -> None:
    """Two workers, planners that die or fail, and a good one: one run each of each problem."""
    cases = small_cases(tmp_path, 1)
    bad = [f"tests.comparison_tasks:{name}Planner" for name in ("Dying", "Broken")]
    with open_journal(tmp_path / "journal.jsonl") as journal:
        found = compare(cases, (*bad, STRAIGHT), LocalWorkers(2), journal, time_limit=1.0)
    assert [run.solved for run in found.method_runs(STRAIGHT)] == [True, False]
    assert all(run.outcome != "solved" and run.reason for name in bad for run in found.method_runs(name))
    assert len((tmp_path / "journal.jsonl").read_text().splitlines()) == len(cases) * (len(bad) + 1)


@pytest.mark.drawn(2, of="comparisons")
def test_a_process_that_behaves_is_kept(tmp_path: Path) -> None:
    """Libraries are loaded once for many runs; after a fault there is another process."""
    settings = SupervisionSettings()
    process = RunProcess()
    task = Task(small_cases(tmp_path, 1)[0], STRAIGHT, 1.0)
    assert process.run(task, 60.0, settings).solved
    assert process.run(task, 60.0, settings).solved
    assert process.alive
    assert not process.run(Task(task.case, "tests.comparison_tasks:DyingPlanner", 1.0), 60.0, settings).solved
    assert not process.alive


def test_time_for_a_run_follows_the_limit_of_its_planner(tmp_path: Path) -> None:
    """Three times the planner's CPU time and some for the rest; the problem's own limit where none is given."""
    case = small_cases(tmp_path, 1)[0]
    settings = SupervisionSettings(spare_time=10.0)
    assert wall_limit(Task(case, STRAIGHT, 5.0), settings) == 25.0
    assert wall_limit(Task(case, STRAIGHT), settings) == 3.0 * case.problem().planner.time_limit + 10.0


@pytest.mark.drawn(2, of="comparisons")
@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_nothing_is_left_running_when_the_watcher_is_killed(tmp_path: Path) -> None:
    """A run whose watcher dies, even by SIGKILL, ends with it, though its planner hangs."""
    (tmp_path / "p.toml").write_text((ROOT / "problems" / "open-space.toml").read_text())
    script = (
        "from ccm_opt.cli.compare import running as s; from ccm_opt.cli.compare.runs import Task;"
        "from ccm_opt.cli.compare.suites import cases_from_files; from pathlib import Path;"
        f"case = cases_from_files([Path({str(tmp_path / 'p.toml')!r})])[0];"
        "process = s._process(); print(process._process.pid, flush=True);"
        "s.run_apart(Task(case, 'tests.comparison_tasks:HangingPlanner'))"
    )
    watcher = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=ROOT, text=True)
    assert watcher.stdout is not None
    child = int(watcher.stdout.readline())
    time.sleep(1.0)
    assert _running(child)
    watcher.kill()
    watcher.wait()
    watcher.stdout.close()
    end = time.monotonic() + 20.0
    while _running(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _running(child)


def _running(process: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.drawn(2, of="comparisons")
@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_no_children_are_left_when_a_comparison_is_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers end, and with them the processes in which their runs were made."""
    mark = f"mark-of-{uuid4().hex}"
    monkeypatch.setenv("MARK_OF_A_TEST", mark)
    seen: list[int] = []
    with open_journal(tmp_path / "journal.jsonl") as journal:
        compare(
            small_cases(tmp_path, 1),
            (STRAIGHT,),
            LocalWorkers(1),
            journal,
            time_limit=1.0,
            progress=lambda _: seen.append(len(marked(mark))),
        )
    assert not multiprocessing.active_children()
    end = time.monotonic() + 20.0
    while marked(mark) and time.monotonic() < end:
        time.sleep(0.05)
    assert max(seen) >= 1
    assert not marked(mark)


def marked(mark: str) -> set[str]:
    """Processes below this one that make runs, known by a variable that they inherit."""
    found = set()
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if (
                mark.encode() in (place / "environ").read_bytes()
                and b"answer_tasks" in (place / "cmdline").read_bytes()
            ):
                found.add(place.name)
        except OSError:
            continue
    return found
