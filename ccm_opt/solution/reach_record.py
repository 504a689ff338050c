"""Where the tip can be and where it can point there: a map over a grid of the room."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.problem import Problem


@dataclass(frozen=True, eq=False)
class ReachMap:
    """For each cell of a grid whether a pose was found with the tip in its middle, and with which headings.

    Attributes:
        problem: arm and room.
        step: width of a cell [m].
        x: middles of the columns, shape (nx,) [m].
        y: middles of the rows, shape (ny,) [m].
        headings: of the last link that were tried, increasing, shape (K,) [rad].
        reachable: whether a pose was found, with any heading, shape (ny, nx).
        taken: whether one was found with each heading, shape (ny, nx, K).
        gap: largest room beyond radius and clearance of any pose found in the cell, as far as it was looked at, shape
            (ny, nx) [m]; NaN where there is none.
        proved: whether it is proved that no pose exists, shape (ny, nx); elsewhere nothing is known where none was
            found.
        seen: room above which gaps are not told apart [m].
        timings: CPU time by stage, of this process and of the workers [s].
    """

    problem: Problem
    step: float
    x: FloatArray
    y: FloatArray
    headings: FloatArray
    reachable: BoolArray
    taken: BoolArray
    gap: FloatArray
    proved: BoolArray
    seen: float
    timings: Mapping[str, float]

    @cached_property
    def heading_ranges(self) -> FloatArray:
        """Runs of neighbouring headings that were taken, shape (R, 4).

        Each has the number of the row, that of the column, and the first and last heading [rad]. A run over 360° ends
        beyond it, and one all round has a whole turn.
        """
        ranges = [
            (float(row), float(column), first, last)
            for row, column in np.argwhere(self.taken.any(axis=2))
            for first, last in _runs(self.headings, self.taken[row, column])
        ]
        return np.array(ranges).reshape(-1, 4)

    @property
    def area(self) -> float:
        """Of the cells in which a pose was found [m²]."""
        return float(self.reachable.sum()) * self.step**2


def _runs(headings: FloatArray, taken: BoolArray) -> list[tuple[float, float]]:
    """First and last heading of every run, round the whole turn."""
    count = len(taken)
    turn = 2.0 * np.pi
    if taken.all():
        return [(float(headings[0]), float(headings[0]) + turn)]
    starts = [k for k in range(count) if taken[k] and not taken[k - 1]]
    runs = []
    for start in starts:
        length = 0
        while taken[(start + length) % count]:
            length += 1
        last = start + length - 1
        runs.append((float(headings[start]), float(headings[last % count]) + turn * (last // count)))
    return runs
