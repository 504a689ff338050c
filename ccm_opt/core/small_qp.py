"""Small dense quadratic programs, solved by DAQP: min ½ δᵀHδ + gᵀδ subject to bounds on rows."""

import daqp
import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray


def solve_small_qp(
    hessian: FloatArray,
    gradient: FloatArray,
    matrix: FloatArray,
    upper: FloatArray,
    lower: FloatArray,
    sense: npt.NDArray[np.intc],
    most_iterations: int | None = None,
) -> FloatArray | None:
    """Return the minimiser δ, shape (p,), or None when the problem is infeasible or the solver fails.

    Failures are cycling, running out of iterations, and a raised error.

    Args:
        hessian: H, positive definite, shape (p, p).
        gradient: g, shape (p,).
        matrix: constraint rows, shape (m, p), contiguous; no rows where the bounds are on δ itself.
        upper: upper bounds of the rows, shape (m,), or of δ, shape (p,).
        lower: lower bounds, of the same shape as ``upper``.
        sense: kind of each row, in DAQP's codes; DAQP writes into this array.
        most_iterations: maximum number of iterations; None for DAQP's default.
    """
    limits = {} if most_iterations is None else {"iter_limit": most_iterations}
    try:
        delta, _, flag, _ = daqp.solve(hessian, gradient, matrix, upper, lower, sense, **limits)
    except RuntimeError:
        return None
    return np.asarray(delta) if flag > 0 else None
