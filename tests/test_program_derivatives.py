"""Derivatives of programs of named rows: those of their blocks are those of the whole program."""

import casadi as ca
import numpy as np
import pytest

from ccm_opt.ik.pose_program import PoseSize, pose_program
from ccm_opt.ik.row_program import block_derivatives

SIZES = ((2, 1, False), (7, 2, True), (13, 3, False))
"""Links, segments, and whether torque is limited."""
COUPLING = ((0.0, 0.0), (0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.0), (0.0, 0.5))
"""Of the bends of three joints to two drives."""


@pytest.mark.drawn(3)
@pytest.mark.planning
@pytest.mark.parametrize(
    "size",
    [
        *(PoseSize(d, links, 3, k, loaded) for d in (2, 3) for links, k, loaded in SIZES),
        PoseSize(3, 3, 3, 1, loaded=True, coupling=COUPLING),
        PoseSize(3, 3, 3, 1, loaded=True, coupling=COUPLING, travels=((0.5, 0.3),), arcs=(0.0, 0.25, 0.25, 0.0)),
    ],
)
def test_derivatives_of_blocks_are_those_of_the_program(size: PoseSize) -> None:
    """At random values, to rounding, and with no more places than are needed."""
    built = pose_program(size)
    symbols = [built.variables, built.parameters.column]
    weight = ca.SX.sym("weight")
    multipliers = ca.SX.sym("multiplier", built.constraints.numel())
    whole, _ = ca.hessian(weight * built.objective + ca.dot(multipliers, built.constraints), built.variables)
    jacobian = ca.Function("jacobian", symbols, [built.constraints, ca.jacobian(built.constraints, built.variables)])
    hessian = ca.Function("hessian", [*symbols, weight, multipliers], [ca.triu(whole)])
    functions = block_derivatives(built)
    random = np.random.default_rng(size.links)
    for _ in range(5):
        x = random.normal(size=built.variables.numel())
        knots = built.unknowns.places.get("arcs", slice(0))
        x[knots] = np.sort(random.uniform(size=len(x[knots])))  # they lie in their order
        p = random.normal(size=built.parameters.column.numel())
        further = (random.normal(), random.normal(size=built.constraints.numel()))
        for found, wanted in (
            *zip(functions["jac_g"](x, p), jacobian(x, p), strict=True),
            (functions["hess_lag"](x, p, *further), hessian(x, p, *further)),
        ):
            scale = float(ca.norm_inf(ca.vec(ca.densify(wanted))))
            np.testing.assert_allclose(ca.densify(found), ca.densify(wanted), atol=1e-12 * scale)
            assert found.nnz() <= wanted.nnz()
