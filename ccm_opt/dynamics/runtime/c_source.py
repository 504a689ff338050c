"""C source of the compiled dynamics: functions of one link as CasADi generates them, then hand-written files.

``sines.c`` and ``recursion.c``, next to this module, run the functions of a link along the arm, and ``simulation.c``
closes the control loop. Masses, lengths, gravity, gains and the number of links are run-time inputs. There are four
sources: two orders of axes, one for motions in the plane, where both orders are equivalent, and one for the arcs of
sections that bend evenly.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import casadi as ca

from ccm_opt.dynamics.algorithms.aba import aba_steps
from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.rnea import rnea_steps
from ccm_opt.robot.arm import Axes

C_FILES = ("sines.c", "recursion.c", "simulation.c")
SYMBOLS = ("inverse_dynamics", "forward_dynamics", "simulate", "work_per_link", "loop_rows")
"""Names of the C functions that every source of the dynamics exports.

In the library, two underscores and the variant of the arm's structure follow the name.
"""
# The functions of one link are called by the recursions only.
PRIVATE = "#define CASADI_SYMBOL_EXPORT static ALWAYS_INLINE\n"


def every_source() -> dict[str, str]:
    """Return the C sources of the dynamics for all structures of arms, by file name."""
    of_balls = (Structure(1, axes) for axes in get_args(Axes))
    structures = (*of_balls, Structure(1, "zyx", planar=True), Structure(1, "zyx", arcs=True))
    return {f"dynamics_{structure.variant}.c": source_text(structure) for structure in structures}


def source_text(structure: Structure) -> str:
    """Return the C source of the dynamics for arms of a given structure with any number of links."""
    rnea = rnea_steps(structure)
    aba = None if structure.arcs else aba_steps(structure)
    names = "".join(f"#define {name} {name}__{structure.variant}\n" for name in SYMBOLS)
    # The hand-written loops need the number of values of a body, and of those that ABA passes on and keeps per link.
    sizes = f"#define BODY {rnea.outward.size1_in(4)}\n"
    if aba is None:
        sizes += "#define ARCS\n"
    else:
        sizes += f"#define STATE {aba.inertia.size1_in(0)}\n#define SOLVED {aba.inertia.size1_out(1)}\n"
    by_hand = [Path(__file__).with_name(name).read_text(encoding="utf-8") for name in C_FILES]
    generated = _generated([*rnea, *(aba or ())], structure.variant)
    return "\n".join(('#include "native.h"', PRIVATE, generated, names, sizes, *by_hand))


def _generated(functions: Sequence[Any], name: str) -> str:
    generator = ca.CodeGenerator(f"{name}.c")  # prefixes the names of helper functions, as all sources form one library
    for function in functions:
        # CasADi omits known zeros from sparse results, which would shift the values that follow.
        if not all(function.sparsity_out(i).is_dense() for i in range(function.n_out())):
            raise RuntimeError(f"{function.name()} leaves out zeros, which the recursions do not expect")
        generator.add(function)
    return str(generator.dump())
