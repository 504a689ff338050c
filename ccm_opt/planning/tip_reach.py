"""Cells of a reach map, and the flood fill that finds those that the tip can reach.

Cells are processed in waves: all seeds of a wave are known before it begins, and its results are recorded together in
the order of its tasks. So the map depends neither on which process finishes first nor on the number of processes.
"""

import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.threads import on_one_thread
from ccm_opt.planning.draws import TargetDraws
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.link_space import KNOTS, fit_coordinates
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.sampled_poses import POLISH_TURN, random_unknowns
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.step import StepperOf
from ccm_opt.problem import Problem, TipGoal

_STEPS = 40
"""Maximum number of steps from a pose to a goal in a neighbouring cell. Measured: nearly all successes take fewer."""
_PROGRESS = 0.9
"""Largest ratio of the remaining error after a round of steps to the one before at which steps continue. Heuristic."""
_ROUND = 4
"""Number of steps in a round, after which the progress is checked."""
_AHEAD = 0.25
"""Weight of the cosine of the turn from a pose to a goal, relative to the distance as a fraction of the arm's length,
in the choice of poses from which a goal is tried. Heuristic."""
_TURNS = 2
"""Maximum number of poses from which each direction is tried in a cell. Heuristic."""

_AT_ONCE = 50
"""Number of sampled poses that are checked together. Heuristic."""

Cell: TypeAlias = tuple[int, ...]
"""Indices of a cell along x and y, in space along z too."""


@dataclass(frozen=True)
class ReachSettings:
    """Settings of the search for the positions and directions that the tip can reach.

    Attributes:
        step: default width of a cell in the plane, as a fraction of the arm's length. Heuristic.
        step_in_space: default width of a cell in space, as a fraction of the arm's length. Heuristic: with a fixed base
            it gives about two thousand cells, which take about half a minute.
        headings: default number of headings tried in a cell in the plane. Heuristic.
        directions: default number of directions tried in a cell in space. Heuristic: none, since each direction takes
            as long as the whole map without directions.
        drawn: number of sampled poses; those that are free are seeds in the cells of their tips. Heuristic: each takes
            a thousandth of a second, and together they find the regions beyond narrow passages.
        margin: planning margin of steps in the plane, in nominal links. Heuristic.
        seen: largest gap that is measured, as a fraction of the arm's length. Heuristic.
        most_cells: maximum number of cells; larger grids are refused. Derived: several minutes of work and 10 MB of
            arrays.
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
"""Default settings."""


@dataclass(frozen=True, eq=False)
class ReachQuestion:
    """Inputs that the processing of every cell of one reach map shares; cheap to pickle.

    Attributes:
        pickled: the pickled problem.
        width: width of a cell [m].
        directions: unit vectors of tip directions that are tried in every cell, shape (K, d).
        settings: settings of the search.
    """

    pickled: bytes
    width: float
    directions: FloatArray
    settings: ReachSettings

    @classmethod
    def about(
        cls, problem: Problem, width: float, directions: FloatArray, settings: ReachSettings = REACH
    ) -> "ReachQuestion":
        """Return the inputs of all cells for a problem.

        In the pickled problem, the goal is replaced by the position of the tip at the start. Only in space, a goal of
        the tip is kept, as it is the goal of an initial motion.

        Args:
            problem: the problem.
            width: width of a cell [m].
            directions: unit vectors of tip directions that are tried in every cell, shape (K, d).
            settings: settings of the search.
        """
        goal = TipGoal(problem.start.tip(problem.arm))
        if problem.dimension == 3 and problem.goal.for_tip is not None and problem.goal.look_at is None:
            goal = problem.goal.for_tip
        return cls(pickle.dumps(replace(problem, goal=goal, stops=())), width, directions, settings)

    @property
    def looker(self) -> "TipLooker":
        """Processor of cells for this problem, built once per process and cached."""
        return _looker(self.pickled, self.settings)


@dataclass(frozen=True, eq=False)
class ReachTask:
    """A cell to be entered, or a reached cell whose directions and gap are to be determined.

    Attributes:
        cell: indices of the cell.
        middle: centre of the cell, shape (d,) [m].
        seeds: unknowns of poses, each of shape (p,), in the order of trying. For a cell to be entered, the poses have
            their tips in it or in a neighbour; for a reached cell, they are the pose with the tip at its centre and
            those of reached neighbours.
        reached: whether the cell is reached.
    """

    cell: Cell
    middle: FloatArray
    seeds: tuple[FloatArray, ...]
    reached: bool = False


@dataclass(frozen=True, eq=False)
class CellFound:
    """Result for a cell.

    Attributes:
        arrived: unknowns of a free pose with the tip at the cell's centre, shape (p,); None if none was found.
        stone: unknowns of a free pose with the tip in the cell, but not at its centre, from which neighbours may be
            entered, shape (p,); None if none was found.
        tried: number of seeds tried.
        taken: mask of the directions that the tip can have, shape (K,); None for a cell to be entered.
        turned: unknowns of poses with these directions, each of shape (p,).
        gap: largest minimum gap of one of these poses or of the first seed, capped at the largest measured gap [m]; NaN
            for a cell to be entered.
        cpu: CPU time used [s].
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
    """Process one cell of a reach map, and return the result with the CPU time used."""
    begun = time.process_time()
    looker = question.looker
    found = looker.turned(task, question.directions) if task.reached else looker.entered(task, question.width)
    return replace(found, cpu=time.process_time() - begun)


@lru_cache(maxsize=2)  # a worker creates it once for all cells of a map
def _looker(pickled: bytes, settings: ReachSettings) -> "TipLooker":
    problem: Problem = pickle.loads(pickled)  # noqa: S301 - made by this very program
    return _in_plane(problem, settings) if problem.dimension == 2 else _in_space(problem, settings)


@dataclass(frozen=True, eq=False)
class TipLooker:
    """Processor of the cells of a reach map: moves the tip of one arm among fixed obstacles to cells by QP steps.

    Attributes:
        stepper: solver of QP steps.
        start: unknowns of the start pose, shape (p,).
        room: returns the minimum gap of configurations, shape (k, c), beyond radius and clearance, capped at the
            largest measured gap [m].
        drawn: returns unknowns of a random shape, shape (p,).
        seed: seed of the random shapes.
        task: task in space, for an initial motion; None in the plane.
    """

    stepper: StepperOf[Any]
    start: FloatArray
    room: Callable[[FloatArray], float]
    drawn: Callable[[np.random.Generator], FloatArray]
    seed: int
    task: SpaceTask | None = None

    def free(self, pose: Pose) -> bool:
        """Return whether a pose is certified to be free of contact and within all limits."""
        return self.stepper.safe(pose.q, pose.q)

    def entered(self, task: ReachTask, width: float) -> CellFound:
        """Return a pose with the tip at a cell's centre, or else one with the tip in the cell, derived from the seeds.

        In a duct the centres of cells may lie in its walls. So a pose with the tip elsewhere in the cell is used as a
        seed for neighbours, though the cell does not count as reached.

        Args:
            task: the cell to be entered.
            width: width of a cell [m].
        """
        stone: FloatArray | None = None
        for number, seed in enumerate(task.seeds, start=1):
            near = self.stepper.pose(seed)
            # Straight across the face that the cells share, since a duct may lead there, and then to the centre.
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
        """Return which directions the tip can have at a cell's centre, with poses that have them and their largest gap.

        Each direction is tried from the known poses whose tip directions are nearest to it.

        Args:
            task: the reached cell.
            directions: unit vectors, shape (K, d).
        """
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

    def led_from(self, poses: Sequence[Pose], goal: GoalPose, most: int) -> Pose | None:
        """Return a free pose at a goal, reached by steps from the nearest of several poses, or None.

        Args:
            poses: free poses.
            goal: the goal, with a direction.
            most: number of poses from which it is tried.
        """
        unit = self.stepper.space.arm.length
        tips, axes = np.stack([(pose.tip, pose.tip_direction) for pose in poses], axis=1)
        away = np.linalg.norm(tips - goal.position, axis=1) / unit
        ahead = 0.0 if goal.direction is None else axes @ goal.direction
        for number in np.argsort(away - _AHEAD * ahead, kind="stable")[:most]:
            found, _ = self._led(poses[number], goal)
            if found is not None:
                return found
        return None

    def drawn_free(self, count: int) -> Iterator[Pose]:
        """Yield those of a number of randomly sampled poses that are free of contact and within all limits."""
        rng = np.random.default_rng(self.seed)
        for done in range(0, count, _AT_ONCE):
            poses = [self.stepper.pose(self.drawn(rng)) for _ in range(min(_AT_ONCE, count - done))]
            # Each pose is an interval without motion; those between two poses do not matter.
            still = np.repeat([pose.q for pose in poses], 2, axis=0)
            failing = self.stepper.failures(still, 0)
            yield from (pose for k, pose in enumerate(poses) if 2 * k not in failing)

    def _led(self, pose: Pose, goal: GoalPose) -> tuple[Pose | None, Pose]:
        """Return a free pose at a goal, reached by steps from a nearby pose, or None, and the pose after the steps."""
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
    """Return the processor of cells for an arm on a fixed base among walls in the plane.

    Raises:
        UnreachableGoal: the start touches something, or violates a joint limit.
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
    """Return the processor of cells for an arm among surfaces in space."""
    task = space_task(problem, problem.workspace.surface_tree, Deadline.never(), SpaceMotionSettings())
    curve, start = unknowns_through(task.arm, task.start)
    stepper = task.stepper(curve)
    seen = replace(task, wanted_gap=settings.seen * task.arm.length)
    return TipLooker(stepper, start, seen.least_gap, partial(random_unknowns, stepper), task.seed, task)


def _into(middle: FloatArray, width: float, place: FloatArray) -> FloatArray:
    """Return a point in a cell: coordinates outside the cell's range are replaced by the centre's, shape (d,) [m].

    Args:
        middle: centre of the cell, shape (d,) [m].
        width: width of the cell [m].
        place: the point, shape (d,) [m].
    """
    return np.where(np.abs(place - middle) > 0.5 * width, middle, place)


@dataclass(eq=False)
class TipFlood:
    """State of a reach map under construction, and an iterator over the tasks whose results complete the map.

    Iteration stops when all tasks of a wave are given out; it may resume when their results have been added.

    Attributes:
        axes: coordinates of the cells' centres along each axis [m].
        width: width of a cell [m].
        closed: mask of cells that do not count as reached, one array axis per coordinate.
        count: number K of directions that are tried in a cell.
        settings: settings of the search.
        poses: unknowns of a pose in each reached cell, each of shape (p,).
        taken: mask of the directions that the tip can have in each cell, shape (*closed.shape, K).
        gap: largest gap found in each cell [m]; NaN for cells that are not reached.
        cpu: CPU time used for all cells [s].
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
        """Create the first wave from the start, the poses of a motion, and sampled poses, at most one in each cell.

        Args:
            looker: gives the start and samples poses.
            along: unknowns of a motion's poses, shape (N, p); these may lie in regions that the flood fill does not
                reach otherwise.
        """
        for pose in (*map(looker.stepper.pose, (looker.start, *along)), *looker.drawn_free(self.settings.drawn)):
            cell = self._cell_index(pose.tip)
            if cell is not None and cell not in self._stones:
                self._stones[cell] = pose.v
                self._wave.append(ReachTask(cell, self._place(cell), (pose.v,)))

    def add(self, task: ReachTask, found: CellFound) -> None:
        """Record the result for a cell."""
        self.cpu += found.cpu
        self._found[task.cell] = found

    def __iter__(self) -> Iterator[ReachTask]:
        """Return the flood itself."""
        return self

    def __next__(self) -> ReachTask:
        """Return the next task.

        Raises:
            StopIteration: the map is complete, or all tasks of the current wave are given out and results are missing;
                then iteration may resume after these have been added.
        """
        if self._given == len(self._wave) == len(self._found):
            self._next_wave()
        if self._given == len(self._wave):
            raise StopIteration
        task = self._wave[self._given]
        self._given += 1
        return task

    def _next_wave(self) -> None:
        """Record the results of a finished wave, and create the next one.

        As long as there are cells to be entered, the wave consists of these; then directions are tried in the reached
        cells, and the poses found serve as seeds for further cells.
        """
        first = not self._tried
        gained = [task.cell for task in self._wave if self._take(task) or first]
        self._found.clear()
        self._given = 0
        self._wave = self._entering(gained) or self._turning() or self._from_turned()

    def _take(self, task: ReachTask) -> bool:
        """Record a task's result, and return whether its cell has gained a pose that can be a seed for neighbours."""
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
            # The cell does not count as reached, but its pose may be a seed for neighbours.
            if new:
                self._stones[cell] = found.arrived
            return new
        self.poses[cell] = found.arrived
        return True

    def _entering(self, gained: list[Cell]) -> list[ReachTask]:
        """Return tasks of entering the neighbours of cells that have gained a pose, with a seed from each such cell.

        At most as many seeds as a cell has neighbours are tried in it.
        """
        seeds: dict[Cell, list[FloatArray]] = {}
        for cell in gained:
            for other in self._beside(cell):
                left = 2 * len(cell) - self._tried.get(other, 0) - len(seeds.get(other, ()))
                if other not in self.poses and left > 0:
                    pose = self.poses[cell] if cell in self.poses else self._stones[cell]
                    seeds.setdefault(other, []).append(pose)
        return [ReachTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items()]

    def _turning(self) -> list[ReachTask]:
        """Return tasks of trying directions in those reached cells where they have not yet been tried."""
        tasks: list[ReachTask] = []
        for cell in self.poses:
            if cell not in self._turned:
                near = (self.poses[other] for other in self._beside(cell) if other in self.poses)
                tasks.append(ReachTask(cell, self._place(cell), (self.poses[cell], *near), reached=True))
        return tasks

    def _from_turned(self) -> list[ReachTask]:
        """Return tasks to move the tip into unreached cells from poses in neighbouring cells, in other directions."""
        seeds: dict[Cell, list[FloatArray]] = {}
        for cell, poses in self._turned.items():
            if cell not in self._given_on:
                for other in self._beside(cell):
                    if other not in self.poses and not self.closed[other]:
                        seeds.setdefault(other, []).extend(poses)
        self._given_on.update(self._turned)
        return [ReachTask(cell, self._place(cell), tuple(poses)) for cell, poses in seeds.items() if poses]

    def _cell_index(self, place: FloatArray) -> Cell | None:
        """Return the indices of the cell that contains a point, shape (d,) [m]; None outside the grid."""
        low = np.array([middles[0] for middles in self.axes])
        numbers = np.round((place - low) / self.width).astype(int)
        within = np.all(numbers >= 0) and np.all(numbers < self.closed.shape)
        return tuple(numbers.tolist()) if within else None

    def _beside(self, cell: Cell) -> Iterator[Cell]:
        """Yield the indices of the cells of the grid that share a face with a given cell."""
        for axis, size in enumerate(self.closed.shape):
            for step in (1, -1):
                if 0 <= cell[axis] + step < size:
                    yield (*cell[:axis], cell[axis] + step, *cell[axis + 1 :])

    def _place(self, cell: Cell) -> FloatArray:
        return np.array([middles[number] for number, middles in zip(cell, self.axes, strict=True)])
