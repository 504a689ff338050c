"""Poses with the tip in the cells of a grid in space, led on from cell to cell like water that fills a vessel."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.curve_map import CurveMap
from ccm_opt.space.motion.goal_poses import drawn_unknowns
from ccm_opt.space.motion.space_goal import SpaceTipPose, onto_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.task import SpaceTask
from ccm_opt.space.space_reach_settings import SpaceReachSettings

Cell = tuple[int, int, int]
BESIDE: tuple[Cell, ...] = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
"""Cells with a side in common."""
_ROUND = 4
"""Steps after which it is looked whether they help."""


@dataclass(eq=False)
class TipFlood:
    """Fills a grid with poses.

    Attributes:
        task: of the arm, with any goal.
        axes: middles of the cells along x, y and z [m].
        width: of a cell [m].
        closed: cells that no pose can have, shape (nx, ny, nz).
        directions: that are tried in every cell, shape (K, 3).
        settings: how hard is tried.
        along: unknowns of poses to begin at, those of a motion, which leads where nothing else does, shape (N, p).
        poses: of the cells that are reached, by their numbers.
        taken: which directions a cell has, shape (nx, ny, nz, K).
    """

    task: SpaceTask
    axes: tuple[FloatArray, FloatArray, FloatArray]
    width: float
    closed: BoolArray
    directions: FloatArray
    settings: SpaceReachSettings
    along: FloatArray
    poses: dict[Cell, SpacePose] = field(default_factory=dict)

    def __post_init__(self) -> None:
        curve, start = CurveMap.through(self.task.arm, self.task.start)
        self.stepper = self.task.stepper(curve)
        self._start = start
        self.taken: BoolArray = np.zeros((*self.closed.shape, len(self.directions)), dtype=bool)
        self._tried: dict[Cell, int] = {}
        self._stones: dict[Cell, SpacePose] = {}

    def fill(self, progress: Callable[[int, int], None] | None = None) -> None:
        """Lead poses on until no cell is left to be tried."""
        open_cells = int(np.sum(~self.closed))
        waiting: deque[Cell] = deque()
        for pose in (*map(self.stepper.pose, (self._start, *self.along)), *self._drawn()):
            cell = self._cell_of(pose.tip)
            if cell is not None and cell not in self.poses and cell not in self._stones:
                self._stones[cell] = pose
                self._enter(cell, pose)
                waiting.append(cell)
        while waiting:
            cell = waiting.popleft()
            for other in self._beside(cell):
                if self._enter(other, self.poses.get(cell) or self._stones[cell]):
                    waiting.append(other)
            if progress is not None:
                progress(len(self.poses), open_cells)
        for cell, pose in self.poses.items():
            self._turn(cell, pose)
            if progress is not None:
                progress(len(self.poses), open_cells)

    def gap(self, cell: Cell, tree: SurfaceTree, reach: float) -> float:
        """Room of a cell's pose to the scene beyond radius and clearance, at most as far as is looked [m]."""
        arm = self.task.arm
        link, share = arm.mount_end
        segments = self.poses[cell].segments()[link:].copy()
        segments[0, 0] += share * (segments[0, 1] - segments[0, 0])
        kept = arm.radius + self.task.clearance
        least = float(np.min(tree.distances(segments, reach + kept), initial=reach + kept))
        return least - kept

    def _drawn(self) -> Iterator[SpacePose]:
        """Free poses that are drawn."""
        rng = np.random.default_rng(self.task.seed)
        for _ in range(self.settings.drawn):
            pose = self.stepper.pose(drawn_unknowns(self.stepper, rng))
            if self._free(pose):
                yield pose

    def _enter(self, cell: Cell, near: SpacePose) -> bool:
        """Whether a cell gets a pose from one near by from which its neighbours may be reached: a new way on.

        In a duct the middles of cells may lie in its walls. So a pose that only comes into the cell is a stepping
        stone, though the cell does not count as reached by it.
        """
        if cell in self.poses or self._tried.get(cell, 0) >= self.settings.attempts:
            return False
        self._tried[cell] = self._tried.get(cell, 0) + 1
        middle = self._place(cell)
        # Straight across the side that the cells share, as a duct may go, and then to the middle.
        across = self._into(cell, near.tip)
        if float(np.linalg.norm(across - middle)) > self.stepper.unit:
            _, near = self._led(near, SpaceTipPose(across))
        arrived, pose = self._led(near, SpaceTipPose(middle))
        if not self._free(pose):
            pose = near
        if arrived is not None and not self.closed[cell]:
            self.poses[cell] = arrived
            return True
        if cell in self._stones or self._cell_of(pose.tip) != cell or not self._free(pose):
            return False
        self._stones[cell] = pose
        return True

    def _turn(self, cell: Cell, pose: SpacePose) -> None:
        """Try all directions in a cell, the nearest first, each from the pose that points most nearly there."""
        found = [pose]
        order = np.argsort(-self.directions @ pose.tip_direction)
        for number in order:
            direction = self.directions[number]
            nearest = max(found, key=lambda each: float(each.tip_direction @ direction))
            turned, _ = self._led(nearest, SpaceTipPose(self._place(cell), direction))
            if turned is not None:
                found.append(turned)
                self.taken[(*cell, int(number))] = True

    def _led(self, pose: SpacePose, goal: SpaceTipPose) -> tuple[SpacePose | None, SpacePose]:
        """A free pose at a goal, from a pose near by, or None where it does not arrive; and how far it comes."""
        stepper = self.stepper
        before = np.inf
        for number in range(self.settings.steps):
            distance, turn = goal.errors(pose)
            left = distance / stepper.unit + turn
            if distance < 0.3 * stepper.unit and turn < 0.1:
                break
            if number % _ROUND == 0:
                if left > self.settings.progress * before:
                    return None, pose
                before = left
            pose = stepper.step(pose, [goal.term(pose, stepper.unit, 1.0 + number)], certified=False)
        onto = onto_goal(stepper, goal, pose, self.task.settings.goal_poses.polish_turn)
        return (onto if onto is not None and self._free(onto) else None), pose

    def _free(self, pose: SpacePose) -> bool:
        """Whether a pose touches nothing and keeps all limits."""
        return self.stepper.within_limits(pose.q) and self.stepper.certificate.safe(pose.q, pose.q)

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

    def _into(self, cell: Cell, place: FloatArray) -> FloatArray:
        """The place moved into a cell along the axes on which it is not within it, as far as its middle there."""
        middle = self._place(cell)
        half = 0.5 * self.width
        return np.where(np.abs(place - middle) > half, middle, place)

    def _place(self, cell: Cell) -> FloatArray:
        return np.array([middles[number] for number, middles in zip(cell, self.axes, strict=True)])
