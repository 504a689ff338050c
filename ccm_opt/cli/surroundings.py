"""What a command finds about it: streams that are closed or know few letters, little memory, searches for cycles."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper

LEAST_ADDRESS_SPACE = 300_000_000
"""Address space below which libraries cannot even be loaded [bytes]; some of them would try without end. Measured:
by ``ulimit -v``, loading ends in errors below this."""

MORE_MEMORY = "more memory: solving takes 0.6 to 1 GB of address space, and more for many links"
"""What helps where memory runs out."""


def ensure_stdio() -> None:
    """Give every standard stream something to write to, and let it write what it has no letter for as an escape.

    A stream that is closed is a number that the next file gets, which then receives whatever is printed.
    """
    while (opened := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest number that is free
        # Python's own files are closed where another program begins, whose next file would get the number then.
        os.set_inheritable(opened, True)  # noqa: FBT003 - it has no name
    os.close(opened)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.dup(number), mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A stream that was written to before it became a pipe cannot be reconfigured.
            with suppress(OSError, ValueError):
                stream.reconfigure(errors="backslashreplace")


def too_little_memory() -> str:
    """Return why nothing can be loaded, in a line; empty where it can."""
    allowed = address_space()
    if allowed is None or allowed >= LEAST_ADDRESS_SPACE:
        return ""
    return (
        f"out of memory: {allowed / 1e6:.0f} MB of address space are allowed (ulimit -v), and loading the libraries "
        f"alone takes {LEAST_ADDRESS_SPACE / 1e6:.0f} MB; solving takes 0.6 to 1 GB"
    )


def address_space() -> int | None:
    """Return how much address space this process is allowed [bytes]; None where that is not limited."""
    try:
        import resource  # noqa: PLC0415 - not on every system
    except ImportError:
        return None
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if allowed in {-1, resource.RLIM_INFINITY} else allowed


def is_out_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or what it came from, says that memory is used up, in any of the ways in which that is said."""
    seen = 0
    while error is not None and seen < _DEEPEST:
        said = isinstance(error, _SAYERS) and any(words in str(error) for words in _SAID)
        if isinstance(error, MemoryError) or (said and "permitted" not in str(error)):
            return True
        # The system refuses threads for want of address space, or because a user has too many of them.
        if "can't start new thread" in str(error) and address_space() is not None:
            return True
        error = error.__cause__ or error.__context__
        seen += 1
    return False


_SAID = (
    *("failed to map segment", "cannot allocate memory", "Cannot allocate memory", "std::bad_alloc"),
    *("bad allocation", "Unable to allocate", "out of memory"),
)
"""How libraries say it."""
_SAYERS = (RuntimeError, OSError, ImportError, SystemError)
"""Errors in which they say it; the same words in others are about something else, say a file of that name."""
_DEEPEST = 50
"""Errors that came from each other are followed no further."""


@contextmanager
def no_search_for_cycles() -> Iterator[None]:
    """Load inside it; no search looks at what is loaded, then or later, which takes a tenth off the time of loading."""
    loaded = len(sys.modules)
    gc.disable()
    try:
        yield
    finally:
        # Where nothing was loaded, all that there is new may be garbage, which is not to be kept.
        if len(sys.modules) > loaded:
            gc.freeze()
        gc.enable()
