"""Cells of a reach map, and how they are flooded.

Cells are looked at in waves: all that a wave may lead to is known before it begins, and what it found is taken in
together in the order of its tasks. So the map does not depend on which process is done first, nor on their number.
"""

import pickle
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.threads import on_one_thread
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.drawn_poses import POLISH_TURN, random_unknowns
from ccm_opt.planning.draws import TargetDraws
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.link_space import KNOTS, fit_coordinates
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.step import StepperOf
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_STEPS = 40
"""Most steps from a pose in the cell beside onto a place. Measured: of those that arrive nearly all take less."""
_PROGRESS = 0.9
"""Share of the way left that four steps may leave, or the place is given up. Taste."""
_ROUND = 4
"""Steps after which it is looked whether they help."""
_TURNS = 2
"""Poses from which a direction is tried in a cell. Taste."""

Cell: TypeAlias = tuple[int, ...]
"""Numbers of a cell along x and y, in space along z too."""


@dataclass(frozen=True)
class ReachSettings:
    """How it is found out where the tip can be.

    Attributes:
        step: width of a cell in the plane, as a share of the arm's length, where none is given. Taste.
        step_in_space: the same in space. Taste: with a base that stands still some two thousand cells, in about half a
            minute.
        headings: that are tried in a cell in the plane, where no number is given. Taste.
        directions: that are tried in a cell in space, where no number is given. Taste: none, for each of them takes as
            long as all of the map without.
        drawn: poses that are drawn, each of which is a beginning in the cell of its tip. Taste: a thousandth of a
            second each; they find what lies beyond narrow places.
        margin: room that steps in the plane keep, in nominal links, where there is so much. Taste.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        most_cells: of a grid; more are refused. Derived: some minutes of work and 10 MB of arrays.
    """

    step: float = 1.0 / 16.0
    step_in_space: float = 1.0 / 8.0
    headings: int = 16
    directions: int = 0
    drawn: int = 300
    margin: float = 0.024
    seen: float = 0.05
    most_cells: int = 200_000


REACH = ReachSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True, eq=False)
class ReachQuestion:
    """What all cells of one map have in common; cheap to pickle.

    Attributes:
        pickled: the problem.
        width: of a cell [m].
        directions: that are tried in every cell, shape (K, d).
        settings: how hard is tried.
    """

    pickled: bytes
    width: float
    directions: FloatArray
    settings: ReachSettings

    @classmethod
    def about(
        cls, problem: Problem, width: float, directions: FloatArray, settings: ReachSettings = REACH
    ) -> "ReachQuestion":
        """The question for a problem, whose last goal, if it is one of a tip in space, is where a motion may lead."""
        goal = TipGoal(problem.start.tip(problem.arm))
        if problem.dimension == 3 and problem.goal.whole(problem.arm) is None:
            goal = problem.goal  # type: ignore[assignment]  # that is no pose of the whole arm
        return cls(pickle.dumps(replace(problem, goal=goal, stops=())), width, directions, settings)

    @property
    def looker(self) -> "TipLooker":
        """Who looks at cells in this process, made once."""
        return _looker(self.pickled, self.settings)


@dataclass(frozen=True, eq=False)
class ReachTask:
    """A cell to be entered, or one that is reached, in which directions and room are looked at.

    Attributes:
        cell: its numbers.
        middle: of it, shape (d,) [m].
        seeds: unknowns of poses, each of shape (p,): to enter it, such with the tip in it or beside it, in the order of
            trying; where it is reached, first of the pose with the tip in its middle, then of those beside.
        reached: whether it is.
    """

    cell: Cell
    middle: FloatArray
    seeds: tuple[FloatArray, ...]
    reached: bool = False


@dataclass(frozen=True, eq=False)
class CellFound:
    """What was found in a cell.

    Attributes:
        arrived: unknowns of a free pose with the tip in its middle, shape (p,); None where there is none.
        stone: of one that only came into the cell; None where there is none.
        tried: seeds that were tried.
        taken: directions that it can have, shape (K,).
        turned: unknowns of poses with these, each of shape (p,).
        gap: room of the roomiest pose, as far as is looked [m].
        cpu: that it took [s].
    """

    arrived: FloatArray | None = None
    stone: FloatArray | None = None
    tried: int = 0
    taken: BoolArray | None = None
    turned: tuple[FloatArray, ...] = ()
    gap: float = np.nan
    cpu: float = 0.0


@on_one_thread()
def look_at_cell(question: ReachQuestion, task: ReachTask) -> CellFound:
    """Do one task of a map."""
    begun = time.process_time()
    looker = question.looker
    found = looker.turned(task, question.directions) if task.reached else looker.entered(task, question.width)
    return replace(found, cpu=time.process_time() - begun)


@lru_cache(maxsize=2)  # a worker makes it once for all cells of a map
def _looker(pickled: bytes, settings: ReachSettings) -> "TipLooker":
    problem: Problem = pickle.loads(pickled)  # noqa: S301 - made by this very program
    return _in_plane(problem, settings) if problem.dimension == 2 else _in_space(problem, settings)


@dataclass(frozen=True, eq=False)
class TipLooker:
    """Leads poses of one arm among fixed walls or surfaces from place to place.

    Attributes:
        stepper: takes the steps.
        start: unknowns of the first pose, shape (p,).
        room: least of configurations, shape (k, c), beyond radius and clearance, as far as is looked [m].
        drawn: draws unknowns of random shapes.
        seed: of the draws.
        task: in space, for a motion to begin with; None in the plane.
    """

    stepper: StepperOf[Any]
    start: FloatArray
    room: Callable[[FloatArray], float]
    drawn: Callable[[np.random.Generator], FloatArray]
    seed: int
    task: SpaceTask | None = None

    def free(self, pose: Pose) -> bool:
        """Return whether a pose touches nothing and keeps all limits."""
        return self.stepper.safe(pose.q, pose.q)

    def entered(self, task: ReachTask, width: float) -> CellFound:
        """Return a pose in a cell, or one that comes into it, from poses near by.

        In a duct the middles of cells may lie in its walls. So a pose that only comes into the cell is a stepping
        stone, though the cell does not count as reached by it.
        """
        stone: FloatArray | None = None
        for number, seed in enumerate(task.seeds, start=1):
            near = self.stepper.pose(seed)
            # Straight across the side that the cells share, as a duct may go, and then to the middle.
            across = _into(task.middle, width, near.tip)
            if float(np.linalg.norm(across - task.middle)) > self.stepper.space.nominal_length:
                _, near = self._led(near, GoalPose(across))
            arrived, pose = self._led(near, GoalPose(task.middle))
            if arrived is not None:
                return CellFound(arrived=arrived.v, stone=stone, tried=number)
            if not self.free(pose):
                pose = near
            inside = bool(np.all(np.abs(pose.tip - task.middle) <= 0.5 * width))
            if stone is None and inside and self.free(pose):
                stone = pose.v
        return CellFound(stone=stone, tried=len(task.seeds))

    def turned(self, task: ReachTask, directions: FloatArray) -> CellFound:
        """Return the directions that a cell can have, each tried from the poses that point most nearly there."""
        own, *beside = map(self.stepper.pose, task.seeds)
        found = [own]
        taken = np.zeros(len(directions), dtype=bool)
        for number in np.argsort(-directions @ own.tip_direction):
            direction = directions[number]
            goal = GoalPose(task.middle, direction)
            nearest = sorted((*found, *beside), key=lambda each: -float(each.tip_direction @ direction))
            for pose in nearest[:_TURNS]:
                turned, _ = self._led(pose, goal)
                if turned is not None:
                    found.append(turned)
                    taken[number] = True
                    break
        return CellFound(
            taken=taken, turned=tuple(each.v for each in found[1:]), gap=max(self.room(each.q[None]) for each in found)
        )

    def _led(self, pose: Pose, goal: GoalPose) -> tuple[Pose | None, Pose]:
        """Return a free pose at a goal, from a pose near by, or None where it does not arrive; and how far it comes."""
        stepper = self.stepper
        if self.task is not None:
            goal = self.task.limited(goal)
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


def _in_plane(problem: Problem, settings: ReachSettings) -> TipLooker:
    """Of an arm among walls, whose base stands still.

    Raises:
        UnreachableGoal: the start touches something, or breaks a joint limit.
    """
    ends = resolve_ends(problem)
    task = MotionPlanner().task_without_routes(problem, ends, Deadline.never())
    task = replace(task, wanted_gap=settings.seen * task.arm.length)
    space, start = task.space_through(task.start)
    shapes = TargetDraws.within(space, [ends.start], KNOTS + 1, task.settings.step.limit_share)

    def drawn(rng: np.random.Generator) -> FloatArray:
        headings = shapes.shapes(rng, 1)[0] - task.arm.headings(space.offset)
        return fit_coordinates(space.turns, headings, task.arm.length)

    return TipLooker(task.stepper(space, settings.margin), start, task.least_gap, drawn, task.seed)


def _in_space(problem: Problem, settings: ReachSettings) -> TipLooker:
    """Of an arm among surfaces."""
    task = space_task(problem, SurfaceTree.of(problem.workspace.soup), Deadline.never(), SpaceMotionSettings())
    curve, start = CurveMap.through(task.arm, task.start)
    stepper = task.stepper(curve)
    seen = replace(task, wanted_gap=settings.seen * task.arm.length)
    return TipLooker(stepper, start, seen.least_gap, partial(random_unknowns, stepper), task.seed, task)


def _into(middle: FloatArray, width: float, place: FloatArray) -> FloatArray:
    """Return a place moved into a cell along the axes on which it is not within it, as far as its middle there."""
    return np.where(np.abs(place - middle) > 0.5 * width, middle, place)


@dataclass(eq=False)
class TipFlood:
    """The state of a map while it is made: an iterator of tasks that ends when there is none at the moment.

    Attributes:
        axes: middles of the cells along x and y, in space along z too [m].
        width: of a cell [m].
        closed: cells that no pose can have, one axis a coordinate.
        count: of the directions that are tried in a cell.
        settings: how hard is tried.
        poses: unknowns of a pose in each cell that is reached, shape (p,).
        taken: which directions a cell has, shape (..., K).
        gap: room in a cell [m]; not a number where it is not reached.
        cpu: that all cells took [s].
    """

    axes: tuple[FloatArray, ...]
    width: float
    closed: BoolArray
    count: int
    settings: ReachSettings
    poses: dict[Cell, FloatArray] = field(default_factory=dict)
    cpu: float = 0.0
    _stones: dict[Cell, FloatArray] = field(default_factory=dict)
    _tried: dict[Cell, int] = field(default_factory=dict)
    _wave: list[ReachTask] = field(default_factory=list)
    _given: int = 0
    _found: dict[Cell, CellFound] = field(default_factory=dict)
    _turned: dict[Cell, tuple[FloatArray, ...]] = field(default_factory=dict)
    _given_on: set[Cell] = field(default_factory=set)

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
            cell = self._cell_index(pose.tip)
            if cell is not None and cell not in self._stones:
                self._stones[cell] = pose.v
                self._wave.append(ReachTask(cell, self._place(cell), (pose.v,)))

    def add(self, task: ReachTask, found: CellFound) -> None:
        """Take in what was found in a cell."""
        self.cpu += found.cpu
        self._found[task.cell] = found

    def __iter__(self) -> Iterator[ReachTask]:
        """Return the itself."""
        return self

    def __next__(self) -> ReachTask:
        """Return the next task; it may end and go on again when results have come.

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
        """Take in a wave that is over, and make the next one.

        Cells are entered while there are any; then those that are reached are turned in, which may lead to others.
        """
        first = not self._tried
        gained = [task.cell for task in self._wave if self._take(task) or first]
        self._found.clear()
        self._given = 0
        self._wave = self._entering(gained) or self._turning() or self._from_turned()

    def _take(self, task: ReachTask) -> bool:
        """Take in what a task found; whether its cell has got a pose from which others may be reached."""
        cell = task.cell
        found = self._found[cell]
        if task.reached:
            self.taken[cell] = found.taken
            self.gap[cell] = found.gap
            self._turned[cell] = found.turned
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
        """Return what can be tried beside cells that have got a pose, from each of those beside them once."""
        seeds: dict[Cell, list[FloatArray]] = {}
        for cell in gained:
            for other in self._beside(cell):
                left = 2 * len(cell) - self._tried.get(other, 0) - len(seeds.get(other, ()))
                if other not in self.poses and left > 0:
                    pose = self.poses[cell] if cell in self.poses else self._stones[cell]
                    seeds.setdefault(other, []).append(pose)
        return [ReachTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items()]

    def _turning(self) -> list[ReachTask]:
        """Return the directions to be looked at in cells that are reached."""
        tasks: list[ReachTask] = []
        for cell in self.poses:
            if cell not in self._turned:
                near = (self.poses[other] for other in self._beside(cell) if other in self.poses)
                tasks.append(ReachTask(cell, self._place(cell), (self.poses[cell], *near), reached=True))
        return tasks

    def _from_turned(self) -> list[ReachTask]:
        """What can be tried in cells that nothing else led to, from the poses of the cells beside with directions."""
        seeds: dict[Cell, list[FloatArray]] = {}
        for cell, poses in self._turned.items():
            if cell not in self._given_on:
                for other in self._beside(cell):
                    if other not in self.poses and not self.closed[other]:
                        seeds.setdefault(other, []).extend(poses)
        self._given_on.update(self._turned)
        return [ReachTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items() if poses]

    def _drawn(self, looker: TipLooker) -> Iterator[Pose]:
        """Yield the free poses that are drawn."""
        rng = np.random.default_rng(looker.seed)
        for _ in range(self.settings.drawn):
            pose = looker.stepper.pose(looker.drawn(rng))
            if looker.free(pose):
                yield pose

    def _cell_index(self, place: FloatArray) -> Cell | None:
        """Return the cell of a place; None where the grid does not reach."""
        low = np.array([middles[0] for middles in self.axes])
        numbers = np.round((place - low) / self.width).astype(int)
        within = np.all(numbers >= 0) and np.all(numbers < self.closed.shape)
        return tuple(numbers.tolist()) if within else None

    def _beside(self, cell: Cell) -> Iterator[Cell]:
        """Yield the cells with a side in common."""
        for axis, size in enumerate(self.closed.shape):
            for step in (1, -1):
                if 0 <= cell[axis] + step < size:
                    yield (*cell[:axis], cell[axis] + step, *cell[axis + 1 :])

    def _place(self, cell: Cell) -> FloatArray:
        return np.array([middles[number] for number, middles in zip(cell, self.axes, strict=True)])
