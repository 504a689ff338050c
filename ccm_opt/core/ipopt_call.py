"""Calls of IPOPT: one at a time, and without losing Ctrl-C.

MUMPS, the linear solver inside IPOPT, keeps global state, so two threads that call it at once crash the process. CasADi
checks for signals while IPOPT runs but discards the exception that the handler raises: IPOPT just stops early, as after
a failure.
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
    """Solve a nonlinear program with IPOPT from an initial guess; an exception in the solver counts as a failed solve.

    Args:
        solver: returns the CasADi solver, building it if necessary.
        start: initial guess, shape (variables,).
        arguments: bounds and parameters by the names of CasADi; ``lbg`` is required.

    Returns:
        The result and the statistics, by the names of CasADi. If the solver raised an exception, the result is the
        initial guess, with NaN as the value of every constraint.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed during the call.
    """
    with ipopt_call():
        try:
            solve = solver()
            answer = solve(x0=start, **arguments)
            statistics = solve.stats()
        except RuntimeError as error:
            unknown = np.full(np.size(arguments["lbg"]), np.nan)
            words = str(error).strip().splitlines() or [type(error).__name__]
            answer = {"x": start, "f": np.nan, "g": unknown, "lam_g": np.zeros_like(unknown), "lam_x": 0.0 * start}
            statistics = {"return_status": f"raised an error: {words[0]}", "iter_count": 0}
    if statistics["return_status"] == "User_Requested_Stop":
        raise KeyboardInterrupt  # no callback is set, so only Ctrl-C causes this status
    return answer, statistics


@contextmanager
def ipopt_call() -> Iterator[None]:
    """Give this thread exclusive use of IPOPT during a block, which must not be nested.

    Raises:
        BaseException: the exception that the handler of Ctrl-C raised in the block, usually ``KeyboardInterrupt``.
    """
    with _LOCK, _deferred_interrupt():
        yield


@contextmanager
def _deferred_interrupt() -> Iterator[None]:
    """Raise again, at the end of a block, any exception that the handler of SIGINT raised inside the block."""
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
