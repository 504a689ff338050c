"""SCM-6: take the curvature out of a segment's end, so that another can go on from there (section 4.2)."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import EVEN_KNOTS
from ccm_opt.continuum.segment_types import natural_segment, select_segment_type
from ccm_opt.ground.angles import wrap
from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.length_words import long_length
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.distance import Distance, TipPose
from ccm_opt.hill_climbing.hill_climb import Climb, Ending, end_of
from ccm_opt.hill_climbing.operators import Moves, Operator
from ccm_opt.hill_climbing.steps import Schema, SchemaStep, SchemaStopped
from ccm_opt.hill_climbing.world import World

HELD = (
    Operator.C_A, Operator.C_B, Operator.C_C, Operator.C_D, Operator.S_B, Operator.S_C, Operator.S_D, Operator.ROTATE,
)  # fmt: skip
"""Operators that leave the curvature at the end alone."""


def scm_6(world: World, start: Configuration) -> Schema:
    """SCM-6: change the curvature at the end to zero, while preserving the tip's position and orientation.

    Args:
        world: the world.
        start: where the arm is.

    Yields:
        A configuration with the tip where it was for every part of the way to zero.

    Returns:
        A configuration with C_e = 0 and the tip where it was.

    Raises:
        SchemaStopped: the tip cannot be held.
    """
    position, heading = start.tip
    held = TipPose(position, heading)
    here = start
    last = len(start.segments) - 1
    end = float(start.segments[-1].curvature[-1])
    count = int(np.ceil(abs(end) * start.segments[-1].length / world.settings.schemas.end_turn))
    for k in range(1, count + 1):
        shapes = Shapes.from_configurations([here])
        shapes.curvature[0, -1, -1] = end * (1.0 - k / count)
        here = hold(world, here, shapes.configuration(0), last, held, "SCM-6")
        yield SchemaStep("SCM-6", here)
    return here


def hold(
    world: World, before: Configuration, changed: Configuration, segment: int, held: TipPose, schema: str
) -> Configuration:
    """Bring the end of a segment back to a pose after a change, by operators that leave its end curvature alone.

    Args:
        world: the world.
        before: where the arm was; it must be able to move from there to the result.
        changed: the arm after the change.
        segment: whose end is held; the operators move it and those before it.
        held: where its end has to be.
        schema: in whose name.

    Raises:
        SchemaStopped: its end cannot be held, or something is in the way.
    """

    def objective(shapes: Shapes) -> FloatArray:
        return distance(shapes.first_segments(segment + 1))

    def reachable(here: Shapes, there: Shapes) -> BoolArray:
        del here
        return world.passes(origin, there)

    settings = world.settings.schemas
    origin = Shapes.from_configurations([before])
    distance = Distance(held, before.length, precision=settings.held_precision)
    moves = Moves(tuple(range(segment + 1)), HELD)

    # Climbs that ask about contact at their end only are quick, so they are tried first, from several beginnings; the
    # last one asks at every move.
    watched = replace(world, passes=reachable)
    anywhere = replace(world, passes=World().passes)
    relaxing = Climb(objective, -np.inf, moves, most_steps=settings.relaxing, push=settings.held_push)
    relaxed, _ = end_of(anywhere, changed, relaxing)
    tries = [(anywhere, begin, 0.0) for begin in (*_reselected(changed, segment, held), relaxed, changed)]
    tries.append((watched, changed, settings.held_push))
    # A climb may stop in a local minimum a hair from its end. From the middle between two beginnings it takes
    # another path, on which that minimum does not lie.
    tries += [(anywhere, middle, 0.0) for middle in _middles([begin for _, begin, _ in tries])]
    for guard, begin, push in tries:
        task = Climb(objective, distance.threshold, moves, push=push, patience=settings.held_patience)
        here, ending = end_of(guard, begin, task)
        if ending is Ending.ARRIVED and world.move_allowed(before, here):
            return here
    reason = "contact" if ending is Ending.ARRIVED else str(ending)
    raise SchemaStopped(schema, before, f"the segment of {long_length(changed.segments[segment].length)}: {reason}")


def _middles(beginnings: list[Configuration]) -> tuple[Configuration, ...]:
    """Configurations half-way between each beginning and the next, coordinate by coordinate."""
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
    """The base segment as the natural curve of its type and length, as SCM-1 would select it; nothing for others."""
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
