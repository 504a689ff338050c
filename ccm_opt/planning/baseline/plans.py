"""The fold plan of the baseline, and follow-the-leader (section 4).

The arm takes the mean heading of the curve on each link plus the offset of the start's own mapping, so that the first
keyframe is the start itself. Tips and contacts are those of the arm.
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
"""Share of the time left that one plan may use, so that the others have their turn. Taste."""
_CERTIFIED_GAP = 1e-4
"""Gap beyond contact that moves keep, as a share of the arm's length, so that the smooth path has clearance. Taste."""
_PLANNING_SHARE = 0.9
"""Share of the time limit that planning may use; the rest is for timing and verification. Taste."""
_BISECTIONS = 3
"""Halvings of a move before it counts as blocked. Taste: most candidate moves are discarded, so that fewer halvings
than the certificate's own pay."""
_ROUTE_INFLATION = 1e-3
"""Inflation of the walls for routes beyond radius and clearance, as a share of the arm's length. Taste."""

_LEAST_BASE_SEGMENT = 0.05
"""Least length of the base segment, as a share of the arm's. Taste."""
_BOUNDARY_AHEAD = 0.06
"""Length by which the boundary moves ahead, as a share of the arm's. Taste."""
_BOUNDARY_SLIDE = 0.4
"""Share of that length by which the boundary slides with the feed. Taste."""
_NEAR_GOAL = 0.15
"""Length left of the curve at which the arm climbs to the goal, as a share of the arm's. Taste."""
_NOTHING_LEFT = 1e-6
"""Length left of the curve that counts as none, as a share of the arm's. Taste."""
_TAKEN_BACK = (0.0, 0.25, 0.5, 0.75)
"""Shares of the steps of SCM-8 that are taken back where SCM-7 cannot continue from its end. Taste."""
_MOST_OF_WAY = 0.5
"""Share of its path above which SCM-7, when stuck, is not restarted from an earlier step. Taste."""
_LAST_CLIMB = 300
"""Most moves of SCM-0 after a merge. Taste."""
_MERGE_TOLERANCE = 0.1
"""Largest change of headings when the segments are merged [rad]; the arm moves to the result by SCM-2. Taste."""

_Result = TypeVar("_Result")

REACH = "4 reach from the subgoal"
"""The stage of the plan between the fold and the merge."""


def subgoals(base: FloatArray, obstacle: FloatArray) -> tuple[TipPose, TipPose]:
    """Return the subgoals midway between the base and a point of the obstacle, each (2,) [m].

    Their headings are the two directions perpendicular to the line from the base to that point.
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
    """Run the five steps of Figure 5.

    Args:
        world: the world.
        start: configuration of the arm.
        subgoal: subgoal in front of the obstacle.
        goal: goal of the tip.
        sliding: whether the boundary slides ahead with the feed from the beginning.
        folds: cache of folds shared with other plans.

    Yields:
        Steps, whose ``stage`` begins with the number of the step in Figure 5.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: a schema could not continue; names the schema.
    """
    yield SchemaStep("start", start, "1 start")
    here = yield from (folds or Folds()).to(world, start, subgoal)
    here = yield from staged(scm_6(world, here), REACH)
    return (yield from reach(world, here, goal, sliding=sliding))


def fold(world: World, start: Configuration, subgoal: TipPose) -> Schema:
    """Change the type towards a subgoal (SCM-1, SCM-8) and proceed straight to it (SCM-7).

    Where SCM-8 meets an obstruction, or SCM-7 gets stuck at once, SCM-7 begins at an earlier step of SCM-8.

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
    """Return the fraction of the tip's initial distance to a subgoal that has been covered."""
    before = float(np.hypot(*(start.tip[0] - subgoal.position)))
    after = float(np.hypot(*(end.tip[0] - subgoal.position)))
    return 1.0 - after / before


FoldOutcome: TypeAlias = tuple[tuple[SchemaStep, ...], Configuration] | SchemaStopped
"""Steps and end of a fold, or the exception that stopped it."""


@dataclass(frozen=True)
class Folds:
    """Folds of one arm from one start, each computed once and shared by all plans.

    Attributes:
        known: steps and end of each fold, or the exception that stopped it, by subgoal.
    """

    known: dict[tuple[float, ...], FoldOutcome] = field(default_factory=dict)

    def to(self, world: World, start: Configuration, subgoal: TipPose) -> Schema:
        """Run ``fold`` to a subgoal, or repeat the cached outcome.

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
    """Trace the curve to the goal with a tip segment (SCM-4, SCM-5), while the previous one holds the subgoal (SCM-3).

    When the base segment is short enough, the segments are merged and the arm climbs to the goal (SCM-0). Where the
    climb stops, the boundary moves ahead along the curve and the feed continues; with ``sliding`` the boundary moves
    throughout.
    """
    curve = scm_4(world, start, goal, longest=start.length).segment
    return (yield from trace(world, start, SegmentTrack((curve,)), goal, sliding=sliding))


def trace(world: World, start: Configuration, track: SegmentTrack, goal: TipPose, *, sliding: bool) -> Schema:
    """Feed the arm along a track that begins at its tip, and climb to the goal when the track's end is near.

    A climb that stops is tried again when half of the remaining length is fed, and where the feed ends.

    Raises:
        SchemaStopped: the feed does not come near enough, or the climb does not reach the goal.
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
            near = max(0.5 * fed.left, _NOTHING_LEFT * total)  # the climb may arrive from nearer

        here = yield from staged(slide_boundary(world, fed, min(slide, fed.out - step)), REACH)
        # Continue while feed and boundary together have moved by at least a step.
        moving = fed.out - here.out + fed.out - before >= step
    return (yield from _arrival(world, here, goal))


def _arrival_if_any(world: World, start: Feeding, goal: TipPose) -> tuple[tuple[SchemaStep, ...], Configuration] | None:
    """Return the steps and final configuration of the last part of Figure 5, or None if the goal is not reached."""
    try:
        return run(_arrival(world, start, goal))
    except SchemaStopped:
        return None


def _arrival(world: World, start: Feeding, goal: TipPose) -> Schema:
    """Run the last part of Figure 5, where little of the curve is left; yields steps only if the goal is reached.

    Raises:
        SchemaStopped: too much of the curve is left, or the climb does not reach the goal.
    """
    if start.left > _NEAR_GOAL * start.configuration.length:
        reason = f"{long_length(start.left)} of the curve to the goal are left"
        raise SchemaStopped("SCM-3 with SCM-5", start.configuration, reason)
    steps, here = run(merge_and_climb(world, start.configuration, goal))
    for step in steps:
        yield replace(step, stage="5 merge and climb")
    return here


def merge_and_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Merge the segments if one segment can replace them, and climb to the goal by SCM-0 with one or both.

    Raises:
        SchemaStopped: the arm reaches the goal neither with merged nor with separate segments.
    """
    try:
        steps, here = run(_merged_climb(world, start, goal))
    except (ProblemError, SchemaStopped):
        return (yield from _last_climb(world, start, goal))
    yield from steps
    return here


def _merged_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Move to the merged configuration by SCM-2, and on to the goal by SCM-0.

    Raises:
        ProblemError: the segments cannot be merged.
        SchemaStopped: a schema does not reach its goal.
    """
    if len(start.segments) < 2:
        raise ProblemError("got an arm of one segment, expected two that can be merged; climb with the one")
    # The merged arm is another configuration: SCM-2 moves there in steps that touch nothing.
    merged = merge_segments(start, len(start.segments) - 2, _MERGE_TOLERANCE)
    here = yield from scm_2(world, start, merged)
    return (yield from _last_climb(world, here, goal))


def _last_climb(world: World, start: Configuration, goal: TipPose) -> Schema:
    """Run SCM-0 with the weight of crowding and the patience that plans use."""
    most = _LAST_CLIMB
    return (yield from scm_0(world, start, goal, most_steps=most, push=PUSH, patience=PATIENCE))


def staged(schema: Generator[SchemaStep, None, _Result], stage: str) -> Generator[SchemaStep, None, _Result]:
    """Yield the steps of a schema, labelled with a stage of the plan."""
    while True:
        try:
            step = next(schema)
        except StopIteration as end:
            value: _Result = end.value
            return value
        yield replace(step, stage=stage)


_FIELD_CELLS = 160
"""Cells of the distance grid along the longer side of the workspace. Taste."""
_JOINT_LIMIT_SHARE = 0.99
"""Share of the joint limits that moves use, since the smooth path near them bends a little more. Taste."""
_MERGING_TOLERANCE = 0.02
"""Largest change of headings when segments of the start are merged [rad]; the follower's offset corrects it exactly.
Taste."""


def clearance_field(workspace: Workspace, need: float, cells: int = _FIELD_CELLS) -> Gap:
    """Return a function for the distance of points from the nearest wall beyond ``need``, interpolated in a grid.

    Args:
        workspace: the workspace; points outside it take the value at its edge.
        need: distance that the arm requires [m].
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
    """The jointed arm that follows the curves of the baseline.

    Attributes:
        problem: problem with the arm and its workspace.
        ends: start and goal on the links.
        certificate: certificate of moves.
        deadline: time at which to stop.
    """

    problem: Problem
    ends: Ends
    certificate: Certificate
    deadline: Deadline

    @classmethod
    def from_problem(cls, problem: Problem) -> "Follower":
        """Return the follower of a problem, with its share of the problem's time from now on.

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
        """The curve at the start, with as few segments as represent it."""
        pose = self.problem.start
        curve = nearest_curves(self.problem.arm, self.ends.start[None])[0] if pose.curve is None else pose.curve
        return _with_few_segments(curve, _MERGING_TOLERANCE)

    @cached_property
    def offset(self) -> FloatArray:
        """Difference of the start's link headings from the curve's mean headings, shape (links,) [rad]."""
        mean_headings = Shapes.from_configurations([self.start]).mean_headings(self.problem.arm.links)[0]
        offset: FloatArray = self.problem.arm.headings(self.ends.start) - mean_headings
        return offset

    def headings(self, shapes: Shapes) -> FloatArray:
        """Return the link headings, shape (m, links) [rad]."""
        return shapes.mean_headings(self.problem.arm.links) + self.offset

    def tips(self, shapes: Shapes) -> tuple[FloatArray, FloatArray]:
        """Return the positions (m, 2) [m] and headings (m,) [rad] of the arm's tips."""
        headings = self.headings(shapes)
        return self.problem.arm.joint_positions(headings)[:, -1], headings[:, -1]

    def passes(self, here: Shapes, there: Shapes) -> BoolArray:
        """Return a mask of the moves that satisfy the joint limits and touch nothing on their way.

        Args:
            here: one curve, the arm's current one.
            there: m curves to move to.

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
        """Function that returns the gaps of points in the workspace."""
        return clearance_field(self.problem.workspace, self.problem.arm.radius + self.problem.workspace.clearance)

    @cached_property
    def free_space(self) -> FreeSpace:
        """Free space of the arm's axis."""
        arm = self.problem.arm
        need = arm.radius + self.problem.workspace.clearance
        return FreeSpace(self.problem.workspace, need + _ROUTE_INFLATION * arm.length)

    @property
    def hurried_world(self) -> World:
        """World of the schemas for one plan, whose share of the remaining time begins now."""
        # A share of the time left now, so that late plans have less but every one has some.
        until = Deadline.after(_PLAN_SHARE * self.deadline.left)

        def passes(here: Shapes, there: Shapes) -> BoolArray:
            look_at_clock(until)
            return self.passes(here, there)

        return replace(self.world, passes=passes)

    @property
    def world(self) -> World:
        """The world of the schemas."""
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
    """Raise an error if the deadline has passed.

    Raises:
        TimeLimitReached: the deadline has passed.
    """
    if deadline.passed():
        raise TimeLimitReached(Diagnosis(deadline.what_passed(), "hill climbing", ("raise planner.time_limit",)))


def _certificate(problem: Problem, ends: Ends) -> Certificate:
    """Return the certificate of contact, with a small spare gap if the start has one.

    A start that touches something must be allowed to leave.
    """
    with_gap = Certificate(problem.arm, problem.workspace, _CERTIFIED_GAP * problem.arm.length)
    standing_still = np.stack((ends.start, ends.start))
    if len(with_gap.failures(standing_still)) == 0:
        return with_gap
    return Certificate(problem.arm, problem.workspace)


def _with_few_segments(configuration: Configuration, tolerance: float) -> Configuration:
    """Return the curve with neighbouring segments merged from the base on if headings stay within a tolerance [rad].

    Every segment multiplies the moves that a climb has to try, so each merged segment is worth the error.
    """
    k = 0
    while k < len(configuration.segments) - 1:
        try:
            configuration = merge_segments(configuration, k, tolerance)
        except ProblemError:
            k += 1
    return configuration
