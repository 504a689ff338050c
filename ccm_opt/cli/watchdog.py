"""Ends a command that does not end itself: a process beside it that listens for how far it has come.

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from typing import TYPE_CHECKING, NoReturn

from ccm_opt.cli.surroundings import MORE_MEMORY, used_up
from ccm_opt.core.progress import Progress
from ccm_opt.errors import Diagnosis, NoPlanFound, TimeLimitReached
from ccm_opt.problem import PlannerOptions

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Recorder = Callable[[str, Diagnosis], None]
"""Writes the record of a status and its diagnosis."""
ENDING = signal.SIGQUIT if hasattr(signal, "SIGQUIT") else signal.SIGTERM
"""Ends planning while the guard stands. Its number is the exit code of a problem without a plan."""


@dataclass(frozen=True)
class WatchdogSettings:
    """How long planning may tell nothing before it is ended from outside.

    Attributes:
        limits: times the time limit. Derived: planning ends after three times as much wall time by itself.
        grace: further time [s]. Taste: far longer than any stage that no time limit ends has taken.
        patience: time within which a process that was told to end ends, before it is killed [s]. Taste.
    """

    limits: float = 3.0
    grace: float = 60.0
    patience: float = 2.0


WATCHDOG = WatchdogSettings()
"""What every command that plans goes by."""


@contextmanager
def ended_when_silent(
    name: str,
    planner: PlannerOptions,
    progress: Callable[..., None],
    record: Recorder | None = None,
    settings: WatchdogSettings = WATCHDOG,
) -> Iterator[Callable[..., None]]:
    """Work inside it; the process is ended when it has told nothing for too long.

    Args:
        name: of the problem.
        planner: whose time limit counts.
        progress: told of the progress, too.
        record: leaves the record of why there is no result, if one is to be left.
        settings: how long the silence may last.

    Yields:
        What is to be told how far the work has come.
    """
    if not hasattr(os, "fork"):  # not on every system
        yield progress
        return
    silence = settings.limits * planner.time_limit + settings.grace
    hears, tells = Pipe(duplex=False)
    command = os.getpid()
    listener = os.fork()
    if listener == 0:
        tells.close()
        _listen(command, hears, silence, name, record, settings)
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
    """Within it a signal ends the process at once, its number being the exit code, whatever C code runs.

    The handler is the C library's own ``_exit``: where a solver spins, none of Python's would ever be called.
    """
    try:
        usual = signal.getsignal(ENDING)
        library = ctypes.CDLL(None)
        library.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
        library.signal.restype = ctypes.c_void_p
        if usual is signal.SIG_DFL:
            library.signal(ENDING, ctypes.cast(library._exit, ctypes.c_void_p))  # noqa: SLF001 - its name in C
    except (OSError, AttributeError, TypeError, ValueError):
        usual = None  # then the process is killed
    try:
        yield
    finally:
        if usual is signal.SIG_DFL:
            with suppress(ValueError):  # not in the main thread
                signal.signal(ENDING, usual)


def _listen(
    command: int,
    hears: "Connection[None, Diagnosis | None]",
    silence: float,
    name: str,
    record: Recorder | None,
    settings: WatchdogSettings,
) -> NoReturn:
    """The process that listens; it never returns."""
    known: Diagnosis | None = None
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Who reads what the command prints is not to wait for this process.
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 1)
        with suppress(EOFError):
            while hears.poll(silence):
                known = hears.recv() or known
            _end(command, name, silence, record, known, settings)
    finally:
        os._exit(0)


def _end(
    command: int,
    name: str,
    silence: float,
    record: Recorder | None,
    known: Diagnosis | None,
    settings: WatchdogSettings,
) -> None:
    """Say why, leave the record, and end the command, which is the last that anybody waits for.

    Where there is a reason already, it has been printed, and stands in the record.
    """
    what = "planning" if known is None else "the search for changes that would help"
    reason = f"nothing was heard of {what} for {silence:g} s, so it was ended"
    advice: tuple[str, ...] = ("report it, with the problem file",)
    if used_up(command):
        reason += "; memory ran out"
        advice = (MORE_MEMORY,)
    known = known or Diagnosis(reason, "planning", advice)
    status = NoPlanFound(known).status if known.proved else TimeLimitReached.unproved_status
    with suppress(OSError):  # whoever read it may have gone, and the command is to end all the same
        os.write(2, f"error: {name}: {reason}\n".encode(sys.stderr.encoding, "replace"))
    try:
        if record is not None:
            record(status, known)
    finally:
        for ending in (ENDING, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.kill(command, ending)
            if _has_ended(command, settings.patience):
                break


def _has_ended(command: int, patience: float) -> bool:
    """Whether a process, whose child this is, has ended within a time [s]."""
    until = time.monotonic() + patience
    while os.getppid() == command:
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True
