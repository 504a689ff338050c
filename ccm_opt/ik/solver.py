"""Solve the configuration NLP with IPOPT: SX expressions, exact Hessian, one built solver a program."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik.built_solver import IPOPT_SWITCHES
from ccm_opt.ik.configuration_task import ConfigurationSettings
from ccm_opt.ik.multiple_shooting import ConfigurationNLP, ShootingProgram

_MOST_ITERATIONS = 80
"""IPOPT's iterations, at most. Taste."""
_OPTIMALITY = 1e-4
"""Residual of the optimality conditions, in the NLP's units, at which IPOPT stops. Taste: coarse, since the polish
follows."""
_FEASIBILITY = 1e-6
"""Violation of a row, in the NLP's units, that counts as satisfied. Taste; the polish mends more."""
_ROWS_KEPT = 40
"""Violated rows that a result names. Taste."""

_solvers: WeakKeyDictionary[ShootingProgram, ca.Function] = WeakKeyDictionary()


@dataclass(frozen=True)
class NLPResult:
    """What the solver returned.

    Attributes:
        variables: the final iterate, shape (variables,).
        status: the solver's own word for how it stopped.
        iterations: number of iterations.
        objective: value at the final iterate.
        violation: largest violation of any row, in units of the arm's length.
        worst_row: name of that row.
        feasible: whether all rows hold, however the solver stopped.
        broken: names of the rows that are violated most, each with its violation, the worst first.
    """

    variables: FloatArray
    status: str
    iterations: int
    objective: float
    violation: float
    worst_row: str
    feasible: bool
    broken: tuple[tuple[str, float], ...] = ()


def solve_nlp(nlp: ConfigurationNLP, guess: FloatArray) -> NLPResult:
    """Solve from a guess; never raises on failure, the result says how it went. Threads wait for each other.

    Args:
        nlp: from ``build_configuration_nlp``, possibly extended.
        guess: shape (variables,).

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed meanwhile.
    """
    program = nlp.program
    bounds = {"lbx": nlp.lower, "ubx": nlp.upper, "lbg": program.lower, "ubg": program.upper}
    answer, statistics = ipopt_answer(lambda: built_solver(program), guess, p=nlp.parameters, **bounds)
    variables = np.asarray(answer["x"], dtype=np.float64).ravel()
    worst = _worst_rows(nlp, variables, np.asarray(answer["g"]).ravel())
    row, violation = worst[0]
    allowed = _FEASIBILITY
    return NLPResult(
        variables,
        str(statistics["return_status"]),
        int(statistics["iter_count"]),
        float(answer["f"]),
        violation,
        row,
        violation <= allowed,
        tuple(pair for pair in worst if pair[1] > allowed),
    )


def built_solver(program: ShootingProgram) -> ca.Function:
    """The IPOPT solver of a program; built once, kept as long as the program lives."""
    if program not in _solvers:
        symbols = {
            "x": program.variables,
            "p": program.parameters,
            "f": program.objective,
            "g": program.constraints,
        }
        options = {**IPOPT_SWITCHES, **_numbers(program.settings)}
        _solvers[program] = ca.nlpsol("configuration", "ipopt", symbols, options)
    return _solvers[program]


def _numbers(settings: ConfigurationSettings) -> dict[str, float]:
    """The settings in IPOPT's names."""
    return {
        "ipopt.tol": _OPTIMALITY,
        "ipopt.constr_viol_tol": settings.violation,
        "ipopt.mu_init": settings.first_barrier,
        "ipopt.max_iter": _MOST_ITERATIONS,
    }


def _worst_rows(nlp: ConfigurationNLP, variables: FloatArray, rows: FloatArray) -> list[tuple[str, float]]:
    """Names and violations of the rows and bounds that are violated most, the worst first."""
    names = (*nlp.program.row_names, *(f"bound of variable {i}" for i in range(len(variables))))
    values = np.concatenate((rows, variables))
    lower = np.concatenate((nlp.program.lower, nlp.lower))
    upper = np.concatenate((nlp.program.upper, nlp.upper))
    violation = np.nan_to_num(np.maximum(lower - values, values - upper), nan=np.inf)
    worst = np.argsort(-violation, kind="stable")[:_ROWS_KEPT]
    return [(names[row], max(0.0, float(violation[row]))) for row in worst]
