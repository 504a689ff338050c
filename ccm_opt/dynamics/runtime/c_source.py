"""The C source of the compiled dynamics: one link's functions as CasADi generates them, then the files beside this one.

``sines.c`` and ``recursion.c`` run those functions along the arm, ``simulation.c`` closes the loop. Masses, lengths,
gravity, gains and the number of links are run-time inputs.
"""

import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca

from ccm_opt.dynamics.algorithms.aba import aba_steps
from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.rnea import rnea_steps

C_FILES = ("sines.c", "recursion.c", "simulation.c")
HEADERS = "#include <math.h>\n#include <string.h>\n"
PRIVATE = "#define CASADI_SYMBOL_EXPORT static inline\n"  # the functions of one link are for the recursions alone


def source_text(structure: Structure) -> str:
    """C source for arms of a structure, whatever the number of their links."""
    rnea = rnea_steps(structure)
    aba = aba_steps(structure)
    # The two forms of ABA pass on states of different sizes; the loops written by hand are told which.
    sizes = f"#define STATE {aba.inertia.size1_in(0)}\n#define SOLVED {aba.inertia.size1_out(1)}\n"
    by_hand = [_beside(name).read_text(encoding="utf-8") for name in C_FILES]
    return "\n".join((PRIVATE, _generated([*rnea, *aba]), HEADERS, sizes, *by_hand))


@cache
def digest_of_sources() -> str:
    """Digest of everything that ``source_text`` is made from but the structure, without generating it."""
    folder = Path(__file__).parent
    algorithms = sorted(folder.with_name("algorithms").glob("*.py"))
    digest = hashlib.sha256()
    for path in (*algorithms, Path(__file__), *map(_beside, C_FILES)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _generated(functions: Sequence[Any]) -> str:
    generator = ca.CodeGenerator("steps.c")
    for function in functions:
        # Zeros that CasADi knows of are not stored in sparse results, and the rows below would be shifted.
        if not all(function.sparsity_out(i).is_dense() for i in range(function.n_out())):
            raise RuntimeError(f"{function.name()} leaves out zeros, which the recursions do not expect")
        generator.add(function)
    return str(generator.dump())


def _beside(name: str) -> Path:
    return Path(__file__).with_name(name)
