"""Ctrl-C at random moments of a command: it ends soon, with exit code 130 or its result, and without a traceback.

How soon is counted in CPU time, of the command and of all processes that it has started, so that what else a machine
does matters little. Half of the signals go to the command alone, and half to its workers, too, as a terminal does it.
"""

import itertools
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import PROBLEMS

IN_SPACE = PROBLEMS / "space" / "blade-row.toml"
LATEST = 2.0
"""A command that computes for so long after Ctrl-C does not hear it [s]; one is wanted, on a machine that is idle."""
HANGING = 120.0
"""One that goes on for so long hangs, whatever the machine does [s]."""
TOLD_AFTER = 20
"""Number of interrupts between two reports of progress."""
CANCELLED = 130
"""Exit code of an interrupted command."""
SHOWN = 8.0
"""After so long a page that is shown without end has long been there [s]."""


@dataclass(frozen=True)
class _Strike:
    """Result of one interrupt: exit code, CPU time spent after the interrupt [s], and defects."""

    code: int
    computed: float
    defect: str


def interrupted_commands(generator: random.Random) -> Iterator[str]:
    """Commands without end, each interrupted once; what was wrong, or an empty word.

    Before the interpreter has come to the command line, at about 0.1 s, Python itself answers Ctrl-C. Every command is
    interrupted in its turn, at any moment of its course.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        plan = place / "plan" / "swan-neck"
        for problem in (PROBLEMS / "swan-neck.toml", IN_SPACE):
            _ended(["solve", str(problem), "--out", str(plan.parent), "--no-pictures"])
        commands = _commands(place, plan)
        lasts = [_seconds(command, place) for command in commands]
        slowest = 0.0
        cancelled = 0
        for number, (command, seconds) in enumerate(itertools.cycle(zip(commands, lasts, strict=True)), start=1):
            strike = _interrupted(command, generator.uniform(0.15, max(seconds, 0.3)), whole=generator.random() < 0.5)
            yield strike.defect or ("" if (plan / "solution.json").is_file() else f"{command[0]}: the plan is gone")
            slowest = max(slowest, strike.computed)
            cancelled += strike.code == CANCELLED
            if number % TOLD_AFTER == 0:
                print(f"  {cancelled} of {number} cancelled, with at most {slowest:.1f} s of CPU time", flush=True)  # noqa: T201
            shutil.rmtree(place / "out", ignore_errors=True)


def _commands(place: Path, plan: Path) -> list[list[str]]:
    problem = str(PROBLEMS / "swan-neck.toml")
    out = ["--out", str(place / "out")]
    return [
        ["solve", problem, *out],
        ["solve", problem, "--out", str(plan.parent), "--no-pictures"],
        ["check", str(plan)],
        ["simulate", str(plan)],
        ["pose", problem, *out],
        ["reach", problem, *out],
        ["compare", problem, "--method", "nlp", *out],
        ["export", str(plan), "--format", "urdf", "--out", str(place / "out" / "arm.urdf")],
        ["tolerance", str(plan)],
        ["draw", str(plan), *out],
        ["describe", problem],
        ["problems"],
        ["new", str(place / "out" / "mine.toml")],
        ["view", problem, "--no-browser", "--port", str(_free_port())],
        ["solve", str(IN_SPACE), *out],
        ["check", str(plan.parent / IN_SPACE.stem)],
    ]


def _seconds(command: list[str], place: Path) -> float:
    """Return the duration of a command without interrupt [s]."""
    if command[0] == "view":
        return SHOWN
    begun = time.monotonic()
    _ended(command)
    shutil.rmtree(place / "out", ignore_errors=True)
    return time.monotonic() - begun


def _interrupted(command: list[str], after: float, *, whole: bool) -> _Strike:
    """Run a command, interrupt it, and return the result.

    Args:
        command: program and arguments.
        after: time until the interrupt, unless the command ends before [s].
        whole: whether the child processes of the command are interrupted, too.
    """
    before = _of_children()
    process = _started(command)
    try:
        process.wait(after)
        spent = _of_children() - before
    except subprocess.TimeoutExpired:
        spent = _of_group(process.pid)
        if whole:
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.send_signal(signal.SIGINT)
    to = "with its workers" if whole else "alone"
    what = f"{' '.join(command[:2])}, interrupted {to} after {after:.2f} s"
    try:
        _, told = process.communicate(timeout=HANGING)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return _Strike(-signal.SIGKILL, HANGING, f"{what}, went on for {HANGING:.0f} s")
    computed = _of_children() - before - spent
    words = told.decode(errors="replace")
    defect = ""
    if process.returncode not in {0, CANCELLED} or "Traceback" in words:
        defect = f"{what}: exit code {process.returncode}, {words[-400:]}"
    elif computed > LATEST:
        defect = f"{what}, computed for {computed:.1f} s more"
    return _Strike(process.returncode, computed, defect)


def _of_children() -> float:
    """Return the CPU time of all ended child processes [s]."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def _of_group(group: int) -> float:
    """Return the CPU time of the processes in a group, and of their ended child processes [s]."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = place.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        if int(fields[2]) == group:
            ticks += sum(int(field) for field in fields[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def _free_port() -> int:
    """Return a port of this machine that is not in use."""
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


def _started(command: list[str]) -> subprocess.Popen[bytes]:
    # What a shell starts in the background ignores Ctrl-C, and so would its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return subprocess.Popen(
        [sys.executable, "-m", "ccm_opt", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        process_group=0,  # a group of its own, together with its workers
    )


def _ended(command: list[str]) -> None:
    process = _started(command)
    _, told = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(told.decode(errors="replace"))
