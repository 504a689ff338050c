"""Hill climbing over the curvature operators, and the steps that schemas make of it."""

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
"""Least share of the distance that a move has to gain to count as an improvement. Taste."""
_GAIN_WHILE_PUSHED = 0.02
"""The same share while walls push, so that the push does not prolong the climb. Taste."""
_EASING = 0.3
"""Factor by which the push decreases where push and distance balance, like the weight of a barrier. Taste."""
_LEAST_PUSH = 1e-6
"""Weight of crowding below which the push is dropped. Taste."""
_TRIED_AT_ONCE = 4
"""Number of candidates checked against the world in the first batch, best first. Taste."""
_MORE_EACH_GO = 3
"""Factor on that number from batch to batch. Derived: checking one costs nearly as much as checking ten."""
_MOST_TRIED = 96
"""Most improving candidates checked before the climb counts as blocked. Taste."""
_HEADWAY = 0.2
"""Share of the distance, which is a square, that has to be gained to count as headway. Taste."""

Objective: TypeAlias = Callable[[Shapes], FloatArray]
"""Distance of each configuration of a batch, shape (m,)."""


class Ending(StrEnum):
    """Reasons why a climb can end."""

    ARRIVED = "arrived"
    LOCAL_MINIMUM = "local minimum"
    BLOCKED = "blocked"
    STALLED = "no progress"
    STEPS = "step limit reached"


@dataclass(frozen=True)
class Climb:
    """Aim and settings of a climb.

    Attributes:
        objective: the distance function.
        threshold: value of the objective at which the climb has arrived.
        moves: the operators.
        most_steps: maximum number of moves.
        push: weight of the world's crowding relative to the distance; where both balance, the climb continues without
            crowding.
        patience: number of moves without progress after which the climb ends; unlimited by default.
    """

    objective: Objective
    threshold: float
    moves: Moves = field(default_factory=Moves)
    most_steps: int = 600
    push: float = 0.0
    patience: float = np.inf


def climb(world: World, start: Configuration, task: Climb) -> Generator[Shapes, None, Ending]:
    """Climb until the distance is small enough or no move improves it.

    All candidate moves of a step are evaluated as one batch; those that improve are checked against the world, the best
    first, until one is allowed.

    Args:
        world: decides which moves are allowed.
        start: first configuration; it is not yielded.
        task: aim and settings of the climb.

    Yields:
        The configuration after each move, as a batch of one.

    Returns:
        Reason why the climb ended.
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

        # Where no allowed move improves distance and push together, decrease the push until one does, or it is 0.
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
    """Return the last configuration of a climb and the reason why it ended."""
    here = None
    moves = climb(world, start, task)
    while True:
        try:
            here = next(moves)
        except StopIteration as end:
            ending: Ending = end.value
            return start if here is None else here.configuration(0), ending


def _order(values: FloatArray, now: float, pushed: bool) -> IntArray:
    """Return the indices of the improving candidates, the best first.

    Args:
        values: values of the candidates, shape (m,).
        now: current value of the climb.
        pushed: whether crowding counts, so that a move has to gain more to be accepted.
    """
    gain = _GAIN_WHILE_PUSHED if pushed else _LEAST_GAIN
    improving = np.flatnonzero(values < (1.0 - gain) * now)
    return improving[np.argsort(values[improving], kind="stable")][:_MOST_TRIED]


def _first_allowed(world: World, here: Shapes, candidates: Shapes, order: IntArray) -> int | None:
    """Return the first candidate that the world allows, or None; candidates are checked in growing batches."""
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
    """One configuration of a motion made by schemas.

    Attributes:
        schema: name of the schema that made the step, for example ``SCM-7``; two names where schemas work together.
        configuration: the arm after the step.
        stage: description of the part of the plan that the step belongs to.
    """

    schema: str
    configuration: Configuration
    stage: str = ""


_Result = TypeVar("_Result")
Schema: TypeAlias = Generator[SchemaStep, None, Configuration]
"""Yields its steps, the motion of the arm; returns the arm's last configuration."""


class SchemaStopped(MotionNotFound):
    """A schema could not continue.

    Attributes:
        schema: name of the schema.
        configuration: last configuration of the arm.
        reason: description of the reason.
    """

    def __init__(self, schema: str, configuration: Configuration, reason: str) -> None:
        self.schema = schema
        self.configuration = configuration
        self.reason = reason
        advice = ('use planner.method = "nlp"', "move obstacles away from the base")
        super().__init__(Diagnosis(f"{schema} stopped: {reason}", schema, advice, {"schema": schema}))


def run(schema: Generator[SchemaStep, None, _Result]) -> tuple[tuple[SchemaStep, ...], _Result]:
    """Run a schema to its end and return all of its steps and its result."""
    steps: list[SchemaStep] = []
    while True:
        try:
            steps.append(next(schema))
        except StopIteration as end:
            last: _Result = end.value
            return tuple(steps), last
