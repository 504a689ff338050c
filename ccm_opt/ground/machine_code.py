"""What machine code is made for: flags of the compiler, and the kinds of processor that the code runs on.

Every operation is rounded by itself, as IEEE 754 has it: the compiler may neither fuse a product with a sum nor
reorder sums. So all processors, compilers and vector widths give the same numbers to the last bit.
"""

import platform
import sys
from functools import cache
from pathlib import Path

# Nobody reads errno or floating-point traps, and without them loops can be vectorised; no value changes.
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")
"""Flags for any processor of a kind."""
SUFFIX = ".dll" if sys.platform == "win32" else ".so"
WIDE = ("-mavx2",)
"""Further flags for the x86 processors that have it, on which inverse dynamics takes half as long."""


def is_x86() -> bool:
    """Whether this machine's processor is of the kind that may have wide vectors."""
    return platform.machine().lower() in {"x86_64", "amd64"}


def levels_here() -> tuple[tuple[str, ...], ...]:
    """All sets of flags that are worth compiling on a machine of this kind, whatever its own processor has."""
    return (FLAGS, FLAGS + WIDE) if is_x86() else (FLAGS,)


@cache
def best_level() -> tuple[str, ...]:
    """The set of flags for this very processor."""
    return FLAGS + WIDE if is_x86() and "avx2" in _features() else FLAGS


def _features() -> frozenset[str]:
    """The processor's features as Linux tells them; empty elsewhere."""
    told = Path("/proc/cpuinfo")
    if not told.exists():
        return frozenset()
    lines = told.read_text(encoding="utf-8", errors="replace").splitlines()
    return frozenset(next((line for line in lines if line.startswith("flags")), "").split())


def target(flags: tuple[str, ...]) -> str:
    """What decides the machine code of a source: system, kind of processor, C library and flags."""
    return " ".join((platform.system(), platform.machine(), platform.libc_ver()[0], *flags))
