"""What happens on Ctrl-C: the command stops, writes ``error: cancelled`` to stderr, and ends with exit code 130.

Where Ctrl-C strikes decides who handles it and what remains on disk:

===================================  ===============================  =================================================
while                                handled in                       what remains
===================================  ===============================  =================================================
modules are loaded                   ``cli.main``, ``CommandGroup``   nothing is written
IPOPT runs in CasADi                 ``ground/ipopt_call.py``         it is kept and raised again, as in the next line
``solve`` plans a problem            ``solving``, ``outcome``         ``solution.json`` with the status ``cancelled``;
                                                                      plans of earlier files stay, later ones are not
                                                                      tried
``solve`` has a verified plan        ``failure_record``               the whole folder, but for pictures and, where it
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
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

CANCELLED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells count."""


@dataclass
class _Notes:
    """What is known of Ctrl-C.

    Attributes:
        noted: whether it was pressed where it is only noted.
    """

    noted: bool = False


_NOTES = _Notes()


def last_steps_uninterrupted() -> None:
    """From here to the end of ``interrupts_as_usual`` Ctrl-C is noted and no more.

    The work on one file is all but done then. A second one interrupts as ever, should those last steps hang.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, _note)


@contextmanager
def interrupts_as_usual() -> Iterator[None]:
    """Whatever the block does to the handling of Ctrl-C is undone at its end."""
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
    """Whether Ctrl-C was noted in the last such block."""
    return _NOTES.noted


def _note(_signal: int, _frame: FrameType | None) -> None:
    _NOTES.noted = True
    signal.signal(signal.SIGINT, signal.default_int_handler)


def report_cancelled() -> int:
    """Report on stderr that the command was cancelled, in plain text since Rich may not be loaded yet.

    Returns:
        The exit code.
    """
    sys.stderr.write("error: cancelled\n")
    return CANCELLED
