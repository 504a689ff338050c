"""The IPOPT solver of a program of named rows, built once."""

from collections.abc import Mapping
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca

from ccm_opt.nlp.program_derivatives import ProgramDerivatives
from ccm_opt.nlp.repeated_rows import RepeatedRows
from ccm_opt.nlp.row_program import RowProgram

_solvers: WeakKeyDictionary[RowProgram, dict[tuple[Any, ...], ca.Function]] = WeakKeyDictionary()


def built_solver(program: RowProgram, options: Mapping[str, Any]) -> ca.Function:
    """The solver of a program; built once for the same options, kept as long as the program lives.

    Where rows are repeated the derivatives are those of their templates, and CasADi's of the program otherwise.
    """
    kept = _solvers.setdefault(program, {})
    asked = tuple(options.items())
    if asked not in kept:
        symbols = {
            "x": program.variables,
            "p": program.parameters.column,
            "f": program.objective,
            "g": program.constraints,
        }
        repeated = any(isinstance(block, RepeatedRows) for block in program.rows)
        derivatives = ProgramDerivatives(program).functions if repeated else {}
        kept[asked] = ca.nlpsol("goal_pose", "ipopt", symbols, {**options, **derivatives})
    return kept[asked]
