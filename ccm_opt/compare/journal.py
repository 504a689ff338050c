"""The journal of a comparison: one line of JSON for each run, written as soon as the run is done.

A line is written by one call at the end of the file, so that a process that is killed leaves whole lines and at most
one torn one, which is cut off when the journal is opened again. Runs are identified by their keys; of two with the same
key the first counts, unless it crashed: a crash is a defect that may have been mended since.
"""

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ccm_opt.compare.runs import Run
from ccm_opt.errors import ProblemError


class Journal:
    """Runs in a file, each once.

    Args:
        path: the file; it is made when it is not there.

    Attributes:
        runs: those in the file, by key.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self.runs: dict[str, Run] = {}
        for run in _parsed(path, _whole_lines(descriptor)):
            if not self.has(run.key):
                self.runs[run.key] = run

    def has(self, key: str) -> bool:
        """Whether there is a run with this key that counts: one that did not crash."""
        return key in self.runs and self.runs[key].outcome != "crashed"

    def append(self, run: Run) -> None:
        """Write a run, unless one with its key counts already.

        Raises:
            ProblemError: when it cannot be written.
        """
        if self.has(run.key):
            return
        line = json_line(run)
        before = os.fstat(self._descriptor).st_size
        try:
            written = os.write(self._descriptor, line)
        except OSError as error:
            raise self._full(error.strerror or str(error)) from error
        # A line written in part must not be completed by a second call: another line could come between.
        if written != len(line):
            # What is torn is cut off; where even that fails, the next who opens the journal does it.
            with suppress(OSError):
                os.ftruncate(self._descriptor, before)
            raise self._full(f"only {written} of {len(line)} bytes; is the device full?")
        self.runs[run.key] = run

    def _full(self, reason: str) -> ProblemError:
        return ProblemError(
            f"cannot write {self._path}: {reason}; all {len(self.runs)} runs before this one are in it, and the same "
            "command goes on from there once there is room"
        )


@contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """A journal for one writer; a second one is refused while the first is there.

    Raises:
        ProblemError: when the file cannot be used, is used by another comparison, or holds something else.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # With O_APPEND every write goes to the end of the file, whoever wrote before.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise ProblemError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
    try:
        _lock(path, descriptor)
        yield Journal(path, descriptor)
    finally:
        os.close(descriptor)


def json_line(run: Run) -> bytes:
    """A run as a line of JSON; figures that are not finite are left out."""
    finite = {key: value for key, value in run.figures.items() if math.isfinite(value)}
    data = vars(run) | {"figures": finite}
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _lock(path: Path, descriptor: int) -> None:
    """Keep other comparisons out; the lock goes with the process. Where there are no such locks, nothing happens."""
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise ProblemError(f"{path} is being written by another comparison; choose another --out") from error


def _whole_lines(descriptor: int) -> list[bytes]:
    """The lines of the file; a torn one at its end is cut off the file."""
    size = os.fstat(descriptor).st_size
    # A duplicate, since closing the file closes its descriptor.
    with os.fdopen(os.dup(descriptor), "rb") as file:
        file.seek(0)
        content = file.read(size)
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.ftruncate(descriptor, whole)
    return content[:whole].splitlines()


def _parsed(path: Path, lines: list[bytes]) -> Iterator[Run]:
    for number, line in enumerate(lines, start=1):
        try:
            yield Run(**json.loads(line))
        except (ValueError, TypeError) as error:
            raise ProblemError(
                f"{path}, line {number} is no run of a comparison ({error}); delete the line or choose another --out"
            ) from error
