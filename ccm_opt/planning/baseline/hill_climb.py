"""Hill climbing with the curvature operators, and the motion steps that schemas yield."""

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
"""Minimum relative decrease of the objective for a move to count as an improvement. Heuristic."""
_GAIN_WHILE_PUSHED = 0.02
"""Minimum relative decrease of the objective for a move to count as an improvement while the objective includes the
repulsive potential of obstacles; a smaller one would prolong the climb. Heuristic."""
_EASING = 0.3
"""Factor by which the weight of the repulsive potential is reduced when potential and distance balance, as in barrier
methods. Heuristic."""
_LEAST_PUSH = 1e-6
"""Weight of the repulsive potential below which the potential is ignored. Heuristic."""
_TRIED_AT_ONCE = 4
"""Number of candidate moves checked for collision in the first batch, best first. Heuristic."""
_MORE_EACH_GO = 3
"""Factor by which batches grow. Derived: checking one move takes nearly as long as checking ten."""
_MOST_TRIED = 96
"""Maximum number of improving candidates checked before the climb counts as blocked. Heuristic."""
_HEADWAY = 0.2
"""Relative decrease of the squared distance that counts as progress. Heuristic."""

Objective: TypeAlias = Callable[[Shapes], FloatArray]
"""Function that returns the objective, a squared distance, of m configurations, shape (m,)."""


class Ending(StrEnum):
    """Reasons why a hill climb can end."""

    ARRIVED = "arrived"
    LOCAL_MINIMUM = "local minimum"
    BLOCKED = "blocked"
    STALLED = "no progress"
    STEPS = "step limit reached"


@dataclass(frozen=True)
class Climb:
    """Objective and settings of a hill climb.

    Attributes:
        objective: function to minimise, a squared distance.
        threshold: value of the objective at which the goal is reached.
        moves: operators that generate the candidate moves.
        most_steps: maximum number of moves.
        push: weight of the repulsive potential of obstacles relative to the objective; reduced where both balance.
        patience: number of moves without progress after which the climb ends; unlimited by default.
    """

    objective: Objective
    threshold: float
    moves: Moves = field(default_factory=Moves)
    most_steps: int = 600
    push: float = 0.0
    patience: float = np.inf


def climb(world: World, start: Configuration, task: Climb) -> Generator[Shapes, None, Ending]:
    """Minimise an objective by moves of one operator each, until the goal is reached or no allowed move improves.

    All candidates for a move are evaluated as one batch; improving candidates are checked for collision, best first,
    until one is allowed.

    Args:
        world: environment that decides which moves are allowed.
        start: initial configuration; not yielded.
        task: objective and settings.

    Yields:
        The configuration after each move, as a batch of one.

    Returns:
        Reason why the climb ended.
    """
    here = Shapes.from_configurations([start])
    left = float(task.objective(here)[0])
    push = task.push
    crowded = float(world.crowding(here)[0]) if push > 0.0 else 0.0
    mark = left  # objective and number of the move at the last progress
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

        # If no allowed move improves objective and potential together, reduce the weight of the potential, down to 0.
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
    """Run a hill climb to its end; return its last configuration, ``start`` if it made no move, and why it ended."""
    here = None
    moves = climb(world, start, task)
    while True:
        try:
            here = next(moves)
        except StopIteration as end:
            ending: Ending = end.value
            return start if here is None else here.configuration(0), ending


def _order(values: FloatArray, now: float, pushed: bool) -> IntArray:
    """Return the indices of the improving candidate moves, best first, shape (k,).

    Args:
        values: objectives of the m candidates, with weighted potential, shape (m,).
        now: objective of the current configuration, with weighted potential.
        pushed: whether the potential counts, which requires a larger improvement.
    """
    gain = _GAIN_WHILE_PUSHED if pushed else _LEAST_GAIN
    improving = np.flatnonzero(values < (1.0 - gain) * now)
    return improving[np.argsort(values[improving], kind="stable")][:_MOST_TRIED]


def _first_allowed(world: World, here: Shapes, candidates: Shapes, order: IntArray) -> int | None:
    """Return the index of the first allowed candidate move in a given order; None if no candidate is allowed.

    Candidates are checked for collision in growing batches.

    Args:
        world: environment that decides which moves are allowed.
        here: current configuration, a batch of one.
        candidates: configurations after the candidate moves.
        order: indices of the candidates to check, best first.
    """
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
    """One configuration of an arm's motion, with the schema and the stage of the plan that led to it.

    Attributes:
        schema: name of the paper's schema, such as ``SCM-7``; two names if schemas act together.
        configuration: configuration of the arm after the step.
        stage: description of the stage of the plan.
    """

    schema: str
    configuration: Configuration
    stage: str = ""


_Result = TypeVar("_Result")
Schema: TypeAlias = Generator[SchemaStep, None, Configuration]
"""Generator that yields the steps of a schema, a motion of the arm, and returns the last configuration."""


class SchemaStopped(MotionNotFound):
    """Raised when a schema of the baseline cannot continue, for example in a local minimum or because of contact.

    Attributes:
        schema: name of the schema.
        configuration: last configuration of the arm.
        reason: description of the reason, for messages.
    """

    def __init__(self, schema: str, configuration: Configuration, reason: str) -> None:
        self.schema = schema
        self.configuration = configuration
        self.reason = reason
        advice = ('use planner.method = "nlp"', "move obstacles away from the base")
        super().__init__(Diagnosis(f"{schema} stopped: {reason}", schema, advice, {"schema": schema}))


def run(schema: Generator[SchemaStep, None, _Result]) -> tuple[tuple[SchemaStep, ...], _Result]:
    """Run a generator of motion steps to the end, and return all of its steps and its return value."""
    steps: list[SchemaStep] = []
    while True:
        try:
            steps.append(next(schema))
        except StopIteration as end:
            last: _Result = end.value
            return tuple(steps), last
