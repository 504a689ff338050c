"""The planner of the 1990 paper: hill climbing through convex regions of free space.

(1) Free space is partitioned into convex regions. (2) Subgoals are the turns of a route through the connectivity graph
of the regions. (3) The arm is divided at the first subgoal: the part before is folded and keeps its end there, the part
after has a segment for each straight passage and each cubic-spiral turn. (4) Schemas achieve the subgoals: SCM-1, SCM-8
and SCM-7 the first, SCM-3 and SCM-5 the others, SCM-0 the goal.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import Diagnosis, MotionNotFound, ProblemError, TimeLimitReached, UnreachableGoal
from ccm_opt.core.polyline import arc_lengths, unit_vector, vector_heading
from ccm_opt.core.progress import Stages
from ccm_opt.planning.baseline.curve_track import SegmentTrack, track_through, without_near
from ccm_opt.planning.baseline.distance import Precision, TipPose
from ccm_opt.planning.baseline.hill_climb import Schema, SchemaStep, SchemaStopped, run
from ccm_opt.planning.baseline.operators import Shapes
from ccm_opt.planning.baseline.plans import REACH, Folds, Follower, fold_plan, staged, subgoals, trace
from ccm_opt.planning.baseline.schema import scm_0, scm_2
from ccm_opt.planning.baseline.schemas import ranked_selections, scm_6, scm_7
from ccm_opt.planning.baseline.world import World
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.spline_path import certified_spare, certified_spline
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.scene.free_space import FreeSpace

_STRAIGHT_RUNS = (0.08, 0.05, 0.03, 0.015)
"""Lengths of the straight lines after the first subgoal and before the goal, tried in order, as fractions of the arm's
length. Heuristic."""
_FIRST_SUBGOALS = (0.15, 0.08)
"""Distances of the first subgoal from the base along the route, as fractions of the arm's length; the farther one is
tried first, since a nearer subgoal requires a tighter fold. Heuristic."""
_CORNER_SPACING = 0.7
"""Distance between corners below which they are merged, as a fraction of the length of the straight lines at the ends
of the reference path. Heuristic."""
_CORNER_DISTANCE = 0.04
"""Distance to keep from corners of obstacles where possible, as a fraction of the arm's length. Heuristic."""
_NEAR_SUBGOAL = Precision(1.2e-3, 4e-3)
"""Precision of the first subgoal for an arm of several curvature segments. Heuristic."""
_TRACK_SAMPLES = 200
"""Number of points of a reference path that are checked for contact. Heuristic."""
_SHARPEST_TURN = 0.85
"""Maximum curvature of a turn, as a fraction of the curvature limit. Heuristic."""


Passage: TypeAlias = tuple[TipPose, SegmentTrack]
"""A first subgoal for the tip of the folded arm, and the reference path from this subgoal to the goal."""


def region_plan(
    world: World, start: Configuration, passage: Passage, goal: TipPose, folds: Folds | None = None
) -> Schema:
    """Run the region plan: fold the arm to the first subgoal of a passage, then feed it along the passage to the goal.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        passage: first subgoal, and reference path from there to the goal.
        goal: goal of the tip.
        folds: cache of folds shared with other plans; not shared if None.

    Yields:
        Steps of the motion.

    Returns:
        A configuration at the goal.

    Raises:
        SchemaStopped: a schema cannot continue; the exception has its name.
    """
    yield SchemaStep("start", start, "1 start")
    subgoal, track = passage
    if len(start.segments) == 1:
        here = yield from (folds or Folds()).to(world, start, subgoal)
    else:
        nearer = scm_7(world.of_curve, start, subgoal, _NEAR_SUBGOAL)
        here = yield from staged(nearer, "3 proceed to the subgoal")
    here = yield from staged(_interface(world, here), REACH)
    return (yield from trace(world, here, track, goal, sliding=True))


def _interface(world: World, start: Configuration) -> Schema:
    """Run schema SCM-6 of the paper: reduce the curvature at the tip to zero while the tip keeps its pose.

    Without it, curvature jumps where the reference path begins. If SCM-6 succeeds, its steps are yielded and its last
    configuration is returned. If it is blocked, no step is yielded and ``start`` is returned.
    """
    try:
        steps, here = run(scm_6(world, start))
    except SchemaStopped:
        return start
    yield from steps
    return here


def passages(
    world: World, start: Configuration, room: FreeSpace, goal: TipPose, obstacle: FloatArray | None, routes: int
) -> Iterator[Passage]:
    """Yield passages (first subgoal near the base, reference path to the goal) that touch no wall.

    Those past the obstacle ahead come first, then those along routes from the base. Passages longer than the arm are
    left out, since the arm cannot reach their ends.

    Args:
        world: environment of the schemas, with the curvature limit.
        start: configuration of the arm.
        room: free space of the arm's centre line.
        goal: goal of the tip.
        obstacle: result of ``obstacle_ahead``, shape (2,) [m]; None if the line of sight from base to goal is free.
        routes: maximum number of routes in different homotopy classes, shortest first.
    """
    shrink = _CORNER_DISTANCE * start.length
    firsts = []
    if obstacle is not None:
        firsts = [(first, np.array([first.position, goal.position])) for first in subgoals(start.base, obstacle)]
    for route in room.routes(start.base, goal.position, routes, shrink=shrink):
        firsts += [_on_route(route.taut, share * start.length) for share in _FIRST_SUBGOALS]
    for first, way in firsts:
        track = _first_open_track(world, room, first, way, goal, start.length, shrink)
        if track is not None and track.length <= start.length:
            yield first, track


def _first_open_track(
    world: World, room: FreeSpace, first: TipPose, way: FloatArray, goal: TipPose, length: float, shrink: float
) -> SegmentTrack | None:
    """Return a collision-free reference path whose straight ends are the longest of those tried.

    The lengths in ``_STRAIGHT_RUNS`` are tried in order; the result is None if no path is collision-free.

    Args:
        world: environment of the schemas.
        room: free space of the arm's centre line.
        first: first subgoal, where the path begins.
        way: vertices of the route from the first subgoal to the goal, shape (k ≥ 2, 2) [m].
        goal: goal of the tip.
        length: length of the arm [m].
        shrink: distance to keep from corners of obstacles where possible [m].
    """
    for share in _STRAIGHT_RUNS:
        try:
            track = _track(world, room, first, way, goal, share * length, shrink)
        except (ProblemError, UnreachableGoal):
            continue  # no path, or one too sharp for the arm: a shorter run leaves more space to turn
        if _is_open(world, first, track):
            return track
    return None


def _is_open(world: World, first: TipPose, track: SegmentTrack) -> bool:
    """Return whether a reference path that begins at the first subgoal touches no wall."""
    samples = np.linspace(0.0, track.length, _TRACK_SAMPLES)
    places = track.from_pose(first.position).positions_at(samples)
    return bool(np.all(world.gap(places) > 0.0))


def _on_route(taut: FloatArray, distance: float) -> tuple[TipPose, FloatArray]:
    """Return the pose on a polyline at a distance from its start, and the rest of the polyline, shape (k, 2) [m].

    Args:
        taut: vertices of the polyline, shape (K, 2) [m].
        distance: arc length from the start [m].
    """
    ends = arc_lengths(taut)[1:]
    leg = min(int(np.searchsorted(ends, distance)), len(ends) - 1)
    heading = vector_heading(taut[leg + 1] - taut[leg])
    short = max(0.0, float(ends[leg]) - distance)
    position = taut[leg + 1] - short * unit_vector(heading)
    return TipPose(position, heading), np.vstack((position, taut[leg + 1 :]))


def _track(
    world: World, room: FreeSpace, first: TipPose, way: FloatArray, goal: TipPose, run: float, shrink: float
) -> SegmentTrack:
    """Return the reference path from the first subgoal to the goal: straight lines and turns along a shortest path.

    The shortest path is homotopic to the route and joins the inner ends of two straight lines of given length, which
    begin at the first subgoal and end at the goal, with their headings.

    Args:
        world: environment of the schemas, with the curvature limit.
        room: free space of the arm's centre line.
        first: first subgoal.
        way: vertices of the route from the first subgoal to the goal, shape (k ≥ 2, 2) [m]; a route is searched if k =
            2.
        goal: goal of the tip.
        run: length of the straight lines at both ends [m].
        shrink: distance to keep from corners of obstacles where possible [m].

    Raises:
        ProblemError: a turn is too sharp for the curvature limit, or no route exists.
        UnreachableGoal: the ends lie in different components of free space.
    """
    # Straight lines at both ends, so that their headings are met without a turn.
    entry = first.position + run * unit_vector(first.heading or 0.0)
    last = goal.position if goal.heading is None else goal.position - run * unit_vector(goal.heading)
    # A path of only two points does not say how to pass between the walls: find a route.
    if len(way) == 2:
        found = room.routes(entry, last, 1)
        if not found:
            raise ProblemError("no route leads from the first subgoal to the goal: choose another subgoal")
        way = found[0].taut
    taut = room.taut_path(np.array([entry, *way[1:-1], last]), shrink)
    corners = [first.position, *taut]
    if goal.heading is not None:
        corners.append(goal.position)
    distinct = without_near(corners, _CORNER_SPACING * run)
    return track_through(distinct, _SHARPEST_TURN * world.curvature_limit)


_TYPES_TRIED = 4
"""Number of segment types that are tried, best first. The paper has five; the worst one is seldom useful. Heuristic."""


@dataclass(frozen=True)
class HillClimbingPlanner:
    """Planner for planar arms without feed axis by the method of the 1990 paper, with the ``Planner`` protocol.

    Attributes:
        stages: recorder of names and durations of the planning stages.
    """

    stages: Stages = field(default_factory=Stages)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a smooth joint path from start to goal that is certified collision-free.

        Raises:
            ProblemError: the arm has a feed axis or unequal links, which are not supported.
            NoPlanFound: no plan reaches the goal; the diagnosis names the schema at which each plan stopped.
        """
        if problem.arm.proportions is not None:
            raise ProblemError(
                'hill climbing maps the curve to pairs of equal links; use planner.method = "nlp", or leave '
                "arm.sections out"
            )
        if problem.arm.base_axes:
            raise ProblemError('hill climbing moves no feed axis; use planner.method = "nlp", or leave arm.feed out')
        with planning_units(problem) as units:
            with self.stages("mapping"):
                follower = Follower.from_problem(units.scaled(problem))
            with self.stages("motion"):
                name, steps = first_plan(follower)
                path = followed_joint_path(follower, name, steps)
        return units.path_in_metres(path, problem.arm)


_Stop: TypeAlias = tuple[str, str, str]
"""Record of a stopped plan: name of the plan, name of the schema that stopped, and reason for messages."""


def first_plan(follower: Follower) -> tuple[str, tuple[SchemaStep, ...]]:
    """Return the name and steps of the first plan that reaches the goal.

    Raises:
        MotionNotFound: no plan reaches the goal; the diagnosis names the schema at which each plan stopped.
        TimeLimitReached: the time limit passed, or a plan used up the time allotted to it and no other plan reaches the
            goal; the diagnosis names the schema at which each plan stopped.
    """
    stops: list[_Stop] = []
    some_cut_short = False

    for name, schema in plans(follower):
        steps: list[SchemaStep] = []
        try:
            for step in schema:
                steps.append(step)  # noqa: PERF402 - keeps the steps before a stop
            return name, tuple(steps)
        except SchemaStopped as stopped:
            stops.append((name, stopped.schema, stopped.diagnosis.reason))
        except TimeLimitReached as late:
            # A plan that has made no step yet is still selecting a segment type.
            last_schema = steps[-1].schema if steps else "SCM-1"
            if follower.deadline.passed():
                stops.append((name, last_schema, f"the time limit passed after {last_schema}"))
                raise TimeLimitReached(_diagnosis("no plan arrived in time", stops)) from late
            stops.append((name, last_schema, f"its share of the time passed after {last_schema}"))
            some_cut_short = True

    if some_cut_short:
        raise TimeLimitReached(_diagnosis("no plan arrived in its share of the time", stops))
    raise MotionNotFound(_diagnosis("no plan arrived", stops))


def plans(follower: Follower) -> Iterator[tuple[str, Schema]]:
    """Yield the name of every plan to try, and the generator of its steps.

    Plans by segment type come first, then folds to either side of an obstacle, then plans along passages.
    """
    start = follower.start
    folds = Folds()
    goal = TipPose(follower.ends.goal.position, follower.ends.goal.heading)

    # Each plan gets a new world, since the time allotted to a plan begins when its world is created.
    for k in range(_TYPES_TRIED):
        yield f"type selection {k + 1}", by_type(follower.quick_world, start, goal, k)

    # The fold's subgoal lies in front of an obstacle; without one there is nothing to fold round.
    obstacle = obstacle_ahead(follower.problem, goal.position)
    if obstacle is not None:
        for subgoal, side in zip(subgoals(start.base, obstacle), ("right", "left"), strict=True):
            fold = fold_plan(follower.quick_world, start, subgoal, goal, sliding=True, folds=folds)
            yield f"fold to the {side}", fold

    count = follower.problem.planner.routes
    found = passages(follower.world, start, follower.free_space, goal, obstacle, count)
    for k, passage in enumerate(found, start=1):
        yield f"passage {k}", region_plan(follower.quick_world, start, passage, goal, folds)


def by_type(world: World, start: Configuration, goal: TipPose, rank: int) -> Schema:
    """Run schemas SCM-1, SCM-2, SCM-0 (Figure 4 of the paper): select a segment type, move to its curve, then climb.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        goal: goal of the tip.
        rank: rank of the segment type, 0 for the best.
    """
    target = ranked_selections(world, start, goal)[rank].configuration(start.base)
    here = yield from scm_2(world, start, target)
    return (yield from scm_0(world, here, goal))


def obstacle_ahead(problem: Problem, goal: FloatArray) -> FloatArray | None:
    """Return the point nearest to the base on the first obstacle between base and goal, shape (2,) [m].

    An obstacle lies between them if, inflated by the arm's radius, it meets the straight line from base to goal. The
    result is None if there is none.
    """
    base = shapely.Point(problem.arm.base)
    sight = shapely.LineString([problem.arm.base, goal])

    distance_ahead: dict[int, float] = {}
    for k, wall in enumerate(problem.workspace.obstacles):
        outline = wall.outline(problem.arm.radius)
        if shapely.intersects(sight, outline):
            distance_ahead[k] = shapely.distance(base, shapely.intersection(sight, outline))
    if not distance_ahead:
        return None

    first = min(distance_ahead, key=lambda k: distance_ahead[k])
    nearest = shapely.shortest_line(base, problem.workspace.obstacles[first].outline())
    return np.array(nearest.coords[1])


def followed_joint_path(follower: Follower, name: str, steps: tuple[SchemaStep, ...]) -> JointPath:
    """Return a smooth joint path, certified collision-free, of the jointed arm that follows the steps of a plan.

    Args:
        follower: the jointed arm.
        name: name of the plan, recorded as the path's candidate.
        steps: steps of the plan.

    Raises:
        MotionNotFound: no smooth path near the steps can be certified.
    """
    arm = follower.problem.arm
    curves = (follower.start, *(step.configuration for step in steps))
    headings = np.concatenate([follower.headings(Shapes.from_configurations([curve])) for curve in curves])

    turns = np.abs(np.diff(headings, axis=0)).max(axis=1)
    # The spline needs distinct keyframes; steps that turn no link by more than rounding are left out.
    moved = np.append(True, turns > TINY)
    headings = headings[moved]
    curves = tuple(curves[k] for k in np.flatnonzero(moved))

    keyframes = arm.bends(headings)
    keyframes[0] = follower.ends.start  # equal except for rounding
    spline = certified_spline(keyframes, follower.certificate)
    if spline is None:
        reason = "a motion was found, but no smooth path along it keeps the required clearance"
        raise MotionNotFound(
            Diagnosis(reason, "motion", clearance_advice(arm.radius, follower.problem.workspace.clearance))
        )
    spare = certified_spare(spline, follower.certificate)
    return JointPath(spline, keyframes, curves, name, spare=spare)


def _diagnosis(what: str, stops: list[_Stop]) -> Diagnosis:
    reasons = "; ".join(f"{plan}: {reason}" for plan, _, reason in stops)
    evidence = {"stopped_at": {plan: schema for plan, schema, _ in stops}}
    return Diagnosis(f"{what}: {reasons}", "motion", ('use planner.method = "nlp"',), evidence)
