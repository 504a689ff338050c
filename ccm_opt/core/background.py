"""Calls of what may never return, and may raise anything."""

from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar

ANSWER = TypeVar("ANSWER")


def in_background(call: Callable[[], ANSWER]) -> Future[ANSWER]:
    """Run a call in a thread that the process does not wait for at its end, and return its future.

    Give `result` or `exception` of the future a timeout. What the call raises, an exit or an interrupt among it, comes
    out of `exception` and so is told from Ctrl-C, which strikes the main thread.
    """
    answer: Future[ANSWER] = Future()

    def run() -> None:
        try:
            answer.set_result(call())
        except BaseException as error:  # noqa: BLE001 - whoever waits decides what it means
            answer.set_exception(error)

    Thread(target=run, daemon=True).start()
    return answer
