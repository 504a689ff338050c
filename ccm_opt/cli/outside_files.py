"""Whether problem files of the command that runs may name drawings outside their folders."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_ALLOWED: ContextVar[bool] = ContextVar("drawings outside the folder of the problem", default=False)


def outside_allowed() -> bool:
    """Whether drawings outside the folder of a problem file are read; not unless somebody says so."""
    return _ALLOWED.get()


@contextmanager
def outside_files(*, allowed: bool) -> Iterator[None]:
    """Say so, until the block ends."""
    token = _ALLOWED.set(allowed)
    try:
        yield
    finally:
        _ALLOWED.reset(token)
