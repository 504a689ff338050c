"""Comparison of planning methods, with every run in a supervised process.

Every run gives a record, whatever a planner does. If a process dies, or is killed for excessive time or memory, this is
the result of the run, and the next run gets a new process. Otherwise the process, with libraries loaded, is reused.
"""

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO, cast

from ccm_opt.cli.compare.methods import code_of
from ccm_opt.cli.compare.runs import Journal, Outcome, Run, Task, failed_run
from ccm_opt.cli.compare.statistics import (
    ConfidenceInterval,
    FigurePair,
    SuccessPair,
    compare_figures,
    compare_success,
    success_interval,
)
from ccm_opt.cli.compare.suites import Case
from ccm_opt.core.executors import Workers, completed


@dataclass(frozen=True)
class SupervisionSettings:
    """Limits of time and memory of a run, enforced from outside the process.

    Attributes:
        time_factor: wall time for planning, as a multiple of the planner's CPU time limit. Derived: the built-in
            planners stop after this multiple too.
        spare_time: additional wall time for timing, verification and simulation [s]. Heuristic.
        most_memory: maximum resident memory of a run [bytes]. Heuristic: the built-in planners need less than a tenth.
        look_every: interval between checks of a run's memory [s]. Heuristic.
        last_words: maximum time to wait for a process to end [s]. Heuristic.
    """

    time_factor: float = 3.0
    spare_time: float = 120.0
    most_memory: int = 4 << 30
    look_every: float = 0.05
    last_words: float = 5.0


DEFAULT_SUPERVISION = SupervisionSettings()
"""Default limits on runs."""


_ALONE = threading.Lock()
"""Lock that makes runs exclusive in a process with several threads, since CPU time is measured per process."""


class RunProcess:
    """A child process that makes one run of a comparison after the other."""

    def __init__(self) -> None:
        # The child finds planners on the same path as this process.
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        # Nothing is ever written to this pipe: the child ends when this end is closed, see ``answer_tasks``.
        theirs, ours = os.pipe()
        self._life = os.fdopen(ours, "wb")
        self._process = subprocess.Popen(  # noqa: S603 - this interpreter
            [sys.executable, "-c", "from ccm_opt.cli.compare.runs import answer_tasks; answer_tasks()", str(theirs)],
            pass_fds=(theirs,) if os.name == "posix" else (),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        os.close(theirs)
        self._answers: SimpleQueue[Run | None] = SimpleQueue()
        # A thread waits for answers, as pipes cannot be waited for with a time limit on every system.
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def alive(self) -> bool:
        """Whether the process still exists and can make a run."""
        return self._process.poll() is None

    def run(self, task: Task, limit: float, settings: SupervisionSettings) -> Run:
        """Return the result of a run, ending the process if it exceeds its wall time or memory.

        Args:
            task: the run to make.
            limit: maximum wall time [s].
            settings: limits of time and memory.
        """
        begin = time.monotonic()
        try:
            pickle.dump(task, self._tasks)
            self._tasks.flush()
        except OSError:
            self._answers.put(None)  # the process died before it read the task
        answer = self._watched(begin + limit, limit, settings)
        if isinstance(answer, Run):
            return answer
        self.end(settings)
        outcome, reason = answer
        ended = failed_run(task, RuntimeError())
        return replace(ended, outcome=outcome, reason=reason, wall=time.monotonic() - begin)

    def end(self, settings: SupervisionSettings = DEFAULT_SUPERVISION) -> None:
        """Kill the process, even during a run."""
        self._process.kill()
        # Unsent data no longer matters.
        with suppress(OSError):
            self._tasks.close()
        self._process.wait(settings.last_words)
        self._life.close()

    @property
    def _tasks(self) -> IO[bytes]:
        return cast("IO[bytes]", self._process.stdin)

    def _listen(self) -> None:
        """Put results into the queue until the process ends or sends unreadable data, then None."""
        with cast("IO[bytes]", self._process.stdout) as answers:
            while True:
                try:
                    answer = pickle.load(answers)  # noqa: S301 - from our own process
                except Exception:  # noqa: BLE001 - whatever a planner wrote there
                    self._answers.put(None)
                    return
                self._answers.put(answer)

    def _watched(self, until: float, limit: float, settings: SupervisionSettings) -> Run | tuple[Outcome, str]:
        """Return the result that the process sends, or outcome and reason of a run that ended without a result.

        Args:
            until: monotonic time at which the run is ended [s].
            limit: maximum wall time, for the reason [s].
            settings: limits of time and memory.
        """
        while True:
            with suppress(Empty):
                answer = self._answers.get(timeout=settings.look_every)
                if isinstance(answer, Run):
                    return answer
                return "crashed", f"the planner's process died: {self._how_it_ended(settings)}"
            if time.monotonic() > until:
                return "timed out", f"the run exceeded {limit:.4g} s of wall time and was stopped"
            memory = _resident_memory(self._process.pid)
            if memory > settings.most_memory:
                gigabytes = settings.most_memory / 2**30
                return "crashed", f"the run exceeded {gigabytes:.3g} GiB of memory and was stopped"

    def _how_it_ended(self, settings: SupervisionSettings) -> str:
        try:
            code = self._process.wait(settings.last_words)
        except subprocess.TimeoutExpired:
            return "it sent unreadable answers"
        return f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"


def run_apart(task: Task, settings: SupervisionSettings = DEFAULT_SUPERVISION) -> Run:
    """Return the result of a run made in a child process; a failure of that process is the result of the run."""
    with _ALONE:
        try:
            limit = wall_limit(task, settings)
        except Exception as error:  # noqa: BLE001 - a problem that cannot be made is the run's result
            return failed_run(task, error)
        return _process().run(task, limit, settings)


def wall_limit(task: Task, settings: SupervisionSettings) -> float:
    """Return the wall time after which a run is ended from outside [s]."""
    limit = task.time_limit if task.time_limit is not None else task.case.problem().planner.time_limit
    return settings.time_factor * limit + settings.spare_time


_kept: list[RunProcess] = []


def _process() -> RunProcess:
    """Return the child process of earlier runs, or a new one if that has ended."""
    if _kept and not _kept[0].alive:
        _kept.pop().end()
    if not _kept:
        _kept.append(RunProcess())
    return _kept[0]


@atexit.register
def _end_kept() -> None:
    while _kept:
        _kept.pop().end()


def _resident_memory(process: int) -> int:
    """Return the resident memory of a process [bytes], given its id; 0 if the system does not report it."""
    try:
        pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Pair:
    """Comparison of two methods on the same problems.

    Attributes:
        first: name of the first method.
        second: name of the second method.
        success: comparison of the problems solved.
        figures: comparison of every figure on the problems that both methods solve.
    """

    first: str
    second: str
    success: SuccessPair
    figures: tuple[FigurePair, ...]


@dataclass(frozen=True)
class Comparison:
    """Runs of several methods on the same problems.

    Attributes:
        problems: names of the problems.
        methods: names of the methods.
        runs: runs by problem, then by method, in the order of ``problems`` and ``methods``.
    """

    problems: tuple[str, ...]
    methods: tuple[str, ...]
    runs: tuple[tuple[Run, ...], ...]

    def method_runs(self, method: str) -> tuple[Run, ...]:
        """Return the runs of a method, in the order of the problems."""
        column = self.methods.index(method)
        return tuple(row[column] for row in self.runs)

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Comparisons of every two methods, in the order of ``methods``."""
        found = []
        for one, other in combinations(self.methods, 2):
            first = self.method_runs(one)
            second = self.method_runs(other)
            found.append(Pair(one, other, compare_success(first, second), compare_figures(first, second)))
        return tuple(found)

    def solved(self, method: str) -> tuple[int, ConfidenceInterval]:
        """Return the number of problems that a method solves, and the 95 % confidence interval of their fraction."""
        count = sum(run.solved for run in self.method_runs(method))
        return count, success_interval(count, len(self.problems))

    @property
    def failures(self) -> tuple[Run, ...]:
        """All runs that did not solve their problem."""
        return tuple(run for row in self.runs for run in row if not run.solved)


def outdated(journal: Journal, cases: Sequence[Case], methods: Sequence[str]) -> Mapping[str, int]:
    """Return the number of runs in a journal that were made with other code than the present, by method.

    Methods without such runs are left out.

    Such runs remain in the journal but are made again.

    Args:
        journal: the journal.
        cases: problems of the comparison; runs on other problems are ignored.
        methods: names of the methods.
    """
    names = {case.name for case in cases}
    old = Counter(
        run.method
        for run in journal.runs.values()
        if run.problem in names and run.method in methods and run.code != code_of(run.method)
    )
    return {method: old[method] for method in methods if old[method]}


def compare(
    cases: Sequence[Case],
    methods: Sequence[str],
    workers: Workers,
    journal: Journal,
    *,
    time_limit: float | None = None,
    progress: Callable[[Run], None] | None = None,
) -> Comparison:
    """Return the comparison of methods on problems, after making all runs that are not in the journal.

    Runs that crashed are made again.

    Args:
        cases: the problems, with distinct names.
        methods: names of the methods.
        workers: processes that make the runs.
        journal: receives every run as soon as it is finished.
        time_limit: CPU time limit of every planner [s]; None for that of each problem.
        progress: function called with every finished run.

    Raises:
        ProblemError: a method is unknown, the journal cannot be written, or the connection to the cluster is lost.
    """
    rows = [[Task(case, method, time_limit, code_of(method)) for method in methods] for case in cases]
    # A comparison that was interrupted goes on where it stopped.
    missing = [task for row in rows for task in row if not journal.has(task.key)]
    if missing:
        for task, result in completed(workers, run_apart, missing):
            run = result if isinstance(result, Run) else failed_run(task, result)
            journal.append(run)
            if progress is not None:
                progress(run)

    # Tasks finish in any order; the results are ordered by problems and methods.
    runs = tuple(tuple(journal.runs[task.key] for task in row) for row in rows)
    return Comparison(tuple(case.name for case in cases), tuple(methods), runs)
