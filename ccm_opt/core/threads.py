"""Linear algebra on one thread, so that the same problem gives the same bytes whatever the machine's settings.

BLAS adds up in an order that depends on how many threads share a sum, and a motion that differs by 1e-14 is another
file. The matrices here are small, and faster on one thread besides.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def on_one_thread() -> Iterator[None]:
    """Keep BLAS on one thread until the block, or the function that this decorates, ends; then as before."""
    with threadpool_limits(1, user_api="blas"):
        yield
