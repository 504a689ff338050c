"""The schemas of the 1990 paper that climb or interpolate: SCM-0, SCM-2, SCM-6, SCM-7 and SCM-8."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import vector_heading, whole_turns, wrap
from ccm_opt.planning.baseline.distance import Distance, Precision, TipPose
from ccm_opt.planning.baseline.hill_climb import Climb, Ending, Schema, SchemaStep, SchemaStopped, climb, end_of, run
from ccm_opt.planning.baseline.operators import Moves, Operator, Shapes
from ccm_opt.planning.baseline.world import World
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import interpolate
from ccm_opt.robot.segment import EVEN_KNOTS, natural_segment, select_segment_type

PUSH = 0.01
"""Weight of the repulsive potential of obstacles relative to the squared distance, in the climbs of a plan.
Heuristic."""
PATIENCE = 15
"""Number of moves without progress after which a climb of a plan ends, as later success is rare. Heuristic."""
FEED = 0.02
"""Length that schemas SCM-3 and SCM-5 of the paper feed in one step, as a fraction of the arm's length. Heuristic."""
_ON_THE_WAY = Precision(2e-3, 2e-2)
"""Tolerances of the tip at the intermediate subgoals of schema SCM-7 of the paper. Heuristic."""
_STRIDE = 0.12
"""Maximum change of heading along the curve between two steps of schemas SCM-2 and SCM-8 [rad]. Heuristic."""
_HELD_PRECISION = Precision(1.5e-4, 1.5e-3)
"""Tolerances within which schemas SCM-3 and SCM-6 of the paper hold the pose of a segment's end. Heuristic."""
_SUBGOAL_SPACING = 0.03
"""Maximum distance between subgoals of schema SCM-7, as a fraction of the arm's length. Heuristic."""
_SUBGOAL_TURN = 0.12
"""Maximum change of the tip's heading between subgoals of schema SCM-7 [rad]. Heuristic."""
_STRIDE_SAMPLES = 65
"""Number of arc lengths at which the change of heading is evaluated. Heuristic."""
_HELD_PUSH = 0.03
"""Weight of the repulsive potential of obstacles while the pose of a segment's end is held. Heuristic."""
_HELD_PATIENCE = 20
"""Number of moves without progress after which holding the pose of a segment's end has failed. Heuristic."""
_RELAXING = 6
"""Maximum number of moves that reduce distance and obstacle potential before a segment's end is moved back to its pose.
Heuristic."""
_END_TURN = 0.3
"""Maximum change of the curvature at the tip in one step of schema SCM-6, times the segment's length [rad].
Heuristic."""

HELD = (
    Operator.C_A, Operator.C_B, Operator.C_C, Operator.C_D, Operator.S_B, Operator.S_C, Operator.S_D, Operator.ROTATE,
)  # fmt: skip
"""Operators that keep the curvature at the end of a segment."""


def scm_6(world: World, start: Configuration) -> Schema:
    """Run schema SCM-6 of the paper: reduce the curvature at the tip to zero while the tip keeps its pose.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.

    Yields:
        Steps with decreasing curvature at the tip.

    Returns:
        A configuration with C_e = 0 and an unchanged tip pose.

    Raises:
        SchemaStopped: the tip pose cannot be kept.
    """
    position, heading = start.tip
    held = TipPose(position, heading)
    here = start
    last = len(start.segments) - 1
    end = float(start.segments[-1].curvature[-1])
    count = int(np.ceil(abs(end) * start.segments[-1].length / _END_TURN))
    for k in range(1, count + 1):
        shapes = Shapes.from_configurations([here])
        shapes.curvature[0, -1, -1] = end * (1.0 - k / count)
        here = hold(world, here, shapes.configuration(0), last, held, "SCM-6")
        yield SchemaStep("SCM-6", here)
    return here


def hold(
    world: World, before: Configuration, changed: Configuration, segment: int, held: TipPose, schema: str
) -> Configuration:
    """Correct a changed configuration until the end of a segment is back at a given pose, and return the result.

    The correction is a hill climb with the operators that keep the curvature at that end.

    Args:
        world: environment of the schemas.
        before: the arm before the change; the motion from there to the result, linear in bends, must be allowed.
        changed: the arm after the change.
        segment: index of the segment whose end is held; the operators change this segment and those before.
        held: pose at which the end is held.
        schema: name of the schema, for messages.

    Raises:
        SchemaStopped: the pose is not reached, or the motion to the result is blocked.
    """

    def objective(shapes: Shapes) -> FloatArray:
        return distance(shapes.first_segments(segment + 1))

    def reachable(here: Shapes, there: Shapes) -> BoolArray:
        del here
        return world.passes(origin, there)

    origin = Shapes.from_configurations([before])
    distance = Distance(held, before.length, precision=_HELD_PRECISION)
    moves = Moves(tuple(range(segment + 1)), HELD)

    # Climbs that check contact only at their end are quick, so they are tried first, from several initial
    # configurations; another one then checks every move.
    watched = replace(world, passes=reachable)
    anywhere = replace(world, passes=World().passes)
    relaxing = Climb(objective, -np.inf, moves, most_steps=_RELAXING, push=_HELD_PUSH)
    relaxed, _ = end_of(anywhere, changed, relaxing)
    tries = [(anywhere, begin, 0.0) for begin in (*_reselected(changed, segment, held), relaxed, changed)]
    tries.append((watched, changed, _HELD_PUSH))
    # A climb may stop in a local minimum very near its end. From the middle between two initial configurations it
    # takes another path, which may avoid that minimum.
    tries += [(anywhere, middle, 0.0) for middle in _middles([begin for _, begin, _ in tries])]
    for guard, begin, push in tries:
        task = Climb(objective, distance.threshold, moves, push=push, patience=_HELD_PATIENCE)
        here, ending = end_of(guard, begin, task)
        if ending is Ending.ARRIVED and world.move_allowed(before, here):
            return here
    reason = "contact" if ending is Ending.ARRIVED else str(ending)
    raise SchemaStopped(schema, before, f"the segment of {long_length(changed.segments[segment].length)}: {reason}")


def _middles(beginnings: list[Configuration]) -> tuple[Configuration, ...]:
    """Return the midpoints of consecutive configurations: means of curvatures, knots and base headings."""
    middles = []
    for one, other in pairwise(beginnings):
        first = Shapes.from_configurations([one])
        second = Shapes.from_configurations([other])
        first.curvature[:] = 0.5 * (first.curvature + second.curvature)
        first.knots[:] = 0.5 * (first.knots + second.knots)
        first.heading[:] = 0.5 * (first.heading + second.heading)
        middles.append(first.configuration(0))
    return tuple(middles)


def _reselected(changed: Configuration, segment: int, held: TipPose) -> tuple[Configuration, ...]:
    """Replace the base segment of a configuration by the curve that schema SCM-1 of the paper would select.

    The segment keeps its length and its end curvature. The result is a tuple with the new configuration; it is empty
    if the pose is out of reach, or if ``segment`` is not the base segment.

    Args:
        changed: the configuration.
        segment: index of the segment whose end is held.
        held: pose at which the end is held.
    """
    if segment > 0 or float(np.hypot(*(held.position - changed.base))) > changed.segments[0].length:
        return ()
    shapes = Shapes.from_configurations([changed])
    # As SCM-1 does, from the poses alone; the end curvature stays as it was changed.
    kind = select_segment_type(changed.base, None, held.position, held.heading)
    natural = natural_segment(kind, changed.base, held.position, changed.segments[0].length)
    shapes.curvature[0, 0, :-1] = natural.curvature[:-1]
    shapes.knots[0, 0] = EVEN_KNOTS
    shapes.heading[0] += wrap(natural.heading - float(shapes.heading[0]))
    return (shapes.configuration(0),)


def scm_0(
    world: World,
    start: Configuration,
    goal: TipPose,
    *,
    precision: Precision | None = None,
    most_steps: int = 600,
    push: float = 0.0,
    patience: float = np.inf,
) -> Schema:
    """Run schema SCM-0 of the paper: pure hill climbing to a goal position and, if given, heading of the tip.

    Interpolation points and base rotation change; number and lengths of the segments are kept.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        goal: goal of the tip.
        precision: tolerances of the tip at the goal; default values if None.
        most_steps: maximum number of moves.
        push: weight of the repulsive potential of obstacles; 0 for pure hill climbing.
        patience: number of moves without progress after which the climb ends; unlimited for pure hill climbing.

    Yields:
        The step after every move.

    Returns:
        A configuration within the precision.

    Raises:
        SchemaStopped: the climb ended in a local minimum, without progress, at the maximum number of moves, or because
            all improving moves are blocked.
    """
    here = start
    distance = Distance(goal, start.length, precision=precision or Precision())

    def objective(shapes: Shapes) -> np.ndarray:
        positions, headings = world.tips(shapes)
        return distance.of_tips(positions, headings, shapes.heading)

    moves = Moves(tuple(range(len(start.segments))))
    climbing = climb(world, start, Climb(objective, distance.threshold, moves, most_steps, push, patience))
    while True:
        try:
            here = next(climbing).configuration(0)
        except StopIteration as end:
            if end.value is Ending.ARRIVED:
                return here
            raise SchemaStopped("SCM-0", here, f"{end.value}, {miss(world, here, goal)}") from None
        yield SchemaStep("SCM-0", here)


def scm_7(world: World, start: Configuration, goal: TipPose, precision: Precision | None = None) -> Schema:
    """Run schema SCM-7 of the paper: a sequence of SCM-0 with subgoals on the straight line from tip to goal.

    The heading of the tip changes evenly from subgoal to subgoal. The motion between subgoals is linear in bends if
    that is allowed.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        goal: goal of the tip.
        precision: tolerances of the tip at the goal; default values if None.

    Yields:
        A step at every subgoal, and the moves of the climb between two subgoals if a linear motion is not allowed.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: a subgoal is not reached.
    """
    here = start
    (position,), (heading,) = world.tips(Shapes.from_configurations([start]))
    line = goal.position - position
    turn = 0.0 if goal.heading is None else wrap(goal.heading - float(heading))
    spaces = np.hypot(*line) / (_SUBGOAL_SPACING * start.length)
    count = max(1, int(np.ceil(max(spaces, abs(turn) / _SUBGOAL_TURN))))
    for k in range(1, count + 1):
        share = k / count
        subgoal = TipPose(position + share * line, None if goal.heading is None else float(heading) + share * turn)
        try:
            here = yield from _hop(world, here, subgoal, precision if k == count else _ON_THE_WAY)
        except SchemaStopped as stopped:
            reason = f"at subgoal {k} of {count}: {stopped.diagnosis.reason}"
            raise SchemaStopped("SCM-7", stopped.configuration, reason) from stopped
    return here


def _hop(world: World, start: Configuration, subgoal: TipPose, precision: Precision | None) -> Schema:
    """Move to the next subgoal of schema SCM-7 by SCM-0, in one step if a motion linear in bends is allowed.

    Raises:
        SchemaStopped: the subgoal is not reached.
    """
    climb_there = scm_0(world, start, subgoal, precision=precision, push=PUSH, patience=PATIENCE)
    steps, here = run(climb_there)
    moves = [step.configuration for step in steps]
    # The moves of a climb zigzag; a straight motion is shorter, if collision-free.
    if len(moves) > 1 and world.move_allowed(start, here):
        moves = [here]
    for configuration in moves:
        yield SchemaStep("SCM-7", configuration)
    return here


def miss(world: World, configuration: Configuration, goal: TipPose) -> str:
    """Describe, for messages, how far the tip is from a goal in position and, if the goal has one, in heading."""
    (position,), (heading,) = world.tips(Shapes.from_configurations([configuration]))
    text = f"the tip {short_length(float(np.hypot(*(position - goal.position))))}"
    if goal.heading is not None:
        text += f" and {abs(np.rad2deg(wrap(float(heading) - goal.heading))):.1f}°"
    return text + " off its goal"


def scm_2(world: World, start: Configuration, target: Configuration) -> Schema:
    """Run schema SCM-2 of the paper: move to a configuration by linear interpolation of curvature and base rotation.

    Base position and length are kept.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        target: a configuration with the same base position and length as ``start``.

    Yields:
        Evenly spaced steps.

    Returns:
        The target.

    Raises:
        SchemaStopped: the motion is blocked.
    """
    here = start
    for share in _shares(start, target):
        there = interpolate(start, target, share)
        if not world.move_allowed(here, there):
            raise SchemaStopped("SCM-2", here, f"contact after {share:.0%} of the way to the selected curvature")
        here = there
        yield SchemaStep("SCM-2", here)
    return here


def scm_8(world: World, start: Configuration, target: Configuration, *, as_far_as_free: bool = False) -> Schema:
    """Run schema SCM-8 of the paper: move as in SCM-2, but with a fixed direction of the vector from base to tip.

    The base rotates to keep this direction, so base rotation does not end at the value of the target.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        target: a configuration with the same base position and length as ``start``.
        as_far_as_free: end before a contact instead of raising an error, unless the first step is already blocked.

    Yields:
        Evenly spaced steps.

    Returns:
        The target, rotated about the base, or the last configuration before a contact.

    Raises:
        SchemaStopped: the motion is blocked.
    """
    here = start
    direction = direction_to_tip(world, start)
    for share in _shares(start, target):
        mixed = interpolate(start, target, share)
        # First restore the direction, then the number of whole turns of the base.
        there = turned(mixed, wrap(direction - direction_to_tip(world, mixed)))
        there = turned(there, whole_turns(here.base_heading - there.base_heading))
        if not world.move_allowed(here, there):
            if as_far_as_free and here is not start:
                return here
            raise SchemaStopped("SCM-8", here, f"contact after {share:.0%} of the way to the selected curvature")
        here = there
        yield SchemaStep("SCM-8", here)
    return here


def turned(configuration: Configuration, angle: float) -> Configuration:
    """Return a configuration rotated about its base by an angle [rad]."""
    shapes = Shapes.from_configurations([configuration])
    shapes.heading[0] += angle
    return shapes.configuration(0)


def direction_to_tip(world: World, configuration: Configuration) -> float:
    """Return the heading of the vector from base to tip of a configuration [rad]; ``world`` tells where the tip is."""
    (tip,), _ = world.tips(Shapes.from_configurations([configuration]))
    return vector_heading(tip - configuration.base)


def _shares(start: Configuration, target: Configuration) -> list[float]:
    """Return evenly spaced interpolation parameters in (0, 1] for a motion between two configurations.

    From one to the next, no heading along the curve changes by more than ``_STRIDE``.
    """
    arc = np.linspace(0.0, start.length, _STRIDE_SAMPLES)
    most = float(np.abs(target.heading_at(arc) - start.heading_at(arc)).max())
    count = max(1, int(np.ceil(most / _STRIDE)))
    return [k / count for k in range(1, count + 1)]
