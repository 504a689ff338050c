"""Ctrl-C at any moment: exit code 130, one line, no traceback; an interrupt that is lost comes again."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from .conftest import PROBLEMS

SWALLOWED = """
import os, signal, sys, time
from ccm_opt.cli.cancelling import interrupt_met, interrupts_insist, leave_at_once, report_cancelled

interrupts_insist()
try:
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        pass  # as C code does that drops what was raised
    {meanwhile}
    time.sleep(60)
except KeyboardInterrupt:
    report_cancelled()
    leave_at_once()
"""
IN_A_FINALISER = """
class Held:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)

held = Held()
"""
LET_GO = """
from ccm_opt.cli.cancelling import interrupts_insist, leave_at_once, report_cancelled

interrupts_insist()
try:
    del held
    time.sleep(60)
except KeyboardInterrupt:
    report_cancelled()
    leave_at_once()
"""
HALF_MADE = """
import os, signal, time
from ccm_opt.cli.cancelling import interrupts_insist, leave_at_once, report_cancelled

class Held:
    def __init__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(60)
        self.whole = True

    def __del__(self):
        self.whole

interrupts_insist()
try:
    Held()
except KeyboardInterrupt:
    report_cancelled()
leave_at_once()
"""
HANDLED = "interrupt_met(); time.sleep(1); sys.exit(7)"
"""What answers an interrupt, and goes on for longer than it takes to look again."""


def ended(command: list[str], cwd: Path, after: float | None = None) -> tuple[int, str]:
    """Exit code and messages of a process, interrupted after a time [s] where one is given."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=cwd)
    assert process.stderr is not None
    said = ""
    if after is not None:
        said = process.stderr.readline()  # from here on it is our own code that runs
        time.sleep(after)
        process.send_signal(signal.SIGINT)
    said += process.communicate(timeout=120)[1]
    return process.returncode, said


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer that sends signals")
def test_an_interrupt_that_is_lost_comes_again(tmp_path: Path) -> None:
    """Code that drops what Ctrl-C raises does not keep the command running; one that answers it is left alone."""
    code, said = ended([sys.executable, "-c", SWALLOWED.format(meanwhile="pass")], tmp_path)
    assert (code, said) == (130, "error: cancelled\n")
    code, said = ended([sys.executable, "-c", SWALLOWED.format(meanwhile=HANDLED)], tmp_path)
    assert (code, said) == (7, "")


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer that sends signals")
def test_an_interrupt_in_a_finaliser_is_not_told_of(tmp_path: Path) -> None:
    """Python can raise nothing there and prints it; it comes again soon, and one line says so."""
    script = f"import os, signal, time\n{IN_A_FINALISER}{LET_GO}"
    assert ended([sys.executable, "-c", script], tmp_path) == (130, "error: cancelled\n")


def test_objects_that_an_interrupt_leaves_half_made_are_not_told_of(tmp_path: Path) -> None:
    """What their finalisers stumble over, as those of archives do, is no news once Ctrl-C has struck."""
    assert ended([sys.executable, "-c", HALF_MADE], tmp_path) == (130, "error: cancelled\n")


@pytest.mark.drawn(6, of="processes")
def test_a_solve_that_is_interrupted_says_so_and_leaves_an_earlier_plan(tmp_path: Path) -> None:
    """At any moment: 130 or, when it was just done, success; one line, no traceback; an earlier plan is as it was."""
    folder = tmp_path / "runs" / "swan-neck"
    folder.mkdir(parents=True)
    (folder / "solution.json").write_text("{}")
    (folder / "solution.npz").write_bytes(b"earlier")
    command = [sys.executable, "-m", "ccm_opt", "solve", str(PROBLEMS / "swan-neck.toml"), "--no-pictures"]
    code, said = ended(command, tmp_path, 2.0 * random.random())  # noqa: S311
    assert "Traceback" not in said
    assert code in {0, 130}
    if code == 130:
        assert "error: cancelled" in said
        assert (folder / "solution.npz").read_bytes() == b"earlier"
    assert not [name for name in os.listdir(tmp_path / "runs") if name.startswith(".")]  # noqa: PTH208


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there is no timer")
def test_the_timer_ends_when_ctrl_c_is_met() -> None:
    """No alarm is left for Python's own end, which forgets its handlers and would be ended by it."""
    script = """
import os, signal
from ccm_opt.cli.cancelling import interrupt_met, interrupts_insist
interrupts_insist()
try:
    os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt:
    assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
    interrupt_met()
assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
"""
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 0, ended.stderr


LOADING = """
import os, signal, sys
from ccm_opt.cli.cancelling import interrupts_insist, leave_at_once, report_cancelled

sys.path.insert(0, {folder!r})
interrupts_insist()
try:
    import slow
    print("loaded" if slow.done else "", flush=True)
    import time
    time.sleep(60)
except KeyboardInterrupt:
    print(slow.done, flush=True)
    report_cancelled()
    leave_at_once()
"""
SLOW = """
import os, signal, time

class Watched:
    def __set_name__(self, owner, name):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.3)  # an error here would come out as another

class Owner:
    watched = Watched()

done = True
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there is no timer")
def test_modules_are_loaded_whole_before_ctrl_c_is_met(tmp_path: Path) -> None:
    """An interrupt that strikes while a module is loaded waits for its end, and comes as what it is."""
    (tmp_path / "slow.py").write_text(SLOW)
    script = LOADING.format(folder=str(tmp_path))
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 130
    assert ended.stdout.endswith("True\n")  # it may come between what is printed and the end of that line
    assert ended.stderr == "error: cancelled\n"


STRUCK = """
import os, signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background would ignore it
left = None

class Finder:
    def find_spec(self, name, path=None, target=None):
        global left
        left = {after} if name == "ccm_opt.cli.commands" else left
        if left is not None:
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
sys.argv = ["ccm-opt", "describe", {file!r}]
from ccm_opt.cli import main
main()
"""


AN_EXIT_CODE = """
import signal, sys
from ccm_opt.cli import commands, main

def app():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        sys.exit(130)  # as Typer does, without a word

commands.app = app
main()
"""


def test_ctrl_c_that_the_library_of_commands_meets_is_told(tmp_path: Path) -> None:
    """Where it comes out as an exit code before a command begins, the line is written all the same."""
    assert ended([sys.executable, "-c", AN_EXIT_CODE], tmp_path) == (130, "error: cancelled\n")


@pytest.mark.parametrize("most", [30, 300])
def test_ctrl_c_while_the_command_line_is_loaded(tmp_path: Path, most: int) -> None:
    """Whichever module it strikes at, it ends the command with one line."""
    script = STRUCK.format(after=random.randint(1, most), file=str(PROBLEMS / "swan-neck.toml"))  # noqa: S311
    assert ended([sys.executable, "-c", script], tmp_path) == (130, "error: cancelled\n")
