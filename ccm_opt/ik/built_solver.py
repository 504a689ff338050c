"""IPOPT on a CasADi program with derivatives made once.

Blocks of repeated rows bring the derivatives of their template, evaluated for all links, joints or pieces at once; what
is left of rows, and the objective, is differentiated as a whole.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.ik.row_program import RepeatedRows, RowProgram


@dataclass(frozen=True, eq=False)
class ProgramDerivatives:
    """The functions that IPOPT asks for, by CasADi's names of its options.

    Attributes:
        program: symbols and rows.
    """

    program: RowProgram

    @property
    def functions(self) -> dict[str, ca.Function]:
        """Gradient of the objective, Jacobian of the rows and upper triangle of the Lagrangian's Hessian."""
        return {"grad_f": self._gradient(), "jac_g": self._jacobian(), "hess_lag": self._hessian()}

    @cached_property
    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        """Variables and parameters of the program."""
        return self.program.variables, self.program.parameters.column

    @cached_property
    def _blocks(self) -> tuple["_RepeatedBlock", ...]:
        """The repeated rows, each block with where it stands."""
        variables, parameters = self._symbols
        first = 0
        blocks = []
        for block in self.program.rows:
            if isinstance(block, RepeatedRows):
                blocks.append(_RepeatedBlock(block, first, variables, parameters))
            first += len(block.names)
        return tuple(blocks)

    @cached_property
    def _other_rows(self) -> tuple[IntArray, ca.SX]:
        """All other rows: their places and expressions."""
        first = 0
        places = [np.zeros(0, dtype=np.intp)]
        expressions = [ca.SX(0, 1)]
        for block in self.program.rows:
            if not isinstance(block, RepeatedRows):
                places.append(first + np.arange(len(block.names)))
                expressions.append(block.expression)
            first += len(block.names)
        return np.concatenate(places), ca.vertcat(*expressions)

    def _gradient(self) -> ca.Function:
        variables, parameters = self._symbols
        objective = self.program.objective
        gradient = ca.gradient(objective, variables)
        return ca.Function("nlp_grad_f", [variables, parameters], [objective, gradient])

    def _jacobian(self) -> ca.Function:
        variables, parameters = self._symbols
        rows = ca.Function("rows", [variables, parameters], [self.program.constraints])
        places, others = self._other_rows
        of_others = ca.jacobian(others, variables)
        values = ca.Function("slopes", [variables, parameters], [_nonzeros(of_others)])
        x, p = _columns(self._symbols)
        entries = _Entries()
        row, column = _triplets(of_others)
        entries.add(places[row], column, values(x, p))
        for block in self._blocks:
            block.add_slopes(entries, x, p)
        shape = (self.program.constraints.numel(), variables.numel())
        return ca.Function("nlp_jac_g", [x, p], [rows(x, p), entries.matrix(shape)])

    def _hessian(self) -> ca.Function:
        variables, parameters = self._symbols
        places, others = self._other_rows
        weight = ca.SX.sym("weight")
        multipliers = ca.SX.sym("multiplier", others.numel())
        whole, _ = ca.hessian(weight * self.program.objective + ca.dot(multipliers, others), variables)
        of_others = ca.triu(whole)
        arguments = [variables, parameters, weight, multipliers]
        values = ca.Function("curvatures", arguments, [_nonzeros(of_others)])
        x, p = _columns(self._symbols)
        lam_f = ca.MX.sym("lam_f")
        lam_g = ca.MX.sym("lam_g", self.program.constraints.numel())
        entries = _Entries()
        entries.add(*_triplets(of_others), values(x, p, lam_f, lam_g[places.tolist()]))
        for block in self._blocks:
            block.add_curvatures(entries, x, p, lam_g)
        matrix = entries.matrix((variables.numel(), variables.numel()))
        return ca.Function("nlp_hess_l", [x, p, lam_f, lam_g], [matrix])


@dataclass(frozen=True, eq=False)
class _RepeatedBlock:
    """Repeated rows among those of a program.

    Attributes:
        rows: the block.
        first: where it begins.
        variables: of the program, shape (nx, 1).
        parameters: likewise.
    """

    rows: RepeatedRows
    first: int
    variables: ca.SX
    parameters: ca.SX

    def add_slopes(self, entries: "_Entries", x: ca.MX, p: ca.MX) -> None:
        """The block's part of the Jacobian."""
        linear = ca.jacobian(self.rows.linear, self.variables)
        row, column = _triplets(linear)
        entries.add(self.first + row, column, ca.MX(ca.DM(linear).nonzeros()))
        template = self.rows.repeated.template
        function = ca.Function("slopes", [template.variables, template.given], [_nonzeros(template.jacobian)])
        slopes = ca.vec(function.map(self.rows.repeated.count)(*self._columns.call([x, p])))
        # A value is in several rows where these are sums.
        row, summed = _triplets(self.rows.sums)
        factors = np.array(self.rows.sums.nonzeros())
        repetition, value = np.divmod(summed, template.values.numel())
        of_value, argument = _triplets(template.jacobian)
        entry, place = np.nonzero(of_value[:, None] == value)
        repetition = repetition[place]
        column = self._places[argument[entry], repetition]
        source = entry + template.jacobian.nnz() * repetition
        entries.add(self.first + row[place], column, slopes, source, factors[place])

    def add_curvatures(self, entries: "_Entries", x: ca.MX, p: ca.MX, lam_g: ca.MX) -> None:
        """The block's part of the Hessian's upper triangle."""
        template = self.rows.repeated.template
        if not template.hessian.nnz():
            return
        arguments = [template.variables, template.given, template.multipliers]
        function = ca.Function("curvatures", arguments, [_nonzeros(template.hessian)])
        of_rows = lam_g[self.first : self.first + len(self.rows.names)]
        multipliers = ca.reshape(ca.mtimes(self.rows.sums.T, of_rows), template.values.numel(), -1)
        curvatures = function.map(self.rows.repeated.count)(*self._columns.call([x, p]), multipliers)
        first, second = _triplets(template.hessian)
        one, other = self._places[first], self._places[second]
        # Off its diagonal an entry of the template stands for two, which meet where both arguments are one variable.
        factors = np.where((one == other) & (first != second)[:, None], 2.0, 1.0)
        row, column = np.minimum(one, other), np.maximum(one, other)
        source = np.arange(row.size)
        entries.add(row.ravel("F"), column.ravel("F"), ca.vec(curvatures), source, factors.ravel("F"))

    @cached_property
    def _places(self) -> IntArray:
        """Places of the arguments among the variables, shape (k, e); -1 of what is zero."""
        numbers = ca.Function("places", [self.variables], [ca.vertcat(*self.rows.repeated.variables)])
        return np.asarray(numbers(ca.DM(range(1, self.variables.numel() + 1)))).astype(np.intp) - 1

    @cached_property
    def _columns(self) -> ca.Function:
        """(x, p) to the template's variables and what is given, shapes (k, e) and (p, e)."""
        repeated = self.rows.repeated
        given = ca.vertcat(ca.SX(0, repeated.count), *repeated.given)
        columns = [ca.densify(ca.vertcat(*repeated.variables)), ca.densify(given)]
        return ca.Function("columns", [self.variables, self.parameters], columns)


@dataclass(frozen=True)
class _Some:
    """Some entries of a sparse matrix.

    Attributes:
        rows: of each, shape (k,); negative where there is none.
        columns: likewise.
        values: a column of values, each perhaps of several entries, or of none.
        sources: which of these each entry is, shape (k,).
        factors: by which it is multiplied, shape (k,).
    """

    rows: IntArray
    columns: IntArray
    values: ca.MX
    sources: IntArray
    factors: FloatArray


class _Entries:
    """Entries of a sparse matrix; those at the same place are summed."""

    def __init__(self) -> None:
        self._some: list[_Some] = []

    def add(
        self,
        rows: IntArray,
        columns: IntArray,
        values: ca.MX,
        sources: IntArray | None = None,
        factors: FloatArray | None = None,
    ) -> None:
        """Add some, see ``_Some``; of each value one, as it is, when there are neither sources nor factors."""
        sources = np.arange(len(rows)) if sources is None else sources
        factors = np.ones(len(rows)) if factors is None else factors
        self._some.append(_Some(rows, columns, values, sources, factors))

    def matrix(self, shape: tuple[int, int]) -> ca.MX:
        """The sparse matrix of a shape."""
        starts = np.cumsum([0, *(some.values.numel() for some in self._some)])
        row = np.concatenate([some.rows for some in self._some])
        column = np.concatenate([some.columns for some in self._some])
        source = np.concatenate([start + some.sources for start, some in zip(starts, self._some, strict=False)])
        factor = np.concatenate([some.factors for some in self._some])
        there = (row >= 0) & (column >= 0)
        # CasADi has its nonzeros column by column.
        number, place = np.unique(column[there] * shape[0] + row[there], return_inverse=True)
        sparsity = ca.Sparsity.triplet(*shape, (number % shape[0]).tolist(), (number // shape[0]).tolist())
        sums = ca.DM.triplet(place.tolist(), source[there].tolist(), ca.DM(factor[there]), len(number), int(starts[-1]))
        return ca.MX(sparsity, ca.mtimes(sums, ca.vertcat(*(some.values for some in self._some))))


def _nonzeros(matrix: ca.SX) -> ca.SX:
    """The nonzeros of a matrix in one column."""
    return ca.vec(matrix.nz[:])  # of a row they are a row


def _triplets(matrix: ca.SX | ca.DM) -> tuple[IntArray, IntArray]:
    """Rows and columns of the nonzeros of a matrix, in their order."""
    row, column = matrix.sparsity().get_triplet()
    return np.array(row, dtype=np.intp), np.array(column, dtype=np.intp)


def _columns(symbols: tuple[ca.SX, ca.SX]) -> tuple[ca.MX, ca.MX]:
    """Symbols of the same sizes for functions that call others."""
    variables, parameters = symbols
    return ca.MX.sym("x", variables.numel()), ca.MX.sym("p", parameters.numel())


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


IPOPT_SWITCHES: MappingProxyType[str, Any] = MappingProxyType(
    {
        "print_time": False,
        "error_on_fail": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.acceptable_iter": 0,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.nlp_scaling_method": "none",
        # The matrices are small and well scaled by themselves: a fifth of the time goes, the iterates stay.
        "ipopt.fast_step_computation": "yes",
        "ipopt.min_refinement_steps": 0,
        "ipopt.mumps_permuting_scaling": 0,
        "ipopt.mumps_pivot_order": 0,
        "ipopt.mumps_scaling": 0,
    }
)
"""Silent, without an acceptable level of its own, and without scaling."""
