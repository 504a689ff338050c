"""What happens on Ctrl-C: the command stops, writes ``error: cancelled`` to stderr, and ends with exit code 130.

Where Ctrl-C strikes decides who handles it and what remains on disk:

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
``pose`` asks for a pose             ``posing``, ``outcome``          ``pose.json`` with the status ``cancelled``
``reach`` looks at cells             ``outcome``                      nothing is written; processes are ended
``compare`` runs its methods         ``comparing``, ``outcome``       every finished run is in the journal, from which
                                                                      the same command goes on; processes are ended
``check``, ``simulate``, ``export``  ``outcome``                      nothing is written
===================================  ===============================  =================================================

Where a folder of an earlier result stands, it stays, and what is no whole result is written beside it.

An interrupt may be lost: C code that calls Python, CasADi's wrappers among it, drops whatever is raised there. So the
interrupt that is raised can be told from others, and is looked for until somebody has met it; where it is gone and
nobody has, it is raised again. While modules are loaded none is raised at all: there it may come out as another error,
with half a module left behind.
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
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells count."""
LOOK_AGAIN = 0.25
"""Time between two looks whether an interrupt was lost [s]; a share of the second within which a command is to end."""
LOOK_FOR_LOADED = 0.02
"""Time between two looks whether modules are loaded, after which an interrupt can be raised [s]."""
_LOADER = "<frozen importlib._bootstrap>"
"""Where Python loads modules."""


@dataclass
class _Notes:
    """What is known of Ctrl-C.

    Attributes:
        noted: whether it was pressed where it is only noted.
        met: whether whoever is to answer it has.
        struck: whether it was ever raised.
        raised: the interrupt as it was raised last, or None once nobody holds it any more.
    """

    noted: bool = False
    met: bool = True
    struck: bool = False
    raised: Callable[[], "Interrupted | None"] = lambda: None


_NOTES = _Notes()


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, told from other interrupts, so that it is seen when one is lost."""


def interrupts_end_at_once() -> None:
    """From here on Ctrl-C ends the process with exit code 130: nothing has begun that would have to be put away."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, lambda _signal, _frame: leave_at_once(report_cancelled()))


def interrupts_insist() -> None:
    """From here on a Ctrl-C that is lost on its way is raised again, until ``interrupt_met``."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _interrupt)
        sys.unraisablehook = _ignore_unraisable


def _ignore_unraisable(lost: "sys.UnraisableHookArgs") -> None:
    """Say nothing of an interrupt that Python cannot raise where it struck, as in a finaliser: it comes again.

    Nor, once one was raised, of what finalisers of objects stumble over that it left half made.
    """
    if not _NOTES.struck and not issubclass(lost.exc_type, Interrupted):
        sys.__unraisablehook__(lost)


def interrupt_met() -> None:
    """Whoever is to answer Ctrl-C has it.

    The timer ends here: Python forgets its handlers at its end, and an alarm after that would end the process.
    """
    _NOTES.met = True
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def interrupt_unmet() -> bool:
    """Return whether Ctrl-C was pressed and nobody has answered it yet: whatever error comes out is likely to be it."""
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
    # It has no name here: the frame would keep it, and be kept by it.
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
    """Raise the interrupt again where nobody has met it and nobody holds it."""
    if _NOTES.met:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    elif _NOTES.raised() is None:
        _interrupt(number, frame)


def last_steps_uninterrupted() -> None:
    """From here to the end of ``interrupts_as_usual`` Ctrl-C is noted and no more.

    The work on one file is all but done then. A second one interrupts as ever, should those last steps hang.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _note)


@contextmanager
def interrupts_as_usual() -> Iterator[None]:
    """Return whatever the block does to the handling of Ctrl-C is undone at its end."""
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
    """Return whether Ctrl-C was noted in the last such block."""
    return _NOTES.noted


def _note(_signal: int, _frame: FrameType | None) -> None:
    _NOTES.noted = True
    signal.signal(signal.SIGINT, _interrupt)


def ignore_interrupts() -> None:
    """From here on Ctrl-C does nothing."""
    interrupt_met()
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def leave_at_once(code: int = CANCELLED) -> NoReturn:
    """End the process at once with an exit code.

    At Python's own end, a Ctrl-C that struck while some text was run as code, as dataclasses do when modules are
    loaded, would count as unhandled however it was handled, and the process would end by the signal itself.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed, or none at all
            stream.flush()
    os._exit(code)


def report_cancelled() -> int:
    """Report on stderr that the command was cancelled, in plain text since Rich may not be loaded yet.

    Returns:
        The exit code.
    """
    interrupt_met()
    with suppress(OSError, ValueError, AttributeError):  # nobody reads it
        sys.stderr.write("error: cancelled\n")
    return CANCELLED
