"""The plan of section 4.3: fold the arm, move it in front of the obstacle, and reach the goal from there (Figure 5)."""

from dataclasses import replace

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import merge_segments
from ccm_opt.errors import ProblemError
from ccm_opt.hill_climbing.distance import TipPose
from ccm_opt.hill_climbing.schemas import scm_0, scm_1, scm_2, scm_4, scm_6, scm_7, scm_8
from ccm_opt.hill_climbing.schemas.feeding import begin_feeding, pass_length
from ccm_opt.hill_climbing.steps import Schema, SchemaStopped, Step, run
from ccm_opt.hill_climbing.world import World

SHORT_ENOUGH = 1.5
"""The base segment gives away its length down to this multiple of the distance that it spans."""
ENOUGH = 3.0
"""From this multiple on it is short enough for merging where it can give no more."""
BACK = (0.0, 0.25, 0.5, 0.75)
"""Shares of the steps of SCM-8 that are taken back where SCM-7 cannot go on from its end."""
MERGE_TOLERANCE = 3.0
"""How far headings may move when the segments are merged [rad]; the arm goes there by SCM-2."""


def subgoals(base: FloatArray, obstacle: FloatArray) -> tuple[TipPose, TipPose]:
    """The midpoint between the base and a point of the obstacle, each (2,) [m], with both headings across the line."""
    line = obstacle - base
    direction = float(np.arctan2(line[1], line[0]))
    middle = base + 0.5 * line
    return TipPose(middle, direction - 0.5 * np.pi), TipPose(middle, direction + 0.5 * np.pi)


def fold_plan(world: World, start: Configuration, subgoal: TipPose, goal: TipPose) -> Schema:
    """The five steps of Figure 5.

    Args:
        world: the world.
        start: where the arm is.
        subgoal: in front of the obstacle.
        goal: for the tip.

    Yields:
        Steps; ``stage`` begins with the number of their part of the figure.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: naming the schema.
    """
    yield Step("start", start, "1 start")
    here = yield from fold(world, start, subgoal)
    here = yield from staged(scm_6(world, here), "4 reach from the subgoal")
    here = yield from staged(reach(world, here, goal), "4 reach from the subgoal")
    return (yield from staged(merge_and_climb(world, here, goal), "5 merge and climb"))


def fold(world: World, start: Configuration, subgoal: TipPose) -> Schema:
    """Change the type towards a subgoal (SCM-1, SCM-8) and proceed straight to it (SCM-7).

    Where SCM-8 meets something, or SCM-7 gets stuck at once, SCM-7 begins earlier on the way of SCM-8.
    """
    selection = scm_1(world, start, subgoal)
    turned, _ = run(scm_8(world.of_curve, start, selection.configuration(start.base), as_far_as_free=True))
    for back in BACK:
        kept = turned[: len(turned) - int(back * len(turned))]
        try:
            ahead, here = run(scm_7(world.of_curve, kept[-1].configuration, subgoal))
        except SchemaStopped as stopped:
            failure = stopped
            continue
        yield from (replace(step, stage="2 change the type") for step in kept)
        yield from (replace(step, stage="3 proceed to the subgoal") for step in ahead)
        return here
    raise failure


def reach(world: World, start: Configuration, goal: TipPose) -> Schema:
    """A tip segment traces the curve to the goal (SCM-4, SCM-5); what is before it holds the subgoal (SCM-3)."""
    span = float(np.hypot(*(start.tip[0] - start.base)))
    least = SHORT_ENOUGH * span
    curve = scm_4(world, start, goal, longest=start.length).segment
    here = begin_feeding(world, start, curve)
    yield Step("SCM-3", here)
    return (yield from pass_length(world, here, curve, curve.length, least, ENOUGH * span))


def merge_and_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Merge the segments where one can follow them, and climb to the goal by SCM-0; else climb with both."""
    here = start
    if len(start.segments) > 1:
        try:
            merged = merge_segments(start, len(start.segments) - 2, MERGE_TOLERANCE)
            here = yield from scm_2(world, start, merged)
        except (ProblemError, SchemaStopped):
            here = start  # a merge is a convenience: steps yielded before a contact are undone by the caller
    return (yield from scm_0(world, here, goal))


def staged(schema: Schema, stage: str) -> Schema:
    """The same steps, marked as a part of a plan."""
    while True:
        try:
            step = next(schema)
        except StopIteration as end:
            value: Configuration = end.value
            return value
        yield replace(step, stage=stage)
