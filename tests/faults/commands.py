"""Commands run with injected faults, and checks of the files that they leave."""

import io
import json
import shutil
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from ccm_opt.cli import main
from tests.conftest import PROBLEMS
from tests.faults.injection import Faults, injected

PROBLEM = PROBLEMS / "swan-neck.toml"
IN_SPACE = PROBLEMS / "space" / "swan-neck-in-space.toml"
NOTE = "notes.txt"
"""Name of a file of the user in the output folder."""
CODES_OF_RESULTS = frozenset({0, 2, 3, 4})
"""Allowed exit codes of commands; 1 is a bug in ccm_opt."""


@dataclass(frozen=True)
class Outcome:
    """Result of a command with an injected fault.

    Attributes:
        code: exit code.
        stdout: text on standard output.
        stderr: text on standard error.
        faults: counted operations, and the failed one.
    """

    code: int
    stdout: str
    stderr: str
    faults: Faults

    def defects(self) -> list[str]:
        """Return defects in exit code and output, regardless of files."""
        told = self.stdout + self.stderr
        found = []
        if self.code not in CODES_OF_RESULTS:
            found.append(f"exit code {self.code}")
        if "Traceback" in told:
            found.append("a traceback")
        if self.code in {2, 3} and not self.stderr.strip():
            found.append("no word of why")
        return found


def run(arguments: Sequence[str], fail_at: int | None) -> Outcome:
    """Run a ``ccm-opt`` command in this process, with one failing operation.

    Args:
        arguments: arguments of the command line.
        fail_at: number of the operation that fails, from 1; None: none.
    """
    stdout, stderr = io.StringIO(), io.StringIO()
    sys.argv = ["ccm-opt", *arguments]
    code = 0
    with redirect_stdout(stdout), redirect_stderr(stderr), injected(fail_at) as faults:
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException as error:  # noqa: BLE001 - whatever comes out is a defect to be told
            stderr.write(f"Traceback: {error!r}")
            code = 1
    return Outcome(code, stdout.getvalue(), stderr.getvalue(), faults)


@dataclass(frozen=True)
class Bench:
    """Folder with an earlier plan and a file of the user, in which commands are run repeatedly.

    Attributes:
        root: the folder.
        problem: path of the problem file.
    """

    root: Path
    problem: Path = PROBLEM

    @property
    def out(self) -> Path:
        """Parent directory of output folders."""
        return self.root / "runs"

    @property
    def target(self) -> Path:
        """Output folder of the plan."""
        return self.out / self.problem.stem

    @property
    def earlier(self) -> Path:
        """Copy of the output folder after the earlier run."""
        return self.root / "earlier"

    @property
    def later(self) -> Path:
        """Copy of the output folder after a run without faults."""
        return self.root / "later"

    def solve(self, *more: str) -> list[str]:
        """Return the arguments of the command that solves the problem."""
        return ["solve", str(self.problem), "--out", str(self.out), "--no-pictures", "--quiet", *more]

    def prepare(self) -> None:
        """Write the output folders of the earlier run and of a run without faults."""
        for place, more in ((self.earlier, ("--set", "arm.radius=0.02")), (self.later, ())):
            outcome = run(self.solve(*more), None)
            if outcome.code != 0:
                raise RuntimeError(outcome.stderr)
            (self.target / NOTE).write_text("mine", encoding="utf-8")
            shutil.copytree(self.target, place)

    def restore(self) -> None:
        """Restore the output folder of the earlier run."""
        shutil.rmtree(self.out)
        shutil.copytree(self.earlier, self.target)

    def defects(self) -> list[str]:
        """Return defects of the output folder; there are none if it is equal to the old or the new one."""
        if not self.target.is_dir():
            return ["there is no folder any more"]
        if not (self.target / NOTE).is_file():
            return ["the user's file is gone"]
        old, new = (_differences(self.target, kept) for kept in (self.earlier, self.later))
        if not old or not new:
            return []
        # Where a solver has failed another plan may be found; it is as good if it is whole, and the verifier takes it.
        same_files = {path.name for path in self.target.iterdir()} == {path.name for path in self.later.iterdir()}
        whole = same_files and run(["check", str(self.target), "--quiet"], None).code == 0
        return [] if whole else [f"neither old nor new: {old} and {new}"]

    def leftovers(self) -> list[str]:
        """Return the names of files and folders beside the output folder that are no complete results."""
        beside = [path for path in self.out.iterdir() if path != self.target]
        return [path.name for path in beside if not _is_whole_record(path)]


def _differences(folder: Path, kept: Path) -> list[str]:
    """Return the names of files that differ between two folders; times of stages in records are ignored."""
    names = {path.name for path in folder.iterdir()}
    expected = {path.name for path in kept.iterdir()}
    if names != expected:
        return sorted(names ^ expected)
    return [name for name in sorted(names) if _content(folder / name) != _content(kept / name)]


def _content(path: Path) -> object:
    if path.suffix != ".json":
        return path.read_bytes()
    record = json.loads(path.read_text(encoding="utf-8"))
    record.pop("timings", None)
    return record


def _is_whole_record(path: Path) -> bool:
    """Return whether a folder is that of a failure or of an unfinished plan, with a readable record."""
    record = path / "solution.json"
    if path.name.startswith(".") or not record.is_file():
        return False
    return "status" in json.loads(record.read_text(encoding="utf-8"))
