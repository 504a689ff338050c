"""The fewest sets that together cover a share of what there is, by an integer program.

Variables are the sets, taken or not, and the elements, covered or not; an element counts only if a set that has it is
taken. Elements that are in the same sets are one element.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray

_ROUNDING = 1e-9
"""Share that may be lacking through rounding."""
_PREFERENCE = 0.5
"""Cost of taking only sets that are not preferred, in sets. Derived: below 1, so that the number comes first."""


@dataclass(frozen=True, eq=False)
class Cover:
    """Sets that cover enough.

    Attributes:
        sets: indices of the sets, shape (k,).
        fewest: lower bound on the number of sets that do.
    """

    sets: IntArray
    fewest: int


def greedy_order(covers: BoolArray, weights: FloatArray) -> IntArray:
    """Return sets in the order in which each covers the most of what those before it leave, shape (k,).

    Args:
        covers: whether each of n sets has each of m elements, shape (n, m).
        weights: weights of the elements, shape (m,).
    """
    left = weights.copy()
    order: list[int] = []
    while True:
        gains = covers @ left
        best = int(np.argmax(gains)) if len(gains) else 0
        if len(gains) == 0 or gains[best] <= 0.0:
            return np.array(order, dtype=np.intp)
        order.append(best)
        left[covers[best]] = 0.0


def fewest_sets(
    covers: BoolArray, weights: FloatArray, least: float, preference: FloatArray, time_limit: float
) -> Cover:
    """Return the fewest sets whose elements weigh enough, or the best found within the time limit.

    Args:
        covers: whether each of n sets has each of m elements, shape (n, m).
        weights: weights of the elements, shape (m,); those that are in a set weigh ``least`` together at least.
        least: weight that has to be covered.
        preference: from 0 to 1, how much a set is preferred to others if the number of sets is the same, shape (n,).
        time_limit: time limit [s].
    """
    from scipy.optimize import Bounds, LinearConstraint, milp  # noqa: PLC0415 - few problems have sets to choose
    from scipy.sparse import csr_matrix, hstack, identity  # noqa: PLC0415 - likewise

    n = len(covers)
    kept = np.flatnonzero(np.any(covers, axis=0))
    columns, number = np.unique(np.packbits(covers[:, kept], axis=0), axis=1, return_inverse=True)
    alike = np.unpackbits(columns, axis=0, count=n).astype(np.float64)
    of_alike = np.bincount(number.ravel(), weights[kept], minlength=columns.shape[1])
    m = len(of_alike)
    needed = least - _ROUNDING * float(np.sum(weights))
    taken: Any = hstack((csr_matrix(alike.T), -identity(m)), format="csr")
    weighed: Any = csr_matrix(np.concatenate((np.zeros(n), of_alike))[None])
    order = greedy_order(covers, weights)
    enough = _enough(covers, weights, order, needed)
    costs = 1.0 + (1.0 - preference) * _PREFERENCE / len(enough)
    found = milp(
        np.concatenate((costs, np.zeros(m))),
        integrality=np.concatenate((np.ones(n), np.zeros(m))),
        bounds=Bounds(0.0, 1.0),
        constraints=[LinearConstraint(taken, 0.0, np.inf), LinearConstraint(weighed, needed, np.inf)],
        options={"time_limit": time_limit},
    )
    sets = enough if found.x is None else np.flatnonzero(found.x[:n] > 0.5)
    sets = enough if len(enough) < len(sets) else sets
    bound = found.mip_dual_bound if found.mip_dual_bound is not None and np.isfinite(found.mip_dual_bound) else 1.0
    return Cover(sets, min(max(int(np.ceil(bound - _PREFERENCE - 1e-6)), 1), len(sets)))


def _enough(covers: BoolArray, weights: FloatArray, order: IntArray, needed: float) -> IntArray:
    """Return as few of the first sets of an order as weigh enough."""
    covered = np.cumsum(covers[order], axis=0) > 0
    weighs = covered @ weights
    return order[: int(np.searchsorted(weighs, needed)) + 1]
