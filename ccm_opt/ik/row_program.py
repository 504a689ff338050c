"""Nonlinear programs whose constraint rows have names, and IPOPT's answers to them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray

Bounds = Mapping[str, tuple[FloatArray, FloatArray]]
"""Lower and upper bounds of symbols, by name."""


@dataclass(frozen=True)
class RowBlock:
    """Block of constraint rows ``lower <= expression <= upper`` of an NLP, with one name per row."""

    names: tuple[str, ...]
    expression: ca.SX
    lower: FloatArray
    upper: FloatArray


def equal_to_zero(names: tuple[str, ...], expression: ca.SX) -> RowBlock:
    """Return constraint rows that require every entry of an expression to be zero, with one name per entry."""
    return RowBlock(names, expression, np.zeros(len(names)), np.zeros(len(names)))


def not_negative(names: tuple[str, ...], expression: ca.SX) -> RowBlock:
    """Return constraint rows that require every entry of an expression to be at least zero, with one name per entry."""
    return RowBlock(names, expression, np.zeros(len(names)), np.full(len(names), np.inf))


def pinned_bounds(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds that fix variables at finite values and leave those with the value ∞ free."""
    return np.where(np.isfinite(values), values, -np.inf), values


@dataclass(frozen=True, eq=False)
class Symbols:
    """Named CasADi symbols, stacked in one column.

    Attributes:
        by_name: matrices of symbols by name; empty ones take no place in the column.
    """

    by_name: Mapping[str, ca.SX]

    def __getitem__(self, name: str) -> ca.SX:
        return self.by_name[name]

    @cached_property
    def column(self) -> ca.SX:
        """All symbols stacked in one column, each matrix column by column."""
        return ca.vertcat(*(ca.vec(symbols) for symbols in self.by_name.values()))

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """Slice of the stacked column that holds the symbols of each name."""
        sizes = [symbols.numel() for symbols in self.by_name.values()]
        stops = np.cumsum(sizes).tolist()
        cuts = (slice(stop - size, stop) for stop, size in zip(stops, sizes, strict=True))
        return dict(zip(self.by_name, cuts, strict=True))

    def filled(self, numbers: Mapping[str, FloatArray], fill: float = np.nan) -> FloatArray:
        """Return numerical values for the stacked column of symbols, shape (entries,).

        Args:
            numbers: values by name, each in the shape of the transpose of the matrix of symbols.
            fill: value for the symbols of names without numbers.
        """
        column = np.full(self.column.numel(), fill)
        for name, place in self.places.items():
            if name in numbers:
                column[place] = np.ravel(numbers[name])
        return column


@dataclass(frozen=True, eq=False, kw_only=True)
class RowProgram:
    """Symbolic nonlinear program with named variables, parameters, constraint rows and costs.

    Attributes:
        unknowns: the variables.
        parameters: values that may change between solutions, including the weights of the cost terms.
        rows: all blocks of constraint rows.
        parts: cost terms of the objective by name. Those whose weights are parameters come first, unweighted; the
            user's follow, with their weights included.
        objective: weighted sum of the cost terms.
    """

    unknowns: Symbols
    parameters: Symbols
    rows: tuple[RowBlock, ...]
    parts: Mapping[str, ca.SX]
    objective: ca.SX

    @property
    def variables(self) -> ca.SX:
        """All variables of the program in one column."""
        return self.unknowns.column

    @cached_property
    def constraints(self) -> ca.SX:
        """Expressions of all constraint rows in one column."""
        return ca.vertcat(*(block.expression for block in self.rows))

    @cached_property
    def parts_function(self) -> ca.Function:
        """CasADi function from variables and parameters to the cost terms in ``parts``, in one column."""
        parts = ca.vertcat(*self.parts.values())
        return ca.Function("parts", [self.variables, self.parameters.column], [parts])

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """Name of each constraint row."""
        return tuple(name for block in self.rows for name in block.names)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the constraint rows, each of shape (rows,)."""
        lower = np.concatenate([block.lower for block in self.rows])
        upper = np.concatenate([block.upper for block in self.rows])
        return lower, upper

    def costs(self, variables: FloatArray, parameters: FloatArray, weights: FloatArray) -> dict[str, float]:
        """Return the values of the weighted cost terms of the objective by name.

        Args:
            variables: values of the variables, shape (variables,).
            parameters: values of the parameters, shape (parameters,).
            weights: weights of the first cost terms; the remaining ones, the user's, already include their weights.
        """
        own = np.ones(len(self.parts) - len(weights))
        amounts = np.asarray(self.parts_function(variables, parameters), dtype=np.float64).ravel()
        return dict(zip(self.parts, (amounts * np.append(weights, own)).tolist(), strict=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class RowAnswer:
    """IPOPT's answer to a nonlinear program with named rows.

    Attributes:
        variables: values of the variables at which the solver stopped, shape (variables,).
        costs: weighted cost terms of the objective by name; their sum is the objective.
        multipliers: magnitudes of the Lagrange multipliers of active rows and bounds by name, the largest first: the
            decrease of the objective per unit by which the row is relaxed (arm length, radian, or the user's unit).
        status: return status of the solver.
        iterations: number of iterations of the solver.
        violation: largest violation of any row, in the row's unit (arm length, radian, or the user's unit).
        worst_row: name of the row with the largest violation.
        size: numbers of variables and of rows.
        broken: violations, by name, of the rows that do not count as satisfied; the worst first.
    """

    variables: FloatArray
    costs: Mapping[str, float]
    multipliers: Mapping[str, float]
    status: str
    iterations: int
    violation: float
    worst_row: str
    size: tuple[int, int] = (0, 0)
    broken: Mapping[str, float] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        """Value of the objective, the sum of its weighted cost terms."""
        return float(sum(self.costs.values()))


def row_answer(
    program: RowProgram,
    answer: Mapping[str, Any],
    statistics: Mapping[str, Any],
    *,
    feasible: float,
    costs: Mapping[str, float] = MappingProxyType({}),
    bounded: Mapping[str, float] = MappingProxyType({}),
    binding: float = np.inf,
) -> RowAnswer:
    """Return IPOPT's results for a program by the names of its rows.

    Args:
        program: the program that was solved.
        answer: results of CasADi's solver, with the keys "x", "g" and "lam_g".
        statistics: statistics of CasADi's solver.
        feasible: violation up to which a constraint counts as satisfied.
        costs: weighted cost terms of the objective by name.
        bounded: multipliers, by name, of bounds on variables that are reported like those of rows.
        binding: multiplier above which a row or bound counts as active.
    """
    rows = np.asarray(answer["g"], dtype=np.float64).ravel()
    multipliers = np.append(np.asarray(answer["lam_g"], dtype=np.float64), list(bounded.values()))
    lower, upper = program.bounds
    violation = np.nan_to_num(np.maximum(lower - rows, rows - upper), nan=np.inf)
    worst_first = np.argsort(-violation, kind="stable").tolist()
    names = program.row_names
    shaping = (*names, *bounded)
    strongest_first = np.argsort(-np.abs(multipliers), kind="stable").tolist()
    return RowAnswer(
        variables=np.asarray(answer["x"], dtype=np.float64).ravel(),
        costs=costs,
        multipliers={
            shaping[row]: float(abs(multipliers[row]))
            for row in strongest_first
            if abs(multipliers[row]) > binding and not _is_tie(shaping[row])
        },
        status=str(statistics["return_status"]),
        iterations=int(statistics["iter_count"]),
        violation=max(float(violation[worst_first[0]]), 0.0),
        worst_row=names[worst_first[0]],
        size=(program.variables.numel(), len(rows)),
        broken={names[row]: float(violation[row]) for row in worst_first if violation[row] > feasible},
    )


def _is_tie(name: str) -> bool:
    """Return whether a constraint row, judged by its name, only defines variables and does not restrict the pose."""
    if name.startswith("user: "):  # whatever its name
        return False
    return any(tie in name for tie in ("mapping", "gap in", "spline at", "of its end"))


_solvers: WeakKeyDictionary[RowProgram, dict[tuple[Any, ...], ca.Function]] = WeakKeyDictionary()


def built_solver(program: RowProgram, options: Mapping[str, Any], *, by_blocks: bool) -> ca.Function:
    """Return the IPOPT solver of a program, built once per set of options and kept as long as the program exists.

    Args:
        program: the program.
        options: options of CasADi and IPOPT.
        by_blocks: whether the derivatives are built block by block, which is faster where blocks share few variables.
    """
    kept = _solvers.setdefault(program, {})
    options_key = tuple(options.items())
    if options_key not in kept:
        symbols = {
            "x": program.variables,
            "p": program.parameters.column,
            "f": program.objective,
            "g": program.constraints,
        }
        derivatives = block_derivatives(program) if by_blocks else {}
        kept[options_key] = ca.nlpsol("goal_pose", "ipopt", symbols, {**options, **derivatives})
    return kept[options_key]


def block_derivatives(program: RowProgram) -> dict[str, ca.Function]:
    """Return CasADi functions for the Jacobian of a program's rows and the Hessian of its Lagrangian, by option name.

    They are built block by block. All rows of a block depend on few variables in a similar way, so the derivatives of a
    block take fewer sweeps than those of all rows at once: with CasADi's own derivatives a program in space takes 1.5
    times as long (measured).
    """
    variables, parameters = program.variables, program.parameters.column
    weight = ca.SX.sym("weight")
    multipliers = [ca.SX.sym("multiplier", len(block.names)) for block in program.rows]
    terms = [ca.dot(each, block.expression) for each, block in zip(multipliers, program.rows, strict=True)]
    slopes = ca.vertcat(*(ca.jacobian(block.expression, variables) for block in program.rows))
    curvatures = sum(ca.triu(ca.hessian(term, variables)[0]) for term in (weight * program.objective, *terms))
    arguments = [variables, parameters, weight, ca.vertcat(*multipliers)]
    return {
        "jac_g": ca.Function("nlp_jac_g", [variables, parameters], [program.constraints, slopes]),
        "hess_lag": ca.Function("nlp_hess_l", arguments, [curvatures]),
    }


IPOPT_SWITCHES: MappingProxyType[str, Any] = MappingProxyType(
    {
        "print_time": False,
        "error_on_fail": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.acceptable_iter": 0,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.nlp_scaling_method": "none",
        # The matrices are small and well scaled: this saves a fifth of the time, with the same iterates.
        "ipopt.fast_step_computation": "yes",
        "ipopt.min_refinement_steps": 0,
        "ipopt.mumps_permuting_scaling": 0,
        "ipopt.mumps_pivot_order": 0,
        "ipopt.mumps_scaling": 0,
    }
)
"""IPOPT options common to all programs: silent, without a separate acceptable level, and without scaling."""
