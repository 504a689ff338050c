"""The process's environment: standard streams that are closed or lack letters, memory limits, garbage collection."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper

LEAST_ADDRESS_SPACE = 300_000_000
"""Address space below which the libraries cannot even be loaded [bytes]; some of them would retry without end.
Measured: by ``ulimit -v``, loading ends in errors below this."""

MORE_MEMORY = "more memory: solving takes 0.6 to 1 GB of address space, and more for many links"
"""Advice when memory runs out."""


def ensure_stdio() -> None:
    """Open every closed standard stream, and escape characters that the output streams cannot encode.

    The descriptor of a closed stream would be given to the next file opened, which would then receive whatever is
    printed.
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
    """Return one line on why memory is too small to load the libraries; empty if they can be loaded."""
    allowed = address_space()
    if allowed is None or allowed >= LEAST_ADDRESS_SPACE:
        return ""
    return (
        f"out of memory: {allowed / 1e6:.0f} MB of address space are allowed (ulimit -v), but loading the "
        f"libraries takes {LEAST_ADDRESS_SPACE / 1e6:.0f} MB; solving takes 0.6 to 1 GB"
    )


def address_space() -> int | None:
    """Return the limit on this process's address space [bytes]; None if there is none."""
    try:
        import resource  # noqa: PLC0415 - not on every system
    except ImportError:
        return None
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if allowed in {-1, resource.RLIM_INFINITY} else allowed


def is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an error, or one of its causes, is of a known kind that means exhausted memory."""
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
"""Words by which libraries report that memory ran out."""
_SAYERS = (RuntimeError, OSError, ImportError, SystemError)
"""Types of errors with such words; in others the words mean something else, such as a file of that name."""
_DEEPEST = 50
"""Most errors of a causal chain that are inspected."""


@contextmanager
def no_search_for_cycles() -> Iterator[None]:
    """Disable garbage collection while modules are loaded, and exempt them from later collections.

    This saves a tenth of the loading time.
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
