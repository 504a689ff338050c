"""The fold plan of the baseline, and the jointed arm that follows the baseline's curves (section 4).

The heading of each link is the mean heading of the curve on that link plus a constant offset, chosen such that the
first keyframe is the start of the problem. Tips and contacts are evaluated for the jointed arm.
"""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
import shapely
from scipy.ndimage import map_coordinates

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, ProblemError, TimeLimitReached
from ccm_opt.core.length_words import long_length
from ccm_opt.core.polyline import vector_heading
from ccm_opt.planning.baseline.curve_track import SegmentTrack
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import Schema, SchemaStep, SchemaStopped, run
from ccm_opt.planning.baseline.operators import Shapes
from ccm_opt.planning.baseline.schema import FEED, PATIENCE, PUSH
from ccm_opt.planning.baseline.schemas import (
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
from ccm_opt.planning.baseline.world import Gap, World
from ccm_opt.planning.ends import Ends, resolve_ends
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import Problem
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import merge_segments
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Workspace

_PLAN_SHARE = 0.6
"""Fraction of the remaining time that one plan may use, so that time is left for the others. Heuristic."""
_CERTIFIED_GAP = 1e-4
"""Certified clearance of moves, as a fraction of the arm's length, so that the smooth path has clearance. Heuristic."""
_PLANNING_SHARE = 0.9
"""Fraction of the time limit that planning may use; the rest is for timing and verification. Heuristic."""
_BISECTIONS = 3
"""Number of bisections in the collision check after which a move counts as blocked. Heuristic: fewer than the check's
default are faster, since most candidate moves are discarded."""
_ROUTE_INFLATION = 1e-3
"""Inflation of walls for routes in addition to radius and clearance, as a fraction of the arm's length. Heuristic."""

_LEAST_BASE_SEGMENT = 0.05
"""Minimum length of the base segment, as a fraction of the arm's length. Heuristic."""
_BOUNDARY_AHEAD = 0.06
"""Length by which the start of the reference path moves ahead at a time, as a fraction of the arm's length.
Heuristic."""
_BOUNDARY_SLIDE = 0.4
"""Factor on ``_BOUNDARY_AHEAD`` if the start of the path moves ahead throughout the feed. Heuristic."""
_NEAR_GOAL = 0.15
"""Remaining length of the reference path at which the climb to the goal begins, as a fraction of the arm's length.
Heuristic."""
_NOTHING_LEFT = 1e-6
"""Remaining length of the reference path that counts as zero, as a fraction of the arm's length. Heuristic."""
_TAKEN_BACK = (0.0, 0.25, 0.5, 0.75)
"""Fractions of the steps of schema SCM-8 of the paper that are discarded, in order, if SCM-7 fails from the last step.
Heuristic."""
_MOST_OF_WAY = 0.5
"""Progress of a failed run of schema SCM-7 of the paper, as a fraction, above which it is not restarted from an earlier
step. Heuristic."""
_LAST_CLIMB = 300
"""Maximum number of moves of schema SCM-0 of the paper, the hill climb, at the end of a plan. Heuristic."""
_MERGE_TOLERANCE = 0.1
"""Maximum change of headings when segments are merged [rad]; the arm then moves to the result. Heuristic."""

_Result = TypeVar("_Result")

REACH = "4 reach from the subgoal"
"""Name of the stage of a plan between fold and merge."""


def subgoals(base: FloatArray, obstacle: FloatArray) -> tuple[TipPose, TipPose]:
    """Return two subgoals for the tip midway between the base and a point of an obstacle, with opposite headings.

    The headings are perpendicular to the line from base to point, first to the right, then to the left.

    Args:
        base: position of the base, shape (2,) [m].
        obstacle: point of the obstacle, shape (2,) [m].
    """
    line = obstacle - base
    direction = vector_heading(line)
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
    """Run the fold plan, the five stages of Figure 5: fold the arm in front of an obstacle, then feed it to the goal.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        subgoal: subgoal in front of the obstacle.
        goal: goal of the tip.
        sliding: whether the end of the folded part moves ahead throughout the feed.
        folds: cache of folds shared with other plans; not shared if None.

    Yields:
        Steps of the motion, whose ``stage`` begins with the number of the stage in Figure 5.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: a schema cannot continue; the exception has its name.
    """
    yield SchemaStep("start", start, "1 start")
    here = yield from (folds or Folds()).to(world, start, subgoal)
    here = yield from staged(scm_6(world, here), REACH)
    return (yield from reach(world, here, goal, sliding=sliding))


def fold(world: World, start: Configuration, subgoal: TipPose) -> Schema:
    """Change the curve to a type that suits a subgoal, then move the tip straight to the subgoal.

    The change uses schemas SCM-1 and SCM-8 of the paper, the second motion SCM-7. SCM-7 begins at the last
    collision-free step of SCM-8, or, if it fails early, at an earlier step. Steps are yielded only if it succeeds.

    Returns:
        A configuration with the tip at the subgoal.

    Raises:
        SchemaStopped: SCM-7 does not reach the subgoal from any step of SCM-8.
    """
    selection = scm_1(world, start, subgoal)
    turned, _ = run(scm_8(world.of_curve, start, selection.configuration(start.base), as_far_as_free=True))
    for back in _TAKEN_BACK:
        kept = turned[: len(turned) - int(back * len(turned))]
        try:
            ahead, here = run(scm_7(world.of_curve, kept[-1].configuration, subgoal))
        except SchemaStopped as stopped:
            failure = stopped
            if _progress_share(kept[-1].configuration, stopped.configuration, subgoal) > _MOST_OF_WAY:
                break  # the obstruction is far from the first step
        else:
            for step in kept:
                yield replace(step, stage="2 change the type")
            for step in ahead:
                yield replace(step, stage="3 proceed to the subgoal")
            return here
    raise failure


def _progress_share(start: Configuration, end: Configuration, subgoal: TipPose) -> float:
    """Return the fraction of the tip's distance to a subgoal that a motion from ``start`` to ``end`` removes.

    It is at most 1, and negative if the tip ends farther from the subgoal.
    """
    before = float(np.hypot(*(start.tip[0] - subgoal.position)))
    after = float(np.hypot(*(end.tip[0] - subgoal.position)))
    return 1.0 - after / before


FoldOutcome: TypeAlias = tuple[tuple[SchemaStep, ...], Configuration] | SchemaStopped
"""Steps and last configuration of a fold, or the exception that stopped the fold."""


@dataclass(frozen=True)
class Folds:
    """Cache of the folds of one arm from one start, each computed once and shared by all plans.

    Attributes:
        known: outcome of each fold, with position and heading of the subgoal as key.
    """

    known: dict[tuple[float, ...], FoldOutcome] = field(default_factory=dict)

    def to(self, world: World, start: Configuration, subgoal: TipPose) -> Schema:
        """Run ``fold`` to a subgoal, or repeat the steps or the exception of an earlier run.

        Raises:
            SchemaStopped: the fold does not reach the subgoal.
        """
        key = (*subgoal.position, np.inf if subgoal.heading is None else subgoal.heading)
        if key not in self.known:
            try:
                self.known[key] = run(fold(world, start, subgoal))
            except SchemaStopped as stopped:
                self.known[key] = stopped
        outcome = self.known[key]
        # Each exception is raised only once: raise a copy.
        if isinstance(outcome, SchemaStopped):
            raise SchemaStopped(outcome.schema, outcome.configuration, outcome.reason)
        yield from outcome[0]
        return outcome[1]


def reach(world: World, start: Configuration, goal: TipPose, *, sliding: bool = False) -> Schema:
    """Feed a new segment of the arm from the tip to the goal, while the segments before it get shorter.

    Schema SCM-4 of the paper selects the segment, SCM-5 feeds it, and SCM-3 shortens the others. Near the goal, the
    segments are merged and the arm climbs to the goal (SCM-0). If the climb stops, the boundary between the segments
    moves ahead along the curve and the feed continues; with ``sliding`` the boundary moves throughout.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        goal: goal of the tip.
        sliding: whether the boundary moves throughout.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: no segment reaches the goal, or the feed or the climb stops before the goal.
    """
    curve = scm_4(world, start, goal, longest=start.length).segment
    return (yield from trace(world, start, SegmentTrack((curve,)), goal, sliding=sliding))


def trace(world: World, start: Configuration, track: SegmentTrack, goal: TipPose, *, sliding: bool) -> Schema:
    """Feed the arm along a reference path that begins at the tip, and climb to the goal near the end of the path.

    A climb that stops is tried again after half of the remaining length is fed, and at the end of the feed.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        track: the reference path.
        goal: goal of the tip.
        sliding: whether the start of the path moves ahead throughout the feed, not just when the feed is blocked.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: the feed ends too far from the goal, or the climb does not reach the goal.
    """
    total = start.length
    step = FEED * total
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
            near = max(0.5 * fed.left, _NOTHING_LEFT * total)  # the climb may succeed from nearer

        here = yield from staged(slide_boundary(world, fed, min(slide, fed.out - step)), REACH)
        # Continue while the displacements of feed and boundary add up to at least a step.
        moving = fed.out - here.out + fed.out - before >= step
    return (yield from _arrival(world, here, goal))


def _arrival_if_any(world: World, start: Feeding, goal: TipPose) -> tuple[tuple[SchemaStep, ...], Configuration] | None:
    """Return the steps and last configuration of ``_arrival`` at the goal; None if the goal is not reached."""
    try:
        return run(_arrival(world, start, goal))
    except SchemaStopped:
        return None


def _arrival(world: World, start: Feeding, goal: TipPose) -> Schema:
    """Run the last stage of Figure 5, merge and climb, near the end of the reference path.

    Steps are yielded only if the goal is reached.

    Raises:
        SchemaStopped: the end of the path is too far away, or the climb does not reach the goal.
    """
    if start.left > _NEAR_GOAL * start.configuration.length:
        reason = f"{long_length(start.left)} of the curve to the goal are left"
        raise SchemaStopped("SCM-3 with SCM-5", start.configuration, reason)
    steps, here = run(merge_and_climb(world, start.configuration, goal))
    for step in steps:
        yield replace(step, stage="5 merge and climb")
    return here


def merge_and_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Merge the last two segments if possible and climb to the goal; if that fails, climb with both segments.

    Both climbs are schema SCM-0 of the paper.

    Raises:
        SchemaStopped: the goal is reached neither with merged nor with separate segments.
    """
    try:
        steps, here = run(_merged_climb(world, start, goal))
    except (ProblemError, SchemaStopped):
        return (yield from _last_climb(world, start, goal))
    yield from steps
    return here


def _merged_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Move to the configuration with the last two segments merged, then to the goal (schemas SCM-2 and SCM-0).

    Raises:
        ProblemError: the segments cannot be merged.
        SchemaStopped: a schema cannot continue.
    """
    if len(start.segments) < 2:
        raise ProblemError("got an arm of one segment, expected two that can be merged; climb with the one")
    # The merged arm is another configuration, to which SCM-2 moves without collision.
    merged = merge_segments(start, len(start.segments) - 2, _MERGE_TOLERANCE)
    here = yield from scm_2(world, start, merged)
    return (yield from _last_climb(world, here, goal))


def _last_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Run schema SCM-0 with the weight of the obstacle potential and the limits on moves that plans use."""
    most = _LAST_CLIMB
    return (yield from scm_0(world, start, goal, most_steps=most, push=PUSH, patience=PATIENCE))


def staged(schema: Generator[SchemaStep, None, _Result], stage: str) -> Generator[SchemaStep, None, _Result]:
    """Yield the steps of a generator, labelled with a stage of the plan, and return its return value."""
    while True:
        try:
            step = next(schema)
        except StopIteration as end:
            value: _Result = end.value
            return value
        yield replace(step, stage=stage)


_FIELD_CELLS = 160
"""Number of cells of the distance grid along the longer side of the workspace. Heuristic."""
_JOINT_LIMIT_SHARE = 0.99
"""Fraction of the joint limits that moves may use, since the smooth path may bend a little more. Heuristic."""
_MERGING_TOLERANCE = 0.02
"""Maximum change of headings when segments of the start are merged [rad]; the offset of the follower corrects it
exactly. Heuristic."""


def clearance_field(workspace: Workspace, need: float, cells: int = _FIELD_CELLS) -> Gap:
    """Return a function from points to their distance from the nearest wall minus ``need``, interpolated in a grid.

    Args:
        workspace: the workspace; points outside get the value at the nearest point of its edge.
        need: required distance [m].
        cells: number of cells along the longer side of the workspace.
    """
    xmin, ymin, xmax, ymax = workspace.boundary.bounds
    cell = max(xmax - xmin, ymax - ymin) / cells
    x = np.arange(xmin, xmax + cell, cell)
    y = np.arange(ymin, ymax + cell, cell)
    nodes = np.asarray(shapely.points(*np.meshgrid(x, y, indexing="ij")))
    gaps = np.full(nodes.shape, np.inf)
    for wall in workspace.walls:
        np.minimum(gaps, shapely.distance(nodes, wall.core) - wall.rounding, out=gaps)

    def gap(points: FloatArray) -> FloatArray:
        places = np.moveaxis((points - np.array([xmin, ymin])) / cell, -1, 0)
        return np.asarray(map_coordinates(gaps - need, places, order=1, mode="nearest"))

    return gap


@dataclass(frozen=True)
class Follower:
    """The jointed arm that follows the baseline's curves: joint angles, tips and allowed moves for backbone curves.

    Attributes:
        problem: problem with the arm and its workspace.
        ends: start and goal of the jointed arm.
        certificate: collision check for straight motions in joint space.
        deadline: time at which planning stops.
    """

    problem: Problem
    ends: Ends
    certificate: Certificate
    deadline: Deadline

    @classmethod
    def from_problem(cls, problem: Problem) -> "Follower":
        """Return the follower of a problem, whose deadline begins to run now.

        Args:
            problem: the problem.

        Raises:
            UnreachableGoal: the start or the goal is impossible.
        """
        ends = resolve_ends(problem)
        deadline = Deadline.after(_PLANNING_SHARE * problem.planner.time_limit)
        return cls(problem, ends, _certificate(problem, ends), deadline)

    @cached_property
    def start(self) -> Configuration:
        """Backbone curve of the start, with as few segments as represent it."""
        pose = self.problem.start
        curve = nearest_curves(self.problem.arm, self.ends.start[None])[0] if pose.curve is None else pose.curve
        return _with_few_segments(curve, _MERGING_TOLERANCE)

    @cached_property
    def offset(self) -> FloatArray:
        """Differences between link headings of the start and mean headings of its curve, shape (links,) [rad]."""
        mean_headings = Shapes.from_configurations([self.start]).mean_headings(self.problem.arm.links)[0]
        offset: FloatArray = self.problem.arm.headings(self.ends.start) - mean_headings
        return offset

    def headings(self, shapes: Shapes) -> FloatArray:
        """Return the link headings of the arm for m backbone curves, shape (m, links) [rad]."""
        return shapes.mean_headings(self.problem.arm.links) + self.offset

    def tips(self, shapes: Shapes) -> tuple[FloatArray, FloatArray]:
        """Return positions (m, 2) [m] and headings (m,) [rad] of the arm's tip for m backbone curves."""
        headings = self.headings(shapes)
        return self.problem.arm.joint_positions(headings)[:, -1], headings[:, -1]

    def passes(self, here: Shapes, there: Shapes) -> BoolArray:
        """Return which of m motions, linear in bends, respect the joint limits and are certified collision-free.

        Args:
            here: current backbone curve, a batch of one.
            there: m backbone curves at the ends of the motions.

        Returns:
            Mask, shape (m,).

        Raises:
            TimeLimitReached: the deadline has passed.
        """
        look_at_clock(self.deadline)
        arm = self.problem.arm
        limits = _JOINT_LIMIT_SHARE * arm.bend_limits
        bends = arm.bends(self.headings(there))
        allowed: BoolArray = np.all(np.abs(bends) <= limits, axis=1)
        if allowed.any():
            # One call of the certificate for all moves: here, there, here, there, ... The odd intervals lead back from
            # a candidate to the start and are ignored.
            keyframes = np.repeat(bends[allowed], 2, axis=0)
            keyframes[::2] = arm.bends(self.headings(here)[0])
            failing = self.certificate.failures(keyframes, _BISECTIONS)
            blocked = failing[failing % 2 == 0] // 2
            allowed[np.flatnonzero(allowed)[blocked]] = False
        return allowed

    @cached_property
    def gap(self) -> Gap:
        """Function from points (..., 2) to their approximate distances from contact with a wall, shape (...) [m]."""
        return clearance_field(self.problem.workspace, self.problem.arm.radius + self.problem.workspace.clearance)

    @cached_property
    def free_space(self) -> FreeSpace:
        """Free space of the arm's centre line, bounded by walls inflated by radius, clearance and a small margin."""
        arm = self.problem.arm
        need = arm.radius + self.problem.workspace.clearance
        return FreeSpace(self.problem.workspace, need + _ROUTE_INFLATION * arm.length)

    @property
    def quick_world(self) -> World:
        """New environment of the schemas for one plan, whose fraction of the remaining time begins to run now."""
        # A share of the time left now, so that late plans have less but every one has some.
        until = Deadline.after(_PLAN_SHARE * self.deadline.left)

        def passes(here: Shapes, there: Shapes) -> BoolArray:
            look_at_clock(until)
            return self.passes(here, there)

        return replace(self.world, passes=passes)

    @property
    def world(self) -> World:
        """Environment of the schemas for this arm."""
        arm = self.problem.arm
        if self.ends.clamped:  # the base stands flush on a wall
            base_range = (self.start.base_heading, self.start.base_heading)
        else:
            base_range = (arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit)
        return World(
            passes=self.passes,
            tips=self.tips,
            gap=self.gap,
            curvature_limit=arm.joint_limit / arm.link_length,
            thickness=2.0 * arm.radius if arm.self_collision else 0.0,
            base_range=base_range,
        )


def look_at_clock(deadline: Deadline) -> None:
    """Raise an exception if a deadline has passed.

    Raises:
        TimeLimitReached: the deadline has passed.
    """
    if deadline.passed():
        raise TimeLimitReached(Diagnosis(deadline.what_passed(), "hill climbing", ("raise planner.time_limit",)))


def _certificate(problem: Problem, ends: Ends) -> Certificate:
    """Return the collision check for moves of the arm, with a small clearance if the start has this clearance.

    A start in contact must be allowed to leave.
    """
    with_gap = Certificate(problem.arm, problem.workspace, _CERTIFIED_GAP * problem.arm.length)
    standing_still = np.stack((ends.start, ends.start))
    if len(with_gap.failures(standing_still)) == 0:
        return with_gap
    return Certificate(problem.arm, problem.workspace)


def _with_few_segments(configuration: Configuration, tolerance: float) -> Configuration:
    """Return a curve with adjacent segments merged, from the base on, if headings change by at most ``tolerance``.

    Fewer segments are worth the error, since the number of candidate moves of a climb grows with every segment.
    """
    k = 0
    while k < len(configuration.segments) - 1:
        try:
            configuration = merge_segments(configuration, k, tolerance)
        except ProblemError:
            k += 1
    return configuration
