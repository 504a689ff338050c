"""The 1990 baseline as a planner: type selection, then the fold plan (section 4.3), then the region plan (4.1).

The schemas move the continuous curve. The jointed arm follows it by the mean heading of the curve on each link plus
what the start's own mapping adds, so the first keyframe is the start itself. Tips and contacts are those of the arm.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.interpolate import BSpline

from ccm_opt.arrays import BoolArray, FloatArray
from ccm_opt.collision.certificate import Certificate
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import merge_segments
from ccm_opt.errors import Diagnosis, MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.clearance_field import ClearanceField
from ccm_opt.hill_climbing.distance import TipPose
from ccm_opt.hill_climbing.fold_plan import Folds, fold_plan, subgoals
from ccm_opt.hill_climbing.region_plan import passages, region_plan
from ccm_opt.hill_climbing.schemas.climbing import scm_0
from ccm_opt.hill_climbing.schemas.interpolation import scm_2
from ccm_opt.hill_climbing.schemas.selection import ranked_selections
from ccm_opt.hill_climbing.steps import Schema, SchemaStopped, Step
from ccm_opt.hill_climbing.world import World
from ccm_opt.motion.ends import Ends, resolve_ends
from ccm_opt.motion.link_space import nearest_curve
from ccm_opt.motion.spline_path import certified_spline, spare_kept
from ccm_opt.problem import CurvePose, Problem
from ccm_opt.solution import JointPath
from ccm_opt.stages import Stages

PLANNING_SHARE = 0.9
"""Share of the time limit that planning may use."""
PLAN_SHARE = 0.6
"""Share of the time that is left that one plan may use, so that the others have their turn."""
LIMIT_SHARE = 0.99
"""Share of the joint limits that planning uses."""
SPARE = 1e-4
"""Gap beyond contact that moves keep, as a share of the arm's length."""
DEPTH = 3
"""Bisections of a move before it counts as blocked."""
SIMPLIFIED = 0.02
"""How far headings may move when the start's segments are merged [rad]; the follower's offset makes up for it."""
ROUTE_MARGIN = 1e-3
"""Free space for routes is inflated by this share of the arm's length beyond radius and clearance."""
TYPES_TRIED = 4


@dataclass(frozen=True)
class Follower:
    """The jointed arm as it follows curves.

    Attributes:
        problem: with the arm and its room.
        ends: start and goal on the links.
        certificate: of moves.
        deadline: monotonic time at which to stop [s].
    """

    problem: Problem
    ends: Ends
    certificate: Certificate
    deadline: float

    @classmethod
    def of(cls, problem: Problem) -> "Follower":
        """The arm of a problem, with its share of the problem's time from now on.

        Raises:
            UnreachableGoal: start or goal cannot be.
        """
        ends = resolve_ends(problem)
        deadline = time.monotonic() + PLANNING_SHARE * problem.planner.time_limit
        return cls(problem, ends, certificate_of(problem, ends), deadline)

    @cached_property
    def start(self) -> Configuration:
        """The curve at the start, with as few segments as follow it."""
        pose = self.problem.start
        if isinstance(pose, CurvePose):
            return with_few_segments(pose.configuration)
        return with_few_segments(nearest_curve(self.problem.arm, self.ends.start))

    @cached_property
    def offset(self) -> FloatArray:
        """What the start's mapping adds to mean headings, shape (links,) [rad]."""
        offset: FloatArray = self.ends.start - Shapes.of([self.start]).mean_headings(self.problem.arm.links)[0]
        return offset

    def headings(self, shapes: Shapes) -> FloatArray:
        """Link headings, shape (m, links) [rad]."""
        return shapes.mean_headings(self.problem.arm.links) + self.offset

    def tips(self, shapes: Shapes) -> tuple[FloatArray, FloatArray]:
        """Positions (m, 2) [m] and headings (m,) [rad] of the arm's tips."""
        headings = self.headings(shapes)
        return self.problem.arm.joint_positions(headings)[:, -1], headings[:, -1]

    def passes(self, here: Shapes, there: Shapes) -> BoolArray:
        """Which moves keep the joint limits and touch nothing on the way, shape (m,); or ``TimeLimitReached``."""
        _look_at_clock(self.deadline)
        arm = self.problem.arm
        headings = self.headings(there)
        allowed: BoolArray = np.all(np.abs(arm.bends(headings)) <= LIMIT_SHARE * arm.bend_limits, axis=1)
        if allowed.any():
            first = self.headings(here)[0]
            legs = np.repeat(headings[allowed], 2, axis=0)
            legs[::2] = first
            blocked = self.certificate.failures(legs, DEPTH)
            allowed[np.flatnonzero(allowed)[blocked[blocked % 2 == 0] // 2]] = False
        return allowed

    @cached_property
    def field(self) -> ClearanceField:
        """Gaps in the room."""
        return ClearanceField.of(self.problem.workspace, self.problem.arm.radius + self.problem.workspace.clearance)

    @cached_property
    def room(self) -> FreeSpace:
        """Free space of the arm's axis."""
        arm, clearance = self.problem.arm, self.problem.workspace.clearance
        return FreeSpace.of(self.problem.workspace, arm.radius + clearance + ROUTE_MARGIN * arm.length)

    @property
    def hurried_world(self) -> World:
        """The world of the schemas for one plan, whose share of the time that is left begins now."""
        now = time.monotonic()
        until = now + PLAN_SHARE * (self.deadline - now)

        def passes(here: Shapes, there: Shapes) -> BoolArray:
            _look_at_clock(until)
            return self.passes(here, there)

        return replace(self.world, passes=passes)

    @property
    def world(self) -> World:
        """The world of the schemas."""
        arm = self.problem.arm
        low, high = arm.base_heading - arm.base_limit, arm.base_heading + arm.base_limit
        if self.ends.clamped:
            low = high = self.start.base_heading
        thickness = 2.0 * arm.radius if arm.self_collision else 0.0
        return World(self.passes, self.tips, self.field.gap, arm.joint_limit / arm.link_length, thickness, (low, high))


@dataclass(frozen=True)
class HillClimbingPlanner:
    """Plans as the paper of 1990 does; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
    """

    stages: Stages = field(default_factory=Stages)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            ProblemError: the arm has a feed axis, which the baseline does not know.
            NoPlanFound: with the schema at which each plan stopped.
        """
        if problem.arm.feed is not None:
            raise ProblemError("hill climbing moves no feed axis; use planner.method nlp, or leave arm.feed out")
        with self.stages("mapping"):
            follower = Follower.of(problem)
        with self.stages("motion"):
            name, steps = first_plan(follower)
            return joint_path(follower, name, steps)


def _look_at_clock(deadline: float) -> None:
    if time.monotonic() > deadline:
        raise TimeLimitReached(Diagnosis("the time limit passed", "hill climbing", ("raise planner.time_limit",)))


def certificate_of(problem: Problem, ends: Ends) -> Certificate:
    """A little more than contact where the start has it."""
    spare = Certificate(problem.arm, problem.workspace, SPARE * problem.arm.length)
    both = np.stack((ends.start, ends.start))
    return spare if len(spare.failures(both)) == 0 else Certificate.of(problem.arm, problem.workspace)


def with_few_segments(configuration: Configuration) -> Configuration:
    """The same curve, to within ``SIMPLIFIED``, with neighbours merged from the base on."""
    k = 0
    while k < len(configuration.segments) - 1:
        try:
            configuration = merge_segments(configuration, k, SIMPLIFIED)
        except ProblemError:
            k += 1
    return configuration


def first_plan(follower: Follower) -> tuple[str, tuple[Step, ...]]:
    """The first plan that arrives, and its name.

    Raises:
        MotionNotFound: none does; the diagnosis names the schema at which each stopped.
        TimeLimitReached: the time passed first, or some plan spent its share and no other arrives; with the stops.
    """
    stops: list[tuple[str, str, str]] = []
    cut = False
    for name, schema in plans(follower):
        steps: list[Step] = []
        try:
            for step in schema:
                steps.append(step)  # noqa: PERF402 - what came before a stop is kept
        except SchemaStopped as stopped:
            stops.append((name, stopped.schema, stopped.diagnosis.reason))
            continue
        except TimeLimitReached as late:
            schema_name = steps[-1].schema if steps else "SCM-1"
            if time.monotonic() > follower.deadline:
                stops.append((name, schema_name, f"the time limit passed after {schema_name}"))
                raise TimeLimitReached(_diagnosis("no plan arrived in time", stops)) from late
            stops.append((name, schema_name, f"its share of the time passed after {schema_name}"))
            cut = True
            continue
        return name, tuple(steps)
    if cut:
        raise TimeLimitReached(_diagnosis("no plan arrived in its share of the time", stops))
    raise MotionNotFound(_diagnosis("no plan arrived", stops))


def plans(follower: Follower) -> Iterator[tuple[str, Schema]]:
    """Type selection with every type in turn, folds to either side, then the passages of the region plan."""
    start, folds = follower.start, Folds()
    goal = TipPose(follower.ends.goal.position, follower.ends.goal.heading)
    for k in range(TYPES_TRIED):
        yield f"type selection {k + 1}", by_type(follower.hurried_world, start, goal, k)
    obstacle = obstacle_ahead(follower.problem, goal.position)
    if obstacle is not None:
        for subgoal, side in zip(subgoals(start.base, obstacle), ("right", "left"), strict=True):
            yield (
                f"fold to the {side}",
                fold_plan(follower.hurried_world, start, subgoal, goal, sliding=True, folds=folds),
            )
    count = follower.problem.planner.routes
    for k, passage in enumerate(passages(follower.world, start, follower.room, goal, obstacle, count), start=1):
        yield f"passage {k}", region_plan(follower.hurried_world, start, passage, goal, folds)


def by_type(world: World, start: Configuration, goal: TipPose, rank: int) -> Schema:
    """SCM-1, SCM-2 and SCM-0, as in Figure 4."""
    target = ranked_selections(world, start, goal)[rank].configuration(start.base)
    here = yield from scm_2(world, start, target)
    return (yield from scm_0(world, here, goal))


def obstacle_ahead(problem: Problem, goal: FloatArray) -> FloatArray | None:
    """The point nearest to the base of the first obstacle between base and goal, shape (2,) [m]; None without one."""
    base = shapely.Point(problem.arm.base)
    sight = shapely.LineString([problem.arm.base, goal])
    grown = [wall.outline(problem.arm.radius) for wall in problem.workspace.obstacles]
    met = [
        (shapely.distance(base, shapely.intersection(sight, outline)), k)
        for k, outline in enumerate(grown)
        if shapely.intersects(sight, outline)
    ]
    if not met:
        return None
    nearest = shapely.shortest_line(base, problem.workspace.obstacles[min(met)[1]].outline())
    return np.array(nearest.coords[1])


def joint_path(follower: Follower, name: str, steps: tuple[Step, ...]) -> JointPath:
    """The smooth, certified path through the steps of a plan.

    Raises:
        MotionNotFound: no smooth path near them can be certified.
    """
    curves = (follower.start, *(step.configuration for step in steps))
    headings = np.concatenate([follower.headings(Shapes.of([curve])) for curve in curves])
    headings[0] = follower.ends.start
    moved = np.append(True, np.abs(np.diff(headings, axis=0)).max(axis=1) > 1e-12)
    headings, curves = headings[moved], tuple(c for c, m in zip(curves, moved, strict=True) if m)
    spline = certified_spline(headings, follower.certificate)
    if spline is None:
        reason = "the motion leaves no room for a smooth path"
        raise MotionNotFound(Diagnosis(reason, "motion", ("use a smaller radius or clearance",)))
    arm, spare = follower.problem.arm, spare_kept(spline, follower.certificate)
    return JointPath(BSpline(spline.t, arm.bends(spline.c), spline.k), arm.bends(headings), curves, name, spare=spare)


def _diagnosis(what: str, stops: list[tuple[str, str, str]]) -> Diagnosis:
    lines = "; ".join(f"{name}: {reason}" for name, _, reason in stops)
    evidence = {"stopped_at": {name: schema for name, schema, _ in stops}}
    return Diagnosis(f"{what}: {lines}", "motion", ("use planner.method nlp",), evidence)
