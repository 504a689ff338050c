"""Small dense quadratic programs, min ½ δᵀHδ + gᵀδ subject to lower ≤ A δ ≤ upper, solved by DAQP."""

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
    """Return the minimiser of ½ δᵀHδ + gᵀδ with lower ≤ A δ ≤ upper, shape (p,); None if there is none.

    The result is also None if the solver fails: by cycling, too many iterations, or an exception.

    Args:
        hessian: H, positive definite, shape (p, p).
        gradient: g, shape (p,).
        matrix: A, shape (m, p), contiguous. If m = 0, the bounds are on δ itself.
        upper: upper bounds of A δ, shape (m,), or of δ, shape (p,).
        lower: lower bounds, of the shape of ``upper``.
        sense: kind of each constraint (inequality, equality, ...), in the codes of DAQP; DAQP writes into this array.
        most_iterations: maximum number of iterations; None for the default of DAQP.
    """
    limits = {} if most_iterations is None else {"iter_limit": most_iterations}
    try:
        delta, _, flag, _ = daqp.solve(hessian, gradient, matrix, upper, lower, sense, **limits)
    except RuntimeError:
        return None
    return np.asarray(delta) if flag > 0 else None
