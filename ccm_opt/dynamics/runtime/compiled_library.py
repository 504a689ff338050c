"""The compiled dynamics on disk: compiled once for arms of any number of links, then loaded.

A machine compiles at most four libraries: two orders of axes, with rotor inertia or without. A library's name is a
digest of all that its machine code depends on, so that a change of any of it compiles anew and nothing is ever stale.
Without a compiler, or when it fails, one log line says so and CasADi's virtual machine takes over.
"""

import ctypes
from concurrent.futures import ThreadPoolExecutor

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import Structure, arm_structure
from ccm_opt.dynamics.runtime.c_source import digest_of_sources, source_text
from ccm_opt.ground.compiled_source import LibraryRecipe, library_of
from ccm_opt.jointed.arm import Arm

KIND = "dynamics"
"""Folder of the cache."""
SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate")


def prepare(arm: Arm) -> None:
    """Begin to compile in the background what an arm will need; ``load_library`` waits for it."""
    pool = ThreadPoolExecutor(1, thread_name_prefix="compile")
    pool.submit(load_library, arm_structure(arm))
    # The thread finishes what it has begun and ends by itself; nobody waits here.
    pool.shutdown(wait=False)


def load_library(structure: Structure) -> ctypes.PyDLL | None:
    """The compiled recursions of a structure, from the cache or compiled first; None when there is no compiling."""
    return library_of(recipe_of(structure))


def recipe_of(structure: Structure) -> LibraryRecipe:
    """How the library of a structure is made."""
    variant = f"{structure.axes} {'geared' if structure.geared else 'free'}"
    # The number of links is not among them: it is a run-time input of the machine code.
    parts = (variant, str(ca.CasadiMeta.version()), digest_of_sources())
    otherwise = "dynamics run in CasADi's virtual machine, about ten times slower than compiled"
    return LibraryRecipe(KIND, SYMBOLS, parts, lambda: {"dynamics.c": source_text(structure)}, otherwise)
