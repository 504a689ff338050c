"""Handling of Ctrl-C: the command stops, writes ``error: cancelled`` to stderr, and ends with exit code 130.

What the command is doing at Ctrl-C decides which code handles it and what remains on disk:

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

A folder with an earlier result is kept, and an incomplete result is written next to it.

An interrupt may be lost: C code that calls Python, such as CasADi's wrappers, drops exceptions raised there. So the
interrupt has a type of its own and is watched by a timer until it is handled; if it is gone and was not handled, it is
raised again. While modules are loaded none is raised at all: there it could surface as another error, with a module
half loaded.
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
"""Exit code after Ctrl-C: 128 plus the number of the signal, by the convention of shells."""
LOOK_AGAIN = 0.25
"""Time between two checks whether an interrupt was lost [s]; a fraction of the second within which a command should
end."""
LOOK_FOR_LOADED = 0.02
"""Time between two checks whether modules are still being loaded [s]; an interrupt is raised once they are not."""
_LOADER = "<frozen importlib._bootstrap>"
"""File name in the stack frames of Python's module loader."""


@dataclass
class _Notes:
    """State of Ctrl-C.

    Attributes:
        noted: whether Ctrl-C was pressed while presses were only noted.
        met: whether the last press was handled; true before the first press.
        struck: whether an interrupt was ever raised.
        raised: returns the interrupt raised last, or None once it no longer exists.
    """

    noted: bool = False
    met: bool = True
    struck: bool = False
    raised: Callable[[], "Interrupted | None"] = lambda: None


_NOTES = _Notes()


class Interrupted(KeyboardInterrupt):
    """Interrupt by Ctrl-C, a separate type so that an interrupt that Python lost can be detected."""


def interrupts_end_at_once() -> None:
    """Make Ctrl-C end the process at once with exit code 130; to be called before anything needs cleaning up."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, lambda _signal, _frame: leave_at_once(report_cancelled()))


def interrupts_insist() -> None:
    """Install a handler that raises a lost Ctrl-C again until ``interrupt_met`` is called."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _interrupt)
        sys.unraisablehook = _ignore_unraisable


def _ignore_unraisable(lost: "sys.UnraisableHookArgs") -> None:
    """Ignore an interrupt that Python cannot raise in place, such as in a finaliser; the timer raises it again.

    After the first interrupt, ignore errors in finalisers of half-made objects too.
    """
    if not _NOTES.struck and not issubclass(lost.exc_type, Interrupted):
        sys.__unraisablehook__(lost)


def interrupt_met() -> None:
    """Note that Ctrl-C is handled, and stop the timer.

    Python drops its signal handlers when it shuts down, and an alarm after that would end the process.
    """
    _NOTES.met = True
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def interrupt_unmet() -> bool:
    """Return whether Ctrl-C was pressed and not yet handled, so that other errors are likely its consequence."""
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
    """Return whether a module is being loaded."""
    while frame is not None:
        if frame.f_code.co_filename == _LOADER:
            return True
        frame = frame.f_back
    return False


def _watched(interrupt: Interrupted) -> Interrupted:
    _NOTES.raised = weakref.ref(interrupt)
    return interrupt


def _look(number: int, frame: FrameType | None) -> None:
    """Raise the interrupt again if it was not handled and no longer exists."""
    if _NOTES.met:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    elif _NOTES.raised() is None:
        _interrupt(number, frame)


def last_steps_uninterrupted() -> None:
    """Only note the next Ctrl-C, without an interrupt, until the block of ``interrupts_as_usual`` ends.

    The work on a file is then almost finished. A second Ctrl-C interrupts as usual, in case the last steps hang.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _note)


@contextmanager
def interrupts_as_usual() -> Iterator[None]:
    """Restore the handling of Ctrl-C at the end of the block, whatever the block changes."""
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
    """Return whether Ctrl-C was noted in the last block of ``interrupts_as_usual``."""
    return _NOTES.noted


def _note(_signal: int, _frame: FrameType | None) -> None:
    _NOTES.noted = True
    signal.signal(signal.SIGINT, _interrupt)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C from here on."""
    interrupt_met()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def leave_at_once(code: int = CANCELLED) -> NoReturn:
    """End the process at once with an exit code.

    When Python shuts down, a Ctrl-C that struck while text was executed as code, as dataclasses do while modules are
    loaded, would count as unhandled even if it was handled, and the process would end by the signal itself.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed or missing
            stream.flush()
    os._exit(code)


def report_cancelled() -> int:
    """Report on stderr that the command was cancelled, in plain text since Rich may not be loaded yet.

    Returns:
        The exit code.
    """
    interrupt_met()
    with suppress(OSError, ValueError, AttributeError):  # stderr is closed or missing
        sys.stderr.write("error: cancelled\n")
    return CANCELLED
