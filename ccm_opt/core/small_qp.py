"""Small dense quadratic programs, by DAQP: min ½ δᵀHδ + gᵀδ with bounds on rows."""

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
    """Return the best δ, shape (p,); None where there is none, or the solver jams, runs out of iterations, or raises.

    Args:
        hessian: positive definite, shape (p, p).
        gradient: shape (p,).
        matrix: rows, shape (m, p), contiguous; none where the bounds are those of δ itself.
        upper: shape (m,), or (p,).
        lower: likewise.
        sense: what each row is, in DAQP's numbers; it writes there.
        most_iterations: DAQP's own number when None.
    """
    limits = {} if most_iterations is None else {"iter_limit": most_iterations}
    try:
        delta, _, flag, _ = daqp.solve(hessian, gradient, matrix, upper, lower, sense, **limits)
    except RuntimeError:
        return None
    return np.asarray(delta) if flag > 0 else None
