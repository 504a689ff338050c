"""How far a command has come, and an end to one that does not end itself.

Time limits are kept by code that looks at the clock. IPOPT does not where memory runs out: it spins inside its linear
solver, where neither Python nor a handler of Python's gets a turn. So a small process, forked while planning lasts, is
told of every stage and every candidate; when it has heard nothing for far longer than the time limit, it says so in a
line, leaves a record, and ends the command with exit code 3. Where it had been told why there is no plan, and changes
that would help were sought, the record has that reason.
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

from ccm_opt.cli.outcome import tell_reason
from ccm_opt.cli.output import output
from ccm_opt.cli.surroundings import MORE_MEMORY, address_space
from ccm_opt.core.errors import Diagnosis, NoPlanFound, TimeLimitReached
from ccm_opt.core.progress import Progress
from ccm_opt.problem import PlannerOptions

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

STATUS_REFRESHES = 4.0
"""Times a second that the line of the present stage is drawn [1/s]. Taste."""
FIRST_LINE_AFTER = 3.0
"""Wall time after which it is told how far the work has come where there is no terminal [s]. Taste."""
LINE_EVERY = 3.0
"""Wall time between two such lines [s]. Taste."""


def _moment() -> tuple[float, float]:
    """Return the wall time and CPU time now [s]; CPU time counts finished child processes too."""
    times = os.times()
    return time.perf_counter(), time.process_time() + times.children_user + times.children_system


class StageClock:
    """Notes how long each stage takes; ``begin`` tells it of one, and it can be the ``progress`` of a solve.

    Attributes:
        current: the present stage; empty before the first and after ``finish``.
        wall: wall time by stage [s].
        cpu: user and system time by stage, of finished child processes too [s].
        known: why there is no plan, as far as the solve has told; None while it seeks one.
    """

    def __init__(self, show: Callable[[Progress], None] | None = None) -> None:
        self.current = ""
        self.wall: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self.known: Diagnosis | None = None
        self._show = show
        self._since = _moment()

    def begin(self, stage: str) -> None:
        """End the present stage and start the next."""
        self(Progress(stage))

    def __call__(self, progress: Progress) -> None:
        """Hear how far a solve has come; plans of several are counted as one."""
        stage = progress.stage.rpartition(": ")[2]
        if stage != self.current:
            self.finish()
            self.current = stage
        if progress.known is not None:
            self.known = progress.known
            tell_reason(progress.known)
        elif self._show is not None:
            self._show(progress)

    def finish(self) -> None:
        """End the present stage."""
        now = _moment()
        if self.current:
            for spent, end, begin in zip((self.wall, self.cpu), now, self._since, strict=True):
                spent[self.current] = spent.get(self.current, 0.0) + end - begin
        self.current = ""
        self._since = now

    @property
    def timings(self) -> Mapping[str, float]:
        """CPU time of the stages so far, the present one included [s]."""
        if not self.current:
            return dict(self.cpu)
        return {**self.cpu, self.current: _moment()[1] - self._since[1]}


@contextmanager
def stage_display(title: str) -> Iterator[StageClock]:
    """Return a clock that tells on stderr how far the work has come.

    On a terminal one line says so, and changes. Elsewhere plain lines are printed, from the moment on when people would
    ask; with ``--verbose`` there is a line for every stage. With ``--quiet`` there is nothing.

    Args:
        title: stands in front of every line.
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
    """Return what prints how far the work has come, line by line, not more often than people read it."""
    due = time.monotonic() + FIRST_LINE_AFTER
    stage = ""

    def told(progress: Progress) -> None:
        nonlocal due, stage
        new_stage, stage = progress.stage != stage, progress.stage
        if (everything and new_stage) or time.monotonic() >= due:
            due = time.monotonic() + LINE_EVERY
            with suppress(OSError):  # nobody reads it, which is no reason to stop
                sys.stderr.write(f"{title}: {progress}\n")
                sys.stderr.flush()

    return told


Recorder = Callable[[str, Diagnosis], None]
"""Writes the record of a status and its diagnosis."""
ENDING = signal.SIGQUIT if hasattr(signal, "SIGQUIT") else signal.SIGTERM
"""Ends planning while the guard stands. Its number is the exit code of a problem without a plan."""


SILENT_LIMITS = 3.0
"""How often the time limit, and ``GRACE`` beside, planning may tell nothing before it is ended from outside. Derived:
planning ends after three times as much wall time by itself."""
GRACE = 60.0
"""[s]. Taste: far longer than any stage that no time limit ends has taken."""
PATIENCE = 2.0
"""Time within which a process that was told to end ends, before it is killed [s]. Taste."""


@contextmanager
def ended_when_silent(
    name: str,
    planner: PlannerOptions,
    progress: Callable[..., None],
    record: Recorder | None = None,
    silence: float | None = None,
) -> Iterator[Callable[..., None]]:
    """Work inside it; the process is ended when it has told nothing for too long.

    Args:
        name: of the problem.
        planner: whose time limit counts.
        progress: told of the progress, too.
        record: leaves the record of why there is no result, if one is to be left.
        silence: how long nothing may be told [s]; None for what suits the time limit.

    Yields:
        What is to be told how far the work has come.
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
        # Whoever hears the end of the pipe has nothing more to do.
        tells.close()
        with suppress(OSError):
            os.kill(listener, signal.SIGKILL)
            os.waitpid(listener, 0)


@contextmanager
def _ended_by_signal() -> Iterator[None]:
    """Return the within it a signal ends the process at once, its number being the exit code, whatever C code runs.

    The handler is the C library's own ``_exit``: where a solver spins, none of Python's would ever be called.
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
    """Return the process that listens; it never returns."""
    known: Diagnosis | None = None
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Who reads what the command prints is not to wait for this process.
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
    """Say why, leave the record, and end the command, which is the last that anybody waits for.

    Where there is a reason already, it has been printed, and stands in the record.
    """
    what = "planning" if known is None else "the search for changes that would help"
    reason = f"nothing was heard of {what} for {silence:g} s, so it was ended"
    advice = "report it, with the problem file" if address_space() is None else MORE_MEMORY
    known = known or Diagnosis(reason, "planning", (advice,))
    status = NoPlanFound(known).status if known.proved else TimeLimitReached.unproved_status
    with suppress(OSError):  # whoever read it may have gone, and the command is to end all the same
        os.write(2, f"error: {name}: {reason}\n".encode(sys.stderr.encoding, "replace"))
    try:
        if record is not None:
            record(status, known)
    finally:
        os.kill(command, ENDING)
        time.sleep(PATIENCE)
        if os.getppid() == command:
            os.kill(command, signal.SIGKILL)
