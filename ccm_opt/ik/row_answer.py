"""What IPOPT made of a program of named rows: its costs, the rows that shape the answer, and those that are broken."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.row_program import RowProgram


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

    def says(self, costs: Mapping[str, float], *, binding: float, feasible: float) -> RowAnswer:
        """How the program was answered.

        Args:
            costs: weighted parts of the objective by name.
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
            multipliers=_shaping(names, multipliers, binding),
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
