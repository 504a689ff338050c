"""Calls of IPOPT: one at a time, and Ctrl-C is kept.

The MUMPS that IPOPT calls keeps global state, so two threads inside it crash the process. CasADi looks at signals
while IPOPT runs, but what the handler raises is lost there: IPOPT only stops early, as after a failure.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_LOCK = threading.Lock()


@contextmanager
def ipopt_call() -> Iterator[None]:
    """Keep other threads out of IPOPT during the block; it must not be entered again from inside.

    Raises:
        BaseException: what the handler of Ctrl-C raised during the block, usually ``KeyboardInterrupt``.
    """
    with _LOCK, _interrupt_kept():
        yield


@contextmanager
def _interrupt_kept() -> Iterator[None]:
    """Raise at the end of the block what the handler of SIGINT raised inside it."""
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield  # handlers run in the main thread only
        return
    raised: list[BaseException] = []

    def note(number: int, frame: FrameType | None) -> None:
        try:
            handler(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if raised:
        raise raised[0]
