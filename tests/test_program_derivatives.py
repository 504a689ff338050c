"""Derivatives of programs of named rows: those of templates are those of the whole program, written out."""

from functools import partial

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.built_solver import ProgramDerivatives
from ccm_opt.ik.curve_program import equal_to_zero
from ccm_opt.ik.pose_program import PoseProgram, PoseSize, pose_program
from ccm_opt.ik.row_program import Repeated, RepeatedRows, RowProgram, Symbols, repeated_rows

SEEDS = st.integers(0, 2**32 - 1)


def numbers(matrix: ca.DM) -> FloatArray:
    """A sparse matrix with its zeros."""
    return np.asarray(ca.densify(matrix))


def written_out(built: PoseProgram) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Gradient, Jacobian and Hessian as CasADi takes them of the program as a whole."""
    symbols = [built.variables, built.parameters.column]
    weight = ca.SX.sym("weight")
    multipliers = ca.SX.sym("multiplier", built.constraints.numel())
    whole, _ = ca.hessian(weight * built.objective + ca.dot(multipliers, built.constraints), built.variables)
    return (
        ca.Function("gradient", symbols, [built.objective, ca.gradient(built.objective, built.variables)]),
        ca.Function("jacobian", symbols, [built.constraints, ca.jacobian(built.constraints, built.variables)]),
        ca.Function("hessian", [*symbols, weight, multipliers], [ca.triu(whole)]),
    )


@pytest.mark.planning
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("links", "segments", "loaded"), [(2, 1, False), (7, 2, True), (13, 3, False)])
def test_derivatives_of_templates_are_those_of_the_program(
    dimension: int, links: int, segments: int, loaded: bool
) -> None:
    """At random values, to rounding, and with no more places than are needed."""
    built = pose_program(PoseSize(dimension, links, 3, segments, loaded))
    functions = ProgramDerivatives(built).functions
    assert any(isinstance(block, RepeatedRows) for block in built.rows)
    expected = written_out(built)
    found = (functions["grad_f"], functions["jac_g"], functions["hess_lag"])
    random = np.random.default_rng(links)
    for _ in range(5):
        x = random.normal(size=built.variables.numel())
        # Knots lie in their order.
        x[built.unknowns.places["arcs"]] = np.sort(random.uniform(size=built.frames.parts[0].count + 1))
        p = random.normal(size=built.parameters.column.numel())
        multipliers = random.normal(size=built.constraints.numel())
        for one, other in zip(found, expected, strict=True):
            further = (random.normal(), multipliers) if one.n_in() == 4 else ()
            for value, wanted in zip(one.call([x, p, *further]), other.call([x, p, *further]), strict=True):
                scale = float(ca.norm_inf(ca.vec(ca.densify(wanted))))
                np.testing.assert_allclose(numbers(value), numbers(wanted), atol=1e-12 * scale)
                assert value.nnz() <= wanted.nnz()


def _squares(twice: float, one: ca.SX, other: ca.SX, shares: ca.SX) -> ca.SX:
    """Two values of a column."""
    return ca.vertcat(twice * one * other * shares, one**2 - ca.sin(other))


@given(SEEDS, st.integers(1, 5), st.integers(1, 4))
@settings(max_examples=20, deadline=None)
def test_sums_of_repeated_values_of_variables_that_meet(seed: int, count: int, rows: int) -> None:
    """Columns may share variables, have the same one twice, or zeros; rows may sum values of several columns."""
    random = np.random.default_rng(seed)
    variables = ca.SX.sym("x", 4)
    parameters = ca.SX.sym("p", 2)
    choices = ca.vertcat(variables, ca.SX.zeros(1))
    one, other = (choices[random.integers(0, 5, count).tolist()].T for _ in range(2))
    shares = parameters[random.integers(0, 2, count).tolist()].T
    sums = ca.sparsify(ca.DM(np.round(random.normal(0.0, 1.0, (rows, 2 * count)))))
    linear = ca.DM(random.normal(size=(rows, 4))) @ variables
    repeated = Repeated(partial(_squares, 2.0), (one, other), (shares,))
    names = tuple(f"row {row}" for row in range(rows))
    block = repeated_rows(equal_to_zero, names, repeated, sums, linear)
    other_row = equal_to_zero(("other",), variables[0] * variables[3])
    cost = ca.sumsqr(variables) * variables[1]
    stub = RowProgram(
        unknowns=Symbols({"x": variables}),
        parameters=Symbols({"p": parameters}),
        rows=(block, other_row),
        parts={"cost": cost},
        objective=cost,
    )
    functions = ProgramDerivatives(stub).functions
    x, p, multipliers = random.normal(size=4), random.normal(size=2), random.normal(size=rows + 1)
    jacobian = ca.Function("jacobian", [variables, parameters], [ca.jacobian(stub.constraints, variables)])
    np.testing.assert_allclose(numbers(functions["jac_g"](x, p)[1]), numbers(jacobian(x, p)), atol=1e-12)
    lagrangian = stub.objective * 0.7 + ca.dot(ca.DM(multipliers), stub.constraints)
    hessian = ca.Function("hessian", [variables, parameters], [ca.triu(ca.hessian(lagrangian, variables)[0])])
    found = functions["hess_lag"](x, p, 0.7, multipliers)
    np.testing.assert_allclose(numbers(found), numbers(hessian(x, p)), atol=1e-12)
