"""Reachability maps: positions and headings that the tip can reach, on a grid, computed by several processes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ccm_opt.core.arguments import expect_that, is_number, is_whole
from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray, IntArray, in_space
from ccm_opt.core.errors import NoPlanFound, ProblemError
from ccm_opt.core.executors import LocalWorkers, ThisProcess, Workers, completed
from ccm_opt.core.length_words import file_length, words_in
from ccm_opt.core.progress import Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.axis_paths import axis_path_exists
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.reach import spread_directions, within_bend_limits
from ccm_opt.driver.arguments import expect_arguments, expect_workers
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.planning.ends import contact_words
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.space_task import reach_box
from ccm_opt.planning.stand_in import stand_in
from ccm_opt.planning.tip_reach import (
    CellFound,
    ReachQuestion,
    ReachSettings,
    ReachTask,
    TipFlood,
    TipLooker,
    look_at_cell,
)
from ccm_opt.problem import Problem, TipGoal, Tolerances
from ccm_opt.problem.solution import ReachMap
from ccm_opt.robot.tool import in_link
from ccm_opt.scene.distances.enclosures import enclosed

_MOTION_TIME = 5.0
"""CPU time limit of the search for a motion to the goal, whose poses are initial poses of a map in space [s].
Heuristic."""
_EXACTLY = Tolerances(0.0, 0.0)


def reach_map(
    problem: Problem,
    *,
    step: float | None = None,
    headings: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
) -> ReachMap:
    """Return a map of the tip positions and headings that an arm can reach, found by poses continued cell by cell.

    A cell counts as reachable if a collision-free pose within the joint limits has the tip at its centre; motions to
    the pose are not considered. Initial poses are the start, sampled poses and, in space, those of a motion to the last
    goal if one is found quickly. A cell without a pose is proved unreachable only where the map says so.

    Args:
        problem: problem with arm, workspace and start.
        step: width of a grid cell [m]; None for a fraction of the arm's length.
        headings: number of headings tried in each cell, evenly spaced over a full turn; in space the number of
            directions, evenly spaced over the sphere.
        workers: number of processes on this machine, or an object that opens an executor, such as ``DaskWorkers``. The
            map is the same for any choice.
        progress: function called after every task, with the number of cells reached and that of cells not proved
            unreachable.
        settings: settings of all stages of planning; None for the defaults.

    Raises:
        ProblemError: the grid is invalid, or the start in space is in contact.
        UnreachableGoal: the start in the plane is in contact, or the start exceeds a joint limit.
    """
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings)
    _expect_grid(step, headings, workers)
    numbers = (settings or DEFAULT_SETTINGS).reach
    plane = problem.dimension == 2
    stages = Stages()
    with words_in(problem.length_unit):
        width = _width(problem, numbers.step if plane else numbers.step_in_space, step)
        angles, directions = _directions(problem, headings, numbers)
        whole = stand_in(problem)
        flat = whole.dimension > problem.dimension
        axes = _axes(whole, width, numbers, flat=flat)
        question = ReachQuestion.about(
            whole, width, np.stack(list(map(in_link, directions))) if flat else directions, numbers
        )
        with stages("proofs"):
            looker, closed = _proved(whole, question, axes)
        flood = TipFlood(axes, width, closed, len(directions), numbers)
        with stages("motion"):
            _begin(flood, whole, looker)
        _flood(flood, partial(look_at_cell, question), workers, progress)
        reachable = np.zeros(closed.shape, dtype=bool)
        for cell in flood.poses:
            reachable[cell] = True
        if plane and not flat:
            with stages("proofs"):
                closed = closed | _behind_walls(whole, axes, ~reachable & ~closed)
    found: list[Any] = [reachable, flood.taken, flood.gap, closed]
    if flat:
        axes = (axes[0], axes[2])
        found = [each[:, 0] for each in found]
    if plane:
        # Planar maps are stored with y as rows and x as columns.
        found = [np.swapaxes(each, 0, 1) for each in found]
    tried = np.zeros((0, 2)) if plane else directions
    timings = {**stages.timings, "cells": flood.cpu}
    free, taken, gap, proved = found
    seen = numbers.seen * whole.arm.length
    return ReachMap(problem, width, axes, angles, tried, free, taken, gap, proved, seen, timings)


def _flood(
    flood: TipFlood,
    look: Callable[[ReachTask], CellFound],
    workers: Workers | int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Search all grid cells by a flood fill, on several processes, and add the results to the flood fill.

    Args:
        flood: the flood fill, which yields tasks and receives their results.
        look: function that searches the cells of one task.
        workers: number of processes, or an object that opens an executor.
        progress: function called after every task with two numbers of cells, see ``reach_map``; None for none.

    Raises:
        BaseException: the search of a cell raised it.
    """
    crew = workers if not isinstance(workers, int) else ThisProcess() if workers == 1 else LocalWorkers(workers)
    for task, found in completed(crew, look, flood):
        if isinstance(found, BaseException):
            raise found
        flood.add(task, found)
        if progress is not None:
            progress(len(flood.poses), int(np.sum(~flood.closed)))


def _expect_grid(step: object, headings: object, workers: object) -> None:
    """Raise an error for an invalid cell width, number of headings, or value of ``workers``.

    Raises:
        ProblemError: an argument is invalid; the message says what is expected.
    """
    expect_that(lambda: step is None or is_number(step), step, "a cell width [m] for step=")
    expect_that(lambda: headings is None or is_whole(headings), headings, "a whole number for headings=")
    expect_workers(workers)


def _width(problem: Problem, usual: float, step: float | None) -> float:
    """Return the width of a grid cell [m].

    Args:
        problem: the problem, which gives the arm's length.
        usual: default width, as a fraction of the arm's length.
        step: requested width [m]; None for the default.

    Raises:
        ProblemError: the width is not positive, or exceeds twice the arm's length.
    """
    length = problem.arm.length
    width = usual * length if step is None else step
    if not 0.0 < width <= 2.0 * length:
        raise ProblemError(f"--step must be above 0 and at most twice the arm's length, got {file_length(width)}")
    return width


def _middles(low: FloatArray, high: FloatArray, width: float) -> list[FloatArray]:
    """Return the centres along every axis of the fewest grid cells that cover a box, with the grid centred on the box.

    Args:
        low: lower corner of the box, shape (d,) with d = 2 or 3 [m].
        high: upper corner, shape (d,) [m].
        width: width of a cell [m].
    """
    counts = np.maximum(1, np.ceil((high - low) / width - ROUNDING).astype(int))
    middle = 0.5 * (low + high)
    return [m + width * (np.arange(n) - 0.5 * (n - 1)) for m, n in zip(middle, counts, strict=True)]


def _axes(problem: Problem, width: float, settings: ReachSettings, *, flat: bool) -> tuple[FloatArray, ...]:
    """Return the coordinates of grid-cell centres along each axis, one array per axis [m].

    The grid covers the part of the workspace within the arm's reach; a flat one in space is in the x-z plane alone.

    Raises:
        ProblemError: no position is within reach, or there are too many cells.
    """
    low, high = reach_box(problem.arm, problem.workspace.box)
    if np.any(high <= low):
        raise ProblemError(
            "no point of the workspace is within the arm's length of its base; check arm.base and the bounds"
        )
    if flat:
        low[1] = high[1] = 0.0
    axes = _middles(low, high, width)
    cells = int(np.prod([len(each) for each in axes]))
    if cells > settings.most_cells:
        raise ProblemError(
            f"--step {file_length(width)} makes {cells} cells; at most {settings.most_cells} are mapped; raise --step"
        )
    return tuple(axes)


def _directions(problem: Problem, requested: int | None, settings: ReachSettings) -> tuple[FloatArray, FloatArray]:
    """Return the K directions of the last link that are tried in every cell of a reachability map.

    Args:
        problem: the problem.
        requested: requested number K; None for the default.
        settings: settings, which give the default.

    Returns:
        Headings, shape (K,), empty in space [rad]; and unit vectors, shape (K, d) with d = 2 or 3, evenly spaced over
        a full turn, in space over the sphere.

    Raises:
        ProblemError: fewer than one heading is requested in the plane.
    """
    if problem.dimension == 3:
        return np.zeros(0), spread_directions(settings.directions if requested is None else requested, 3)
    count = settings.headings if requested is None else requested
    if count < 1:
        raise ProblemError(f"--headings must be at least 1, got {count}")
    angles: FloatArray = problem.arm.base_heading + 2.0 * np.pi * np.arange(count) / count
    return angles, np.column_stack((np.cos(angles), np.sin(angles)))


@on_one_thread()
def _proved(problem: Problem, question: ReachQuestion, axes: Sequence[FloatArray]) -> tuple[TipLooker, BoolArray]:
    """Return the object that searches grid cells, and a mask of the cells proved unreachable, in the shape of the grid.

    Raises:
        ProblemError: the start in space is in contact.
        UnreachableGoal: the start in the plane is in contact.
    """
    looker = question.looker
    if looker.task is not None:
        contact = contact_words(problem, looker.task, looker.task.start)
        if contact:
            raise ProblemError(f"the start is in contact: {contact}")
    return looker, unreachable_cells(problem, axes)


@on_one_thread()
def _begin(flood: TipFlood, problem: Problem, looker: TipLooker) -> None:
    """Give a flood fill its initial poses: start, sampled poses, and poses of a motion through narrow passages."""
    along = np.zeros((0, len(looker.start)))
    if looker.task is not None and problem.goal.whole(problem.arm) is None:
        with suppress(NoPlanFound):
            along = any_motion(looker.task.deadline_within(_MOTION_TIME)).unknowns
    flood.begin(looker, along)


def unreachable_cells(problem: Problem, axes: Sequence[FloatArray]) -> BoolArray:
    """Return a mask, in the shape of the grid, of the cells whose centres the tip is proved not to reach.

    Such a centre is farther from all positions of the base than the arm's length, inside an obstacle, outside the
    workspace, closer to a surface than radius plus required clearance, or out of reach within the joint limits.
    """
    arm = problem.arm
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    flat = places.reshape(-1, problem.dimension)
    low, high = arm.base_range
    along = np.clip((flat - arm.base) @ arm.direction, low, high) if arm.feed else np.zeros(len(flat))
    away = np.linalg.norm(flat - arm.base - along[:, None] * arm.direction, axis=1)
    closed = away > arm.length + (0.0 if arm.feed else arm.base_travel)
    if arm.tool_links is not None and arm.tool_links.bare[-1]:
        return np.asarray(closed.reshape(places.shape[:-1]))  # the tip is beside its body
    kept = arm.tip_radius + problem.workspace.clearance
    if kept > 0.0 and len(problem.workspace.triangle_soup):
        # If the mount reaches to the tip, the tip may touch the surface that the arm is mounted on.
        points = np.repeat(in_space(flat)[:, None], 2, axis=1)
        tree = problem.workspace.surface_tree
        closed |= (tree.distances(points, 2.0 * kept) < kept) & (arm.mount_length < arm.length)
    for part in _parts(np.flatnonzero(~closed)):
        closed[part[enclosed(problem.workspace, flat[part], arm.tip_radius)]] = True
    # The proof by the limits of bends takes all links to be equal.
    for number in np.flatnonzero(~closed) if arm.proportions is None else ():
        closed[number] = any(finding.proved for finding in within_bend_limits(_at(problem, flat[number])))
    return np.asarray(closed.reshape(places.shape[:-1]))


def _parts(numbers: IntArray) -> Iterator[IntArray]:
    """Yield the given indices of cells in batches of about a thousand, so that intermediate arrays stay small."""
    yield from np.array_split(numbers, max(len(numbers) // 1000, 1))


def _behind_walls(problem: Problem, axes: Sequence[FloatArray], unknown: BoolArray) -> BoolArray:
    """Return a mask, in the shape of the grid, of undecided cells that are proved unreachable.

    Every path through free space to such a cell is too narrow for the arm or too long.

    Args:
        problem: the problem.
        axes: centres of the cells along every axis [m].
        unknown: mask of the undecided cells.
    """
    closed = np.zeros_like(unknown)
    for cell in np.argwhere(unknown):
        place = np.array([middles[number] for middles, number in zip(axes, cell, strict=True)])
        closed[tuple(cell)] = bool(failed(_at(problem, place), (axis_path_exists,)))
    return closed


def _at(problem: Problem, place: FloatArray) -> Problem:
    """Return the problem with a goal for the tip at a given position, with zero tolerance and no intermediate goals."""
    return replace(problem, goal=TipGoal(place), tolerances=_EXACTLY, stops=())
