"""CasADi functions compiled by the machine's C compiler, kept on disk, and called through plain buffers.

The code depends on the structure of an arm alone: masses, lengths, gravity and gains are run-time inputs, so that all
arms of equally many links share one library. Without a compiler, or when it fails, CasADi's virtual machine evaluates
the same functions, about ten times slower; one log line says so.
"""

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import platformdirs

from ccm_opt.arrays import FloatArray

CACHE_VARIABLE = "CCM_OPT_CACHE"  # folder of the cache
COMPILER_VARIABLE = "CCM_OPT_CC"  # compiler to use; empty: none
COMPILERS = ("gcc", "clang", "cc")
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")
COMPILE_TIME_LIMIT = 300.0  # s
logger = logging.getLogger(__name__)


class BufferedFunction:
    """A CasADi function with arrays of its own for inputs and outputs, called without allocation by CasADi.

    Not for use by two threads at once. CasADi stores matrices by columns: an input of shape (rows, columns) is taken
    as a C-ordered array of shape (columns, rows).

    Args:
        function: CasADi function with dense inputs and outputs.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self.inputs = [_array(function.size_in(i)) for i in range(function.n_in())]
        self.outputs = [_array(function.size_out(i)) for i in range(function.n_out())]
        for i, array in enumerate(self.inputs):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.outputs):
            self._buffer.set_res(i, array.data)

    def __call__(self, *arguments: FloatArray | float) -> list[FloatArray]:
        """Evaluate; the returned arrays are overwritten by the next call.

        Args:
            arguments: values of the first inputs; later inputs keep what ``inputs`` holds.
        """
        for array, argument in zip(self.inputs, arguments, strict=False):
            array[...] = argument
        self._evaluate()
        return self.outputs


def _array(shape: tuple[int, int]) -> FloatArray:
    rows, columns = shape
    return np.zeros(rows) if columns == 1 else np.zeros((columns, rows))


def load_functions(key: str, names: Sequence[str], build: Callable[[], Sequence[Any]]) -> dict[str, Any]:
    """Compiled functions from the cache, compiled first when they are new.

    Args:
        key: what the generated code depends on, beside the package's own source.
        names: names of the functions.
        build: makes the CasADi functions of these names; called only when they are not in the cache.

    Returns:
        Functions by name: compiled ones, or CasADi's own when they cannot be compiled.
    """
    compiler = find_compiler()
    if compiler is None:
        _say_uncompiled("no C compiler was found")
        return {function.name(): function for function in build()}
    library = cache_folder() / f"{_digest(key, compiler)}{'.dll' if sys.platform == 'win32' else '.so'}"
    try:
        if library.exists():
            with suppress(RuntimeError):  # damaged: compile it again
                return _open(library, names)
        _compile(library, compiler, build())
        return _open(library, names)
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _say_uncompiled(_first_line(error))
        return {function.name(): function for function in build()}


def find_compiler() -> str | None:
    """Path of the C compiler: ``CCM_OPT_CC`` or the first of gcc, clang, cc; None when there is none."""
    chosen = os.environ.get(COMPILER_VARIABLE)
    candidates = COMPILERS if chosen is None else (chosen,)
    return next((path for name in candidates if name and (path := shutil.which(name))), None)


def cache_folder() -> Path:
    """Folder of compiled functions: under ``CCM_OPT_CACHE`` or the user's cache folder."""
    root = os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("ccm_opt", appauthor=False)
    return Path(root) / "dynamics"


def _open(library: Path, names: Sequence[str]) -> dict[str, Any]:
    return {name: ca.external(name, str(library)) for name in names}


def _compile(library: Path, compiler: str, functions: Sequence[Any]) -> None:
    """Generate, compile, and put the finished library in its place in one step, so that readers see all or nothing."""
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        generator = ca.CodeGenerator("dynamics.c")
        for function in functions:
            generator.add(function)
        source = generator.generate(f"{folder}/")
        output = Path(folder) / library.name
        command = [compiler, *FLAGS, source, "-o", str(output), "-lm"]
        subprocess.run(command, check=True, capture_output=True, timeout=COMPILE_TIME_LIMIT)  # noqa: S603 - our own list
        output.replace(library)


def _digest(key: str, compiler: str) -> str:
    """Name of a library: everything its machine code depends on."""
    parts = (key, str(ca.CasadiMeta.version()), _version(compiler), " ".join(FLAGS), _processor(), _own_source())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


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


@cache
def _own_source() -> str:
    """Digest of this package's source, from which the code is generated."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _say_uncompiled(reason: str) -> None:
    logger.warning("dynamics run in CasADi's virtual machine, about ten times slower than compiled: %s", reason)


def _first_line(error: Exception) -> str:
    if isinstance(error, subprocess.CalledProcessError) and error.stderr:
        return f"the C compiler failed: {error.stderr.decode(errors='replace').strip().splitlines()[0]}"
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
