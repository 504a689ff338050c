"""Memory of a process between two tries, and its maximum."""

import ctypes
import functools
import gc
import os
import resource
import sys
from dataclasses import dataclass
from pathlib import Path

_MEBIBYTE = 2**20


class _HeapFigures(ctypes.Structure):
    """``struct mallinfo2`` of the GNU C library."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()  # noqa: SIM905
    )


@dataclass(frozen=True)
class AtRest:
    """What a process holds when nothing runs.

    Attributes:
        without_caches: once bounded caches are emptied, without pages of files, which are programs and libraries
            [MiB]. Gaps between what is in use count here, where they are smaller than a page.
        caches: what each of those held, by its name [MiB].
        in_use: of the heap of C, without gaps [MiB]; 0 where nobody says.
        objects: small ones of Python, in thousands; they have a heap of their own.
    """

    without_caches: float
    caches: dict[str, float]
    in_use: float
    objects: float

    def __str__(self) -> str:
        large = sorted(((held, name) for name, held in self.caches.items() if held > 1.0), reverse=True)
        listed = "".join(f", {name.rpartition('.')[2]} {held:.0f}" for held, name in large)
        used = f"{self.in_use:.1f} of them in use by C, {self.objects:.1f} thousand objects of Python"
        bounded = f"{sum(self.caches.values()):.1f} more in bounded caches{listed}"
        return f"{self.without_caches:.1f} MB at rest ({used}), {bounded}"


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
    return AtRest(held, caches, _in_use(), sys.getallocatedblocks() / 1000)


def _held() -> float:
    """Return the memory of the process after free memory is returned to the system [MiB]."""
    gc.collect()
    if not sys.platform.startswith("linux"):
        return most()
    ctypes.CDLL(None).malloc_trim(0)
    _, resident, of_files, *_ = map(int, Path("/proc/self/statm").read_text(encoding="ascii").split())
    # Pages of libraries are read in when their code first runs, and belong to no problem.
    return (resident - of_files) * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE


def _in_use() -> float:
    """Return the memory allocated in the heap of C [MiB]; 0 where the C library has no such figure."""
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallinfo2"):
        return 0.0
    library.mallinfo2.restype = _HeapFigures
    found = library.mallinfo2()
    return float(found.uordblks + found.hblkhd) / _MEBIBYTE


def most() -> float:
    """Return the maximum memory of the process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
