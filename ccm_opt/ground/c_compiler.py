"""The machine's C compiler: which one, and what its machine code depends on."""

import os
import platform
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

from ccm_opt.ground.compiler_settings import DEFAULT_COMPILER, CompilerSettings

COMPILER_VARIABLE = "CCM_OPT_CC"
"""Environment variable that names the compiler to use; empty: none."""
COMPILERS = ("gcc", "clang", "cc")
# Nobody reads errno or floating-point traps, and without them loops can be vectorised; no value changes.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")
SUFFIX = ".dll" if sys.platform == "win32" else ".so"


def find_compiler() -> str | None:
    """Path of the C compiler: ``CCM_OPT_CC`` or the first of gcc, clang, cc; None when there is none."""
    chosen = os.environ.get(COMPILER_VARIABLE)
    candidates = COMPILERS if chosen is None else (chosen,)
    for name in candidates:
        path = shutil.which(name) if name else None
        if path:
            return path
    return None


def compile_library(
    compiler: str,
    source: Path,
    output: Path,
    flags: tuple[str, ...] = FLAGS,
    settings: CompilerSettings = DEFAULT_COMPILER,
) -> None:
    """Compile one C file into a shared library.

    Raises:
        CalledProcessError: the compiler refuses; its words are in ``stderr``.
        TimeoutExpired: it hangs.
    """
    command = [compiler, *flags, str(source), "-o", str(output), "-lm"]
    subprocess.run(command, check=True, capture_output=True, timeout=settings.time_limit)  # noqa: S603 - our own list


def machine_code_key(compiler: str) -> str:
    """What decides the machine code of a source: compiler, flags and processor."""
    return "\n".join((_version(compiler), " ".join(FLAGS), _processor()))


@cache
def _version(compiler: str) -> str:
    result = subprocess.run([compiler, "--version"], check=False, capture_output=True, text=True)  # noqa: S603 - path from which()
    return f"{compiler}\n{result.stdout}"


@cache
def _processor() -> str:
    """The processor's instruction set: ``-march=native`` code must not run on another one that shares the cache."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())
    return f"{platform.system()} {platform.machine()} {flags}"
