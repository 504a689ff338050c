"""What a process holds of memory between two tries, and what it held at most."""

import ctypes
import functools
import gc
import os
import resource
import sys
from pathlib import Path

_MEBIBYTE = 2**20


def at_rest() -> float:
    """Memory that is held when nothing runs [MiB]: caches are emptied, and what is free goes back to the system first.

    Without that the heaps of numpy and CasADi keep whatever the largest problem so far needed, and caches, which hold a
    bounded number of programs, those of the latest arms.
    """
    for cache in [each for each in gc.get_objects() if isinstance(each, functools._lru_cache_wrapper)]:
        if cache.cache_parameters()["maxsize"] is not None and str(cache.__module__).startswith("ccm_opt"):
            cache.cache_clear()
    gc.collect()
    if not sys.platform.startswith("linux"):
        return most()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE


def most() -> float:
    """Memory that was held at any time [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
