"""What a process holds of memory between two tries, and what it held at most."""

import ctypes
import functools
import gc
import os
import resource
import sys
from dataclasses import dataclass
from pathlib import Path

_MEBIBYTE = 2**20


@dataclass(frozen=True)
class AtRest:
    """What a process holds when nothing runs.

    Attributes:
        without_caches: once bounded caches are emptied [MiB].
        caches: what each of those held, by its name [MiB].
    """

    without_caches: float
    caches: dict[str, float]

    def __str__(self) -> str:
        large = sorted(((held, name) for name, held in self.caches.items() if held > 1.0), reverse=True)
        listed = "".join(f", {name.rpartition('.')[2]} {held:.0f}" for held, name in large)
        return f"{self.without_caches:.1f} MB at rest, {sum(self.caches.values()):.1f} more in bounded caches{listed}"


def at_rest() -> AtRest:
    """Memory that is held when nothing runs: what is free goes back to the system first.

    Without that the heaps of numpy and CasADi keep whatever the largest problem so far needed. Bounded caches hold the
    programs of the latest arms, which are small in one run and large in another: they are told apart, and emptied.
    """
    held = _held()
    caches = {}
    for cache in [each for each in gc.get_objects() if isinstance(each, functools._lru_cache_wrapper)]:
        if cache.cache_parameters()["maxsize"] is not None and str(cache.__module__).startswith("ccm_opt"):
            cache.cache_clear()
            left = _held()
            caches[f"{cache.__module__}.{cache.__name__}"] = held - left
            held = left
    return AtRest(held, caches)


def _held() -> float:
    """Memory of the process once what is free was given back [MiB]."""
    gc.collect()
    if not sys.platform.startswith("linux"):
        return most()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE


def most() -> float:
    """Memory that was held at any time [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
