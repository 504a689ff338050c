"""The plan of section 4.3: fold the arm, move it in front of the obstacle, and reach the goal from there (Figure 5)."""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import merge_segments
from ccm_opt.errors import ProblemError
from ccm_opt.geometry.angles import heading_of
from ccm_opt.hill_climbing.curve_track import Track
from ccm_opt.hill_climbing.distance import TipPose
from ccm_opt.hill_climbing.schemas import scm_0, scm_1, scm_2, scm_4, scm_6, scm_7, scm_8
from ccm_opt.hill_climbing.schemas.climbing import PATIENCE, PUSH
from ccm_opt.hill_climbing.schemas.feeding import FEED, Feeding, begin_feeding, pass_length, slide_boundary
from ccm_opt.hill_climbing.steps import Schema, SchemaStopped, Step, run
from ccm_opt.hill_climbing.world import World

_Result = TypeVar("_Result")

LEAST = 0.05
"""The base segment keeps this share of the arm's length."""
AHEAD = 0.06
"""The boundary moves ahead by this share of the arm's length."""
REACH = "4 reach from the subgoal"
SLIDE = 0.4
"""The boundary slides by this share of what was fed."""
NEAR = 0.15
"""The arm climbs to the goal when no more than this share of its length is left of the curve to it."""
BACK = (0.0, 0.25, 0.5, 0.75)
"""Shares of the steps of SCM-8 that are taken back where SCM-7 cannot go on from its end."""
FED = 1e-6
"""What is left of the curve counts as nothing below this share of the arm's length."""
AT_ONCE = 0.5
"""SCM-7 that gets farther than this share of its way does not begin earlier when it gets stuck."""
LAST_CLIMB = 300
"""Moves of SCM-0 at most after a merge."""
MERGE_TOLERANCE = 0.1
"""How far headings may move when the segments are merged [rad]; the arm goes there by SCM-2."""


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
    yield Step("start", start, "1 start")
    here = yield from (folds or Folds()).to(world, start, subgoal)
    here = yield from staged(scm_6(world, here), REACH)
    return (yield from reach(world, here, goal, sliding=sliding))


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
            if _share_of_way(kept[-1].configuration, stopped.configuration, subgoal) > AT_ONCE:
                break
            continue
        yield from (replace(step, stage="2 change the type") for step in kept)
        yield from (replace(step, stage="3 proceed to the subgoal") for step in ahead)
        return here
    raise failure


def _share_of_way(start: Configuration, end: Configuration, subgoal: TipPose) -> float:
    """How much of the way of the tip to a subgoal is made."""
    before, after = (float(np.hypot(*(c.tip[0] - subgoal.position))) for c in (start, end))
    return 1.0 - after / before


@dataclass(frozen=True)
class Folds:
    """Folds of one arm from one start, each made once however many plans ask for it.

    Attributes:
        known: steps and end, or how the fold stopped, by subgoal.
    """

    known: dict[tuple[float, ...], tuple[tuple[Step, ...], Configuration] | SchemaStopped] = field(default_factory=dict)

    def to(self, world: World, start: Configuration, subgoal: TipPose) -> Schema:
        """``fold``, or what it came to when it was first asked for."""
        key = (*subgoal.position, np.inf if subgoal.heading is None else subgoal.heading)
        if key not in self.known:
            try:
                self.known[key] = run(fold(world, start, subgoal))
            except SchemaStopped as stopped:
                self.known[key] = stopped
        outcome = self.known[key]
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
    return (yield from trace(world, start, Track((curve,)), goal, sliding=sliding))


def trace(world: World, start: Configuration, track: Track, goal: TipPose, *, sliding: bool) -> Schema:
    """Feed the arm along a track that begins at its tip, and climb to the goal when its end is near.

    A climb that stops is tried again when half of what was left is fed, and where the feed ends.

    Raises:
        SchemaStopped: the feed does not come near enough, or the climb does not arrive.
    """
    here, total = begin_feeding(world, start, track), start.length
    yield Step("SCM-3", here.configuration, REACH)
    most, near, moving = AHEAD * total if sliding else np.inf, NEAR * total, True
    while moving:
        before = here.out
        here = yield from staged(pass_length(world, here, LEAST * total, most), REACH)
        fed = here
        ahead = min((SLIDE if sliding else 1.0) * AHEAD * total, fed.out - FEED * total)
        if fed.left <= near:
            near = max(0.5 * fed.left, FED * total)
            try:
                return (yield from _arrival(world, fed, goal))
            except SchemaStopped:
                pass  # nearer, perhaps
        here = yield from staged(slide_boundary(world, here, ahead), REACH)
        moving = fed.out - here.out + fed.out - before >= FEED * total
    return (yield from _arrival(world, here, goal))


def _arrival(world: World, start: Feeding, goal: TipPose) -> Schema:
    """The last part of Figure 5 from where little of the curve is left; no step is made unless it arrives."""
    if start.left > NEAR * start.configuration.length:
        reason = f"{start.left:.3f} m of the curve to the goal are left"
        raise SchemaStopped("SCM-3 with SCM-5", start.configuration, reason)
    steps, here = run(merge_and_climb(world, start.configuration, goal))
    yield from (replace(step, stage="5 merge and climb") for step in steps)
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
    merged = merge_segments(start, len(start.segments) - 2, MERGE_TOLERANCE)
    here = yield from scm_2(world, start, merged)
    return (yield from _last_climb(world, here, goal))


def _last_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    return (yield from scm_0(world, start, goal, most_steps=LAST_CLIMB, push=PUSH, patience=PATIENCE))


def staged(schema: Generator[Step, None, _Result], stage: str) -> Generator[Step, None, _Result]:
    """The same steps, marked as a part of a plan."""
    while True:
        try:
            step = next(schema)
        except StopIteration as end:
            value: _Result = end.value
            return value
        yield replace(step, stage=stage)
