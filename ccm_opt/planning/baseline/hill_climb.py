"""Hill climbing over the operators."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias, TypeVar

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.planning.baseline.operators import Moves, Shapes
from ccm_opt.planning.baseline.world import World
from ccm_opt.robot.configuration import Configuration

_LEAST_GAIN = 1e-4
"""A move counts as an improvement when it takes away at least this share of the distance. Taste."""
_GAIN_WHILE_PUSHED = 0.02
"""The same while walls push: the climb is not drawn out for the sake of the push. Taste."""
_EASING = 0.3
"""Factor by which the push eases where push and distance balance, as the weight of a barrier does. Taste."""
_LEAST_PUSH = 1e-6
"""Weights of crowding below it are dropped. Taste."""
_TRIED_AT_ONCE = 4
"""Candidates asked of the world in the first go, best first. Taste."""
_MORE_EACH_GO = 3
"""Factor on that number from go to go. Derived: asking for one costs nearly as much as for ten."""
_MOST_TRIED = 96
"""Improving candidates asked in all before the climb counts as blocked. Taste."""
_HEADWAY = 0.2
"""A climb makes headway when it has taken away this share of the distance, which is a square. Taste."""

Objective: TypeAlias = Callable[[Shapes], FloatArray]
"""Distance of each configuration of a batch, shape (m,)."""


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
        most_steps: moves at most.
        push: weight of the world's crowding beside the distance. Where both balance, the climb goes on without it.
        patience: moves without headway after which the climb ends; by default it never loses patience.
    """

    objective: Objective
    threshold: float
    moves: Moves = field(default_factory=Moves)
    most_steps: int = 600
    push: float = 0.0
    patience: float = np.inf


def climb(world: World, start: Configuration, task: Climb) -> Generator[Shapes, None, Ending]:
    """Climb until the distance is small enough or no move improves it.

    All candidate moves of a step are evaluated as one batch; those that improve are shown to the world, the best
    first, until one may be moved to.

    Args:
        world: says which moves are allowed.
        start: where to begin; it is not yielded.
        task: what to aim at.

    Yields:
        The configuration after each move, as a batch of one.

    Returns:
        How it ended.
    """
    here = Shapes.from_configurations([start])
    left = float(task.objective(here)[0])
    push = task.push
    crowded = float(world.crowding(here)[0]) if push > 0.0 else 0.0
    mark = left  # the distance at the last headway, and the move at which it was
    marked = 0
    for count in range(task.most_steps):
        if left <= task.threshold:
            return Ending.ARRIVED
        if left < (1.0 - _HEADWAY) * mark:
            mark = left
            marked = count
        if count - marked > task.patience:
            return Ending.STALLED
        candidates = task.moves.candidates(here)
        distances = task.objective(candidates)
        crowding = world.crowding(candidates) if push > 0.0 else np.zeros(len(candidates))

        # Where no allowed move improves distance and push together, the push eases until one does, or it is gone.
        while True:
            order = _order(distances + push * crowding, left + push * crowded, push > 0.0)
            chosen = _first_allowed(world, here, candidates, order)
            if chosen is not None or push == 0.0:
                break
            push = _EASING * push if push > _LEAST_PUSH else 0.0
        if chosen is None:
            return Ending.BLOCKED if len(order) else Ending.LOCAL_MINIMUM

        left = float(distances[chosen])
        crowded = float(crowding[chosen])
        here = candidates.take(np.array([chosen]))
        yield here
    return Ending.ARRIVED if left <= task.threshold else Ending.STEPS


def end_of(world: World, start: Configuration, task: Climb) -> tuple[Configuration, Ending]:
    """Return where a climb ends, and how."""
    here = None
    moves = climb(world, start, task)
    while True:
        try:
            here = next(moves)
        except StopIteration as end:
            ending: Ending = end.value
            return start if here is None else here.configuration(0), ending


def _order(values: FloatArray, now: float, pushed: bool) -> IntArray:
    """Return the improving candidates, the best first.

    Args:
        values: of the candidates, shape (m,).
        now: the value where the climb is.
        pushed: whether walls push, so that a move has to gain more to count.
    """
    gain = _GAIN_WHILE_PUSHED if pushed else _LEAST_GAIN
    improving = np.flatnonzero(values < (1.0 - gain) * now)
    return improving[np.argsort(values[improving], kind="stable")][:_MOST_TRIED]


def _first_allowed(world: World, here: Shapes, candidates: Shapes, order: IntArray) -> int | None:
    """Return the first candidate that the world lets the arm move to, or None; ever more are asked at once."""
    count = _TRIED_AT_ONCE
    while len(order) > 0:
        some = order[:count]
        order = order[count:]
        count *= _MORE_EACH_GO
        passing = world.passes(here, candidates.take(some))
        if passing.any():
            return int(some[np.argmax(passing)])
    return None


@dataclass(frozen=True)
class SchemaStep:
    """One configuration on the way.

    Attributes:
        schema: that made it, for example ``SCM-7``; two where they work together.
        configuration: where the arm is after it.
        stage: the part of a plan it belongs to, in words.
    """

    schema: str
    configuration: Configuration
    stage: str = ""


_Result = TypeVar("_Result")
Schema: TypeAlias = Generator[SchemaStep, None, Configuration]
"""Yields its steps, the arm's way from where it was; returns where the arm is at the end."""


class SchemaStopped(MotionNotFound):
    """A schema could not go on.

    Attributes:
        schema: its name.
        configuration: how far the arm came.
        reason: why, in words.
    """

    def __init__(self, schema: str, configuration: Configuration, reason: str) -> None:
        self.schema = schema
        self.configuration = configuration
        self.reason = reason
        advice = ("use planner.method nlp", "give the arm more room near its base")
        super().__init__(Diagnosis(f"{schema} stopped: {reason}", schema, advice, {"schema": schema}))


def run(schema: Generator[SchemaStep, None, _Result]) -> tuple[tuple[SchemaStep, ...], _Result]:
    """Return all steps of a schema and where it ends."""
    steps: list[SchemaStep] = []
    while True:
        try:
            steps.append(next(schema))
        except StopIteration as end:
            last: _Result = end.value
            return tuple(steps), last
