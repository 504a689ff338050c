"""Where the tip can be, in one cell, and the order in which a map asks its cells."""

import pickle
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import unit_vector, wrap
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.ends import clamped_arm, resolve_ends
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.limits.limit import Limit
from ccm_opt.planning.limits.limit_stack import assembled_limits
from ccm_opt.planning.link_space import NOMINAL_LINKS, LinkSpace
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.pose_over_routes import pose_search, pose_tries
from ccm_opt.planning.settings import MotionSettings
from ccm_opt.planning.step import Stepper
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.contact_finder import ContactFinder


@dataclass(frozen=True)
class ReachSettings:
    """How it is found out where the tip can be.

    Attributes:
        step: width of a cell, as a share of the arm's length, where none is given. Taste.
        headings: headings that are tried in a cell, where no number is given. Taste.
        margin: room that poses keep while they are led on, in nominal links; four tenths of it a pose has to have.
            Taste: cells with less room to any pose of theirs count as not found.
        seen: room that is looked at, as a share of the arm's length; above it gaps are not told apart. Taste.
        settle_steps: most steps onto a place from the cell beside it, before it is asked whether they help. Measured:
            two of three that arrive take no more.
        settle_rounds: how often so many steps are taken. Taste.
        progress: share of the way left that a round may leave, or the place is given up. Taste.
        attempts: neighbours from which a heading is tried in a cell before it counts as not found. Measured: with two a
            map takes a third longer and has one heading in a hundred more.
        motion: of the steps.
    """

    step: float = 1.0 / 16.0
    headings: int = 16
    margin: float = 0.024
    seen: float = 0.05
    settle_steps: int = 6
    settle_rounds: int = 4
    progress: float = 0.5
    attempts: int = 1
    motion: MotionSettings = field(default_factory=MotionSettings)


REACH = ReachSettings()
"""Used where no other settings are given."""


FREE = -1
"""Stands for a heading that the tip takes by itself, beside the numbers of the headings that are tried."""
NEVER = Deadline.never()
"""Tasks are small; who runs them may stop between them."""


@dataclass(frozen=True, eq=False)
class ReachQuestion:
    """What all cells of one map have in common; cheap to pickle.

    Attributes:
        pickled: the problem.
        headings: that are tried, shape (K,) [rad].
        settings: numbers.
    """

    pickled: bytes
    headings: tuple[float, ...]
    settings: ReachSettings

    @classmethod
    def about(cls, problem: Problem, headings: FloatArray, settings: ReachSettings) -> "ReachQuestion":
        """The question for a problem, whose goals say nothing."""
        tip = problem.arm.joint_positions(start_headings(problem))[-1]
        return cls(pickle.dumps(replace(problem, goal=TipGoal(tip), stops=())), tuple(headings.tolist()), settings)


@dataclass(frozen=True, eq=False)
class CellTask:
    """One cell to be looked at.

    Attributes:
        cell: its number.
        place: its middle, (x, y) [m].
        seeds: poses of cells beside it, link headings of shape (links,) [rad], by the number of the tip's heading.
        missing: numbers of the headings that are wanted.
        sought: whether to begin from nothing, by the goal-pose NLP.
    """

    cell: tuple[int, int]
    place: tuple[float, float]
    seeds: Mapping[int, FloatArray]
    missing: frozenset[int]
    sought: bool = False


@dataclass(frozen=True, eq=False)
class CellPoses:
    """What was found in a cell.

    Attributes:
        poses: link headings, each of shape (links,) [rad], by the number of the tip's heading.
        gap: largest gap of any of them [m]; minus infinity when there are none.
        cpu: that it took [s].
    """

    poses: Mapping[int, FloatArray]
    gap: float
    cpu: float = 0.0


def cell_poses(question: ReachQuestion, task: CellTask) -> CellPoses:
    """Poses in a cell with the headings that are wanted, as many as are found."""
    begun = time.process_time()
    explorer = _explorer(question.pickled, question.settings)
    target = np.array(task.place)
    found: dict[int, FloatArray] = {}
    seeds = explorer.sought(target) if task.sought else task.seeds
    for number, near in seeds.items():
        explorer.lead(near, target, number, question.headings, task.missing, found)
    gap = max((explorer.gap(pose) for pose in found.values()), default=-np.inf)
    return CellPoses(found, gap, time.process_time() - begun)


@lru_cache(maxsize=2)  # a worker makes it once for all cells of a map
def _explorer(pickled: bytes, settings: ReachSettings) -> "_Explorer":
    problem = pickle.loads(pickled)  # noqa: S301 - made by this very program
    ends = resolve_ends(problem)
    return _Explorer(problem, clamped_arm(problem.arm) if ends.clamped else problem.arm, ends.clamped, settings)


@dataclass(frozen=True, eq=False)
class _Explorer:
    """Leads poses of one arm among fixed walls from place to place."""

    problem: Problem
    arm: Arm
    clamped: bool
    settings: ReachSettings

    def lead(
        self,
        near: FloatArray,
        target: FloatArray,
        number: int,
        headings: tuple[float, ...],
        missing: frozenset[int],
        found: dict[int, FloatArray],
    ) -> None:
        """Bring a pose to a place with a heading, and turn it there to either side as far as it goes.

        Args:
            near: link headings of a pose with the tip nearby, shape (links,) [rad].
            target: the place, shape (2,) [m].
            number: of the heading to take first, or FREE.
            headings: all of them [rad].
            missing: numbers of those that are wanted.
            found: poses so far, which is added to.
        """
        if number not in found:
            first = self._settled(near, target, None if number == FREE else headings[number])
            if first is None:
                return
            found[number] = first
        begun = found[number]
        middle = number if number != FREE else int(np.argmin(np.abs(_apart(np.array(headings), begun[-1]))))
        for side in (1, -1):
            pose = begun
            offset = 0 if number == FREE and side == 1 else side
            for turn in range(len(headings)):
                following = (middle + offset + side * turn) % len(headings)
                if following in found or following not in missing:
                    break
                turned = self._settled(pose, target, headings[following])
                if turned is None:
                    break
                found[following] = turned
                pose = turned

    def sought(self, target: FloatArray) -> dict[int, FloatArray]:
        """A pose at a place by the goal-pose NLP along the first routes, as a seed; nothing when there is none."""
        try:
            search = pose_search(replace(self.problem, goal=TipGoal(target)))
            for each in pose_tries(search):
                if each.best is not None:
                    return {FREE: each.poses[each.best].headings}
        except NoPlanFound:
            pass
        return {}

    def gap(self, headings: FloatArray) -> float:
        """Room of a pose beyond radius and clearance, as far as it is looked at [m]."""
        return float(self._finder.find(self.arm.joint_positions(headings)).gap.min(initial=self._finder.reach))

    def _settled(self, near: FloatArray, target: FloatArray, heading: float | None) -> FloatArray | None:
        """Link headings with the tip at a place, from a pose nearby; None when something keeps it off."""
        space, v = LinkSpace.through(self.arm, self.arm.bends(near), clamped=self.clamped)
        stepper = Stepper(space, self._limits, self._motion, finder=self._finder)
        goal = GoalPose(target, None if heading is None else unit_vector(heading))
        pose = stepper.pose(v)
        for _ in range(self.settings.settle_rounds):
            try:
                return self.arm.headings(settle(stepper, goal, pose, NEVER)[-1].q)
            except Stalled as stalled:
                # Most of the time goes into places that cannot be reached: who hardly comes nearer is given up.
                if self._left(goal, stalled.poses[-1]) > self.settings.progress * self._left(goal, pose):
                    return None
                pose = stalled.poses[-1]
        return None

    def _left(self, goal: GoalPose, pose: Pose) -> float:
        """How far a pose is from a goal, in nominal links and radians."""
        distance, turn = goal.errors(pose)
        return distance * NOMINAL_LINKS / self.arm.length + turn

    @cached_property
    def _finder(self) -> ContactFinder:
        workspace = self.problem.workspace
        margin = self.settings.margin * self.arm.length / NOMINAL_LINKS
        reach = self.settings.seen * self.arm.length
        return ContactFinder(self.arm, workspace.flat_walls, workspace.clearance, margin, reach)

    @cached_property
    def _limits(self) -> tuple[Limit, ...]:
        certificate = Certificate(self.arm, self.problem.workspace)
        return assembled_limits(self._finder, certificate, self._motion.step)

    @cached_property
    def _motion(self) -> MotionSettings:
        motion = self.settings.motion
        return replace(motion, continuation=replace(motion.continuation, settle_steps=self.settings.settle_steps))


def start_headings(problem: Problem) -> FloatArray:
    """Link headings of a problem's start, shape (links,) [rad]."""
    return problem.start.headings(problem.arm)


def _apart(first: FloatArray, second: float) -> FloatArray:
    """Angles from one heading to others, the short way [rad]."""
    return np.asarray(wrap(first - second))


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
