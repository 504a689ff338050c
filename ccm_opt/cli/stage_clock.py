"""Progress of a command, and a watchdog for one that hangs.

Time limits are kept by code that checks the clock. IPOPT does not when memory runs out: it spins inside its linear
solver, where neither Python nor its signal handlers get to run. So a small watchdog process, forked for the duration of
planning, is sent every stage and every candidate. When it has received nothing for far longer than the time limit, it
prints an error, writes a record, and ends the command with exit code 3. If the reason for having no plan was known, and
changes that would help were being sought, the record holds that reason.
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
"""Refresh rate of the line with the present stage [1/s]. Taste."""
FIRST_LINE_AFTER = 3.0
"""Wall time after which progress is first printed if stderr is no terminal [s]. Taste."""
LINE_EVERY = 3.0
"""Wall time between two such lines [s]. Taste."""


def _moment() -> tuple[float, float]:
    """Return the wall time and the CPU time [s]; CPU time includes finished child processes."""
    times = os.times()
    return time.perf_counter(), time.process_time() + times.children_user + times.children_system


class StageClock:
    """Measures the time of each stage; ``begin`` starts one, and the clock can be the ``progress`` of a solve.

    Attributes:
        current: the current stage; empty before the first and after ``finish``.
        wall: wall time by stage [s].
        cpu: user and system time by stage, finished child processes included [s].
        known: why there is no plan, once the solve has reported it; None before.
    """

    def __init__(self, show: Callable[[Progress], None] | None = None) -> None:
        self.current = ""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self.known: Diagnosis | None = None
        self._show = show
        self._since = _moment()

    def begin(self, stage: str) -> None:
        """End the current stage and start another."""
        self(Progress(stage))

    def __call__(self, progress: Progress) -> None:
        """Receive the progress of a solve; the times of equal stages of several plans are summed."""
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
        """CPU time of the stages so far, including the current one [s]."""
        if not self.current:
            return dict(self.cpu)
        return {**self.cpu, self.current: _moment()[1] - self._since[1]}


@contextmanager
def stage_display(title: str) -> Iterator[StageClock]:
    """Yield a clock that reports progress on stderr.

    On a terminal, one line is updated in place. Elsewhere, plain lines are printed once the work takes noticeably long;
    with ``--verbose`` there is a line for every stage, with ``--quiet`` none.

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

    def told(progress: Progress) -> None:
        nonlocal due, stage
        new_stage, stage = progress.stage != stage, progress.stage
        if (everything and new_stage) or time.monotonic() >= due:
            due = time.monotonic() + LINE_EVERY
            with suppress(OSError):  # a closed stderr is no reason to stop
                sys.stderr.write(f"{title}: {progress}\n")
                sys.stderr.flush()

    return told


Recorder = Callable[[str, Diagnosis], None]
"""Writes the record of a failure, given its status and diagnosis."""
ENDING = signal.SIGQUIT if hasattr(signal, "SIGQUIT") else signal.SIGTERM
"""Signal that ends a hanging command. Its number is the exit code of a problem without a plan."""


SILENT_LIMITS = 3.0
"""Time limits, plus ``GRACE``, without any report after which planning is ended from outside. Derived: planning ends by
itself after three times as much wall time."""
GRACE = 60.0
"""Wall time added to that [s]. Taste: far longer than any stage without a time limit of its own has taken."""
PATIENCE = 2.0
"""Time that a process is given to end before it is killed [s]. Taste."""


@contextmanager
def ended_when_silent(
    name: str,
    planner: PlannerOptions,
    progress: Callable[..., None],
    record: Recorder | None = None,
    silence: float | None = None,
) -> Iterator[Callable[..., None]]:
    """Watch the work inside the block; end the process if the work reports no progress for too long.

    Args:
        name: name of the problem.
        planner: options with the time limit.
        progress: function that also receives every progress report.
        record: records why there is no result; None for no record.
        silence: longest time without a report [s]; None to derive it from the time limit.

    Yields:
        A function to be called with the progress of the work.
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

    def told(*news: object) -> None:
        known = [each.known for each in news if isinstance(each, Progress)]
        with suppress(OSError):
            tells.send(known[0] if known else None)
        progress(*news)

    try:
        with _ended_by_signal():
            yield told
    finally:
        # The end of the pipe tells the watchdog that it is done.
        tells.close()
        with suppress(OSError):
            os.kill(listener, signal.SIGKILL)
            os.waitpid(listener, 0)


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """Let a signal end the process at once inside the block, even in C code; the exit code is the signal's number.

    The handler is the C library's own ``_exit``: while a solver spins, a Python handler would never be called.
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
    """Run the watchdog process, which never returns."""
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
    """Print why the silent command is ended, write the record, and end the command.

    A known reason why there is no plan was already printed; it is included in the record.
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
