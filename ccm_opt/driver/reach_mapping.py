"""Where the tip can be and with which headings: a map over a grid of the room, on as many processes as wanted."""

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
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.reach import spread_directions, supple_enough
from ccm_opt.diagnosis.ways import wide_and_short_enough
from ccm_opt.driver.arguments import expect_arguments
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.planning.ends import contact_words
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.space_task import reach_box
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
from ccm_opt.scene.distances.enclosures import enclosed
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_MOTION_TIME = 5.0
"""CPU time in which a motion to the goal is sought, whose poses are beginnings in space [s]. Taste."""
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
    """Map where the tip can be in the room, and with which headings, by poses led on from cell to cell.

    The question is static: a pose that keeps the joint limits and touches nothing. The first poses are the problem's
    start, drawn ones, and in space those of a motion to its last goal where one is soon found. That no pose was found
    in a cell is no proof, unless the map says so.

    Args:
        problem: arm, room and start; in the plane the base stands still.
        step: width of a cell [m]; a share of the arm's length when None.
        headings: how many, evenly round the turn, are tried in each cell; in space directions, evenly over the sphere.
        workers: number of processes of this machine, or an object that opens an executor, such as ``DaskWorkers``;
            the map is the same whatever they are.
        progress: called after every task with the numbers of cells reached and of cells that may be.
        settings: numbers; the defaults when None.

    Raises:
        ProblemError: the base moves, or the grid makes no sense.
        UnreachableGoal: the start touches something or breaks a joint limit.
    """
    Problem.expected(problem)
    expect_arguments(progress=progress, settings=settings)
    _expect_grid(step, headings, workers)
    numbers = (settings or DEFAULT_SETTINGS).reach
    arm = problem.arm
    plane = problem.dimension == 2
    if plane and arm.base_axes:
        raise ProblemError("the base is on a feed axis; where the tip can be is mapped for a base that stands still")
    stages = Stages()
    with words_in(problem.length_unit):
        width = _width(problem, numbers.step if plane else numbers.step_in_space, step)
        axes = _axes(problem, width, numbers)
        angles, directions = _directions(problem, headings, numbers)
        question = ReachQuestion.about(problem, width, directions, numbers)
        with stages("proofs"):
            looker, closed = _proved(problem, question, axes)
        flood = TipFlood(axes, width, closed, len(directions), numbers)
        with stages("motion"):
            _begin(flood, problem, looker)
        _flood(flood, partial(look_at_cell, question), workers, progress)
        reachable = np.zeros(closed.shape, dtype=bool)
        for cell in flood.poses:
            reachable[cell] = True
        if plane:
            with stages("proofs"):
                closed = closed | _behind_walls(problem, axes, ~reachable & ~closed)
    found: list[Any] = [reachable, flood.taken, flood.gap, closed]
    if plane:
        # Rows are y, columns x.
        found = [np.swapaxes(each, 0, 1) for each in found]
    tried = np.zeros((0, 2)) if plane else directions
    timings = {**stages.timings, "cells": flood.cpu}
    free, taken, gap, proved = found
    seen = numbers.seen * arm.length
    return ReachMap(problem, width, axes, angles, tried, free, taken, gap, proved, seen, timings)


def _flood(
    flood: TipFlood,
    look: Callable[[ReachTask], CellFound],
    workers: Workers | int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Look at all cells that a flood hands out, on workers or on so many processes of this machine.

    Raises:
        BaseException: what looking at a cell raised.
    """
    crew = workers if not isinstance(workers, int) else ThisProcess() if workers == 1 else LocalWorkers(workers)
    for task, found in completed(crew, look, flood):
        if isinstance(found, BaseException):
            raise found
        flood.add(task, found)
        if progress is not None:
            progress(len(flood.poses), int(np.sum(~flood.closed)))


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


def _width(problem: Problem, usual: float, step: float | None) -> float:
    """Return the width of a cell [m]: the one that is asked for, or the usual share of the arm's length.

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


def _axes(problem: Problem, width: float, settings: ReachSettings) -> tuple[FloatArray, ...]:
    """Return the middles of the cells over the part of the room that the arm's length spans.

    Raises:
        ProblemError: the grid makes no sense.
    """
    low, high = reach_box(problem.arm, problem.workspace.box)
    if np.any(high <= low):
        raise ProblemError("no place of the room is within the arm's length of its base")
    axes = _middles(low, high, width)
    cells = int(np.prod([len(each) for each in axes]))
    if cells > settings.most_cells:
        raise ProblemError(f"--step {file_length(width)} makes {cells} cells; at most {settings.most_cells} are mapped")
    return tuple(axes)


def _directions(problem: Problem, asked: int | None, settings: ReachSettings) -> tuple[FloatArray, FloatArray]:
    """Headings in the plane, evenly round the turn (K,) [rad], and unit vectors, in space over the sphere (K, d).

    Raises:
        ProblemError: none are asked for in the plane.
    """
    if problem.dimension == 3:
        return np.zeros(0), spread_directions(settings.directions if asked is None else asked, 3)
    count = settings.headings if asked is None else asked
    if count < 1:
        raise ProblemError(f"--headings must be at least 1, got {count}")
    angles: FloatArray = problem.arm.base_heading + 2.0 * np.pi * np.arange(count) / count
    return angles, np.column_stack((np.cos(angles), np.sin(angles)))


@on_one_thread()
def _proved(problem: Problem, question: ReachQuestion, axes: Sequence[FloatArray]) -> tuple[TipLooker, BoolArray]:
    """Return who looks at cells, and which of them are out of reach.

    Raises:
        ProblemError: the start touches something.
        UnreachableGoal: likewise in the plane.
    """
    looker = question.looker
    if looker.task is not None:
        contact = contact_words(problem, looker.task, looker.task.start)
        if contact:
            raise ProblemError(f"the start is in contact: {contact}")
    return looker, _unreachable_cells(problem, axes)


@on_one_thread()
def _begin(flood: TipFlood, problem: Problem, looker: TipLooker) -> None:
    """Begin where the arm is, where it can be, and on a motion whose tip shows the way through ducts and holes."""
    along = np.zeros((0, len(looker.start)))
    if looker.task is not None and problem.goal.whole(problem.arm) is None:
        with suppress(NoPlanFound):
            along = any_motion(looker.task.deadline_within(_MOTION_TIME)).unknowns
    flood.begin(looker, along)


def _unreachable_cells(problem: Problem, axes: Sequence[FloatArray]) -> BoolArray:
    """Return the cells to whose middles the tip cannot come.

    They are too far away, in a body, outside of the room, too near to one of them, or where the joints cannot turn to.
    """
    arm = problem.arm
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    flat = places.reshape(-1, problem.dimension)
    low, high = arm.base_range
    along = np.clip((flat - arm.base) @ arm.direction, low, high) if arm.base_axes else np.zeros(len(flat))
    away = np.linalg.norm(flat - arm.base - along[:, None] * arm.direction, axis=1)
    closed = away > arm.length
    kept = arm.radius + problem.workspace.clearance
    if kept > 0.0 and len(problem.workspace.soup):
        # Where the mount reaches to the tip, the tip may touch what it stands on.
        points = np.repeat(in_space(flat)[:, None], 2, axis=1)
        tree = SurfaceTree.of(problem.workspace.soup)
        closed |= (tree.distances(points, 2.0 * kept) < kept) & (arm.mount_length < arm.length)
    for some in _parts(np.flatnonzero(~closed)):
        closed[some[enclosed(problem.workspace, flat[some])]] = True
    for number in np.flatnonzero(~closed):
        closed[number] = any(finding.proved for finding in supple_enough(_at(problem, flat[number])))
    return np.asarray(closed.reshape(places.shape[:-1]))


def _parts(numbers: IntArray) -> Iterator[IntArray]:
    """Yield the numbers a thousand at a time, so that intermediate arrays stay small."""
    yield from np.array_split(numbers, max(len(numbers) // 1000, 1))


def _behind_walls(problem: Problem, axes: Sequence[FloatArray], unknown: BoolArray) -> BoolArray:
    """Of cells of which nothing is known those to which every way through free space is too narrow or too long."""
    closed = np.zeros_like(unknown)
    for cell in np.argwhere(unknown):
        place = np.array([middles[number] for middles, number in zip(axes, cell, strict=True)])
        closed[tuple(cell)] = bool(failed(_at(problem, place), (wide_and_short_enough,)))
    return closed


def _at(problem: Problem, place: FloatArray) -> Problem:
    """Return the problem of bringing the tip to a place."""
    return replace(problem, goal=TipGoal(place), tolerances=_EXACTLY, stops=())
