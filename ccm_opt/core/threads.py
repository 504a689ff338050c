"""Linear algebra on one thread, and calls in threads of their own.

BLAS adds up in an order that depends on how many threads share a sum, and a motion that differs by 1e-14 is another
file. The matrices here are small, and faster on one thread besides.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from threading import Thread
from typing import TypeVar

from threadpoolctl import threadpool_limits


@contextmanager
def on_one_thread() -> Iterator[None]:
    """Keep BLAS on one thread until the block, or the function that this decorates, ends; then as before."""
    with threadpool_limits(1, user_api="blas"):
        yield


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
