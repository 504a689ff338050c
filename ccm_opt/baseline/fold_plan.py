"""The plan of section 4.3 of the paper: fold, move in front of the obstacle, reach the goal from there (Figure 5)."""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import TypeAlias, TypeVar

import numpy as np

from ccm_opt.baseline.curve_track import SegmentTrack
from ccm_opt.baseline.distance import TipPose
from ccm_opt.baseline.hill_climb import Schema, SchemaStep, SchemaStopped, run
from ccm_opt.baseline.schemas import (
    Feeding,
    begin_feeding,
    pass_length,
    scm_0,
    scm_1,
    scm_2,
    scm_4,
    scm_6,
    scm_7,
    scm_8,
    slide_boundary,
)
from ccm_opt.baseline.world import World
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import heading_of
from ccm_opt.errors import ProblemError
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import merge_segments

_LEAST_BASE_SEGMENT = 0.05
"""Length that the base segment keeps. Taste."""
_BOUNDARY_AHEAD = 0.06
"""Length by which the boundary moves ahead. Taste."""
_BOUNDARY_SLIDE = 0.4
"""Share of that by which it slides with the feed. Taste."""
_NEAR_GOAL = 0.15
"""The arm climbs to the goal when no more than this length is left of the curve to it. Taste."""
_NOTHING_LEFT = 1e-6
"""What is left of the curve counts as nothing below this length. Taste."""
_TAKEN_BACK = (0.0, 0.25, 0.5, 0.75)
"""Shares of the steps of SCM-8 that are taken back where SCM-7 cannot go on from its end. Taste."""
_MOST_OF_WAY = 0.5
"""SCM-7 that gets farther than this share of its way does not begin earlier when it is stuck. Taste."""
_LAST_CLIMB = 300
"""Moves of SCM-0 after a merge, at most. Taste."""
_MERGE_TOLERANCE = 0.1
"""How far headings may move when the segments are merged [rad]; the arm goes there by SCM-2. Taste."""

_Result = TypeVar("_Result")

REACH = "4 reach from the subgoal"
"""The stage of the plan between the fold and the merge."""


def subgoals(base: FloatArray, obstacle: FloatArray) -> tuple[TipPose, TipPose]:
    """The midpoint between the base and a point of the obstacle, each (2,) [m], with both headings across the line."""
    line = obstacle - base
    direction = heading_of(line)
    middle = base + 0.5 * line
    return TipPose(middle, direction - 0.5 * np.pi), TipPose(middle, direction + 0.5 * np.pi)


def fold_plan(
    world: World,
    start: Configuration,
    subgoal: TipPose,
    goal: TipPose,
    *,
    sliding: bool = False,
    folds: "Folds | None" = None,
) -> Schema:
    """The five steps of Figure 5.

    Args:
        world: the world.
        start: where the arm is.
        subgoal: in front of the obstacle.
        goal: for the tip.
        sliding: let the boundary slide ahead with the feed from the beginning.
        folds: remembers folds for other plans.

    Yields:
        Steps; ``stage`` begins with the number of their part of the figure.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: naming the schema.
    """
    yield SchemaStep("start", start, "1 start")
    here = yield from (folds or Folds()).to(world, start, subgoal)
    here = yield from staged(scm_6(world, here), REACH)
    return (yield from reach(world, here, goal, sliding=sliding))


def fold(world: World, start: Configuration, subgoal: TipPose) -> Schema:
    """Change the type towards a subgoal (SCM-1, SCM-8) and proceed straight to it (SCM-7).

    Where SCM-8 meets something, or SCM-7 gets stuck at once, SCM-7 begins earlier on the way of SCM-8.
    """
    selection = scm_1(world, start, subgoal)
    turned, _ = run(scm_8(world.of_curve, start, selection.configuration(start.base), as_far_as_free=True))
    for back in _TAKEN_BACK:
        kept = turned[: len(turned) - int(back * len(turned))]
        try:
            ahead, here = run(scm_7(world.of_curve, kept[-1].configuration, subgoal))
        except SchemaStopped as stopped:
            failure = stopped
            if _share_of_way(kept[-1].configuration, stopped.configuration, subgoal) > _MOST_OF_WAY:
                break  # what stopped it is far from where it began
        else:
            for step in kept:
                yield replace(step, stage="2 change the type")
            for step in ahead:
                yield replace(step, stage="3 proceed to the subgoal")
            return here
    raise failure


def _share_of_way(start: Configuration, end: Configuration, subgoal: TipPose) -> float:
    """How much of the way of the tip to a subgoal is made."""
    before = float(np.hypot(*(start.tip[0] - subgoal.position)))
    after = float(np.hypot(*(end.tip[0] - subgoal.position)))
    return 1.0 - after / before


FoldOutcome: TypeAlias = tuple[tuple[SchemaStep, ...], Configuration] | SchemaStopped
"""Steps and end of a fold, or how it stopped."""


@dataclass(frozen=True)
class Folds:
    """Folds of one arm from one start, each made once however many plans ask for it.

    Attributes:
        known: steps and end, or how the fold stopped, by subgoal.
    """

    known: dict[tuple[float, ...], FoldOutcome] = field(default_factory=dict)

    def to(self, world: World, start: Configuration, subgoal: TipPose) -> Schema:
        """``fold``, or what it came to when it was first asked for."""
        key = (*subgoal.position, np.inf if subgoal.heading is None else subgoal.heading)
        if key not in self.known:
            try:
                self.known[key] = run(fold(world, start, subgoal))
            except SchemaStopped as stopped:
                self.known[key] = stopped
        outcome = self.known[key]
        # An exception is raised once only: another one of the same words stands for it.
        if isinstance(outcome, SchemaStopped):
            raise SchemaStopped(outcome.schema, outcome.configuration, outcome.reason)
        yield from outcome[0]
        return outcome[1]


def reach(world: World, start: Configuration, goal: TipPose, *, sliding: bool = False) -> Schema:
    """A tip segment traces the curve to the goal (SCM-4, SCM-5); what is before it holds the subgoal (SCM-3).

    When the base segment is short enough the segments are merged and the arm climbs to the goal (SCM-0). Where that
    stops, the boundary moves ahead along the curve and the feed goes on; with ``sliding`` it does so all along.
    """
    curve = scm_4(world, start, goal, longest=start.length).segment
    return (yield from trace(world, start, SegmentTrack((curve,)), goal, sliding=sliding))


def trace(world: World, start: Configuration, track: SegmentTrack, goal: TipPose, *, sliding: bool) -> Schema:
    """Feed the arm along a track that begins at its tip, and climb to the goal when its end is near.

    A climb that stops is tried again when half of what was left is fed, and where the feed ends.

    Raises:
        SchemaStopped: the feed does not come near enough, or the climb does not arrive.
    """
    total = start.length
    step = world.settings.schemas.feed * total
    least = _LEAST_BASE_SEGMENT * total
    slide = _BOUNDARY_AHEAD * total
    most = np.inf
    if sliding:
        most = slide
        slide *= _BOUNDARY_SLIDE
    near = _NEAR_GOAL * total

    here = begin_feeding(world, start, track)
    yield SchemaStep("SCM-3", here.configuration, REACH)
    moving = True
    while moving:
        before = here.out
        fed = yield from staged(pass_length(world, here, least, most), REACH)
        if fed.left <= near:
            arrived = _arrival_if_any(world, fed, goal)
            if arrived is not None:
                steps, end = arrived
                yield from steps
                return end
            near = max(0.5 * fed.left, _NOTHING_LEFT * total)  # perhaps from nearer

        here = yield from staged(slide_boundary(world, fed, min(slide, fed.out - step)), REACH)
        # It goes on while feed and boundary together have moved by a step.
        moving = fed.out - here.out + fed.out - before >= step
    return (yield from _arrival(world, here, goal))


def _arrival_if_any(world: World, start: Feeding, goal: TipPose) -> tuple[tuple[SchemaStep, ...], Configuration] | None:
    """Steps and end of the last part of Figure 5, or None where it does not arrive."""
    try:
        return run(_arrival(world, start, goal))
    except SchemaStopped:
        return None


def _arrival(world: World, start: Feeding, goal: TipPose) -> Schema:
    """The last part of Figure 5 from where little of the curve is left; no step is made unless it arrives."""
    if start.left > _NEAR_GOAL * start.configuration.length:
        reason = f"{long_length(start.left)} of the curve to the goal are left"
        raise SchemaStopped("SCM-3 with SCM-5", start.configuration, reason)
    steps, here = run(merge_and_climb(world, start.configuration, goal))
    for step in steps:
        yield replace(step, stage="5 merge and climb")
    return here


def merge_and_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Merge the segments where one can follow them, and climb to the goal by SCM-0; else climb with both.

    Raises:
        SchemaStopped: neither the arm with merged segments nor that with all of them arrives.
    """
    try:
        steps, here = run(_merged_climb(world, start, goal))
    except (ProblemError, SchemaStopped):
        return (yield from _last_climb(world, start, goal))
    yield from steps
    return here


def _merged_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """There by SCM-2, on by SCM-0."""
    if len(start.segments) < 2:
        raise ProblemError("got an arm of one segment, expected two that can be merged; climb with the one")
    # The merged arm is another configuration: SCM-2 goes there, in steps that touch nothing.
    merged = merge_segments(start, len(start.segments) - 2, _MERGE_TOLERANCE)
    here = yield from scm_2(world, start, merged)
    return (yield from _last_climb(world, here, goal))


def _last_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """SCM-0 with the push and the patience of a plan."""
    most = _LAST_CLIMB
    settings = world.settings.schemas
    return (yield from scm_0(world, start, goal, most_steps=most, push=settings.push, patience=settings.patience))


def staged(schema: Generator[SchemaStep, None, _Result], stage: str) -> Generator[SchemaStep, None, _Result]:
    """The same steps, marked as a part of a plan."""
    while True:
        try:
            step = next(schema)
        except StopIteration as end:
            value: _Result = end.value
            return value
        yield replace(step, stage=stage)
