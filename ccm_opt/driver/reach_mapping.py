"""Where the tip can be and with which headings: a map over a grid of the room, on as many processes as wanted."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, TypeVar

import numpy as np

from ccm_opt.core.arguments import expect_that, is_number, is_whole
from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray, IntArray
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.core.executors import LocalWorkers, ThisProcess, Workers, completed
from ccm_opt.core.length_words import file_length, words_in
from ccm_opt.core.progress import Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.reach import supple_enough, within_reach
from ccm_opt.diagnosis.ways import wide_and_short_enough
from ccm_opt.driver.arguments import expect_arguments
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.ends import contact_words
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.space_task import SpaceTask, reach_box
from ccm_opt.planning.tip_cells import (
    SpaceReachQuestion,
    SpaceReachSettings,
    TipFlood,
    TipLooker,
    even_directions,
    look_at_cell,
)
from ccm_opt.planning.tip_reach import FREE, Cell, ReachFlood, ReachQuestion, cell_poses, start_headings
from ccm_opt.problem import Problem, TipGoal, Tolerances
from ccm_opt.problem.solution import ReachMap
from ccm_opt.scene.distances.enclosures import enclosed
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_MOTION_TIME = 5.0
"""CPU time in which a motion to the goal is sought, whose poses are beginnings in space [s]. Taste."""

PLACE_CHECKS = (contact_at_tips, within_reach, supple_enough)
"""Checks of a place that cost next to nothing; each is a proof."""
EXACTLY = Tolerances(0.0, 0.0)


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


@dataclass(frozen=True, eq=False)
class _Grid:
    """Width of a cell, middles of columns and rows, and headings."""

    step: float
    x: FloatArray
    y: FloatArray
    headings: FloatArray


def reach_map(
    problem: Problem,
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
) -> ReachMap:
    """Map where the tip can be in the room, and with which headings, by poses led on from cell to cell.

    The question is static: a pose that keeps the joint limits and touches nothing. The problem's goals are not looked
    at; its start is the first pose. That no pose was found in a cell is no proof, unless the map says so.

    Args:
        problem: arm, room and start; in the plane the base stands still.
        step: width of a cell [m]; a share of the arm's length when None.
        headings: how many, evenly round the turn, are tried in each cell; in space directions, evenly over the sphere.
        workers: number of processes of this machine, or an object that opens an executor, such as ``DaskWorkers``;
            in space the map is the same whatever they are.
        progress: called after every task with the numbers of cells reached and of cells that may be.
        settings: numbers; the defaults when None.

    Raises:
        ProblemError: the base moves, or the grid makes no sense.
        UnreachableGoal: the start touches something or breaks a joint limit.
    """
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings)
    _expect_grid(step, headings, workers)
    numbers = settings or DEFAULT_SETTINGS
    with words_in(problem.length_unit):
        if problem.dimension == 3:
            return _mapped_in_space(problem, step, headings, workers, progress, numbers.space_reach)
        return _mapped_in_plane(problem, step, headings, workers, progress, numbers)


def _mapped_in_plane(
    problem: Problem,
    step: float | None,
    headings: int | None,
    workers: Workers | int,
    progress: Callable[[int, int], None] | None,
    numbers: Settings,
) -> ReachMap:
    """The map of a problem in the plane, by poses led on from cell to cell."""
    stages = Stages()
    grid = _grid(problem, step, headings, numbers)
    x = grid.x
    y = grid.y
    with stages("proofs"):
        closed = frozenset(_out_of_reach(problem, x, y))
    flood = ReachFlood(x, y, len(grid.headings), closed, numbers.reach)
    question = ReachQuestion.about(problem, grid.headings, numbers.reach)
    open_cells = len(x) * len(y) - len(closed)
    with stages("cells"):
        flood.begin(_start_cell(problem, x, y, closed), start_headings(problem))
        flooded(flood, partial(cell_poses, question), workers, open_cells, progress)
    with stages("proofs"):
        blocked = closed | frozenset(_behind_walls(problem, x, y, flood))
    timings = {**stages.timings, "cells": flood.cpu}
    return _map(problem, grid, flood, blocked, timings, numbers)


def _expect_grid(step: object, headings: object, workers: object) -> None:
    """Refuse what is no width of a cell, no number of headings, or nobody who looks at cells.

    Raises:
        ProblemError: saying what was expected.
    """
    expect_that(lambda: step is None or is_number(step), step, "the width of a cell [m] for step=")
    expect_that(lambda: headings is None or is_whole(headings), headings, "a whole number for headings=")
    several = is_whole(workers) and workers >= 1
    opens = callable(getattr(workers, "open", None)) and not isinstance(workers, type)
    expect_that(lambda: several or opens, workers, "a number of processes from 1, or ccm_opt workers, for workers=")


def _grid(problem: Problem, step: float | None, headings: int | None, settings: Settings) -> _Grid:
    """Middles of columns and rows over the part of the room that the arm's length spans, and headings.

    Raises:
        ProblemError: the base moves, or the grid makes no sense.
    """
    arm = problem.arm
    if arm.base_axes:
        raise ProblemError("the base is on a feed axis; where the tip can be is mapped for a base that stands still")
    width = _width(problem, settings.reach.step, step)
    count = settings.reach.headings if headings is None else headings
    if count < 1:
        raise ProblemError(f"--headings must be at least 1, got {count}")
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    low = np.maximum((xmin, ymin), arm.base - arm.length)
    high = np.minimum((xmax, ymax), arm.base + arm.length)
    x, y = _middles(low, high, width)
    turns: FloatArray = arm.base_heading + 2.0 * np.pi * np.arange(count) / count
    return _Grid(width, x, y, turns)


def _width(problem: Problem, usual: float, step: float | None) -> float:
    """The width of a cell [m]: the one that is asked for, or the usual share of the arm's length.

    Raises:
        ProblemError: it makes no sense.
    """
    length = problem.arm.length
    width = usual * length if step is None else step
    if not 0.0 < width <= 2.0 * length:
        raise ProblemError(f"--step must be above 0 and at most twice the arm's length, got {file_length(width)}")
    return width


def _middles(low: FloatArray, high: FloatArray, width: float) -> list[FloatArray]:
    """Middles of cells along every axis, as many as cover all of a box, half of what is left over at either side."""
    counts = np.maximum(1, np.ceil((high - low) / width - ROUNDING).astype(int))
    middle = 0.5 * (low + high)
    return [m + width * (np.arange(n) - 0.5 * (n - 1)) for m, n in zip(middle, counts, strict=True)]


def _at(problem: Problem, place: tuple[float, float]) -> Problem:
    """The problem of bringing the tip to a place."""
    return replace(problem, goal=TipGoal(np.array(place)), tolerances=EXACTLY, stops=())


def _out_of_reach(problem: Problem, x: FloatArray, y: FloatArray) -> Iterator[Cell]:
    """Cells to whose middles the tip cannot come for a reason that is found at once."""
    for row, column in np.ndindex(len(y), len(x)):
        if failed(_at(problem, (float(x[column]), float(y[row]))), PLACE_CHECKS):
            yield row, column


def _behind_walls(problem: Problem, x: FloatArray, y: FloatArray, flood: ReachFlood) -> Iterator[Cell]:
    """Cells without a pose to which every way through free space is too narrow or too long."""
    for cell in np.ndindex(len(y), len(x)):
        known = cell in flood.poses or cell in flood.closed
        if not known and failed(_at(problem, (float(x[cell[1]]), float(y[cell[0]]))), (wide_and_short_enough,)):
            yield cell


def _start_cell(problem: Problem, x: FloatArray, y: FloatArray, closed: frozenset[Cell]) -> Cell:
    """The cell whose middle is nearest to the tip in the start, of those that may be reached.

    Raises:
        ProblemError: there is none.
    """
    tip = problem.arm.joint_positions(start_headings(problem))[-1]
    apart = np.hypot(x[None, :] - tip[0], y[:, None] - tip[1])
    for cell in closed:
        apart[cell] = np.inf
    row, column = np.unravel_index(int(np.argmin(apart)), apart.shape)
    if not np.isfinite(apart[row, column]):
        raise ProblemError("no cell of the grid can be reached; give a smaller --step")
    return int(row), int(column)


def _map(
    problem: Problem,
    grid: _Grid,
    flood: ReachFlood,
    proved: frozenset[Cell],
    timings: Mapping[str, float],
    settings: Settings,
) -> ReachMap:
    """The map as arrays."""
    x = grid.x
    y = grid.y
    angles = grid.headings
    shape = (len(y), len(x))
    taken = np.zeros((*shape, len(angles)), dtype=bool)
    reachable: BoolArray = np.zeros(shape, dtype=bool)
    gap = np.full(shape, np.nan)
    out: BoolArray = np.zeros(shape, dtype=bool)
    for cell, poses in flood.poses.items():
        reachable[cell] = True
        gap[cell] = flood.gaps[cell]
        taken[cell][[number for number in poses if number != FREE]] = True
    for cell in proved:
        out[cell] = True
    seen = settings.reach.seen * problem.arm.length
    return ReachMap(problem, grid.step, (x, y), angles, np.zeros((0, 2)), reachable, taken, gap, out, seen, timings)


def _mapped_in_space(
    problem: Problem,
    step: float | None,
    directions: int | None,
    workers: Workers | int,
    progress: Callable[[int, int], None] | None,
    settings: SpaceReachSettings,
) -> ReachMap:
    """The map of a problem in space, wherever the base is on its feed axis.

    Poses begin at the problem's start, at those of a motion to its last goal where one is soon found, and at drawn
    ones.

    Raises:
        ProblemError: the grid makes no sense, or the start touches something.
    """
    stages = Stages()
    width = _width(problem, settings.step, step)
    tried = even_directions(settings.directions if directions is None else directions)
    x, y, z = axes = _axes(problem, width, settings)
    question = SpaceReachQuestion.about(problem, width, tried, settings)
    with stages("proofs"):
        looker, closed = _proved(problem, question, axes)
    flood = TipFlood((x, y, z), width, closed, len(tried), settings)
    with stages("motion"):
        _begin(flood, problem, looker)
    flooded(flood, partial(look_at_cell, question), workers, int(np.sum(~closed)), progress)
    reachable = np.zeros(closed.shape, dtype=bool)
    for cell in flood.poses:
        reachable[cell] = True
    timings = {**stages.timings, "cells": flood.cpu}
    seen = settings.seen * problem.arm.length
    return ReachMap(
        problem, width, (x, y, z), np.zeros(0), tried, reachable, flood.taken, flood.gap, closed, seen, timings
    )


@on_one_thread()
def _proved(problem: Problem, question: SpaceReachQuestion, axes: Sequence[FloatArray]) -> tuple[TipLooker, BoolArray]:
    """Who looks at cells, and which of them are out of reach.

    Raises:
        ProblemError: the start touches something.
    """
    looker = question.looker
    contact = contact_words(problem, looker.task, looker.task.start)
    if contact:
        raise ProblemError(f"the start is in contact: {contact}")
    return looker, _out_of_reach_in_space(problem, looker.task.tree, axes)


@on_one_thread()
def _begin(flood: TipFlood, problem: Problem, looker: TipLooker) -> None:
    """Begin where the arm is, and where it can be."""
    flood.begin(looker, _unknowns_of_motion(problem, looker.task))


def _unknowns_of_motion(problem: Problem, task: SpaceTask) -> FloatArray:
    """Keyframes of a motion to the problem's goal, whose tip shows the way through ducts and holes; none without."""
    none = np.zeros((0, CurveMap.through(task.arm, task.start)[0].dimension))
    if problem.goal.whole(problem.arm) is not None:
        return none
    try:
        return any_motion(task.deadline_within(_MOTION_TIME)).unknowns
    except NoPlanFound:
        return none


def _axes(problem: Problem, width: float, settings: SpaceReachSettings) -> list[FloatArray]:
    """Middles of the cells over the part of the room that the arm's length spans.

    Raises:
        ProblemError: the grid makes no sense.
    """
    low, high = reach_box(problem.arm, problem.workspace.bounds)
    if np.any(high <= low):
        raise ProblemError("no place of the room is within the arm's length of its base")
    axes = _middles(low, high, width)
    cells = int(np.prod([len(each) for each in axes]))
    if cells > settings.most_cells:
        raise ProblemError(f"--step {file_length(width)} makes {cells} cells; at most {settings.most_cells} are mapped")
    return axes


def _out_of_reach_in_space(problem: Problem, tree: SurfaceTree, axes: Sequence[FloatArray]) -> BoolArray:
    """Cells to whose middles the tip cannot come: too far away, in a body, outside of the room, or too near to one."""
    arm = problem.arm
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    flat = places.reshape(-1, 3)
    low, high = arm.base_range
    along = np.clip((flat - arm.base) @ arm.direction, low, high) if arm.base_axes else np.zeros(len(flat))
    away = np.linalg.norm(flat - arm.base - along[:, None] * arm.direction, axis=1)
    closed = away > arm.length
    kept = arm.radius + problem.workspace.clearance
    if kept > 0.0 and len(problem.workspace.soup):
        # Where the mount reaches to the tip, the tip may touch what it stands on.
        points = np.repeat(flat[:, None], 2, axis=1)
        closed |= (tree.distances(points, 2.0 * kept) < kept) & (arm.mount_length < arm.length)
    for some in _parts(np.flatnonzero(~closed)):
        closed[some[enclosed(problem.workspace, flat[some])]] = True
    return np.asarray(closed.reshape(places.shape[:-1]))


def _parts(numbers: IntArray) -> Iterator[IntArray]:
    """Numbers a thousand at a time, so that intermediate arrays stay small."""
    yield from np.array_split(numbers, max(len(numbers) // 1000, 1))
