"""The plan of section 4.1 of the paper, which its authors left as future work.

(1) Free space is partitioned into convex regions. (2) Subgoals are the turns of a route through the connectivity graph
of these regions. (3) The arm is decomposed: what lies before the first subgoal is folded and holds it, what lies after
has a segment for each straight passage and each cubic-spiral turn. (4) Schemas achieve each subgoal: SCM-1, SCM-8 and
SCM-7 the first, SCM-3 and SCM-5 the others, SCM-0 the goal.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ccm_opt.baseline.curve_track import SegmentTrack, track_through, without_near
from ccm_opt.baseline.distance import TipPose
from ccm_opt.baseline.fold_plan import REACH, Folds, staged, subgoals, trace
from ccm_opt.baseline.hill_climb import Schema, SchemaStep, SchemaStopped, run
from ccm_opt.baseline.schemas import scm_6, scm_7
from ccm_opt.baseline.world import World
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths, heading_of, unit_vector
from ccm_opt.errors import ProblemError, UnreachableGoal
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.free_space import FreeSpace

_STRAIGHT_RUNS = (0.08, 0.05, 0.03, 0.015)
"""Straight runs out of the first subgoal and into the goal that are tried. Taste."""
_FIRST_SUBGOALS = (0.15, 0.08)
"""Places of the first subgoal on the route, from the base; the nearer, the tighter the fold, so the farther is tried
first. Taste."""
_CORNER_SPACING = 0.7
"""Corners nearer to each other than this share of the straight run are taken as one. Taste."""
_TRACK_SAMPLES = 200
"""Points of a track that are looked at for contact. Taste."""
_SHARPEST_TURN = 0.85
"""Share of the curvature's limit that a turn may use. Taste."""


@dataclass(frozen=True)
class Passage:
    """A first subgoal and the track that leads from it to the goal.

    Attributes:
        subgoal: for the tip of the folded arm.
        track: from there to the goal.
    """

    subgoal: TipPose
    track: SegmentTrack


def region_plan(
    world: World, start: Configuration, passage: Passage, goal: TipPose, folds: Folds | None = None
) -> Schema:
    """Fold to the first subgoal of a passage, then feed along it to the goal.

    Args:
        world: the world.
        start: where the arm is.
        passage: through the regions.
        goal: for the tip.
        folds: remembers folds for other plans.

    Yields:
        Steps.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: naming the schema.
    """
    yield SchemaStep("start", start, "1 start")
    if len(start.segments) == 1:
        here = yield from (folds or Folds()).to(world, start, passage.subgoal)
    else:
        nearer = scm_7(world.of_curve, start, passage.subgoal, world.settings.plans.near_subgoal)
        here = yield from staged(nearer, "3 proceed to the subgoal")
    here = yield from staged(_interface(world, here), REACH)
    return (yield from trace(world, here, passage.track, goal, sliding=True))


def _interface(world: World, start: Configuration) -> Schema:
    """SCM-6, or nothing where the arm has no room for it: the curvature then jumps where the track begins."""
    try:
        steps, here = run(scm_6(world, start))
    except SchemaStopped:
        return start
    yield from steps
    return here


def passages(
    world: World, start: Configuration, room: FreeSpace, goal: TipPose, obstacle: FloatArray | None, routes: int
) -> Iterator[Passage]:
    """Passages from near the base to the goal: beside the obstacle ahead, then along the routes from the base.

    Those longer than the arm are left out, for it cannot follow them.

    Args:
        world: the world; its curvature limit counts.
        start: the arm.
        room: free space of the arm's axis.
        goal: for the tip.
        obstacle: the point of the obstacle ahead, shape (2,) [m], or None.
        routes: so many routes are looked at, shortest first.
    """
    settings = world.settings.plans
    shrink = settings.corner_distance * start.length
    firsts = []
    if obstacle is not None:
        firsts = [(first, np.array([first.position, goal.position])) for first in subgoals(start.base, obstacle)]
    for route in room.routes(start.base, goal.position, routes, shrink=shrink):
        firsts += [_on_route(route.taut, share * start.length) for share in _FIRST_SUBGOALS]
    for first, way in firsts:
        track = _first_open_track(world, room, first, way, goal, start.length, shrink)
        if track is not None and track.length <= start.length:
            yield Passage(first, track)


def _first_open_track(
    world: World, room: FreeSpace, first: TipPose, way: FloatArray, goal: TipPose, length: float, shrink: float
) -> SegmentTrack | None:
    """The track with the longest straight runs that touches nothing, for an arm of a length [m]; None without any."""
    for share in _STRAIGHT_RUNS:
        try:
            track = _track(world, room, first, way, goal, share * length, shrink)
        except (ProblemError, UnreachableGoal):
            continue  # no way, or one too sharp for the arm: a shorter run leaves more room to turn
        if _is_open(world, first, track):
            return track
    return None


def _is_open(world: World, first: TipPose, track: SegmentTrack) -> bool:
    """Whether a track touches no wall."""
    samples = np.linspace(0.0, track.length, _TRACK_SAMPLES)
    places = track.from_pose(first.position).positions_at(samples)
    return bool(np.all(world.gap(places) > 0.0))


def _on_route(taut: FloatArray, distance: float) -> tuple[TipPose, FloatArray]:
    """The pose on a polyline at a distance from its start, and what of the polyline comes after it."""
    ends = arc_lengths(taut)[1:]
    leg = min(int(np.searchsorted(ends, distance)), len(ends) - 1)
    heading = heading_of(taut[leg + 1] - taut[leg])
    short = max(0.0, float(ends[leg]) - distance)
    position = taut[leg + 1] - short * unit_vector(heading)
    return TipPose(position, heading), np.vstack((position, taut[leg + 1 :]))


def _track(
    world: World, room: FreeSpace, first: TipPose, way: FloatArray, goal: TipPose, run: float, shrink: float
) -> SegmentTrack:
    """Straight passages and turns from the first subgoal to the goal, along the taut way between their runs.

    Raises:
        ProblemError: a turn is too sharp.
        UnreachableGoal: there is no way.
    """
    # Straight runs at both ends, so that the headings there are met without a turn.
    entry = first.position + run * unit_vector(first.heading or 0.0)
    last = goal.position if goal.heading is None else goal.position - run * unit_vector(goal.heading)
    # A way of its two ends only says nothing of how to pass between the walls: look for a route.
    if len(way) == 2:
        found = room.routes(entry, last, 1)
        if not found:
            raise ProblemError("no route leads from the first subgoal to the goal; choose another subgoal")
        way = found[0].taut
    taut = room.taut_path(np.array([entry, *way[1:-1], last]), shrink)
    corners = [first.position, *taut]
    if goal.heading is not None:
        corners.append(goal.position)
    distinct = without_near(corners, _CORNER_SPACING * run)
    return track_through(distinct, _SHARPEST_TURN * world.curvature_limit)
