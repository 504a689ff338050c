"""Commands under faults, and whether what they leave is what must be left."""

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
"""A file of the user's in the output folder."""
CODES_OF_RESULTS = frozenset({0, 2, 3, 4})
"""What a command may end with; 1 is a bug in ccm_opt."""


@dataclass(frozen=True)
class Outcome:
    """What a command did under a fault.

    Attributes:
        code: exit code.
        stdout: what it printed.
        stderr: what it told.
        faults: what was counted, and what failed.
    """

    code: int
    stdout: str
    stderr: str
    faults: Faults

    def defects(self) -> list[str]:
        """What is wrong with code and words, whatever was left on disk."""
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
    """Run a command of the command line in this process, one of its operations failing.

    Args:
        arguments: of the command line.
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
    """A folder with an earlier plan and a note of the user's, in which commands run again and again.

    Attributes:
        root: a folder of its own.
        problem: file of the problem that is solved.
    """

    root: Path
    problem: Path = PROBLEM

    @property
    def out(self) -> Path:
        """Where output folders go."""
        return self.root / "runs"

    @property
    def target(self) -> Path:
        """The folder of the plan."""
        return self.out / self.problem.stem

    @property
    def earlier(self) -> Path:
        """A copy of the folder as the earlier run has left it."""
        return self.root / "earlier"

    @property
    def later(self) -> Path:
        """A copy of the folder as a run without faults leaves it."""
        return self.root / "later"

    def solve(self, *more: str) -> list[str]:
        """Arguments of the command that makes a plan."""
        return ["solve", str(self.problem), "--out", str(self.out), "--no-pictures", "--quiet", *more]

    def prepare(self) -> None:
        """Make the earlier plan and the later one."""
        for place, more in ((self.earlier, ("--set", "arm.radius=0.02")), (self.later, ())):
            outcome = run(self.solve(*more), None)
            if outcome.code != 0:
                raise RuntimeError(outcome.stderr)
            (self.target / NOTE).write_text("mine", encoding="utf-8")
            shutil.copytree(self.target, place)

    def restore(self) -> None:
        """Put the earlier plan in its place."""
        shutil.rmtree(self.out)
        shutil.copytree(self.earlier, self.target)

    def defects(self) -> list[str]:
        """What is wrong with what stands in the place of the plan: it is neither the old result nor the new one."""
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
        """Folders and files beside the plan that no whole result is."""
        beside = [path for path in self.out.iterdir() if path != self.target]
        return [path.name for path in beside if not _is_whole_record(path)]


def _differences(folder: Path, kept: Path) -> list[str]:
    """Names of files that differ; of a record the times of its stages may."""
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
    """Whether it is the folder of a failure or of an unfinished plan, with a record that can be read."""
    record = path / "solution.json"
    if path.name.startswith(".") or not record.is_file():
        return False
    return "status" in json.loads(record.read_text(encoding="utf-8"))
