"""SCM-0 and SCM-7: hill climbing to a goal for the tip, at once or along a straight line (section 4.2)."""

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.angles import wrap
from ccm_opt.ground.length_words import short_length
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.distance import Distance, DistanceWeights, Precision, TipPose
from ccm_opt.hill_climbing.hill_climb import Climb, Ending, Strategy, climb
from ccm_opt.hill_climbing.operators import Moves
from ccm_opt.hill_climbing.steps import Schema, SchemaStep, SchemaStopped, run
from ccm_opt.hill_climbing.world import World


def scm_0(
    world: World,
    start: Configuration,
    goal: TipPose,
    *,
    precision: Precision | None = None,
    weights: DistanceWeights | None = None,
    strategy: Strategy = Strategy.STEEPEST,
    most_steps: int = 600,
    push: float = 0.0,
    patience: float = np.inf,
) -> Schema:
    """SCM-0: pure hill climbing to a goal for the tip's position and, if given, orientation.

    Keeps the number and the lengths of the segments; changes interpolation points and base rotation.

    Args:
        world: the world.
        start: where the arm is.
        goal: for the tip.
        precision: how near counts.
        weights: of the distance function.
        strategy: of the climb.
        most_steps: moves at most.
        push: weight of the world's crowding; none in the pure climb.
        patience: moves without headway after which it ends; the pure climb has no end of it.

    Yields:
        Every move.

    Returns:
        A configuration within the precision.

    Raises:
        SchemaStopped: in a local minimum, or where all that improves is blocked.
    """
    here = start
    distance = Distance(goal, start.length, weights or DistanceWeights(), precision=precision or Precision())

    def objective(shapes: Shapes) -> np.ndarray:
        positions, headings = world.tips(shapes)
        return distance.of_tips(positions, headings, shapes.heading)

    moves = Moves(tuple(range(len(start.segments))))
    climbing = climb(world, start, Climb(objective, distance.threshold, moves, strategy, most_steps, push, patience))
    while True:
        try:
            here = next(climbing).configuration(0)
        except StopIteration as end:
            if end.value is Ending.ARRIVED:
                return here
            raise SchemaStopped("SCM-0", here, f"{end.value}, {miss(world, here, goal)}") from None
        yield SchemaStep("SCM-0", here)


def scm_7(world: World, start: Configuration, goal: TipPose, precision: Precision | None = None) -> Schema:
    """SCM-7: a sequence of SCM-0 whose subgoals lie on the straight line from the tip to its goal.

    The tip's heading turns evenly on the way. Where the arm may move straight from subgoal to subgoal, it does.

    Args:
        world: the world.
        start: where the arm is.
        goal: for the tip.
        precision: how near the goal counts.

    Yields:
        The configuration at every subgoal, with the moves between where they are needed.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: a subgoal is not reached.
    """
    settings = world.settings.schemas
    here = start
    (position,), (heading,) = world.tips(Shapes.from_configurations([start]))
    line = goal.position - position
    turn = 0.0 if goal.heading is None else wrap(goal.heading - float(heading))
    spaces = np.hypot(*line) / (settings.subgoal_spacing * start.length)
    count = max(1, int(np.ceil(max(spaces, abs(turn) / settings.subgoal_turn))))
    for k in range(1, count + 1):
        share = k / count
        subgoal = TipPose(position + share * line, None if goal.heading is None else float(heading) + share * turn)
        try:
            here = yield from _hop(world, here, subgoal, precision if k == count else settings.on_the_way)
        except SchemaStopped as stopped:
            reason = f"at subgoal {k} of {count}: {stopped.diagnosis.reason}"
            raise SchemaStopped("SCM-7", stopped.configuration, reason) from stopped
    return here


def _hop(world: World, start: Configuration, subgoal: TipPose, precision: Precision | None) -> Schema:
    """To the next subgoal by SCM-0, in one step if the world lets it."""
    settings = world.settings.schemas
    climb_there = scm_0(world, start, subgoal, precision=precision, push=settings.push, patience=settings.patience)
    steps, here = run(climb_there)
    moves = [step.configuration for step in steps]
    # The moves of a climb zigzag; the straight way is shorter where it is free.
    if len(moves) > 1 and world.move_allowed(start, here):
        moves = [here]
    for configuration in moves:
        yield SchemaStep("SCM-7", configuration)
    return here


def miss(world: World, configuration: Configuration, goal: TipPose) -> str:
    """How far the tip is from a goal, in words."""
    (position,), (heading,) = world.tips(Shapes.from_configurations([configuration]))
    text = f"the tip {short_length(float(np.hypot(*(position - goal.position))))}"
    if goal.heading is not None:
        text += f" and {abs(np.rad2deg(wrap(float(heading) - goal.heading))):.1f}°"
    return text + " off its goal"
