"""Timing and display of the stages of a command, and a watchdog that ends a command that hangs.

Time limits are enforced by code that checks the clock. When memory runs out, IPOPT does not: its linear solver loops
forever, and neither Python nor its signal handlers run. A watchdog process, forked for the duration of planning,
therefore receives every progress report. After far more time without a report than the time limit, the watchdog prints
an error, writes a record, and ends the command with exit code 3. If the reason why no plan exists was already known,
and only helpful changes were being sought, the record contains that reason.
"""

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from typing import TYPE_CHECKING, NoReturn

from rich.console import Console
from rich.markup import escape

from ccm_opt.cli.outcome import report_reason
from ccm_opt.cli.output import output
from ccm_opt.cli.surroundings import MORE_MEMORY, address_space
from ccm_opt.core.errors import Diagnosis, NoPlanFound, TimeLimitReached
from ccm_opt.core.progress import Progress
from ccm_opt.problem import PlannerOptions

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

STATUS_REFRESHES = 4.0
"""Refresh rate of the line that shows the current stage [1/s]. Heuristic."""
FIRST_LINE_AFTER = 3.0
"""Wall time after which progress is first printed if stderr is not a terminal [s]. Heuristic."""
LINE_EVERY = 3.0
"""Minimum wall time between two printed lines of progress [s]. Heuristic."""


def _moment() -> tuple[float, float]:
    """Return wall time and CPU time of this process [s]; the CPU time includes finished child processes."""
    times = os.times()
    return time.perf_counter(), time.process_time() + times.children_user + times.children_system


class StageClock:
    """Clock that measures the time of each stage of a command; may be passed as the ``progress`` argument of ``solve``.

    Attributes:
        current: name of the current stage; empty before the first stage and after ``finish``.
        wall: wall time of each stage, by name [s].
        cpu: user and system time of each stage, by name, including finished child processes [s].
        known: reason why no plan exists, once reported; None before.
    """

    def __init__(self, show: Callable[[Progress], None] | None = None) -> None:
        self.current = ""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self.known: Diagnosis | None = None
        self._show = show
        self._since = _moment()

    def begin(self, stage: str) -> None:
        """End the current stage and begin another."""
        self(Progress(stage))

    def __call__(self, progress: Progress) -> None:
        """Receive a progress report of ``solve``; times of stages of the same name are added up over several plans."""
        stage = progress.stage.rpartition(": ")[2]
        if stage != self.current:
            self.finish()
            self.current = stage
        if progress.known is not None:
            self.known = progress.known
            report_reason(progress.known)
        elif self._show is not None:
            self._show(progress)

    def finish(self) -> None:
        """End the current stage."""
        now = _moment()
        if self.current:
            for spent, end, begin in zip((self.wall, self.cpu), now, self._since, strict=True):
                spent[self.current] = spent.get(self.current, 0.0) + end - begin
        self.current = ""
        self._since = now

    @property
    def timings(self) -> Mapping[str, float]:
        """CPU time of each stage so far, by name, including the current stage [s]."""
        if not self.current:
            return dict(self.cpu)
        return {**self.cpu, self.current: _moment()[1] - self._since[1]}


@contextmanager
def stage_display(title: str) -> Iterator[StageClock]:
    """Yield a clock of stages that also shows progress on stderr.

    On a terminal, one line is updated in place. Elsewhere, lines are printed once the work takes longer than a few
    seconds; with ``--verbose`` a line for every stage, with ``--quiet`` none.

    Args:
        title: text at the start of every line.
    """
    console = Console(stderr=True, emoji=False)
    if output().quiet:
        yield StageClock()
    elif output().verbose or not console.is_terminal:
        yield StageClock(_plain_lines(title, everything=output().verbose))
    else:
        with console.status(escape(title), refresh_per_second=STATUS_REFRESHES) as status:
            yield StageClock(lambda progress: status.update(escape(f"{title}: {progress}")))


def _plain_lines(title: str, *, everything: bool) -> Callable[[Progress], None]:
    """Return a function that prints progress line by line, at limited frequency."""
    due = time.monotonic() + FIRST_LINE_AFTER
    stage = ""

    def listener(progress: Progress) -> None:
        nonlocal due, stage
        new_stage, stage = progress.stage != stage, progress.stage
        if (everything and new_stage) or time.monotonic() >= due:
            due = time.monotonic() + LINE_EVERY
            with suppress(OSError):  # a closed stderr is no reason to stop
                sys.stderr.write(f"{title}: {progress}\n")
                sys.stderr.flush()

    return listener


Recorder = Callable[[str, Diagnosis], None]
"""Function of status and diagnosis that writes the record of a problem for which no plan was found."""
ENDING = signal.SIGQUIT if hasattr(signal, "SIGQUIT") else signal.SIGTERM
"""Signal that ends a hanging command; its number equals the exit code of a problem without a plan."""


SILENT_LIMITS = 3.0
"""Wall time without a progress report after which planning is ended from outside, as a multiple of the time limit;
``GRACE`` is added. Derived: planning should end by itself after three times the time limit in wall time."""
GRACE = 60.0
"""Wall time added to ``SILENT_LIMITS`` time limits [s]. Heuristic: far longer than stages without a time limit take."""
PATIENCE = 2.0
"""Time to wait for a process to end before it is killed [s]. Heuristic."""


@contextmanager
def ended_when_silent(
    name: str,
    planner: PlannerOptions,
    progress: Callable[..., None],
    record: Recorder | None = None,
    silence: float | None = None,
) -> Iterator[Callable[..., None]]:
    """End this process if the work in a ``with`` block reports no progress for too long.

    Args:
        name: name of the problem.
        planner: planner options, which give the time limit.
        progress: function to which every progress report is passed on.
        record: function that writes the record of a failure; None for no record.
        silence: maximum wall time without a report [s]; None to derive a value from the time limit.

    Yields:
        A function that must be called with every progress report.
    """
    if not hasattr(os, "fork"):  # not on every system
        yield progress
        return
    longest = SILENT_LIMITS * planner.time_limit + GRACE if silence is None else silence
    hears, tells = Pipe(duplex=False)
    command = os.getpid()
    listener = os.fork()
    if listener == 0:
        tells.close()
        _listen(command, hears, longest, name, record)
    hears.close()

    def record_news(*news: object) -> None:
        known = [each.known for each in news if isinstance(each, Progress)]
        with suppress(OSError):
            tells.send(known[0] if known else None)
        progress(*news)

    try:
        with _ended_by_signal():
            yield record_news
    finally:
        # The end of the pipe tells the watchdog that it is done.
        tells.close()
        with suppress(OSError):
            os.kill(listener, signal.SIGKILL)
            os.waitpid(listener, 0)


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """Let ``ENDING`` end the process at once inside a ``with`` block, even in C code, with its number as exit code.

    The handler is the C library's ``_exit``, since a Python handler would not run while a solver loops in C code.
    """
    with suppress(OSError, AttributeError):  # without it the process is killed
        library = ctypes.CDLL(None)
        library.signal(ENDING, library._exit)  # noqa: SLF001 - its name in C
    try:
        yield
    finally:
        signal.signal(ENDING, signal.SIG_DFL)


def _listen(
    command: int,
    hears: "Connection[None, Diagnosis | None]",
    silence: float,
    name: str,
    record: Recorder | None,
) -> NoReturn:
    """Run the watchdog process: wait for progress reports, and end the command after too long without one.

    Args:
        command: process id of the command.
        hears: receiving end of the pipe of progress reports. A report is the diagnosis if the reason why no plan exists
            is known, else None.
        silence: maximum wall time without a report [s].
        name: name of the problem.
        record: function that writes the record of a failure; None for no record.
    """
    known: Diagnosis | None = None
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Close stdout, so that readers of the command's output do not wait for this process.
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 1)
        with suppress(EOFError):
            while hears.poll(silence):
                known = hears.recv() or known
            _end(command, name, silence, record, known)
    finally:
        os._exit(0)


def _end(
    command: int,
    name: str,
    silence: float,
    record: Recorder | None,
    known: Diagnosis | None,
) -> None:
    """Print why a hanging command is ended, write the record, and end the command.

    Arguments are those of ``_listen``, and ``known``: the reason why no plan exists, which goes into the record, or
    None if it is not known yet.
    """
    what = "planning" if known is None else "the search for changes that would help"
    reason = f"{what} reported nothing for {silence:g} s and was stopped"
    advice = "report this, with the problem file" if address_space() is None else MORE_MEMORY
    known = known or Diagnosis(reason, "planning", (advice,))
    status = NoPlanFound(known).status if known.proved else TimeLimitReached.unproved_status
    with suppress(OSError):  # stderr may be closed; the command has to end all the same
        os.write(2, f"error: {name}: {reason}\n".encode(sys.stderr.encoding, "replace"))
    try:
        if record is not None:
            record(status, known)
    finally:
        os.kill(command, ENDING)
        time.sleep(PATIENCE)
        if os.getppid() == command:
            os.kill(command, signal.SIGKILL)
