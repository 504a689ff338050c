"""Process environment of the command line: standard streams, character sets, memory limits, garbage collection."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper

LEAST_ADDRESS_SPACE = 300_000_000
"""Minimum address space for importing the libraries; with less, some retry forever [bytes]. Measured by
``ulimit -v``."""

MORE_MEMORY = "more memory: solving takes 0.6 to 1 GB of address space, and more for many links"
"""Advice to the user when memory runs out."""


def ensure_stdio() -> None:
    """Open every closed standard stream, and make output streams escape characters that they cannot encode.

    The file descriptor of a closed stream would otherwise be reused by the next file opened, into which everything
    printed would be written.
    """
    while (opened := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest free descriptor
        # Descriptors opened by Python are closed in child programs, whose next file would get the number.
        os.set_inheritable(opened, True)  # noqa: FBT003 - it has no name
    os.close(opened)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.dup(number), mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A stream written to before it became a pipe cannot be reconfigured.
            with suppress(OSError, ValueError):
                stream.reconfigure(errors="backslashreplace")


def too_little_memory() -> str:
    """Return an error message if the address space is too small to import the libraries, else an empty text."""
    allowed = address_space()
    if allowed is None or allowed >= LEAST_ADDRESS_SPACE:
        return ""
    return (
        f"out of memory: {allowed / 1e6:.0f} MB of address space are allowed (ulimit -v), but loading the "
        f"libraries takes {LEAST_ADDRESS_SPACE / 1e6:.0f} MB; solving takes 0.6 to 1 GB"
    )


def address_space() -> int | None:
    """Return the limit on the address space of this process [bytes]; None if there is none."""
    try:
        import resource  # noqa: PLC0415 - not on every system
    except ImportError:
        return None
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if allowed in {-1, resource.RLIM_INFINITY} else allowed


def is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one of its causes, means that memory is exhausted."""
    seen = 0
    while error is not None and seen < _DEEPEST:
        said = isinstance(error, _SAYERS) and any(words in str(error) for words in _SAID)
        if isinstance(error, MemoryError) or (said and "permitted" not in str(error)):
            return True
        # The system refuses threads for lack of address space, or because the user has too many of them.
        if "can't start new thread" in str(error) and address_space() is not None:
            return True
        error = error.__cause__ or error.__context__
        seen += 1
    return False


_SAID = (
    *("failed to map segment", "cannot allocate memory", "Cannot allocate memory", "std::bad_alloc"),
    *("bad allocation", "Unable to allocate", "out of memory"),
)
"""Parts of error messages by which libraries report exhausted memory."""
_SAYERS = (RuntimeError, OSError, ImportError, SystemError)
"""Types of errors with which libraries report exhausted memory; in other types, the words of ``_SAID`` may come from a
file name."""
_DEEPEST = 50
"""Maximum number of errors of a causal chain that are checked."""


@contextmanager
def no_search_for_cycles() -> Iterator[None]:
    """Disable garbage collection in a ``with`` block that imports modules, and exempt them from later collections.

    This saves a tenth of the import time.
    """
    loaded = len(sys.modules)
    gc.disable()
    try:
        yield
    finally:
        # If nothing was loaded, the new objects may be garbage, which must not be frozen.
        if len(sys.modules) > loaded:
            gc.freeze()
        gc.enable()
