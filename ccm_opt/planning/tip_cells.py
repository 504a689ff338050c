"""Cells of a reach map in space, and how they are flooded.

Cells are looked at in waves: all that a wave may lead to is known before it begins, and what it found is taken in
together in the order of its tasks. So the map does not depend on which process is done first, nor on their number.
"""

import pickle
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.threads import on_one_thread
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_goal_poses import POLISH_TURN, drawn_unknowns
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_STEPS = 40
"""Most steps from a pose in the cell beside onto a place. Measured: of those that arrive nearly all take less."""
_PROGRESS = 0.9
"""Share of the way left that four steps may leave, or the place is given up. Taste."""
_ATTEMPTS = 6
"""Cells beside from which a place is tried in vain before its cell counts as not found. Taste: all."""

Cell: TypeAlias = tuple[int, int, int]
"""Numbers of a cell along x, y and z."""
_ROUND = 4
"""Steps after which it is looked whether they help."""


@dataclass(frozen=True)
class SpaceReachSettings:
    """How it is found out where the tip can be in space.

    Attributes:
        step: width of a cell, as a share of the arm's length, where none is given. Taste: with a base that stands still
            some two thousand cells, in about half a minute.
        directions: that are tried in a cell, where no number is given. Taste: none, for each of them takes as long as
            all of the map without.
        drawn: poses that are drawn, each of which is a beginning in the cell of its tip. Taste: a thousandth of a
            second each; they find what lies beyond narrow places.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        most_cells: of a grid; more are refused. Derived: some minutes of work and 10 MB of arrays.
    """

    step: float = 1.0 / 8.0
    directions: int = 0
    drawn: int = 300
    seen: float = 0.05
    most_cells: int = 200_000


DEFAULT_SPACE_REACH = SpaceReachSettings()
"""Used where no other settings are given."""


def even_directions(count: int) -> FloatArray:
    """Unit vectors spread evenly over the sphere, on a spiral of the golden angle, shape (count, 3)."""
    number = np.arange(count) + 0.5
    up = 1.0 - 2.0 * number / max(count, 1)
    across = np.sqrt(1.0 - up**2)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number
    return np.stack((across * np.cos(angle), across * np.sin(angle), up), axis=1)


@dataclass(frozen=True, eq=False)
class SpaceReachQuestion:
    """What all cells of one map have in common; cheap to pickle.

    Attributes:
        pickled: the problem.
        width: of a cell [m].
        directions: that are tried in every cell, shape (K, 3).
        settings: how hard is tried.
    """

    pickled: bytes
    width: float
    directions: FloatArray
    settings: SpaceReachSettings

    @classmethod
    def about(
        cls, problem: Problem, width: float, directions: FloatArray, settings: SpaceReachSettings
    ) -> "SpaceReachQuestion":
        """The question for a problem, whose last goal, if it is one for the tip, is where a motion may lead."""
        arm = problem.arm
        tip = arm.joint_positions_at(problem.start.configuration(arm))[-1]
        goal = problem.goal if isinstance(problem.goal, TipGoal) else TipGoal(tip)
        return cls(pickle.dumps(replace(problem, goal=goal, stops=())), width, directions, settings)

    @property
    def looker(self) -> "TipLooker":
        """Who looks at cells in this process, made once."""
        return _looker(self.pickled, self.settings)


@dataclass(frozen=True, eq=False)
class EnterTask:
    """A cell to be entered.

    Attributes:
        cell: its numbers.
        middle: of it, shape (3,) [m].
        seeds: unknowns of poses with the tip in it or beside it, each of shape (p,), in the order of trying.
    """

    cell: Cell
    middle: FloatArray
    seeds: tuple[FloatArray, ...]


@dataclass(frozen=True, eq=False)
class TurnTask:
    """A cell that is reached, in which directions and room are looked at.

    Attributes:
        cell: its numbers.
        middle: of it, shape (3,) [m].
        seed: unknowns of the pose with the tip in its middle, shape (p,).
    """

    cell: Cell
    middle: FloatArray
    seed: FloatArray


ReachTask: TypeAlias = EnterTask | TurnTask


@dataclass(frozen=True, eq=False)
class CellFound:
    """What was found in a cell.

    Attributes:
        arrived: unknowns of a free pose with the tip in its middle, shape (p,); None where there is none.
        stone: of one that only came into the cell; None where there is none.
        tried: seeds that were tried.
        taken: directions that it can have, shape (K,).
        gap: room of the pose, as far as is looked [m].
        cpu: that it took [s].
    """

    arrived: FloatArray | None = None
    stone: FloatArray | None = None
    tried: int = 0
    taken: BoolArray | None = None
    gap: float = np.nan
    cpu: float = 0.0


@on_one_thread()
def look_at_cell(question: SpaceReachQuestion, task: ReachTask) -> CellFound:
    """Do one task of a map."""
    begun = time.process_time()
    looker = question.looker
    if isinstance(task, EnterTask):
        found = looker.entered(task, question.width)
    else:
        found = looker.turned(task, question.directions)
    return replace(found, cpu=time.process_time() - begun)


@lru_cache(maxsize=2)  # a worker makes it once for all cells of a map
def _looker(pickled: bytes, settings: SpaceReachSettings) -> "TipLooker":
    problem: Problem = pickle.loads(pickled)  # noqa: S301 - made by this very program
    tree = SurfaceTree.of(problem.workspace.soup)
    return TipLooker(space_task(problem, tree, Deadline.never(), SpaceMotionSettings()), settings)


class TipLooker:
    """Leads poses of one arm among fixed surfaces from place to place.

    Args:
        task: of the arm, with any goal.
        settings: how hard is tried.
    """

    def __init__(self, task: SpaceTask, settings: SpaceReachSettings) -> None:
        curve, start = CurveMap.through(task.arm, task.start)
        self.task = task
        self.settings = settings
        self.stepper = task.stepper(curve)
        self.start = start

    def entered(self, task: EnterTask, width: float) -> CellFound:
        """A pose in a cell, or one that comes into it, from poses near by.

        In a duct the middles of cells may lie in its walls. So a pose that only comes into the cell is a stepping
        stone, though the cell does not count as reached by it.
        """
        stone: FloatArray | None = None
        for number, seed in enumerate(task.seeds, start=1):
            near = self.stepper.pose(seed)
            # Straight across the side that the cells share, as a duct may go, and then to the middle.
            across = _into(task.middle, width, near.tip)
            if float(np.linalg.norm(across - task.middle)) > self.stepper.space.nominal_length:
                _, near = self._led(near, self.task.limited(GoalPose(across)))
            arrived, pose = self._led(near, self.task.limited(GoalPose(task.middle)))
            if arrived is not None:
                return CellFound(arrived=arrived.v, stone=stone, tried=number)
            if not self.free(pose):
                pose = near
            inside = bool(np.all(np.abs(pose.tip - task.middle) <= 0.5 * width))
            if stone is None and inside and self.free(pose):
                stone = pose.v
        return CellFound(stone=stone, tried=len(task.seeds))

    def turned(self, task: TurnTask, directions: FloatArray) -> CellFound:
        """Directions that a cell can have, each tried from the pose that points most nearly there."""
        pose = self.stepper.pose(task.seed)
        found = [pose]
        taken = np.zeros(len(directions), dtype=bool)
        for number in np.argsort(-directions @ pose.tip_direction):
            direction = directions[number]
            nearest = max(found, key=lambda each: float(each.tip_direction @ direction))
            turned, _ = self._led(nearest, self.task.limited(GoalPose(task.middle, direction)))
            if turned is not None:
                found.append(turned)
                taken[number] = True
        return CellFound(taken=taken, gap=self._gap(pose))

    def free(self, pose: Pose) -> bool:
        """Whether a pose touches nothing and keeps all limits."""
        return self.stepper.within_limits(pose.q) and self.stepper.certificate.safe(pose.q, pose.q)

    def _gap(self, pose: Pose) -> float:
        """Room of a pose to the scene beyond radius and clearance, at most as far as is looked [m]."""
        arm = self.task.arm
        reach = self.settings.seen * arm.length
        _, segments = arm.exposed_links(pose.points)
        kept = arm.radius + self.task.clearance
        least = float(np.min(self.task.tree.distances(segments, reach + kept), initial=reach + kept))
        return least - kept

    def _led(self, pose: Pose, goal: GoalPose) -> tuple[Pose | None, Pose]:
        """A free pose at a goal, from a pose near by, or None where it does not arrive; and how far it comes."""
        stepper = self.stepper
        before = np.inf
        for number in range(_STEPS):
            distance, turn = goal.errors(pose)
            left = distance / stepper.space.nominal_length + turn
            if distance < 0.3 * stepper.space.nominal_length and turn < 0.1:
                break
            if number % _ROUND == 0:
                if left > _PROGRESS * before:
                    return None, pose
                before = left
            pose = stepper.step(pose, goal.terms(stepper.space, pose, 1.0 + number), checked=False)
        onto = moved_onto(stepper.space, goal, pose, POLISH_TURN)
        return (onto if goal.on_goal(onto) and goal.limits_met(onto) and self.free(onto) else None), pose


def _into(middle: FloatArray, width: float, place: FloatArray) -> FloatArray:
    """A place moved into a cell along the axes on which it is not within it, as far as its middle there."""
    return np.where(np.abs(place - middle) > 0.5 * width, middle, place)


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
                left = _ATTEMPTS - self._tried.get(other, 0) - len(seeds.get(other, ()))
                if other not in self.poses and left > 0:
                    pose = self.poses[cell] if cell in self.poses else self._stones[cell]
                    seeds.setdefault(other, []).append(pose)
        return [EnterTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items()]

    def _drawn(self, looker: TipLooker) -> Iterator[Pose]:
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
