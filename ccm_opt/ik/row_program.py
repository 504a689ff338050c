"""Programs of named rows, repeated along the arm, and what IPOPT made of them.

An arm's NLP is partially separable (Griewank and Toint, 1982): almost every row depends on the few variables of one
link. Where the row is known as such a function, its derivatives are taken of that function once, whatever the number of
links; those of a whole program written out take most of the time in which a solver is built.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.ik.curve_program import RowBlock


@dataclass(frozen=True, eq=False)
class Symbols:
    """Symbols by name, one after the other in a column.

    Attributes:
        by_name: matrices of symbols; what is without entries is nowhere.
    """

    by_name: Mapping[str, ca.SX]

    def __getitem__(self, name: str) -> ca.SX:
        return self.by_name[name]

    @cached_property
    def column(self) -> ca.SX:
        """All of them, each column by column."""
        return ca.vertcat(*(ca.vec(symbols) for symbols in self.by_name.values()))

    @cached_property
    def places(self) -> Mapping[str, slice]:
        """Where each stands in the column."""
        sizes = [symbols.numel() for symbols in self.by_name.values()]
        stops = np.cumsum(sizes).tolist()
        cuts = (slice(stop - size, stop) for stop, size in zip(stops, sizes, strict=True))
        return dict(zip(self.by_name, cuts, strict=True))

    def filled(self, numbers: Mapping[str, FloatArray], fill: float = np.nan) -> FloatArray:
        """Numbers for the column.

        Args:
            numbers: by name, a matrix's columns in rows.
            fill: what the others get.
        """
        column = np.full(self.column.numel(), fill)
        for name, place in self.places.items():
            if name in numbers:
                column[place] = np.ravel(numbers[name])
        return column


@dataclass(frozen=True, eq=False, kw_only=True)
class RowProgram:
    """Variables, rows and costs of a pose at the goal.

    Attributes:
        unknowns: the variables.
        parameters: what changes from question to question, the weights of the parts among them.
        rows: all blocks of rows.
        parts: the parts of the objective by name, unweighted; the user's behind those that have a weight among the
            parameters.
        objective: their weighted sum.
    """

    unknowns: Symbols
    parameters: Symbols
    rows: tuple[RowBlock, ...]
    parts: Mapping[str, ca.SX]
    objective: ca.SX

    @property
    def variables(self) -> ca.SX:
        """All variables in one column."""
        return self.unknowns.column

    @cached_property
    def constraints(self) -> ca.SX:
        """All rows in one column."""
        return ca.vertcat(*(block.expression for block in self.rows))

    @cached_property
    def parts_function(self) -> ca.Function:
        """(variables, parameters) to the parts of the objective, unweighted, in one column."""
        parts = ca.vertcat(*self.parts.values())
        return ca.Function("parts", [self.variables, self.parameters.column], [parts])

    @cached_property
    def row_names(self) -> tuple[str, ...]:
        """What each row says."""
        return tuple(name for block in self.rows for name in block.names)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the rows."""
        lower = np.concatenate([block.lower for block in self.rows])
        upper = np.concatenate([block.upper for block in self.rows])
        return lower, upper

    def costs(self, variables: FloatArray, parameters: FloatArray, weights: FloatArray) -> dict[str, float]:
        """Weighted parts of the objective by name.

        Args:
            variables: shape (variables,).
            parameters: for their column.
            weights: of the first parts; the user's that follow have theirs in them already.
        """
        own = np.ones(len(self.parts) - len(weights))
        amounts = np.asarray(self.parts_function(variables, parameters), dtype=np.float64).ravel()
        return dict(zip(self.parts, (amounts * np.append(weights, own)).tolist(), strict=True))


ColumnForm: TypeAlias = Callable[..., ca.SX]
"""Takes columns, shape (k, e) each, and returns a column of m values for each of these e, shape (m, e)."""


@dataclass(frozen=True, eq=False)
class Repeated:
    """A function of columns and what it is repeated for.

    Attributes:
        form: what it says of a column; it must say the same of each, whatever their number.
        variables: its first arguments, shape (k, e) each: symbols of the program's variables, or zeros.
        given: the others, shape (p, e) each: of parameters or numbers.
    """

    form: ColumnForm
    variables: tuple[ca.SX, ...]
    given: tuple[ca.SX, ...] = ()

    @property
    def count(self) -> int:
        """How often it is repeated, e."""
        return int(self.variables[0].shape[1])

    @cached_property
    def values(self) -> ca.SX:
        """All of them, shape (m, e)."""
        return self.form(*self.variables, *self.given)

    @cached_property
    def template(self) -> "Template":
        """It, once, with its derivatives."""
        variables = [ca.SX.sym("variable", each.shape[0]) for each in self.variables]
        given = [ca.SX.sym("given", each.shape[0]) for each in self.given]
        return Template(ca.vertcat(*variables), ca.vertcat(ca.SX(0, 1), *given), self.form(*variables, *given))


@dataclass(frozen=True, eq=False)
class Template:
    """A function of one column in symbols, and its derivatives.

    Attributes:
        variables: shape (k, 1).
        given: shape (p, 1).
        values: shape (m, 1).
    """

    variables: ca.SX
    given: ca.SX
    values: ca.SX

    @cached_property
    def jacobian(self) -> ca.SX:
        """Of the values by the variables, sparse, shape (m, k)."""
        return ca.jacobian(self.values, self.variables)

    @cached_property
    def multipliers(self) -> ca.SX:
        """Symbols of what weighs the values, shape (m, 1)."""
        return ca.SX.sym("multiplier", self.values.shape[0])

    @cached_property
    def hessian(self) -> ca.SX:
        """Second derivatives of the weighted sum of the values, upper triangle, sparse, shape (k, k)."""
        whole, _ = ca.hessian(ca.dot(self.multipliers, self.values), self.variables)
        return ca.triu(whole)


@dataclass(frozen=True, kw_only=True)
class RepeatedRows(RowBlock):
    """Rows that are sums of repeated values, and of what is linear in the variables.

    Attributes:
        repeated: the values.
        sums: what each row has of each value, those of a column in a row, sparse, shape (rows, m · e).
        linear: what is added, shape (rows, 1).
    """

    repeated: Repeated
    sums: ca.DM
    linear: ca.SX


def repeated_rows(
    block: Callable[[tuple[str, ...], ca.SX], RowBlock],
    names: tuple[str, ...],
    repeated: Repeated,
    sums: ca.DM | None = None,
    linear: ca.SX | None = None,
) -> RepeatedRows:
    """Rows of repeated values.

    Args:
        block: what is asked of them, ``equal_to_zero`` or ``not_negative``.
        names: of the rows.
        repeated: the values; all of one column before those of the next.
        sums: how they are summed to rows; every value is a row when None.
        linear: what is added, linear in the variables, shape (rows, 1).
    """
    values = ca.vec(repeated.values)
    if sums is None:
        sums = ca.DM.eye(values.numel())
    if linear is None:
        linear = ca.SX(len(names), 1)
    asked = block(names, ca.mtimes(sums, values) + linear)
    return RepeatedRows(names, asked.expression, asked.lower, asked.upper, repeated=repeated, sums=sums, linear=linear)


def selection(rows: int, columns: int, row: IntArray, column: IntArray) -> ca.DM:
    """A sparse matrix with ones at some places."""
    return ca.DM.triplet(row.tolist(), column.tolist(), ca.DM.ones(len(row)), rows, columns)


@dataclass(frozen=True, eq=False, kw_only=True)
class RowAnswer:
    """How a program was answered, whatever its variables mean.

    Attributes:
        costs: weighted parts of the objective by name; they sum to it.
        multipliers: of the rows that shape the pose, by name: how much the objective would fall for one unit of the
            row (one arm's length, one radian, one unit of the user's); the largest first.
        status: the solver's own word for how it stopped.
        iterations: of the solver.
        violation: largest violation of any row, in units of the arm's length.
        worst_row: name of that row.
        size: numbers of variables and rows.
        broken: rows that are violated by more than what counts as kept, by name, and by how much each; the worst first.
    """

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
        """The objective."""
        return float(sum(self.costs.values()))


@dataclass(frozen=True, eq=False)
class RowReading:
    """Reads an answer of IPOPT to a program.

    Attributes:
        program: that was solved.
        answer: by CasADi's names.
        statistics: by CasADi's names.
    """

    program: RowProgram
    answer: Mapping[str, Any]
    statistics: Mapping[str, Any]

    @property
    def variables(self) -> FloatArray:
        """Where IPOPT stopped, shape (variables,)."""
        return np.asarray(self.answer["x"], dtype=np.float64).ravel()

    @property
    def bound_multipliers(self) -> FloatArray:
        """Multipliers of the bounds of the variables, positive at an upper one, shape (variables,)."""
        return np.asarray(self.answer["lam_x"], dtype=np.float64).ravel()

    def says(
        self, costs: Mapping[str, float], bounded: Mapping[str, float], *, binding: float, feasible: float
    ) -> RowAnswer:
        """How the program was answered.

        Args:
            costs: weighted parts of the objective by name.
            bounded: multipliers of bounds that shape the pose as rows do, by name.
            binding: multipliers from which on a row is said to shape the pose.
            feasible: violation up to which a row counts as kept.
        """
        rows = np.asarray(self.answer["g"], dtype=np.float64).ravel()
        multipliers = np.asarray(self.answer["lam_g"], dtype=np.float64).ravel()
        lower, upper = self.program.bounds
        violation = np.nan_to_num(np.maximum(lower - rows, rows - upper), nan=np.inf)
        worst = int(np.argmax(violation))
        names = self.program.row_names
        return RowAnswer(
            costs=costs,
            multipliers=_shaping((*names, *bounded), np.append(multipliers, list(bounded.values())), binding),
            status=str(self.statistics["return_status"]),
            iterations=int(self.statistics["iter_count"]),
            violation=max(float(violation[worst]), 0.0),
            worst_row=names[worst],
            size=(len(self.variables), len(rows)),
            broken=_broken(names, violation, feasible),
        )


def _shaping(names: tuple[str, ...], multipliers: FloatArray, least: float) -> dict[str, float]:
    """Multipliers of the rows that shape the pose, the largest first; those of equations that tie variables aside."""
    order = np.argsort(-np.abs(multipliers), kind="stable")
    shaping = [int(row) for row in order if abs(multipliers[row]) > least and not _is_tie(names[row])]
    return {names[row]: float(abs(multipliers[row])) for row in shaping}


def _broken(names: tuple[str, ...], violation: FloatArray, allowed: float) -> dict[str, float]:
    """Rows that are violated by more than is allowed, the worst first."""
    order = np.argsort(-violation, kind="stable")
    return {names[row]: float(violation[row]) for row in order if violation[row] > allowed}


def _is_tie(name: str) -> bool:
    """Whether a row only ties variables together and asks nothing of the pose."""
    if name.startswith("user: "):  # whatever its user calls it
        return False
    return any(tie in name for tie in ("mapping", "gap in", "spline at", "of its end"))
