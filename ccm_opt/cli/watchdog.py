"""Ends a command that does not end itself: a process beside it that listens for how far it has come.

Time limits are kept by code that looks at the clock. IPOPT does not where memory runs out: it spins inside its linear
solver, where neither Python nor a signal's handler gets a turn. So a small process, forked while planning lasts, is
told of every stage and every candidate; when it has heard nothing for far longer than the time limit, it says so in a
line and kills the command.
"""

import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from ccm_opt.cli.display_settings import WATCHDOG, WatchdogSettings
from ccm_opt.ground.progress import Progress
from ccm_opt.problem import Problem


@contextmanager
def ended_when_silent(
    problem: Problem, progress: Callable[[Progress], None], settings: WatchdogSettings = WATCHDOG
) -> Iterator[Callable[[Progress], None]]:
    """Plan inside it; the process is killed when it has told nothing for too long.

    Args:
        problem: whose time limit counts.
        progress: told of the progress, too.
        settings: how long the silence may last.

    Yields:
        What is to be told how far planning has come.
    """
    if not hasattr(os, "fork"):  # not on every system
        yield progress
        return
    silence = settings.limits * problem.planner.time_limit + settings.grace
    hears, tells = os.pipe()
    listener = os.fork()
    if listener == 0:
        os.close(tells)
        _listen(hears, silence, f"{problem.name}: nothing was heard of planning for {silence:g} s, so it was ended")
    os.close(hears)

    def told(news: Progress) -> None:
        with suppress(OSError):
            os.write(tells, b".")
        progress(news)

    try:
        yield told
    finally:
        # Whoever hears the end of the pipe has nothing more to do.
        os.close(tells)
        with suppress(OSError):
            os.kill(listener, signal.SIGKILL)
            os.waitpid(listener, 0)


def _listen(hears: int, silence: float, message: str) -> None:
    """The process that listens; it never returns."""
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        command = os.getppid()
        # Who reads what the command prints is not to wait for this process.
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 1)
        while True:
            ready, _, _ = select.select([hears], [], [], silence)
            if not ready:
                os.write(2, f"error: {message}; memory may have run out\n".encode(sys.stderr.encoding, "replace"))
                os.kill(command, signal.SIGKILL)
                break
            if not os.read(hears, 65536):
                break
    finally:
        os._exit(0)
