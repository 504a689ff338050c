"""Handling of Ctrl-C: a command stops, writes ``error: cancelled`` to stderr, and ends with exit code 130.

The current activity of the command determines which code handles Ctrl-C, and what remains on disk:

===================================  ===============================  =================================================
while                                handled in                       what remains
===================================  ===============================  =================================================
the command line is loaded           ``interrupts_end_at_once``       nothing is written
modules are loaded for a command     once they are, as below          as below
IPOPT runs in CasADi                 ``core/ipopt_call.py``         it is kept and raised again, as in the next line
``solve`` plans a problem            ``solving``, ``outcome``         ``solution.json`` with the status ``cancelled``
                                                                      and the reason that is known; plans of earlier
                                                                      files stay, later ones are not tried
``solve`` has a verified plan        ``solving``                      the whole folder, but for pictures and, where it
                                                                      was not waited for, the simulation
``solve`` writes a folder, or after  ``last_steps_uninterrupted``     the whole folder: that file is solved, only
                                                                      those after it are not tried; a second Ctrl-C
                                                                      leaves the whole folder or none
``pose`` searches for a pose         ``posing``, ``outcome``          ``pose.json`` with the status ``cancelled``
``reach`` searches cells             ``outcome``                      nothing is written; processes are ended
``compare`` runs its methods         ``comparing``, ``outcome``       every finished run is in the journal, from which
                                                                      the same command goes on; processes are ended
``check``, ``simulate``, ``export``  ``outcome``                      nothing is written
===================================  ===============================  =================================================

A folder with an earlier result is kept; an incomplete new result is written next to it.

An interrupt may get lost, since C code that calls Python, such as CasADi's wrappers, drops exceptions. Interrupts
therefore have a separate exception type and are watched by a timer; an interrupt that no longer exists but was not
handled is raised again. While modules are being imported no interrupt is raised, since it could appear as another
error and leave a module half imported.
"""

import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import NoReturn

CANCELLED = 130
"""Exit code after Ctrl-C: 128 plus the signal number, by the convention of shells."""
LOOK_AGAIN = 0.25
"""Interval between checks for a lost interrupt, short since a command should end within a second [s]."""
LOOK_FOR_LOADED = 0.02
"""Interval between checks whether modules are still being imported, after which an interrupt is raised [s]."""
_LOADER = "<frozen importlib._bootstrap>"
"""File name of Python's module loader in stack frames."""


@dataclass
class _Notes:
    """State of the handling of Ctrl-C.

    Attributes:
        noted: whether Ctrl-C was pressed during the last steps of a file, when it is only recorded.
        met: whether the last press was handled; true before the first press.
        struck: whether any interrupt was raised.
        raised: weak reference to the interrupt raised last; returns None once that object no longer exists.
    """

    noted: bool = False
    met: bool = True
    struck: bool = False
    raised: Callable[[], "Interrupted | None"] = lambda: None


_NOTES = _Notes()


class Interrupted(KeyboardInterrupt):
    """Exception raised by Ctrl-C, of a separate type so that a lost interrupt can be detected."""


def interrupts_end_at_once() -> None:
    """Make Ctrl-C end the process at once with exit code 130, for use while nothing needs to be cleaned up."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, lambda _signal, _frame: leave_at_once(report_cancelled()))


def interrupts_insist() -> None:
    """Install the signal handler that raises a lost interrupt again until ``interrupt_met`` is called."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _interrupt)
        sys.unraisablehook = _ignore_unraisable


def _ignore_unraisable(lost: "sys.UnraisableHookArgs") -> None:
    """Suppress the message about an interrupt in code that cannot raise, such as a finaliser; a timer raises it again.

    After the first interrupt, errors in finalisers of half-made objects are suppressed too.
    """
    if not _NOTES.struck and not issubclass(lost.exc_type, Interrupted):
        sys.__unraisablehook__(lost)


def interrupt_met() -> None:
    """Record that the last Ctrl-C was handled, and stop the timer that would raise it again.

    Python removes its signal handlers at shutdown, after which the alarm of the timer would end the process.
    """
    _NOTES.met = True
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def interrupt_unmet() -> bool:
    """Return whether Ctrl-C was pressed and not yet handled, so that another error is probably a consequence."""
    return not _NOTES.met


def _interrupt(_signal: int, frame: FrameType | None) -> None:
    _NOTES.met = False
    later = _is_loading(frame)
    if hasattr(signal, "setitimer"):  # not on every system
        again = LOOK_FOR_LOADED if later else LOOK_AGAIN
        signal.signal(signal.SIGALRM, _look)
        signal.setitimer(signal.ITIMER_REAL, again, again)
        if later:
            return
    _NOTES.struck = True
    # Not bound to a name here: the frame and the interrupt would keep each other alive.
    raise _watched(Interrupted())


def _is_loading(frame: FrameType | None) -> bool:
    """Return whether a stack frame, or any of its callers, belongs to Python's module loader."""
    while frame is not None:
        if frame.f_code.co_filename == _LOADER:
            return True
        frame = frame.f_back
    return False


def _watched(interrupt: Interrupted) -> Interrupted:
    _NOTES.raised = weakref.ref(interrupt)
    return interrupt


def _look(number: int, frame: FrameType | None) -> None:
    """Raise the interrupt again if it was not handled and no longer exists (handler of the timer's signal)."""
    if _NOTES.met:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    elif _NOTES.raised() is None:
        _interrupt(number, frame)


def last_steps_uninterrupted() -> None:
    """Only record the next Ctrl-C, without interrupting, until the current ``interrupts_as_usual`` block ends.

    This is for the last steps of the work on a file. A second Ctrl-C interrupts as usual, in case these steps hang.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _note)


@contextmanager
def interrupts_as_usual() -> Iterator[None]:
    """Restore, at the end of a ``with`` block, the handling of Ctrl-C that was in place at its start.

    Only the main thread handles Ctrl-C; in other threads nothing changes.
    """
    _NOTES.noted = False
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


def cancelled_meanwhile() -> bool:
    """Return whether Ctrl-C was recorded, without interrupting, since the last ``interrupts_as_usual`` block began."""
    return _NOTES.noted


def _note(_signal: int, _frame: FrameType | None) -> None:
    _NOTES.noted = True
    signal.signal(signal.SIGINT, _interrupt)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C until the process ends."""
    interrupt_met()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def leave_at_once(code: int = CANCELLED) -> NoReturn:
    """Flush the output streams and end the process at once with an exit code, without Python's shutdown.

    During a regular shutdown, Python would treat a handled Ctrl-C as unhandled, and end by the signal itself, if it
    occurred while text was executed as code, which dataclasses do during import.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed or missing
            stream.flush()
    os._exit(code)


def report_cancelled() -> int:
    """Print on stderr that the command was cancelled, and return the exit code.

    Returns:
        The exit code 130.
    """
    interrupt_met()
    with suppress(OSError, ValueError, AttributeError):  # stderr is closed or missing
        sys.stderr.write("error: cancelled\n")
    return CANCELLED
