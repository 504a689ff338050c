"""Where the tip can be and with which headings: a map over a grid of the room, on as many processes as wanted."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import overload

import numpy as np

from ccm_opt.core.arguments import is_number, is_whole
from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray
from ccm_opt.core.executors import Workers
from ccm_opt.core.expected import expect_that
from ccm_opt.core.length_words import file_length, words_in
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.checks import REACH, SUPPLE, TIPS, WAYS, failed
from ccm_opt.driver.calls import expect_arguments
from ccm_opt.driver.reach_flood import Cell, ReachFlood, flooded
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.errors import ProblemError
from ccm_opt.planning.tip_reach import FREE, ReachQuestion, cell_poses, start_headings
from ccm_opt.problem import Problem, TipGoal, Tolerances
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import ReachMap
from ccm_opt.solution.space_solution import SpaceReachMap

PLACE_CHECKS = (TIPS, REACH, SUPPLE)
"""Checks of a place that cost next to nothing; each is a proof."""
EXACTLY = Tolerances(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Width of a cell, middles of columns and rows, and headings."""

    step: float
    x: FloatArray
    y: FloatArray
    headings: FloatArray


@overload
def reach_map(
    problem: Problem,
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
) -> ReachMap: ...


@overload
def reach_map(
    problem: SpaceProblem,
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
) -> SpaceReachMap: ...


def reach_map(
    problem: AnyProblem,
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
) -> ReachMap | SpaceReachMap:
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
    expect_arguments(progress=progress, settings=settings)
    _expect_grid(step, headings, workers)
    if isinstance(problem, SpaceProblem):
        from ccm_opt.driver.reach_mapping_in_space import reach_map_in_space  # noqa: PLC0415 - most are in the plane

        with words_in(problem.length_unit):
            return reach_map_in_space(problem, step=step, directions=headings, workers=workers, progress=progress)
    Problem.expected(problem)
    with words_in(problem.length_unit):
        return _reach_map_in_plane(problem, step, headings, workers, progress, settings or DEFAULT_SETTINGS)


def _reach_map_in_plane(
    problem: Problem,
    step: float | None,
    headings: int | None,
    workers: Workers | int,
    progress: Callable[[int, int], None] | None,
    numbers: Settings,
) -> ReachMap:
    """The same of a problem in the plane."""
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
    width = settings.reach.step * arm.length if step is None else step
    count = settings.reach.headings if headings is None else headings
    if not 0.0 < width <= 2.0 * arm.length:
        raise ProblemError(f"--step must be above 0 and at most twice the arm's length, got {file_length(width)}")
    if count < 1:
        raise ProblemError(f"--headings must be at least 1, got {count}")
    xmin, ymin, xmax, ymax = problem.workspace.boundary.bounds
    axes: list[FloatArray] = []
    for low, high, base in ((xmin, xmax, arm.base[0]), (ymin, ymax, arm.base[1])):
        first = max(low, float(base) - arm.length)
        last = min(high, float(base) + arm.length)
        # As many whole cells as cover all of it, half of what is left over at either side.
        cells = max(1, int(np.ceil((last - first) / width - ROUNDING)))
        middle = 0.5 * (first + last)
        axes.append(np.asarray(middle + width * (np.arange(cells) - 0.5 * (cells - 1)), dtype=np.float64))
    turns: FloatArray = arm.base_heading + 2.0 * np.pi * np.arange(count) / count
    return _Grid(width, axes[0], axes[1], turns)


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
        if not known and failed(_at(problem, (float(x[cell[1]]), float(y[cell[0]]))), (WAYS,)):
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
    return ReachMap(problem, grid.step, x, y, angles, reachable, taken, gap, out, seen, timings)
