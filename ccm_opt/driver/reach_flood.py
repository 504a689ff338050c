"""The order in which a reach map asks its cells."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.executors import LocalWorkers, ThisProcess, Workers, completed
from ccm_opt.planning.tip_reach import FREE, CellPoses, CellTask, ReachSettings

_SEEKS = 24
"""Cells without a pose at most for which poses are sought anew, one after the other, when nothing more is reached from
the cells beside. Taste: a quarter of a second each."""
_SEEK_SPACING = 3
"""Of these cells, in cells. Taste."""

Cell = tuple[int, int]
BESIDE = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Rows and columns from a cell to those beside it."""


@dataclass(eq=False)
class ReachFlood:
    """The state of a map while it is made: an iterator of tasks that ends when there is none at the moment.

    Attributes:
        x: middles of the columns, shape (nx,) [m].
        y: middles of the rows, shape (ny,) [m].
        count: of the headings.
        closed: cells in which no pose can be.
        settings: numbers.
    """

    x: FloatArray
    y: FloatArray
    count: int
    closed: frozenset[Cell]
    settings: ReachSettings
    poses: dict[Cell, dict[int, FloatArray]] = field(default_factory=dict)
    gaps: dict[Cell, float] = field(default_factory=dict)
    cpu: float = 0.0
    _tried: dict[tuple[Cell, int], set[Cell]] = field(default_factory=dict)
    _given: deque[CellTask] = field(default_factory=deque)
    _waiting: deque[Cell] = field(default_factory=deque)
    _running: set[Cell] = field(default_factory=set)
    _seeks: int = 0
    _sought: set[Cell] = field(default_factory=set)

    def begin(self, cell: Cell, pose: FloatArray) -> None:
        """Begin with a pose whose tip is in or near a cell."""
        self._given.append(CellTask(cell, self._place(cell), {FREE: pose}, self._all()))

    def add(self, task: CellTask, result: CellPoses) -> None:
        """Take a result in; cells beside it may have something to do now."""
        self._running.discard(task.cell)
        self.cpu += result.cpu
        known = self.poses.setdefault(task.cell, {}) if result.poses else self.poses.get(task.cell, {})
        fresh = [number for number in result.poses if number not in known]
        for number in fresh:
            known[number] = result.poses[number]
        if result.poses:
            self.gaps[task.cell] = max(result.gap, self.gaps.get(task.cell, -np.inf))
        if fresh:
            self._waiting.extend(self._beside(task.cell))
        # What came while this cell was looked at is seen to now.
        self._waiting.append(task.cell)

    def __iter__(self) -> Iterator[CellTask]:
        """Itself."""
        return self

    def __next__(self) -> CellTask:
        """The next task; it may end and go on again when results have come."""
        if self._given:
            self._running.add(self._given[0].cell)
            return self._given.popleft()
        for _ in range(len(self._waiting)):
            cell = self._waiting.popleft()
            if cell in self._running:
                continue  # it comes back with its result
            task = self._task(cell)
            if task is not None:
                self._running.add(cell)
                return task
        # Where poses do not spread to, one may still be: in another class, beyond a narrow place.
        if not self._running:
            return self._seek()
        raise StopIteration

    def _task(self, cell: Cell) -> CellTask | None:
        """What can be tried in a cell from those beside it; None when there is nothing."""
        known = self.poses.get(cell, {})
        seeds: dict[int, FloatArray] = {}
        for other in self._beside(cell):
            for number, pose in self.poses.get(other, {}).items():
                if number in known or number in seeds:
                    continue
                tried = self._tried.setdefault((cell, number), set())
                # A cell without any pose is worth a try from every side.
                most = len(BESIDE) if number == FREE and not known else self.settings.attempts
                if other not in tried and len(tried) < most:
                    tried.add(other)
                    seeds[number] = pose
        return CellTask(cell, self._place(cell), seeds, self._all() - known.keys()) if seeds else None

    def _seek(self) -> CellTask:
        """A task for a cell that is still empty, from nothing.

        Raises:
            StopIteration: enough was sought.
        """
        for row in range(len(self.y)):
            for column in range(len(self.x)):
                cell = (row, column)
                empty = cell not in self.poses and cell not in self.closed and cell not in self._sought
                if empty and self._seeks < _SEEKS and self._apart(cell):
                    self._sought.add(cell)
                    self._seeks += 1
                    self._running.add(cell)
                    return CellTask(cell, self._place(cell), {}, self._all(), sought=True)
        raise StopIteration

    def _apart(self, cell: Cell) -> bool:
        """Whether a cell is far enough from those that were sought in."""
        spacing = _SEEK_SPACING
        return all(max(abs(cell[0] - row), abs(cell[1] - column)) >= spacing for row, column in self._sought)

    def _beside(self, cell: Cell) -> list[Cell]:
        beside = [(cell[0] + down, cell[1] + across) for down, across in BESIDE]
        return [
            (row, column)
            for row, column in beside
            if 0 <= row < len(self.y) and 0 <= column < len(self.x) and (row, column) not in self.closed
        ]

    def _place(self, cell: Cell) -> tuple[float, float]:
        return float(self.x[cell[1]]), float(self.y[cell[0]])

    def _all(self) -> frozenset[int]:
        return frozenset((FREE, *range(self.count)))


TASK = TypeVar("TASK")
FOUND = TypeVar("FOUND")
FOUND_contra = TypeVar("FOUND_contra", contravariant=True)


class Flood(Protocol[TASK, FOUND_contra]):
    """Hands out cells to be looked at, and learns what was found."""

    @property
    def poses(self) -> Mapping[Any, Any]:
        """What is known of the cells that were reached."""

    def __iter__(self) -> Iterator[TASK]:
        """Cells to be looked at; new ones as more is added."""

    def add(self, task: TASK, found: FOUND_contra, /) -> None:
        """Learn what was found in a cell."""


def flooded(
    flood: Flood[TASK, FOUND],
    look: Callable[[TASK], FOUND],
    workers: Workers | int,
    open_cells: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Look at all cells that a flood hands out.

    Args:
        flood: learns what is found.
        look: at one cell; pickled.
        workers: where cells are looked at, or on how many processes of this machine.
        open_cells: how many cells there may be.
        progress: called with the numbers of cells reached and of cells that may be; None for nobody.

    Raises:
        BaseException: what looking at a cell raised.
    """
    crew = workers if not isinstance(workers, int) else ThisProcess() if workers == 1 else LocalWorkers(workers)
    for task, found in completed(crew, look, flood):
        if isinstance(found, BaseException):
            raise found
        flood.add(task, found)
        if progress is not None:
            progress(len(flood.poses), open_cells)
