"""Single-threaded linear algebra, and calls in background threads.

The order of summation in BLAS depends on its number of threads, and a motion that differs by 1e-14 gives a different
output file. The matrices here are small, and faster on one thread anyway.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from threading import Thread
from typing import TypeVar

from threadpoolctl import threadpool_limits


@contextmanager
def on_one_thread() -> Iterator[None]:
    """Restrict BLAS to one thread during a block, or during the decorated function."""
    with threadpool_limits(1, user_api="blas"):
        yield


ANSWER = TypeVar("ANSWER")


def in_background(call: Callable[[], ANSWER]) -> Future[ANSWER]:
    """Run a call in a daemon thread, which does not delay the end of the process, and return the future.

    Callers should pass a timeout to ``result`` or ``exception`` of the future. Any exception that the call raises,
    including ``SystemExit`` and ``KeyboardInterrupt``, is kept in the future, which distinguishes it from a Ctrl-C in
    the main thread.
    """
    answer: Future[ANSWER] = Future()

    def run() -> None:
        try:
            answer.set_result(call())
        except BaseException as error:  # noqa: BLE001 - the caller that waits on the future handles it
            answer.set_exception(error)

    Thread(target=run, daemon=True).start()
    return answer
