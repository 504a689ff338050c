"""The compiled dynamics on disk: compiled once for arms of any number of links, then loaded.

A machine compiles at most four libraries: two orders of axes, with rotor inertia or without. A library's name is a
digest of all that its machine code depends on, so that a change of any of it compiles anew and nothing is ever stale.
Without a compiler, or when it fails, one log line says so and CasADi's virtual machine takes over.
"""

import ctypes
import logging
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import Structure, arm_structure
from ccm_opt.dynamics.runtime.c_source import digest_of_sources, source_text
from ccm_opt.ground.c_compiler import find_compiler, machine_code_key
from ccm_opt.ground.library_cache import (
    LOADING_ERRORS,
    cache_folder_of,
    compile_into,
    first_line,
    library_name,
    open_with_symbols,
    opened_or_made,
)
from ccm_opt.jointed.arm import Arm

SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate")
logger = logging.getLogger(__name__)


def prepare(arm: Arm) -> None:
    """Begin to compile in the background what an arm will need; ``load_library`` waits for it."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="compile")
    pool.submit(load_library, arm_structure(arm))
    # The thread finishes what it has begun and ends by itself; nobody waits here.
    pool.shutdown(wait=False)


def load_library(structure: Structure) -> ctypes.PyDLL | None:
    """The compiled recursions of a structure, from the cache or compiled first; None when there is no compiling."""
    compiler = find_compiler()
    if compiler is None:
        _log_uncompiled("no C compiler was found")
        return None
    path = library_path(structure, compiler)
    try:
        return opened_or_made(path, open_library, lambda path: _compile(path, structure, compiler))
    except LOADING_ERRORS as error:
        _log_uncompiled(first_line(error))
        return None


def cache_folder() -> Path:
    """Folder of the compiled dynamics."""
    return cache_folder_of("dynamics")


def library_path(structure: Structure, compiler: str) -> Path:
    """Where the library of a structure stands, or will; its name is a digest of all that it depends on."""
    variant = f"{structure.axes} {'geared' if structure.geared else 'free'}"
    # The number of links is not among them: it is a run-time input of the machine code.
    parts = (variant, str(ca.CasadiMeta.version()), machine_code_key(compiler), digest_of_sources())
    return cache_folder() / library_name(parts)


def open_library(path: Path) -> ctypes.PyDLL:
    """Load a library of dynamics."""
    return open_with_symbols(path, SYMBOLS)


def _compile(path: Path, structure: Structure, compiler: str) -> None:
    compile_into(path, source_text(structure), compiler)


@cache
def _log_uncompiled(reason: str) -> None:
    """One line for one reason, however many functions are made."""
    logger.warning("dynamics run in CasADi's virtual machine, about ten times slower than compiled: %s", reason)
