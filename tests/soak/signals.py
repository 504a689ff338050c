"""Ctrl-C at random moments of a command: it ends soon, with exit code 130 or its result, and without a traceback."""

import itertools
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.conftest import PROBLEMS

IN_SPACE = PROBLEMS / "space" / "blade-row.toml"
LATEST = 10.0
"""A command that goes on for so long after Ctrl-C hangs [s]; one is wanted, and machines are busy."""
SHOWN = 8.0
"""After so long a page that is shown without end has long been there [s]."""


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
        for command, seconds in itertools.cycle(zip(commands, lasts, strict=True)):
            yield _interrupted(command, generator.uniform(0.15, max(seconds, 0.3)), plan)
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
    """How long a command takes undisturbed [s]."""
    if command[0] == "view":
        return SHOWN
    begun = time.monotonic()
    _ended(command)
    shutil.rmtree(place / "out", ignore_errors=True)
    return time.monotonic() - begun


def _interrupted(command: list[str], after: float, plan: Path) -> str:
    """Run a command and interrupt it; what was wrong, or an empty word."""
    process = _started(command)
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    try:
        _, told = process.communicate(timeout=LATEST)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"{command[0]}, interrupted after {after:.2f} s, went on for {time.monotonic() - begun:.0f} s"
    words = told.decode(errors="replace")
    if process.returncode not in {0, 130} or "Traceback" in words:
        return f"{command[0]}, interrupted after {after:.2f} s: exit code {process.returncode}, {words[-400:]}"
    if not (plan / "solution.json").is_file():
        return f"{command[0]}, interrupted after {after:.2f} s: the earlier plan is gone"
    return ""


def _free_port() -> int:
    """A port of this machine that nobody listens at just now."""
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


def _started(command: list[str]) -> subprocess.Popen[bytes]:
    # What a shell starts in the background ignores Ctrl-C, and so would its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return subprocess.Popen(
        [sys.executable, "-m", "ccm_opt", *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def _ended(command: list[str]) -> None:
    process = _started(command)
    _, told = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(told.decode(errors="replace"))
