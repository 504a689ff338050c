"""Which cells of a grid in space are looked at next: poses spread from cell to cell like water that fills a vessel.

Cells are looked at in waves: all that a wave may lead to is known before it begins, and what it found is taken in
together in the order of its tasks. So the map does not depend on which process is done first, nor on their number.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.space.motion.goal_poses import drawn_unknowns
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.space_reach_settings import SpaceReachSettings
from ccm_opt.space.tip_cells import Cell, CellFound, EnterTask, ReachTask, TipLooker, TurnTask

BESIDE: tuple[Cell, ...] = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
"""Cells with a side in common."""


@dataclass(eq=False)
class TipFlood:
    """The state of a map while it is made: an iterator of tasks that ends when there is none at the moment.

    Attributes:
        axes: middles of the cells along x, y and z [m].
        width: of a cell [m].
        closed: cells that no pose can have, shape (nx, ny, nz).
        count: of the directions that are tried in a cell.
        settings: how hard is tried.
        poses: unknowns of a pose in each cell that is reached, shape (p,).
        taken: which directions a cell has, shape (nx, ny, nz, K).
        gap: room in a cell, shape (nx, ny, nz) [m]; not a number where it is not reached.
        cpu: that all cells took [s].
    """

    axes: tuple[FloatArray, FloatArray, FloatArray]
    width: float
    closed: BoolArray
    count: int
    settings: SpaceReachSettings
    poses: dict[Cell, FloatArray] = field(default_factory=dict)
    cpu: float = 0.0
    _stones: dict[Cell, FloatArray] = field(default_factory=dict)
    _tried: dict[Cell, int] = field(default_factory=dict)
    _wave: list[ReachTask] = field(default_factory=list)
    _given: int = 0
    _found: dict[Cell, CellFound] = field(default_factory=dict)
    _turning: bool = False

    def __post_init__(self) -> None:
        self.taken: BoolArray = np.zeros((*self.closed.shape, self.count), dtype=bool)
        self.gap: FloatArray = np.full(self.closed.shape, np.nan)

    def begin(self, looker: TipLooker, along: FloatArray) -> None:
        """Begin at the start, at the poses of a motion, and at drawn ones.

        Args:
            looker: makes poses.
            along: unknowns of poses of a motion, which leads where nothing else does, shape (N, p).
        """
        for pose in (*map(looker.stepper.pose, (looker.start, *along)), *self._drawn(looker)):
            cell = self._cell_of(pose.tip)
            if cell is not None and cell not in self._stones:
                self._stones[cell] = pose.v
                self._wave.append(EnterTask(cell, self._place(cell), (pose.v,)))

    def add(self, task: ReachTask, found: CellFound) -> None:
        """Take in what was found in a cell."""
        self.cpu += found.cpu
        self._found[task.cell] = found

    def __iter__(self) -> Iterator[ReachTask]:
        """Itself."""
        return self

    def __next__(self) -> ReachTask:
        """The next task; it may end and go on again when results have come.

        Raises:
            StopIteration: there is none at the moment.
        """
        if self._given == len(self._wave) == len(self._found):
            self._next_wave()
        if self._given == len(self._wave):
            raise StopIteration
        task = self._wave[self._given]
        self._given += 1
        return task

    def _next_wave(self) -> None:
        """Take in a wave that is over, and make the next one: cells to enter while there are any, then their turns."""
        first = not self._tried
        gained = [task.cell for task in self._wave if self._take(task) or first]
        self._found.clear()
        self._given = 0
        if self._turning:
            self._wave = []
            return
        self._wave = self._entering(gained)
        if not self._wave:
            self._turning = True
            self._wave = [TurnTask(cell, self._place(cell), pose) for cell, pose in self.poses.items()]

    def _take(self, task: ReachTask) -> bool:
        """Take in what a task found; whether its cell has got a pose from which others may be reached."""
        cell = task.cell
        found = self._found[cell]
        if isinstance(task, TurnTask):
            self.taken[cell] = found.taken
            self.gap[cell] = found.gap
            return False
        self._tried[cell] = self._tried.get(cell, 0) + found.tried
        new = cell not in self._stones
        if found.stone is not None and new:
            self._stones[cell] = found.stone
        if found.arrived is None:
            return found.stone is not None and new
        if self.closed[cell]:
            # It does not count as reached, but may lead on.
            if new:
                self._stones[cell] = found.arrived
            return new
        self.poses[cell] = found.arrived
        return True

    def _entering(self, gained: list[Cell]) -> list[ReachTask]:
        """What can be tried beside cells that have got a pose."""
        seeds: dict[Cell, list[FloatArray]] = {}
        for cell in gained:
            for other in self._beside(cell):
                left = self.settings.attempts - self._tried.get(other, 0) - len(seeds.get(other, ()))
                if other not in self.poses and left > 0:
                    pose = self.poses[cell] if cell in self.poses else self._stones[cell]
                    seeds.setdefault(other, []).append(pose)
        return [EnterTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items()]

    def _drawn(self, looker: TipLooker) -> Iterator[SpacePose]:
        """Free poses that are drawn."""
        rng = np.random.default_rng(looker.task.seed)
        for _ in range(self.settings.drawn):
            pose = looker.stepper.pose(drawn_unknowns(looker.stepper, rng))
            if looker.free(pose):
                yield pose

    def _cell_of(self, place: FloatArray) -> Cell | None:
        """The cell of a place; None where the grid does not reach."""
        numbers = []
        for value, middles in zip(place, self.axes, strict=True):
            number = round(float((value - middles[0]) / self.width))
            if not 0 <= number < len(middles):
                return None
            numbers.append(number)
        return numbers[0], numbers[1], numbers[2]

    def _beside(self, cell: Cell) -> Iterator[Cell]:
        shape = self.closed.shape
        for step in BESIDE:
            other = (cell[0] + step[0], cell[1] + step[1], cell[2] + step[2])
            if all(0 <= number < size for number, size in zip(other, shape, strict=True)):
                yield other

    def _place(self, cell: Cell) -> FloatArray:
        return np.array([middles[number] for number, middles in zip(cell, self.axes, strict=True)])
