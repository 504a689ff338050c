"""Quadratic programs over the stages of a motion, in which neighbouring stages are coupled, solved in C.

    minimise  ½ Σ x_k·H_kl x_l + Σ g_k·x_k + Σ c_j s_j
    so that   E x = 0,  A x − s ≤ b,  s ≥ 0,

where stages k, l are at most two apart, every row of E and A has entries in one stage and the one before it, and the
rows of a part j share its slack s_j. Few of the rows decide the solution, and it is found by a dual active-set method:
its time hardly depends on the number of rows, and that of a factorisation is linear in the number of stages. It begins
with the rows that decided a similar program, if these are given.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.native import NativeCall

_TOLERANCE = 1e-5
"""Violation of a row that counts as none. Heuristic."""
_CHANGES = 400
"""Maximum number of changes of the set of active rows, for each stage. Measured: up to 150 in a motion out of one hole
into another with 12 links."""
NO_PART = -1
"""Part of a row without slack."""


@dataclass(frozen=True)
class StageRows:
    """Rows a·x − s ≤ b, or equations a·x = 0, over the stages of a program with w unknowns a stage.

    Attributes:
        stage: index k of the stage of each row, shape (m,).
        before: coefficients of the unknowns of stage k − 1, without effect if k = 0, shape (m, w).
        own: coefficients of the unknowns of stage k, shape (m, w).
        bound: upper bound b, shape (m,).
        part: index of the part whose slack the row has, ``NO_PART`` for none, shape (m,).
    """

    stage: IntArray
    before: FloatArray
    own: FloatArray
    bound: FloatArray
    part: IntArray

    def __len__(self) -> int:
        return len(self.stage)

    def times(self, x: FloatArray) -> FloatArray:
        """Return a·x of every row, shape (m,), for unknowns of shape (K, w)."""
        before = np.where((self.stage > 0)[:, None], x[self.stage - 1], 0.0)
        return np.asarray(np.einsum("mw,mw->m", self.own, x[self.stage]) + np.einsum("mw,mw->m", self.before, before))

    def at(self, row: int, stages: int) -> FloatArray:
        """Return the coefficients of one row over all unknowns, shape (K, w)."""
        whole = np.zeros((stages, self.own.shape[1]))
        whole[self.stage[row]] = self.own[row]
        if self.stage[row] > 0:
            whole[self.stage[row] - 1] = self.before[row]
        return whole


def joined_stage_rows(rows: Sequence[StageRows]) -> StageRows:
    """Return several sets of rows as one set."""
    names = ("stage", "before", "own", "bound", "part")
    return StageRows(*(np.concatenate([getattr(each, name) for each in rows]) for name in names))


@dataclass(frozen=True)
class StageSolution:
    """Solution of a program of K stages with w unknowns each.

    Attributes:
        x: the unknowns, shape (K, w).
        slack: slack of every part, at least 0, shape (parts,).
        pulls: multipliers of the equations, shape (e,).
        multipliers: multipliers of the rows, at least 0, shape (m,).
    """

    x: FloatArray
    slack: FloatArray
    pulls: FloatArray
    multipliers: FloatArray


def solve_stages(
    blocks: FloatArray,
    gradient: FloatArray,
    equations: StageRows,
    rows: StageRows,
    prices: FloatArray,
    likely: IntArray | None = None,
) -> StageSolution | None:
    """Return the solution of a program, or None if it has none or the numbers are too bad.

    Args:
        blocks: blocks H_k,k−d of the Hessian, which is positive definite, by d = 0, 1, 2, shape (3, K, w, w).
        gradient: gradient g, shape (K, w).
        equations: the equations.
        rows: the other rows.
        prices: prices c of slack, above 0, shape (parts,).
        likely: 1 for rows that are likely to be active, as in a similar program, 2 if their part is likely to have
            slack, else 0, shape (m,); the solution is the same for any, but found sooner if they are right. None for
            none.
    """
    stages, width = gradient.shape
    every = joined_stage_rows((equations, rows))
    x, slack, multipliers = np.zeros((stages, width)), np.zeros(len(prices)), np.zeros(len(every))
    guess = np.zeros(len(every), dtype=np.uint8)
    if likely is not None:
        guess[len(equations) :] = likely
    call = NativeCall(
        "staged_program",
        stages=stages, width=width, equations=len(equations), rows=len(every), parts=len(prices),
        most=_CHANGES * stages, tolerance=_TOLERANCE, blocks=blocks, gradient=gradient,
        coefficients=np.concatenate((every.before, every.own), axis=1), stage=every.stage, part=every.part,
        bound=every.bound, price=prices, likely=guess, x=x, slack=slack, multipliers=multipliers,
    )  # fmt: skip
    call()
    if not call.fields.solved or not np.isfinite(x).all():
        return None if not guess.any() else solve_stages(blocks, gradient, equations, rows, prices)
    first = len(equations)
    return StageSolution(x, np.maximum(slack, 0.0), multipliers[:first], np.maximum(multipliers[first:], 0.0))
