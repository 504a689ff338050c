"""Hill climbing over curvature operators (section 3.1): steepest, or the first improvement."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.operators import Moves
from ccm_opt.hill_climbing.world import World

Objective: TypeAlias = Callable[[Shapes], FloatArray]
"""Distance of each configuration of a batch, shape (m,)."""
LEAST_GAIN = 1e-4
"""A move counts as an improvement when it takes away at least this share of the distance."""
WORTH_PUSHING = 0.02
"""The same while walls push: then the climb is not drawn out for the sake of the push."""
EASING = 0.3
"""Where push and distance balance, the push eases by this factor, as the weight of a barrier does."""
LEAST_PUSH = 1e-6
"""Weights of crowding below it are dropped."""
TRIED_AT_ONCE = 4
"""Candidates asked of the world in the first go, best first; as long as all are refused, ever more at once."""
GROWTH = 3
"""Factor from go to go: asking for one costs nearly as much as asking for ten."""
MOST_TRIED = 96
"""Improving candidates asked in all before the climb counts as blocked."""
HEADWAY = 0.2
"""A climb makes headway when it has taken away this share of the distance, which is a square."""


class Strategy(StrEnum):
    """Which improving move is taken."""

    STEEPEST = "steepest"
    FIRST = "first-improvement"


class Ending(StrEnum):
    """How a climb ended."""

    ARRIVED = "arrived"
    LOCAL_MINIMUM = "local minimum"
    BLOCKED = "blocked"
    STALLED = "no headway"
    STEPS = "out of steps"


@dataclass(frozen=True)
class Climb:
    """What a climb aims at, and with what.

    Attributes:
        objective: the distance function.
        threshold: the climb has arrived at values no greater.
        moves: the operators.
        strategy: which improving move is taken.
        most_steps: moves at most.
        push: weight of the world's crowding beside the distance. Where both balance, the climb goes on without it.
        patience: moves without headway after which the climb ends; by default it never loses patience.
    """

    objective: Objective
    threshold: float
    moves: Moves = field(default_factory=Moves)
    strategy: Strategy = Strategy.STEEPEST
    most_steps: int = 600
    push: float = 0.0
    patience: float = np.inf


def climb(world: World, start: Configuration, task: Climb) -> Generator[Shapes, None, Ending]:
    """Climb until the distance is small enough or no move improves it.

    All candidate moves of a step are evaluated as one batch; those that improve are shown to the world in the order
    of the strategy until one may be moved to.

    Args:
        world: says which moves are allowed.
        start: where to begin; it is not yielded.
        task: what to aim at.

    Yields:
        The configuration after each move, as a batch of one.

    Returns:
        How it ended.
    """
    here, push, last = Shapes.of([start]), task.push, 0
    left = float(task.objective(here)[0])
    crowded = float(world.crowding(here)[0]) if push > 0.0 else 0.0
    mark, marked = left, 0
    for count in range(task.most_steps):
        if left <= task.threshold:
            return Ending.ARRIVED
        if left < (1.0 - HEADWAY) * mark:
            mark, marked = left, count
        if count - marked > task.patience:
            return Ending.STALLED
        candidates = task.moves.candidates(here)
        distances = task.objective(candidates)
        crowding = world.crowding(candidates) if push > 0.0 else np.zeros(len(candidates))
        while True:
            values, gain = distances + push * crowding, WORTH_PUSHING if push > 0.0 else LEAST_GAIN
            order = _order(values, (1.0 - gain) * (left + push * crowded), task.strategy, last)
            chosen = _first_allowed(world, here, candidates, order)
            if chosen is not None or push == 0.0:
                break
            push = EASING * push if push > LEAST_PUSH else 0.0
        if chosen is None:
            return Ending.BLOCKED if len(order) else Ending.LOCAL_MINIMUM
        left, crowded, last = float(distances[chosen]), float(crowding[chosen]), chosen
        here = candidates.take(np.array([chosen]))
        yield here
    return Ending.ARRIVED if left <= task.threshold else Ending.STEPS


def end_of(world: World, start: Configuration, task: Climb) -> tuple[Configuration, Ending]:
    """Where a climb ends, and how."""
    here, way = None, climb(world, start, task)
    while True:
        try:
            here = next(way)
        except StopIteration as end:
            ending: Ending = end.value
            return start if here is None else here.configuration(0), ending


def _order(values: FloatArray, below: float, strategy: Strategy, last: int) -> IntArray:
    """Improving candidates: best first, or in the order of the operators beginning with the one used last."""
    improving = np.flatnonzero(values < below)
    if strategy is Strategy.STEEPEST:
        return improving[np.argsort(values[improving], kind="stable")][:MOST_TRIED]
    turn = int(np.searchsorted(improving, last))
    return np.roll(improving, -turn)[:MOST_TRIED]


def _first_allowed(world: World, here: Shapes, candidates: Shapes, order: IntArray) -> int | None:
    count = TRIED_AT_ONCE
    while len(order) > 0:
        some, order = order[:count], order[count:]
        count *= GROWTH
        passing = world.passes(here, candidates.take(some))
        if passing.any():
            return int(some[np.argmax(passing)])
    return None
