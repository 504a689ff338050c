"""The compiled dynamics on disk: compiled once for arms of any number of links, then loaded.

A machine compiles at most four libraries: two orders of axes, with rotor inertia or without. A library's name is a
digest of all that its machine code depends on, so that a change of any of it compiles anew and nothing is ever stale.
Without a compiler, or when it fails, one log line says so and CasADi's virtual machine takes over.
"""

import ctypes
import hashlib
import logging
import os
import subprocess
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import casadi as ca
import platformdirs

from ccm_opt.dynamics.algorithms.arm_model import Structure, arm_structure
from ccm_opt.dynamics.runtime.c_compiler import SUFFIX, compile_library, find_compiler, machine_code_key
from ccm_opt.dynamics.runtime.c_source import digest_of_sources, source_text
from ccm_opt.jointed.arm import Arm

CACHE_VARIABLE = "CCM_OPT_CACHE"
"""Environment variable that names the folder of the cache."""
SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate")
_one_at_a_time = threading.Lock()  # threads that want the same library wait for the first, and then find it
logger = logging.getLogger(__name__)


def prepare(arm: Arm) -> None:
    """Begin to compile in the background what an arm will need; ``load_library`` waits for it."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="compile")
    pool.submit(load_library, arm_structure(arm))
    # The thread finishes what it has begun and ends by itself; nobody waits here.
    pool.shutdown(wait=False)


def load_library(structure: Structure) -> ctypes.CDLL | None:
    """The compiled recursions of a structure, from the cache or compiled first; None when there is no compiling."""
    compiler = find_compiler()
    if compiler is None:
        _log_uncompiled("no C compiler was found")
        return None
    path = library_path(structure, compiler)
    try:
        with _one_at_a_time:
            return _opened(path) or _compiled(path, structure, compiler)
    except (OSError, AttributeError, RuntimeError, subprocess.SubprocessError) as error:
        _log_uncompiled(_first_line(error))
        return None


def cache_folder() -> Path:
    """Folder of compiled functions: under ``CCM_OPT_CACHE`` or the user's cache folder."""
    root = os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("ccm_opt", appauthor=False)
    return Path(root) / "dynamics"


def library_path(structure: Structure, compiler: str) -> Path:
    """Where the library of a structure stands, or will; its name is a digest of all that it depends on."""
    variant = f"{structure.axes} {'geared' if structure.geared else 'free'}"
    # The number of links is not among them: it is a run-time input of the machine code.
    parts = (variant, str(ca.CasadiMeta.version()), machine_code_key(compiler), digest_of_sources())
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
    return cache_folder() / f"{digest}{SUFFIX}"


def _opened(path: Path) -> ctypes.CDLL | None:
    """The library at a path; None when there is none or it is damaged, so that it is compiled anew."""
    if not path.exists():
        return None
    try:
        return open_library(path)
    except (OSError, AttributeError):
        return None


def _compiled(path: Path, structure: Structure, compiler: str) -> ctypes.CDLL:
    _compile(path, structure, compiler)
    return open_library(path)


def open_library(path: Path) -> ctypes.CDLL:
    """Load a library that keeps the interpreter's lock while it runs, which makes short calls shorter."""
    library = ctypes.PyDLL(str(path))
    for symbol in SYMBOLS:
        function = getattr(library, symbol)
        function.restype = None
        function.argtypes = (ctypes.c_void_p,)
    return library


def _compile(path: Path, structure: Structure, compiler: str) -> None:
    """Generate, compile, and put the finished library in its place in one step, so that readers see all or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Beside its destination, since a rename is atomic within one file system only.
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        source = Path(folder) / "dynamics.c"
        output = Path(folder) / path.name
        source.write_text(source_text(structure), encoding="utf-8")
        compile_library(compiler, source, output)
        output.replace(path)


@cache
def _log_uncompiled(reason: str) -> None:
    """One line for one reason, however many functions are made."""
    logger.warning("dynamics run in CasADi's virtual machine, about ten times slower than compiled: %s", reason)


def _first_line(error: Exception) -> str:
    if isinstance(error, subprocess.CalledProcessError) and error.stderr:
        return f"the C compiler failed: {error.stderr.decode(errors='replace').strip().splitlines()[0]}"
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
