"""Closed streams, letters that nobody knows, warnings as errors, little memory: a result or one line, no traceback."""

import json
import os
import resource
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
import tomlkit

from ccm_opt.cli import surroundings
from ccm_opt.cli.outcome import NO_PLAN, SOLVED
from ccm_opt.cli.solving import failures_recorded
from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.io.reading import load_problem

from .conftest import PROBLEMS

OPEN_SPACE = PROBLEMS / "open-space.toml"
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
"""A locale in which files have no names but in ASCII."""
SILENT = """
import ctypes
import time
from pathlib import Path
from ccm_opt.cli.solving import failure_recorder
from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.cli.stage_clock import ended_when_silent
from ccm_opt.io.reading import load_problem

problem = load_problem({file!r})
clock = StageClock()
record = failure_recorder(problem, Path({out!r}), clock, pictures=False)
with ended_when_silent(problem.name, problem.planner, lambda news: None, record, {grace}) as told:
    for _ in range({times}):
        time.sleep(0.2)
        told("a stage")
    ctypes.PyDLL(None).sleep({silence})  # as C does that keeps the interpreter's lock
print("done")
"""


def ended(
    *arguments: str,
    cwd: Path,
    environment: Mapping[str, str] | None = None,
    first: Callable[[], None] | None = None,
) -> "subprocess.CompletedProcess[str]":
    """A command that has come to its end."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        preexec_fn=first,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=300,
        check=False,
    )


def closing(*numbers: int) -> Callable[[], None]:
    """Closes standard streams in a child."""

    def close() -> None:
        for number in numbers:
            os.close(number)

    return close


def allowing(megabytes: int) -> Callable[[], None]:
    """Allows a child so much address space."""
    size = megabytes * 1_000_000
    return lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size))


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A problem whose name and description are not in ASCII, in a file that is not either."""
    data = tomllib.loads(OPEN_SPACE.read_text()) | {"name": "räume-雪", "description": "größe 雪"}
    file = tmp_path / "auftrag-雪.toml"
    file.write_text(tomlkit.dumps(data), encoding="utf-8")
    return file


@pytest.mark.drawn(4, of="surroundings")
@pytest.mark.parametrize("numbers", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_are_no_failure(tmp_path: Path, numbers: tuple[int, ...]) -> None:
    """Nobody reads it, and the folder is written all the same, none of its files with what was printed in it."""
    command = ("-m", "ccm_opt", "solve", str(OPEN_SPACE), "--no-pictures")
    run = ended(*command, cwd=tmp_path, first=closing(*numbers))
    assert run.returncode == 0
    assert "Traceback" not in run.stderr
    assert check_folders([tmp_path / "runs" / "open-space"]) == SOLVED


@pytest.mark.skipif(os.name != "posix", reason="numbers of streams are inherited by POSIX systems")
def test_programs_that_are_started_have_the_streams_that_were_closed(tmp_path: Path) -> None:
    """What a command starts finds no standard stream closed either, and takes none of its pipes for one.

    The runs of ``compare`` did: with all three closed they ended by signals that nobody had sent.
    """
    script = (
        "import subprocess, sys\n"
        "from ccm_opt.cli.surroundings import ensure_stdio\n"
        "ensure_stdio()\n"
        "looks = 'import os; [os.fstat(number) for number in range(3)]'\n"
        "sys.exit(subprocess.run([sys.executable, '-c', looks]).returncode)\n"
    )
    assert ended("-c", script, cwd=tmp_path, first=closing(0, 1, 2)).returncode == 0


@pytest.mark.drawn(4, of="surroundings")
@pytest.mark.skipif(sys.platform != "linux", reason="how many files processes for workers need differs")
def test_workers_that_cannot_be_had_are_told_in_a_line(tmp_path: Path) -> None:
    """Where the system allows too few open files for processes, one line says so."""
    command = ("-m", "ccm_opt", "compare", str(OPEN_SPACE), "--no-pictures", "--workers", "1", "--out", "c")
    few = 8
    run = ended(*command, cwd=tmp_path, first=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (few, few)))
    assert run.returncode == 2
    assert "Traceback" not in run.stderr
    assert "cannot start 1 worker process" in run.stderr.splitlines()[-1]


@pytest.mark.drawn(4, of="surroundings")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems keep a directory that somebody is in")
def test_a_working_directory_that_was_removed_is_no_bug(tmp_path: Path) -> None:
    """Processes have to begin in it, so one line says that it is gone, and nothing is said of bugs."""
    gone = tmp_path / "gone"
    gone.mkdir()

    def leave() -> None:
        os.chdir(gone)
        gone.rmdir()

    command = ("-m", "ccm_opt", "compare", str(OPEN_SPACE), "--no-pictures", "--method", "nlp", "--workers", "1")
    # An empty part would be the working directory, without which Python itself does not start.
    parts = [str(PROBLEMS.parent), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    path = {"PYTHONPATH": os.pathsep.join(parts)}
    run = ended(*command, "--out", str(tmp_path / "c"), cwd=tmp_path, environment=path, first=leave)
    assert run.returncode == 2, run.stderr
    assert run.stderr.splitlines() == [
        "error: cannot start worker processes: the working directory no longer exists",
    ]


@pytest.mark.drawn(4, of="surroundings")
def test_a_locale_without_the_letters_of_a_name_is_told(foreign: Path) -> None:
    """Where no folder can have the name, one line says so and what to do."""
    run = ended("-m", "ccm_opt", "solve", foreign.name, "--no-pictures", cwd=foreign.parent, environment=ASCII)
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1
    assert "PYTHONUTF8=1" in run.stderr
    described = ended("-m", "ccm_opt", "describe", foreign.name, cwd=foreign.parent, environment=ASCII)
    assert described.returncode == 0, described.stderr


@pytest.mark.drawn(4, of="surroundings")
def test_a_stream_without_the_letters_gets_escapes(foreign: Path) -> None:
    """The folder has its name, and what is printed of it is readable in ASCII."""
    ascii_streams = {"PYTHONIOENCODING": "ascii"}
    command = ("-m", "ccm_opt", "solve", foreign.name, "--no-pictures")
    run = ended(*command, cwd=foreign.parent, environment=ascii_streams)
    assert run.returncode == 0, run.stderr
    assert "r\\xe4ume" in run.stdout
    assert (foreign.parent / "runs" / "räume-雪" / "solution.npz").is_file()


@pytest.mark.drawn(4, of="surroundings")
def test_warnings_as_errors_change_nothing(tmp_path: Path) -> None:
    """No library that is loaded, no code of ours warns."""
    run = ended("-m", "ccm_opt", "solve", str(OPEN_SPACE), cwd=tmp_path, environment={"PYTHONWARNINGS": "error"})
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.drawn(4, of="surroundings")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not keep this limit")
@pytest.mark.parametrize("megabytes", [200, 350, 500])
def test_little_memory_is_told_in_a_line(tmp_path: Path, megabytes: int) -> None:
    """A command has a result, or says in one line that memory is too little."""
    # Coverage and the like take memory of their own; this is about the command.
    run = ended("-m", "ccm_opt", "describe", str(OPEN_SPACE), cwd=tmp_path, first=allowing(megabytes))
    assert "Traceback" not in run.stderr
    assert run.returncode in {0, 1}
    if run.returncode == 1:
        assert "out of memory" in run.stderr.splitlines()[-1]
    if megabytes == 200:
        assert run.returncode == 1


@pytest.mark.drawn(4, of="surroundings")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process beside it")
def test_planning_that_falls_silent_is_ended_from_outside(tmp_path: Path) -> None:
    """What tells of itself goes on for as long as it likes; what does not is killed, and one line says so."""
    script = SILENT.format(file=str(OPEN_SPACE), out=str(tmp_path), grace=1.5, times=12, silence=0)
    run = ended("-c", script, cwd=tmp_path)
    assert (run.returncode, run.stdout, run.stderr) == (0, "done\n", "")
    script = SILENT.format(file=str(OPEN_SPACE), out=str(tmp_path), grace=0.5, times=0, silence=60)
    run = ended("-c", script, cwd=tmp_path)
    # On a machine that is very busy the process may not get to end itself, and is killed.
    assert run.returncode in {NO_PLAN, -signal.SIGKILL}
    assert "error: open-space: planning reported nothing for 0.5 s and was stopped" in run.stderr
    assert len(run.stderr.splitlines()) == 1
    record = json.loads((tmp_path / "open-space" / "solution.json").read_text())
    assert record["status"] == "timed-out"
    assert "reported nothing" in record["diagnosis"]["reason"]
    assert "memory" not in run.stderr + str(record["diagnosis"])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process beside it")
def test_what_is_known_outlives_a_search_for_changes_that_falls_silent(tmp_path: Path) -> None:
    """The process that listens has heard why there is no plan, and that is what stands in the record."""
    script = SILENT.format(file=str(OPEN_SPACE), out=str(tmp_path), grace=0.5, times=0, silence=60)
    known = (
        'Progress("diagnosis", known=Diagnosis("in contact", "checks", findings=(Finding("contact", "in contact"),)))'
    )
    script = script.replace("    ctypes", f"    told({known})\n    ctypes")
    script = f"from ccm_opt.core.errors import Diagnosis, Finding\nfrom ccm_opt.core.progress import Progress\n{script}"
    run = ended("-c", script, cwd=tmp_path)
    assert run.returncode in {NO_PLAN, -signal.SIGKILL}
    assert "the search for changes that would help reported nothing for 0.5 s" in run.stderr
    record = json.loads((tmp_path / "open-space" / "solution.json").read_text())
    assert (record["status"], record["diagnosis"]["reason"]) == ("infeasible", "in contact")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell")
def test_memory_is_said_to_have_run_out_only_where_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads that are refused for their number, and files of such a name are not that."""
    monkeypatch.setattr(surroundings, "address_space", lambda: None)
    assert not surroundings.is_out_of_memory(RuntimeError("can't start new thread"))
    assert not surroundings.is_out_of_memory(ValueError("no file 'out of memory.toml'"))
    assert not surroundings.is_out_of_memory(ImportError("failed to map segment from shared object: not permitted"))
    assert surroundings.is_out_of_memory(RuntimeError("std::bad_alloc"))
    monkeypatch.setattr(surroundings, "address_space", lambda: 1_000_000)
    assert surroundings.is_out_of_memory(RuntimeError("can't start new thread"))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process beside it")
def test_planning_that_falls_silent_is_ended_where_nobody_reads_of_it(tmp_path: Path) -> None:
    """The line that says so cannot be written, as after ``2>&1 | head -1``; the process is ended, with its record."""
    script = SILENT.format(file=str(OPEN_SPACE), out=str(tmp_path), grace=0.5, times=0, silence=60)
    reads, writes = os.pipe()
    os.close(reads)
    run = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, stderr=writes, timeout=300, check=False)
    os.close(writes)
    assert run.returncode in {NO_PLAN, -signal.SIGKILL}
    assert json.loads((tmp_path / "open-space" / "solution.json").read_text())["status"] == "timed-out"


HANGING = """
import ctypes
import time
from pathlib import Path
from ccm_opt.cli.stage_clock import ended_when_silent
from ccm_opt.io.reading import load_problem
from ccm_opt.core.executors import LocalWorkers


def work(name):
    Path(name).touch()
    ctypes.PyDLL(None).sleep(600)  # as C does that keeps the interpreter's lock


if __name__ == "__main__":
    problem = load_problem({file!r})
    with LocalWorkers(2).open() as (executor, _):
        tasks = [executor.submit(work, name) for name in ("first", "second")]
        while not (Path("first").exists() and Path("second").exists()):
            time.sleep(0.05)
        with ended_when_silent(problem.name, problem.planner, print, None, 0.5):
            tasks[0].result()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems cannot end a process whose interpreter is held")
def test_processes_that_hang_are_ended_with_their_command(tmp_path: Path) -> None:
    """Silence of other processes ends the command, and they end with it, since nobody holds its output any more."""
    script = tmp_path / "hanging.py"
    script.write_text(HANGING.format(file=str(OPEN_SPACE)), encoding="utf-8")
    run = ended(str(script), cwd=tmp_path)
    assert run.returncode in {NO_PLAN, -signal.SIGKILL}
    assert "planning reported nothing for 0.5 s" in run.stderr


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("std::bad_alloc")])
def test_memory_that_runs_out_leaves_a_record(tmp_path: Path, error: Exception) -> None:
    """Whatever says so, the folder tells why there is no plan; other errors are bugs and leave nothing."""
    problem = load_problem(OPEN_SPACE)
    with pytest.raises(type(error)), failures_recorded(problem, tmp_path, StageClock(), pictures=True):
        raise error
    record = json.loads((tmp_path / "open-space" / "solution.json").read_text())
    assert record["diagnosis"]["reason"] == "out of memory"
    with (
        pytest.raises(ValueError, match="a bug"),
        failures_recorded(problem, tmp_path / "b", StageClock(), pictures=True),
    ):
        raise ValueError("a bug")
    assert not (tmp_path / "b").exists()
