"""Folders are old or new and whole, whoever races, whatever fails, and whenever the writer is killed."""

import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file
from ccm_opt.io import folder as folder_swap
from ccm_opt.io.folder import ARRAYS, RECORD, WORKSHOP, write_folder
from ccm_opt.io.result_folders import FAILED, sibling_folder

OWN = "notes.txt"
"""A file of the user's in a folder of results."""
WRITER = """
import sys
from pathlib import Path
from ccm_opt.io.folder import write_folder
target, name, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
for k in range(count):
    said = f"{name} {k}".encode()
    write_folder(target, {"solution.json": said, "solution.npz": said * 10000, "pareto/1/plan.png": said})
    print(k, flush=True)
"""
"""Writes a folder again and again, all files of which say the same."""


def files(word: str) -> dict[str, bytes]:
    """A folder's files, all of which say one word."""
    return {RECORD: word.encode(), ARRAYS: 1000 * word.encode(), "pareto/1/plan.png": word.encode()}


def names_in(folder: Path) -> list[str]:
    """What a folder holds."""
    return sorted(path.name for path in folder.iterdir())


def word_of(target: Path) -> str:
    """What the files of a folder say, all the same."""
    word = (target / RECORD).read_text()
    assert (target / ARRAYS).read_bytes()[: len(word)].decode() == word
    assert (target / ARRAYS).stat().st_size % len(word) == 0
    assert (target / "pareto" / "1" / "plan.png").read_text() == word
    return word


def with_notes(target: Path) -> None:
    """A folder in which the user keeps a file and a folder."""
    write_folder(target, files("old"))
    (target / OWN).write_text("mine")
    (target / "photos").mkdir()
    (target / "photos" / "one.txt").write_text("mine too")


def assert_notes(target: Path) -> None:
    """What is the user's is there, and no workshop is."""
    assert (target / OWN).read_text() == "mine"
    assert (target / "photos" / "one.txt").read_text() == "mine too"


def writing(target: Path, name: str, count: int) -> "subprocess.Popen[str]":
    """A process that writes a folder."""
    command = [sys.executable, "-c", WRITER, str(target), name, str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.drawn(6, of="processes")
def test_racing_writers_refuse_nobody_and_lose_nothing(tmp_path: Path) -> None:
    """Of three processes that write one folder 30 times none is refused; it is always whole, the user's files stay."""
    target = tmp_path / "plan"
    with_notes(target)
    racers = [writing(target, f"racer{k}", 30) for k in range(3)]
    while any(racer.poll() is None for racer in racers):
        assert (target / OWN).read_text() == "mine"
        assert (target / RECORD).is_file()
        time.sleep(0.001)
    errors = [racer.communicate()[1] for racer in racers]
    assert errors == ["", "", ""]
    assert word_of(target).endswith(" 29")
    assert_notes(target)
    assert names_in(tmp_path) == ["plan"]


def test_a_failure_that_races_a_plan_leaves_the_plan(tmp_path: Path) -> None:
    """Whether there is a plan is looked at when nobody else writes: a record of a failure goes beside it."""
    target = tmp_path / "plan"

    def beside(wanted: Path) -> Path:
        return sibling_folder(wanted, FAILED)

    fails = [
        threading.Thread(target=write_folder, args=(target, {RECORD: b"{}"}), kwargs={"beside": beside})
        for _ in range(8)
    ]
    plans = [threading.Thread(target=write_folder, args=(target, files("plan"))) for _ in range(8)]
    together = [*fails, *plans]
    random.shuffle(together)
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert word_of(target) == "plan"
    assert {path.name for path in tmp_path.iterdir()} <= {"plan", "plan.failed"}


@pytest.mark.drawn(6, of="processes")
def test_killed_writers_leave_old_or_new_and_the_next_clears_up(tmp_path: Path) -> None:
    """SIGKILL at random moments: the folder is whole at once, and nothing is left beside it after the next run."""
    target = tmp_path / "plan"
    with_notes(target)
    for k in range(3):
        writer = writing(target, f"writer{k}", 100_000)
        assert writer.stdout is not None
        assert writer.stdout.readline()
        time.sleep(random.uniform(0.0, 0.05))  # noqa: S311 - not for secrets
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
        word_of(target)
        assert_notes(target)
    write_folder(tmp_path / "other", files("other"))
    assert names_in(tmp_path) == ["other", "plan"]
    word_of(target)
    assert_notes(target)


STEPS: list[tuple[Any, str]] = [
    *((os, name) for name in ("fsync", "link", "mkdir", "open", "rename", "replace")),
    *((Path, name) for name in ("open", "mkdir", "rename", "iterdir")),
    (shutil, "copytree"),
    (folder_swap, "_exchanged"),
]
"""What a write asks of the system."""


@pytest.mark.parametrize("exchange", [True, False], ids=["in one step", "in two steps"])
@pytest.mark.parametrize(("owner", "step"), STEPS, ids=lambda each: getattr(each, "__name__", each))
def test_a_write_that_fails_at_any_step_leaves_old_or_new(
    owner: Any, step: str, exchange: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For every k: the k-th call fails, and the folder is the old one or the new one, whole, with the user's files."""
    target = tmp_path / "plan"
    with_notes(target)
    for k in range(200):
        before = word_of(target)
        with monkeypatch.context() as patch:
            if not exchange:
                patch.setattr(folder_swap, "_exchanged", lambda *_: False)
            patch.setattr(owner, step, failing_at(k, calls := [0], getattr(owner, step)))
            refused = ""
            try:
                write_folder(target, files(f"try{k}"))
            except ProblemError as error:
                refused = str(error)
        assert not refused or "No space left" in refused
        assert word_of(target) == (before if refused else f"try{k}")
        assert_notes(target)
        if calls[0] <= k:
            break
    else:
        pytest.fail("the step is called without end")
    write_folder(target, files("last"))
    assert names_in(tmp_path) == ["plan"]


def failing_at(k: int, calls: list[int], original: Callable[..., Any]) -> Callable[..., Any]:
    """A function that fails at its k-th call, from 0, and counts."""

    def failing(*arguments: Any, **options: Any) -> Any:
        calls[0] += 1
        if calls[0] - 1 == k:
            raise OSError(28, "No space left on device")
        return original(*arguments, **options)

    return failing


@pytest.mark.parametrize("killed", ["before the swap", "between the two renames", "after the swap"])
def test_what_a_killed_writer_left_is_put_back(tmp_path: Path, killed: str) -> None:
    """An earlier plan without its place gets it back, what is the user's moves home, and the rest goes."""
    target = tmp_path / "plan"
    with_notes(target)
    workshop = tmp_path / f".plan{WORKSHOP}"
    (workshop / "new").mkdir(parents=True)
    (workshop / "new" / RECORD).write_text("half")
    if killed == "between the two renames":
        target.rename(workshop / "old")
    if killed == "after the swap":
        (target / OWN).rename(workshop / "new" / OWN)
    write_folder(tmp_path / "other", files("other"))
    assert word_of(target) == "old"
    assert_notes(target)
    assert names_in(tmp_path) == ["other", "plan"]


def test_folders_of_users_that_look_alike_are_left_alone(tmp_path: Path) -> None:
    """Only workshops are cleared up, not hidden folders whose names begin in the same way."""
    for name in (".plan.backup", ".plan"):
        (tmp_path / name).mkdir()
        (tmp_path / name / OWN).write_text("mine")
    write_folder(tmp_path / "plan", files("new"))
    assert names_in(tmp_path) == [".plan", ".plan.backup", "plan"]


def test_a_file_that_cannot_be_written_is_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One file alone is written whole or not at all, through links too, and keeps its permissions."""
    place = tmp_path / "trajectory.csv"
    place.write_text("old")
    place.chmod(0o640)
    link = tmp_path / "link.csv"
    link.symlink_to(place)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", failing_at(0, [0], os.fsync))
        with pytest.raises(OSError, match="No space left"):
            put_file(link, b"new")
    assert place.read_text() == "old"
    put_file(link, b"new")
    assert place.read_text() == "new"
    assert link.is_symlink()
    assert place.stat().st_mode & 0o777 == 0o640
    assert names_in(tmp_path) == ["link.csv", "trajectory.csv"]
    put_file(Path(os.devnull), b"nothing")
