"""Writes, renames, removals and solvers fail at a few places, drawn at random.

``python -m tests.faults solve --every`` lets each of them fail in turn.
"""

import subprocess
import sys

import pytest


@pytest.mark.planning
@pytest.mark.parametrize(
    "arguments",
    [["solve", "check", "compare", "--count", "1"], ["solve", "check", "--space", "--count", "1"]],
    ids=["in the plane", "in space"],
)
def test_what_fails_underneath_leaves_the_old_result_or_the_new_one(arguments: list[str]) -> None:
    """Whatever fails, there is a whole result, the user's file is still there, and a line says what happened."""
    command = [sys.executable, "-m", "tests.faults", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert ended.returncode == 0, ended.stdout + ended.stderr
