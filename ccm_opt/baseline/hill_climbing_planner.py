"""The planner of 1990: one plan after the other until one arrives, then a smooth, certified path through its steps."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import shapely
from scipy.interpolate import BSpline

from ccm_opt.baseline.candidate_moves import Shapes
from ccm_opt.baseline.distance import TipPose
from ccm_opt.baseline.fold_plan import Folds, fold_plan, subgoals
from ccm_opt.baseline.follower import Follower
from ccm_opt.baseline.hill_climb import Schema, SchemaStep, SchemaStopped
from ccm_opt.baseline.region_plan import passages, region_plan
from ccm_opt.baseline.schema import scm_0, scm_2
from ccm_opt.baseline.schemas import ranked_selections
from ccm_opt.baseline.settings import DEFAULT_BASELINE, BaselineSettings
from ccm_opt.baseline.world import World
from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.progress import Stages
from ccm_opt.errors import Diagnosis, MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.planning.spline_path import certified_spline, spare_kept
from ccm_opt.problem import Problem
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.bad_pose import room_advice
from ccm_opt.solution import JointPath

_TYPES_TRIED = 4
"""Segment types that are tried, best first. The paper has five; the last is seldom any good. Taste."""


@dataclass(frozen=True)
class HillClimbingPlanner:
    """Plans as the paper of 1990 does; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
        settings: shares of the time, margins and tolerances.
    """

    stages: Stages = field(default_factory=Stages)
    settings: BaselineSettings = DEFAULT_BASELINE

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            ProblemError: the arm has a feed axis, which the baseline does not know.
            NoPlanFound: with the schema at which each plan stopped.
        """
        if problem.arm.feed is not None:
            raise ProblemError("hill climbing moves no feed axis; use planner.method nlp, or leave arm.feed out")
        with self.stages("mapping"):
            follower = Follower.from_problem(problem, self.settings)
        with self.stages("motion"):
            name, steps = first_plan(follower)
            return followed_joint_path(follower, name, steps)


@dataclass(frozen=True)
class _Stop:
    """Where a plan stopped.

    Attributes:
        plan: its name.
        schema: at which it stopped.
        reason: in words.
    """

    plan: str
    schema: str
    reason: str


def first_plan(follower: Follower) -> tuple[str, tuple[SchemaStep, ...]]:
    """The first plan that arrives, and its name.

    Raises:
        MotionNotFound: none does; the diagnosis names the schema at which each stopped.
        TimeLimitReached: the time passed first, or some plan spent its share and no other arrives; with the stops.
    """
    stops: list[_Stop] = []
    some_cut_short = False

    for name, schema in plans(follower):
        steps: list[SchemaStep] = []
        try:
            for step in schema:
                steps.append(step)  # noqa: PERF402 - what came before a stop is kept
            return name, tuple(steps)
        except SchemaStopped as stopped:
            stops.append(_Stop(name, stopped.schema, stopped.diagnosis.reason))
        except TimeLimitReached as late:
            # A plan that has made no step yet is still selecting a segment type.
            last_schema = steps[-1].schema if steps else "SCM-1"
            if follower.deadline.passed():
                stops.append(_Stop(name, last_schema, f"the time limit passed after {last_schema}"))
                raise TimeLimitReached(_diagnosis("no plan arrived in time", stops)) from late
            stops.append(_Stop(name, last_schema, f"its share of the time passed after {last_schema}"))
            some_cut_short = True

    if some_cut_short:
        raise TimeLimitReached(_diagnosis("no plan arrived in its share of the time", stops))
    raise MotionNotFound(_diagnosis("no plan arrived", stops))


def plans(follower: Follower) -> Iterator[tuple[str, Schema]]:
    """Type selection with every type in turn, folds to either side, then the passages of the region plan."""
    start = follower.start
    folds = Folds()
    goal = TipPose(follower.ends.goal.position, follower.ends.goal.heading)

    # Worlds are made when a plan is asked for, since each one's share of the time begins then.
    for k in range(_TYPES_TRIED):
        yield f"type selection {k + 1}", by_type(follower.hurried_world, start, goal, k)

    # The fold's subgoal lies in front of an obstacle; without one there is nothing to fold round.
    obstacle = obstacle_ahead(follower.problem, goal.position)
    if obstacle is not None:
        for subgoal, side in zip(subgoals(start.base, obstacle), ("right", "left"), strict=True):
            fold = fold_plan(follower.hurried_world, start, subgoal, goal, sliding=True, folds=folds)
            yield f"fold to the {side}", fold

    count = follower.problem.planner.routes
    found = passages(follower.world, start, follower.free_space, goal, obstacle, count)
    for k, passage in enumerate(found, start=1):
        yield f"passage {k}", region_plan(follower.hurried_world, start, passage, goal, folds)


def by_type(world: World, start: Configuration, goal: TipPose, rank: int) -> Schema:
    """SCM-1, SCM-2 and SCM-0, as in the paper's Figure 4."""
    target = ranked_selections(world, start, goal)[rank].configuration(start.base)
    here = yield from scm_2(world, start, target)
    return (yield from scm_0(world, here, goal))


def obstacle_ahead(problem: Problem, goal: FloatArray) -> FloatArray | None:
    """The point nearest to the base of the first obstacle between base and goal, shape (2,) [m]; None without one."""
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
    """The smooth, certified path through the steps of a plan.

    Raises:
        MotionNotFound: no smooth path near them can be certified.
    """
    arm = follower.problem.arm
    curves = (follower.start, *(step.configuration for step in steps))
    headings = np.concatenate([follower.headings(Shapes.from_configurations([curve])) for curve in curves])
    headings[0] = follower.ends.start  # the same but for rounding

    turns = np.abs(np.diff(headings, axis=0)).max(axis=1)
    # The spline wants distinct keyframes; steps that turn no link by more than rounding are left out.
    moved = np.append(True, turns > TINY)
    headings = headings[moved]
    curves = tuple(curves[k] for k in np.flatnonzero(moved))

    spline = certified_spline(headings, follower.certificate)
    if spline is None:
        reason = "the motion leaves no room for a smooth path"
        raise MotionNotFound(Diagnosis(reason, "motion", room_advice(arm, follower.problem.workspace)))
    spare = spare_kept(spline, follower.certificate)
    return JointPath(BSpline(spline.t, arm.bends(spline.c), spline.k), arm.bends(headings), curves, name, spare=spare)


def _diagnosis(what: str, stops: list[_Stop]) -> Diagnosis:
    reasons = "; ".join(f"{stop.plan}: {stop.reason}" for stop in stops)
    evidence = {"stopped_at": {stop.plan: stop.schema for stop in stops}}
    return Diagnosis(f"{what}: {reasons}", "motion", ("use planner.method nlp",), evidence)
