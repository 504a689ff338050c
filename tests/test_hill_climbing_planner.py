"""The paper's planner on whole problems (sections 3.2 and 4.3)."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ccm_opt import load_problem, solve
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.planning.baseline import hill_climbing_planner, plans
from ccm_opt.planning.baseline.distance import TipPose
from ccm_opt.planning.baseline.hill_climb import SchemaStopped, run
from ccm_opt.planning.baseline.hill_climbing_planner import HillClimbingPlanner, first_plan, obstacle_ahead
from ccm_opt.planning.baseline.operators import Shapes
from ccm_opt.planning.baseline.plans import Follower
from ccm_opt.planning.baseline.schemas import scm_0
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.workspace import Obstacle, PlaneShape

from .conftest import PROBLEMS


def shared(name: str, **options: object) -> Problem:
    """A shared problem with hill climbing asked for."""
    problem = load_problem(PROBLEMS / f"{name}.toml")
    return replace(problem, planner=replace(problem.planner, method="hill-climbing", **options))  # type: ignore[arg-type]


def goal_of(problem: Problem) -> TipPose:
    """The goal pose of a problem."""
    assert isinstance(problem.goal, TipGoal)
    return TipPose(problem.goal.position, problem.goal.heading)


def test_figure_3_left_arrives() -> None:
    """Pure hill climbing solves the open-space problem (Figure 3, left)."""
    problem = shared("open-space")
    follower = Follower.from_problem(problem)
    _, end = run(scm_0(follower.world, follower.start, goal_of(problem)))
    tip = follower.tips(Shapes.from_configurations([end]))[0][0]
    assert np.hypot(*(tip - goal_of(problem).position)) < problem.tolerances.position


def test_figure_3_right_is_caught() -> None:
    """Pure hill climbing gets caught on the local-maximum problem, centimetres from its goal (Figure 3, right)."""
    problem = shared("local-maximum")
    follower = Follower.from_problem(problem)
    with pytest.raises(SchemaStopped, match=r"SCM-0 stopped: (blocked|local minimum)") as stopped:
        run(scm_0(follower.world, follower.start, goal_of(problem)))
    tip = follower.tips(Shapes.from_configurations([stopped.value.configuration]))[0][0]
    assert np.hypot(*(tip - goal_of(problem).position)) > 0.02


@pytest.mark.parametrize("name", ["open-space", "local-maximum"])
def test_a_good_type_first_solves_both(name: str) -> None:
    """With the segment type selected first both problems are solved, simulated and verified (Figure 4)."""
    solution = solve(shared(name))
    assert all(check.passed for check in solution.checks)
    assert solution.path.candidate == "type selection 1"


@pytest.mark.drawn(2, of="examples")
@pytest.mark.planning
def test_figure_5_is_planned_certified_and_verified() -> None:
    """The fold plan brings the arm behind the hanging wall: its steps are certified, its timing verified (Figure 5)."""
    problem = shared("fold-and-reach", time_limit=300.0)
    solution = solve(problem)
    assert all(check.passed for check in solution.checks)
    assert solution.path.candidate == "fold to the right"
    headings = problem.arm.headings(solution.path.keyframes)
    assert len(Certificate(problem.arm, problem.workspace).failures(solution.path.keyframes)) == 0
    np.testing.assert_allclose(solution.path.keyframes[0], Follower.from_problem(problem).ends.start, atol=1e-10)
    assert len(solution.path.curves) == len(headings)


def test_the_obstacle_ahead_is_the_first_between_base_and_goal() -> None:
    """For the fold the nearest point of the hanging wall counts; in open space there is none."""
    ahead = obstacle_ahead(shared("fold-and-reach"), np.array([0.72, 0.15]))
    np.testing.assert_allclose(np.zeros(2) if ahead is None else ahead, [0.3, 0.0], atol=1e-9)
    assert obstacle_ahead(shared("open-space"), np.array([0.55, -0.35])) is None


def test_a_failure_names_the_schema_where_each_plan_stopped() -> None:
    """A wall all round the goal stops every type in SCM-2 or SCM-0 and both folds; the diagnosis lists all stops."""
    problem = shared("open-space")
    wall = Obstacle("wall", PlaneShape(shapely.box(0.25, -0.9, 0.35, 0.2)))
    problem = replace(problem, workspace=replace(problem.workspace, obstacles=(wall,)))
    follower = Follower.from_problem(problem)
    blocked = replace(follower, certificate=_Nothing(problem.arm, problem.workspace))
    with pytest.raises(MotionNotFound) as caught:
        first_plan(blocked)
    stops = caught.value.diagnosis.evidence["stopped_at"]
    assert isinstance(stops, dict)
    assert {name.split()[0] for name in stops} >= {"type", "fold"}
    assert all(schema.startswith("SCM-") for schema in stops.values())
    assert all(schema in str(caught.value) for schema in stops.values())


class _Nothing(Certificate):
    """A certificate that refuses every move."""

    def failures(self, headings: FloatArray, depth: int = 7) -> IntArray:
        """All intervals."""
        del depth
        return np.arange(len(headings) - 1)


def test_the_time_limit_is_kept() -> None:
    """A limit that is over before the first move ends the search with its own error."""
    with pytest.raises(TimeLimitReached, match=r"no plan arrived in time: type selection 1") as late:
        HillClimbingPlanner().plan(shared("fold-and-reach", time_limit=1e-6))
    assert "stopped_at" in late.value.diagnosis.evidence


def test_a_plan_has_only_its_share_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan that has used up its share makes room for the next; the error tells that more time might have helped."""
    monkeypatch.setattr(plans, "_PLAN_SHARE", 0.0)
    with pytest.raises(TimeLimitReached, match="in its share of the time") as late:
        first_plan(Follower.from_problem(shared("fold-and-reach", time_limit=1e9)))
    stops = late.value.diagnosis.evidence["stopped_at"]
    assert isinstance(stops, dict)
    assert len(stops) >= 6
    assert "fold to the right: its share of the time passed" in str(late.value)


@pytest.mark.drawn(2, of="examples")
@pytest.mark.planning
def test_the_region_plan_solves_a_shared_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the posts a fold near the base and a passage along a route arrive, timed and verified (section 4.1).

    The plans that come before are left out, of which none arrives.
    """
    every = hill_climbing_planner.plans
    passages = lambda follower: (plan for plan in every(follower) if plan[0].startswith("passage"))  # noqa: E731
    monkeypatch.setattr(hill_climbing_planner, "plans", passages)
    solution = solve(shared("slalom", time_limit=300.0))
    assert all(check.passed for check in solution.checks)
    assert solution.path.candidate.startswith("passage")


def test_a_feed_axis_is_refused() -> None:
    """The baseline moves no base; the message names the other method."""
    problem = shared("open-space")
    limits = replace(problem.limits, feed_velocity=1.0, feed_acceleration=1.0)
    problem = replace(problem, arm=replace(problem.arm, feed=Feed(0.0, 0.5, 0.0)), limits=limits)
    with pytest.raises(ProblemError, match=r"planner\.method = \"nlp\""):
        HillClimbingPlanner().plan(problem)


def test_first_keyframe_is_the_start_exactly() -> None:
    """The follower's offset makes up for whatever the mapping and the merging of the start's segments changed."""
    follower = Follower.from_problem(shared("local-maximum"))
    np.testing.assert_allclose(
        follower.headings(Shapes.from_configurations([follower.start]))[0],
        follower.problem.arm.headings(follower.ends.start),
        atol=1e-12,
    )
