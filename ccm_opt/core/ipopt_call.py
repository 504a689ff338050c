"""Calls of IPOPT: one at a time, and Ctrl-C is kept.

The MUMPS that IPOPT calls keeps global state, so two threads inside it crash the process. CasADi looks at signals
while IPOPT runs, but what the handler raises is lost there: IPOPT only stops early, as after a failure.
"""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray

_LOCK = threading.Lock()


def ipopt_answer(
    solver: Callable[[], Any], start: FloatArray, **arguments: Any
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Ask IPOPT from a start; one that raises has found nothing, which is said like any other failure.

    Args:
        solver: makes or finds CasADi's solver.
        start: shape (variables,).
        arguments: bounds and parameters by CasADi's names; ``lbg`` is needed.

    Returns:
        The answer by CasADi's names, and the statistics; of a solver that raised the start, and NaN for every row.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed meanwhile.
    """
    with ipopt_call():
        try:
            made = solver()
            answer = made(x0=start, **arguments)
            statistics = made.stats()
        except RuntimeError as error:
            unknown = np.full(np.size(arguments["lbg"]), np.nan)
            words = str(error).strip().splitlines() or [type(error).__name__]
            answer = {"x": start, "f": np.nan, "g": unknown, "lam_g": np.zeros_like(unknown), "lam_x": 0.0 * start}
            statistics = {"return_status": f"raised an error: {words[0]}", "iter_count": 0}
    if statistics["return_status"] == "User_Requested_Stop":
        raise KeyboardInterrupt  # no callback is set: only Ctrl-C asks for this
    return answer, statistics


@contextmanager
def ipopt_call() -> Iterator[None]:
    """Keep other threads out of IPOPT during the block; it must not be entered again from inside.

    Raises:
        BaseException: what the handler of Ctrl-C raised during the block, usually ``KeyboardInterrupt``.
    """
    with _LOCK, _deferred_interrupt():
        yield


@contextmanager
def _deferred_interrupt() -> Iterator[None]:
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
