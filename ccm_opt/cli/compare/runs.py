"""Runs of a method on a problem: tasks for worker processes, results, journal, and the figures compared.

Each line of the journal is appended by one system call, so that a killed process leaves whole lines and at most one
partial line, which is removed when the journal is opened again. Runs are identified by keys. Of two runs with the same
key the first counts, unless it crashed: a crash is a defect that may have been fixed since.
"""

import hashlib
import json
import math
import os
import pickle
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Literal

from ccm_opt.cli.compare.methods import code_of, method_named
from ccm_opt.cli.compare.suites import Case
from ccm_opt.core.arguments import in_words
from ccm_opt.core.errors import NoPlanFound, ProblemError, TimeLimitReached, VerificationError
from ccm_opt.driver.legs import Planner
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath

Outcome = Literal["solved", "no plan", "timed out", "refused", "unusable", "crashed"]
"""Outcome of a run: a verified motion; no plan; time limit reached; rejected by the verifier; problem not supported by
the method; a crash."""
_ALONE = threading.Lock()
"""Lock that makes runs exclusive in a process with several threads, since compiled functions and IPOPT are not
thread-safe."""
LONGEST_REASON = 400
"""Maximum length of a reason that is kept [characters]."""
MICROMETRE = 1e-6
"""One micrometre, the difference up to which lengths count as equal, since no arm is built more exactly [m]."""


@dataclass(frozen=True)
class Quantity:
    """A figure of merit in which methods are compared.

    Attributes:
        key: key in records and files, which ends in the unit.
        title: title in tables.
        unit: unit of the values.
        scale: whether two values are compared by ratio or by difference.
        more_is_better: whether larger values are better.
        tie: maximum difference that counts as a tie, in ``unit``.
    """

    key: str
    title: str
    unit: str
    scale: Literal["ratio", "difference"] = "ratio"
    more_is_better: bool = False
    tie: float = 0.0


QUANTITIES = (
    Quantity("tip_error_m", "tip error", "m", "difference", tie=MICROMETRE),
    Quantity("least_wall_clearance_m", "clearance", "m", "difference", more_is_better=True, tie=MICROMETRE),
    Quantity("joint_path_length_rad", "joint path", "rad"),
    Quantity("duration_s", "duration", "s"),
    Quantity("peak_torque_Nm", "peak torque", "N m"),
    Quantity("planning_cpu_s", "planning CPU", "s"),
    Quantity("cpu_s", "total CPU", "s"),
)
"""Figures that are compared on the problems that both methods solve."""


@dataclass(frozen=True)
class Task:
    """A run to be made: one method on one problem.

    Attributes:
        case: the problem.
        method: name of the method.
        time_limit: CPU time limit of the planner [s]; None for that of the problem.
        code: expected hash of the code; empty for any code.
    """

    case: Case
    method: str
    time_limit: float | None = None
    code: str = ""

    @cached_property
    def key(self) -> str:
        """Key that identifies the run, so that a resumed comparison recognises finished runs."""
        options = sorted(method_named(self.method).options.items())
        # Everything that affects the result: an edited problem or changed code makes another run.
        parts = (self.case.name, self.case.fingerprint, self.method, options, self.time_limit, self.code)
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Run:
    """The result of a run of one method on one problem.

    Attributes:
        key: key of the task.
        problem: name of the problem.
        method: name of the method.
        outcome: outcome of the run.
        reason: reason why the problem was not solved; empty if it was.
        figures: figures by the keys of ``QUANTITIES``; those of the motion only if the problem was solved.
        wall: wall time of the run [s].
        tactic: name of the planner's candidate that found the motion.
        code: expected hash of the code.
    """

    key: str
    problem: str
    method: str
    outcome: Outcome
    reason: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    wall: float = 0.0
    tactic: str = ""
    code: str = ""

    @property
    def solved(self) -> bool:
        """Whether a verified motion was found."""
        return self.outcome == "solved"

    def figure(self, key: str) -> float:
        """Return a figure by its key; NaN if the run does not have it."""
        return self.figures.get(key, math.nan)


class ClockedPlanner:
    """Planner that calls another planner and measures its CPU time, even if planning fails.

    Attributes:
        seconds: CPU time of planning so far [s].
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.seconds = 0.0

    def plan(self, problem: Problem) -> JointPath:
        """Return the path that the wrapped planner finds.

        Raises:
            TypeError: the planner returned no path.
        """
        begin = time.process_time()
        try:
            # External planners are untyped, so the result is checked below.
            path: object = self._planner.plan(problem)
        finally:
            self.seconds += time.process_time() - begin
        if not isinstance(path, JointPath):
            raise TypeError(f"the planner returned {in_words(path)}; expected a JointPath")
        return path


def execute(task: Task) -> Run:
    """Return the result of a run made in this process; any error becomes the result.

    CPU time is measured for the whole process, so runs are made one at a time.
    """
    with _ALONE:
        _load_libraries()
        cpu_begin = time.process_time()
        wall_begin = time.perf_counter()
        # If making the planner fails, there is no planning time to record.
        planner = None
        try:
            _refuse_other_code(task)
            method = method_named(task.method)
            problem = method.prepared(task.case.problem(), task.time_limit)
            planner = ClockedPlanner(method.planner(problem))
            run = _solved(task, problem, planner)
        except BaseException as error:  # noqa: BLE001 - whatever a planner raises must not end the comparison
            run = failed_run(task, error)

        figures = dict(run.figures)
        if planner is not None:
            figures["planning_cpu_s"] = planner.seconds
            figures["cpu_s"] = time.process_time() - cpu_begin
        return replace(run, figures=figures, wall=time.perf_counter() - wall_begin)


def _solved(task: Task, problem: Problem, planner: ClockedPlanner) -> Run:
    from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads casadi and toppra

    # Failures are not explained: that would take time, and no figure depends on it.
    solution = solve(problem, planner=planner, explain=False)
    wanted = {quantity.key for quantity in QUANTITIES}
    figures = {key: float(x) for key, x in solution.metrics.items() if key in wanted and math.isfinite(x)}
    tactic = solution.path.candidate
    return Run(task.key, task.case.name, task.method, "solved", "", figures, tactic=tactic, code=task.code)


def _refuse_other_code(task: Task) -> None:
    """Raise an error if the code on this machine differs from the expected code, as on a worker with another version.

    Raises:
        RuntimeError: the code differs; the run counts as a crash, so that it is made again once the worker is updated.
    """
    here = code_of(task.method)
    if task.code and here != task.code:
        raise RuntimeError(
            f"this worker's code of {task.method} ({here}) differs from the requested one ({task.code}); "
            "install the same version on every worker and restart it"
        )


def failed_run(task: Task, error: BaseException) -> Run:
    """Return the result of a run that ended in an error."""
    outcome, reason = _run_outcome(error)
    return Run(task.key, task.case.name, task.method, outcome, reason[:LONGEST_REASON], code=task.code)


def _run_outcome(error: BaseException) -> tuple[Outcome, str]:
    """Return the outcome of a run that ended in an error, and the reason as a single line of text."""
    if isinstance(error, NoPlanFound):
        outcome: Outcome = "timed out" if isinstance(error, TimeLimitReached) else "no plan"
        return outcome, f"{type(error).__name__}: {error.diagnosis.reason}"
    if isinstance(error, VerificationError):
        return "refused", "the verifier rejects the motion: " + "; ".join(error.failures)
    if isinstance(error, ProblemError):
        return "unusable", str(error)
    where = ""
    # A crash is a defect, so the record says where it happened.
    if frames := traceback.extract_tb(error.__traceback__):
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"
    return "crashed", f"{type(error).__name__}: {error}{where}"


@cache
def _load_libraries() -> None:
    """Import libraries that are otherwise imported on first use, so that their time is charged to no run."""
    for name in ("ccm_opt.driver.pipeline", "casadi", "toppra.algorithm"):
        import_module(name)


def answer_tasks() -> None:
    """Make runs until standard input ends; the main function of child processes that make runs.

    Pickled tasks are read from standard input, and the pickled result of each is written to standard output. Output of
    planners is redirected to standard error, so that it is not mistaken for a result. Ctrl-C is left to the parent
    process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        _end_with(int(sys.argv[1]))
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with suppress(EOFError):
        while True:
            task = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the process that started this one
            pickle.dump(execute(task), answers)
            answers.flush()


def _end_with(pipe: int) -> None:
    """Make this process end when the other end of a pipe is closed, which happens when the parent process dies.

    The system then sends a signal whose default action ends the process, even if no Python thread runs. (The Linux
    signal on the death of the parent is unsuitable, since it is sent when the parent's thread ends.)
    """
    import fcntl  # noqa: PLC0415 - not on every system

    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([pipe], [], [], 0.0)[0]:  # it was closed before
        sys.exit()


class Journal:
    """A file of all finished runs of a comparison, which can be resumed from the file.

    Args:
        path: the file; it is created if it does not exist.

    Attributes:
        runs: runs in the file, by key.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self.runs: dict[str, Run] = {}
        for run in _parsed(path, _whole_lines(descriptor)):
            if not self.has(run.key):
                self.runs[run.key] = run

    def has(self, key: str) -> bool:
        """Return whether the journal has a run with a given key that did not crash."""
        return key in self.runs and self.runs[key].outcome != "crashed"

    def append(self, run: Run) -> None:
        """Append a run, unless the journal has a run with the same key that did not crash.

        Raises:
            ProblemError: the run cannot be written.
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
            # Cut off the partial line; if that fails too, the next one to open the journal does it.
            with suppress(OSError):
                os.ftruncate(self._descriptor, before)
            raise self._full(f"only {written} of {len(line)} bytes; is the device full?")
        self.runs[run.key] = run

    def _full(self, reason: str) -> ProblemError:
        return ProblemError(
            f"cannot write {self._path}: {reason}; the {len(self.runs)} runs before this one are in it; "
            "free disk space and repeat the command to continue"
        )


@contextmanager
def open_journal(path: Path) -> Iterator[Journal]:
    """Yield the journal at a path, locked against other comparisons for the duration of a ``with`` block.

    Raises:
        ProblemError: the file cannot be written, is in use by another comparison, or is not a journal.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # With O_APPEND every write goes to the end of the file, even after another process wrote.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise ProblemError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
    try:
        _lock(path, descriptor)
        yield Journal(path, descriptor)
    finally:
        os.close(descriptor)


def json_line(run: Run) -> bytes:
    """Return a run as a line of JSON, without figures that are not finite."""
    finite = {key: value for key, value in run.figures.items() if math.isfinite(value)}
    data = vars(run) | {"figures": finite}
    return (json.dumps(data, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _lock(path: Path, descriptor: int) -> None:
    """Lock a file against other comparisons until the process ends; without effect on systems without file locks."""
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise ProblemError(f"{path} is being written by another comparison; choose another --out") from error


def _whole_lines(descriptor: int) -> list[bytes]:
    """Return the complete lines of a file, and remove a partial line at its end."""
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
                f"{path}, line {number} is not a run of a comparison ({error}); delete the line, or choose "
                "another --out"
            ) from error
