"""Where the tip of an arm in space can be: a map over a grid of places, with or without directions."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray, IntArray
from ccm_opt.core.executors import Workers
from ccm_opt.core.length_words import file_length
from ccm_opt.core.progress import Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.reach_flood import flooded
from ccm_opt.errors import NoPlanFound, ProblemError
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.space_ends import contact_words
from ccm_opt.planning.space_task import SpaceTask, reach_box
from ccm_opt.planning.tip_cells import SpaceReachQuestion, TipFlood, TipLooker, look_at_cell
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.distances.enclosures import enclosed
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.solution.space_solution import DEFAULT_SPACE_REACH, SpaceReachMap, SpaceReachSettings, even_directions

_MOTION_TIME = 5.0
"""CPU time in which a motion to the goal is sought, whose poses are beginnings [s]. Taste."""


def reach_map_in_space(
    problem: SpaceProblem,
    *,
    step: float | None = None,
    directions: int | None = None,
    workers: Workers | int = 1,
    progress: Callable[[int, int], None] | None = None,
    settings: SpaceReachSettings = DEFAULT_SPACE_REACH,
) -> SpaceReachMap:
    """Map where the tip can be in space, by poses led on from cell to cell; see ``reach_map``.

    The question is static: a pose that keeps the joint limits and touches nothing, wherever the base is on its feed
    axis. Poses begin at the problem's start, at those of a motion to its last goal where one is soon found, and at
    drawn ones. The map is the same whatever the workers.

    Args:
        problem: arm, scene and start.
        step: width of a cell [m]; a share of the arm's length when None.
        directions: how many, evenly over the sphere, are tried in each cell.
        workers: as for ``reach_map``.
        progress: called with the numbers of cells reached and of cells that may be.
        settings: numbers.

    Raises:
        ProblemError: the grid makes no sense, or the start touches something.
    """
    stages = Stages()
    width = settings.step * problem.arm.length if step is None else step
    tried = even_directions(settings.directions if directions is None else directions)
    axes = _axes(problem, width, settings)
    question = SpaceReachQuestion.about(problem, width, tried, settings)
    with stages("proofs"):
        looker, closed = _proved(problem, question, axes)
    flood = TipFlood(axes, width, closed, len(tried), settings)
    with stages("motion"):
        _begin(flood, problem, looker)
    flooded(flood, partial(look_at_cell, question), workers, int(np.sum(~closed)), progress)
    reachable = np.zeros(closed.shape, dtype=bool)
    for cell in flood.poses:
        reachable[cell] = True
    timings = {**stages.timings, "cells": flood.cpu}
    seen = settings.seen * problem.arm.length
    return SpaceReachMap(problem, width, *axes, tried, reachable, flood.taken, flood.gap, closed, seen, timings)


@on_one_thread()
def _proved(
    problem: SpaceProblem, question: SpaceReachQuestion, axes: Sequence[FloatArray]
) -> tuple[TipLooker, BoolArray]:
    """Who looks at cells, and which of them are out of reach.

    Raises:
        ProblemError: the start touches something.
    """
    looker = question.looker
    contact = contact_words(problem, looker.task, looker.task.start)
    if contact:
        raise ProblemError(f"the start is in contact: {contact}")
    return looker, _out_of_reach(problem, looker.task.tree, axes)


@on_one_thread()
def _begin(flood: TipFlood, problem: SpaceProblem, looker: TipLooker) -> None:
    """Begin where the arm is, and where it can be."""
    flood.begin(looker, _unknowns_of_motion(problem, looker.task))


def _unknowns_of_motion(problem: SpaceProblem, task: SpaceTask) -> FloatArray:
    """Keyframes of a motion to the problem's goal, whose tip shows the way through ducts and holes; none without."""
    none = np.zeros((0, CurveMap.through(task.arm, task.start)[0].dimension))
    if not isinstance(problem.goal, TipGoal):
        return none
    try:
        return any_motion(task.deadline_within(_MOTION_TIME)).unknowns
    except NoPlanFound:
        return none


def _axes(
    problem: SpaceProblem, width: float, settings: SpaceReachSettings
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middles of the cells over the part of the room that the arm's length spans.

    Raises:
        ProblemError: the grid makes no sense.
    """
    length = problem.arm.length
    if not 0.0 < width <= 2.0 * length:
        raise ProblemError(f"--step must be above 0 and at most twice the arm's length, got {file_length(width)}")
    low, high = reach_box(problem.arm, problem.workspace.bounds)
    if np.any(high <= low):
        raise ProblemError("no place of the room is within the arm's length of its base")
    counts = [max(1, int(np.ceil(span / width - ROUNDING))) for span in high - low]
    cells = int(np.prod(counts))
    if cells > settings.most_cells:
        raise ProblemError(f"--step {file_length(width)} makes {cells} cells; at most {settings.most_cells} are mapped")
    middle = 0.5 * (low + high)
    x, y, z = (m + width * (np.arange(n) - 0.5 * (n - 1)) for m, n in zip(middle, counts, strict=True))
    return x, y, z


def _out_of_reach(problem: SpaceProblem, tree: SurfaceTree, axes: Sequence[FloatArray]) -> BoolArray:
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
