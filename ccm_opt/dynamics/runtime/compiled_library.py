"""The compiled dynamics: one library for arms of any number of links.

There are six: two orders of axes, with rotor inertia or without, and for motions in the plane, where either order is
the same arm, two more. Without a compiler, or when it fails, CasADi's virtual machine takes over, about ten times
slower.
"""

import ctypes
from typing import get_args

import casadi as ca

from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.runtime.c_source import digest_of_sources, source_text
from ccm_opt.ground.compiled_source import LibraryRecipe, library_of
from ccm_opt.jointed.arm import Axes

SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate")


def load_library(structure: Structure) -> ctypes.PyDLL | None:
    """The compiled recursions of a structure; None when there is no compiling."""
    return library_of(recipe_of(structure), SYMBOLS)


def every_recipe() -> tuple[LibraryRecipe, ...]:
    """How each of the six libraries is made."""
    in_space = (Structure(1, axes, geared) for axes in get_args(Axes) for geared in (False, True))
    planar = (Structure(1, "zyx", geared, planar=True) for geared in (False, True))
    return tuple(recipe_of(structure) for structure in (*in_space, *planar))


def recipe_of(structure: Structure) -> LibraryRecipe:
    """How the library of a structure is made."""
    variant = f"{structure.axes} {'geared' if structure.geared else 'free'}{' planar' if structure.planar else ''}"
    # The number of links is not among them: it is a run-time input of the machine code.
    parts = (variant, str(ca.CasadiMeta.version()), digest_of_sources())
    return LibraryRecipe("dynamics", parts, lambda: {"dynamics.c": source_text(structure)})
