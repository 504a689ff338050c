"""Plans that follow their problem: every answer passes the verifier, or says why there is none and keeps the last."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.cli.compare.suites import clutter
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound, ProblemError, UnreachableGoal
from ccm_opt.driver import live_plan
from ccm_opt.driver.live_plan import LivePlan
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning import planner as motion_planner
from ccm_opt.planning import resuming
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.resuming import known_motion, same_route
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.problem import JointPose, Stop, TipGoal
from ccm_opt.scene.tool_links import points_with_tool

from .benchmarks.bench_random_arms import toml
from .conftest import PROBLEMS
from .solved_problems import solved, solved_in_space
from .test_plane_in_space import FED as FED_WITH_TOOL
from .test_tools import FILE as FILE_WITH_TOOL


@pytest.fixture(scope="module")
def swan() -> ccm_opt.Problem:
    """The swan's neck."""
    return ccm_opt.load_problem(PROBLEMS / "swan-neck.toml")


def is_certified(live: LivePlan) -> bool:
    """Whether the plan passes the verifier for its own problem, and ends at its goal."""
    plan = live.plan
    return all(check.passed for check in ccm_opt.check(plan.problem, plan.trajectory, plan.joints))


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=1, deadline=None)  # each plans seven motions
@given(seed=st.integers(0, 10**6))
def test_every_drag_is_answered(swan: ccm_opt.Problem, seed: int) -> None:
    """After each the plan is verified for the goal as it is now, or the last one is there with a reason."""
    live = LivePlan(swan)
    random = np.random.default_rng(seed)
    home = swan.goal.position  # type: ignore[union-attr]
    answered = 0
    for _ in range(6):
        position = home + random.uniform(-0.01, 0.01, 2)  # 15 mm from home the arm is long enough on all sides
        before = live.plan
        answer = live.move_goal(position)
        answered += answer.current
        assert is_certified(live)
        goal = live.problem.goal
        assert isinstance(goal, TipGoal)
        np.testing.assert_array_equal(goal.position, position)
        if answer.current:
            assert live.plan.problem.goal is goal
            assert np.hypot(*(live.plan.joint_positions[-1, -1] - position)) <= swan.tolerances.position
        else:
            assert live.plan is before
            assert answer.reason
    assert answered >= 4


def test_a_wall_pushes_the_plan_aside(swan: ccm_opt.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall that is moved into the motion's way is passed by another motion, which is planned from the last."""
    monkeypatch.setattr(live_plan, "_PATIENCE", 20.0)  # for slow machines
    live = LivePlan(swan)
    answer = live.move_obstacle("floor", (0.0, 0.04))
    assert answer.current
    moved = {obstacle.name: obstacle for obstacle in live.plan.problem.workspace.obstacles}["floor"]
    assert moved.core.bounds[3] == pytest.approx(-0.2)
    assert is_certified(live)


def test_where_there_is_no_plan_the_last_one_stays(swan: ccm_opt.Problem) -> None:
    """A goal inside a wall is answered by the reason, and a goal outside again by a plan."""
    live = LivePlan(swan)
    before = live.plan
    answer = live.move_goal((0.2, 0.3))
    assert (answer.current, live.current, live.plan) == (False, False, before)
    assert "hanging wall" in answer.reason
    assert live.move_goal((0.435, 0.095)).current
    assert live.reason == ""


def cost(plan: ccm_opt.Solution) -> float:
    """The duration of a plan, doubled if it keeps nothing of the preferred clearance."""
    problem = plan.problem
    kept = plan.metrics["least_wall_clearance_m"] - problem.workspace.clearance
    return plan.trajectory.duration * (2.0 - float(np.clip(kept / problem.wanted_gap, 0.0, 1.0)))


@pytest.mark.drawn(20, of="dear tests")
def test_a_plan_made_anew_is_kept_only_where_it_costs_less() -> None:
    """It never costs more than the one that followed the drags; with room, errors and simulation it is a whole one."""
    live = LivePlan(clutter(3, count=20).problem())
    goal = live.problem.goal
    assert isinstance(goal, TipGoal)
    live.move_goal(goal.position + 0.01)
    before = cost(live.plan)
    assert live.plan_anew().current
    assert cost(live.plan) <= before + 1e-9
    whole = live.finished()
    assert whole.room is not None
    assert whole.simulation.verdict.followed
    assert whole.trajectory is live.plan.trajectory


@pytest.mark.drawn(6, of="whole plans")
def test_constraints_are_kept_while_dragging(swan: ccm_opt.Problem) -> None:
    """The user's constraints hold for every plan that is current."""
    high = ccm_opt.Constraint("tip above the floor", lambda q: q.tip[1], lower=-0.18, where="motion")
    live = LivePlan(swan, [high])
    assert live.move_goal((0.44, 0.1)).current
    check = next(check for check in live.plan.checks if check.name == "constraint tip above the floor")
    assert check.passed


def test_what_cannot_be_moved_is_refused(swan: ccm_opt.Problem) -> None:
    """Problems that are not planned live, unknown obstacles, places that are none, and goals for the whole arm."""
    with pytest.raises(ProblemError, match="cannot be planned live"):
        LivePlan(ccm_opt.load_problem(PROBLEMS / "space" / "turbine-thirty.toml"))
    with pytest.raises(ProblemError, match="cannot be planned live"):
        LivePlan(replace(swan, joint_error=1e-3))
    live = LivePlan(swan)
    with pytest.raises(ProblemError, match="there are left wall, floor, ceiling, hanging wall"):
        live.move_obstacle("roof", (0.0, 0.1))
    with pytest.raises(ProblemError, match=r"expected a position \(x, y\)"):
        live.move_goal((0.1, 0.2, 0.3))
    with pytest.raises(ProblemError, match="number=1 or None"):
        live.move_goal((0.1, 0.2), number=2)
    straight = JointPose(np.zeros(swan.arm.links))
    whole = LivePlan(replace(swan, goal=straight, workspace=replace(swan.workspace, obstacles=())))
    with pytest.raises(ProblemError, match="give a goal for the tip"):
        whole.move_goal((0.1, 0.2))


def test_nothing_to_begin_with_is_an_error(swan: ccm_opt.Problem) -> None:
    """Where the first problem has no plan there is nothing to show, and the reason is raised as by ``solve``."""
    far = TipGoal(np.array([5.0, 5.0]))
    with pytest.raises(NoPlanFound):
        LivePlan(replace(swan, goal=far))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["swan-neck", "space/elbow"])
def test_a_start_in_contact_is_refused_as_by_a_solve(name: str) -> None:
    """Whether a plan is to be followed or made once, there is no way from a start that is too near to a wall."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    tight = replace(problem, workspace=replace(problem.workspace, clearance=0.3))
    for asked in (ccm_opt.solve, LivePlan):
        with pytest.raises(UnreachableGoal, match="start"):
            asked(tight)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.parametrize("name", ["swan-neck", "space/swan-neck-in-space"])
def test_a_plan_that_was_loaded_is_planned_on(name: str, tmp_path: Path) -> None:
    """It is the first plan, without planning; a goal that moves is planned for from its motion."""
    solution = (solved_in_space if "space" in name else solved)(name.removeprefix("space/"))
    loaded = ccm_opt.load(solution.save(tmp_path / "kept"))
    live = LivePlan.from_plan(loaded)
    np.testing.assert_array_equal(live.plan.trajectory.positions, solution.trajectory.positions)
    answer = live.move_goal(solution.problem.goal.tip(solution.problem.arm) + 0.001)
    assert answer.current
    assert answer.same_route
    assert is_certified(live)
    whole = live.finished()  # in space drags are timed coarsely
    assert all(check.passed for check in whole.checks)
    assert (whole.trajectory.duration < live.plan.trajectory.duration) == ("space" in name)
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Solution"):
        LivePlan.from_plan(solution.problem)  # type: ignore[arg-type]


LAYOUTS: dict[str, Callable[[], ccm_opt.Problem]] = {
    "even sections": lambda: ccm_opt.load_problem(PROBLEMS / "space" / "tendon-arm.toml"),
    "axes and a feed axis": lambda: ccm_opt.load_problem(PROBLEMS / "space" / "wing-box-gantry.toml"),
    "axes and several goals": lambda: ccm_opt.load_problem(PROBLEMS / "space" / "tank-camera.toml"),
    "feed axis in the plane": lambda: ccm_opt.load_problem(PROBLEMS / "feed-penetration.toml"),
    "tool in the plane": lambda: parse_problem(FILE_WITH_TOOL, "tool.toml"),
    "tool on a feed axis in the plane": lambda: parse_problem(toml(FED_WITH_TOOL), "fed.toml"),
}


@pytest.mark.drawn(2)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_goal_of_any_layout_is_dragged_along_the_route(layout: str) -> None:
    """The motion is adapted, not searched for, and the plan passes the verifier for the goal as it is now."""
    problem = LAYOUTS[layout]()
    live = LivePlan(problem)
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    moved = goal.position - 0.002 * problem.arm.length * np.eye(problem.dimension)[0]
    answer = live.move_goal(moved)
    assert (answer.current, answer.same_route) == (True, True), answer.reason
    assert is_certified(live)
    end = points_with_tool(problem.arm, live.plan.trajectory.positions[-1])[-1]
    assert np.linalg.norm(end - moved) <= problem.tolerances.position


@pytest.mark.drawn(1)
def test_the_path_of_a_fed_arm_is_deformed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the arm cannot follow its tip, the bends of the last path are changed, and no joint bends in the tube."""
    problem = parse_problem(toml(FED_WITH_TOOL), "fed.toml")
    live = LivePlan(problem)
    assert isinstance(problem.goal, TipGoal)
    monkeypatch.setattr(motion_planner, "bent_onto", lambda *_: None)
    for k in range(1, 4):
        if k == 2:
            monkeypatch.setattr(motion_planner, "path_behind_tip", lambda *_, **__: None)
        answer = live.move_goal(problem.goal.position - np.array([0.001 * k, 0.0]))
        assert (answer.current, answer.same_route) == (True, True), answer.reason
        assert is_certified(live)


BALL = """
schema = 1
space = 3
name = "ball"

[workspace]
bounds = [[-1, -1, -1], [1, 1, 1]]

[[workspace.obstacles]]
name = "ball"
sphere = { center = [0.45, 0, 0], radius = 0.03 }

[arm]
links = 6
link_length = 0.07
radius = 0.01
joint_limit_deg = 60
base = { position = [0, 0, 0], direction = [1, 0, 0] }

[limits]
velocity = 1.0
acceleration = 4.0

[start]
joints_deg = [[30, 0], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0]]

[goal]
position = [0.3, 0.1, 0.0]
"""


@pytest.mark.drawn(1)
def test_motions_on_both_sides_of_an_obstacle_take_different_routes() -> None:
    """A motion takes its own route and that of one nearby; between those on two sides of a ball there is contact."""
    problem = parse_problem(BALL, "ball.toml")
    task = MotionPlanner()._space_task(problem)[1]
    above, below = (side * np.linspace(0.2, 0.3, 5)[:, None] * np.tile([1.0, 0.0], 6) for side in (1.0, -1.0))
    assert same_route(above, above, task)
    assert same_route(above, 1.1 * above, task)
    assert not same_route(above, below, task)


@pytest.mark.drawn(1)
def test_a_tour_is_dragged_in_the_order_that_was_found() -> None:
    """A plan for goals in free order is planned on in its own order, and each of its goals can be moved."""
    problem = solved_in_space("swan-neck-in-space").problem
    assert isinstance(problem.goal, TipGoal)
    first = Stop(TipGoal(problem.goal.position - 0.004), problem.tolerances)
    free = replace(problem, stops=(first,), planner=replace(problem.planner, order="free"))
    with pytest.raises(ProblemError, match="it has goals in free order"):
        LivePlan(free)
    live = LivePlan.from_plan(ccm_opt.solve(free))
    for number in (1, 2):
        place = live.problem.goals[number - 1].goal.tip(problem.arm) + 0.001
        answer = live.move_goal(place, number=number)
        assert (answer.current, answer.same_route) == (True, True), answer.reason
        assert is_certified(live)


@pytest.mark.drawn(1)
def test_a_motion_that_touches_is_adapted_from_the_path_that_was_certified_instead() -> None:
    """A known motion need not be certified itself: where it cannot be adapted, the path between its ends is."""
    solution = solved_in_space("swan-neck-in-space")
    known = known_motion(solution.problem.arm, solution.trajectory.positions)
    unknowns = known.unknowns + 0.5 * np.sin(np.linspace(0.0, np.pi, len(known.unknowns)))[:, None]
    touching = replace(known, unknowns=unknowns, configurations=known.curve.configurations(unknowns))
    planner = MotionPlanner(first_found=True)
    for instead, resumed in ((None, False), (solution.path.keyframes, True)):
        planned = planner.planned_in_space(solution.problem, (replace(touching, instead=instead),))
        assert planned.resumed == resumed


@pytest.mark.drawn(1)
def test_a_motion_that_goes_back_and_forth_is_shortened() -> None:
    """Where an adapted motion is longer than need be, it is optimised along the same route if that is wanted."""
    solution = solved_in_space("swan-neck-in-space")
    known = known_motion(solution.problem.arm, solution.trajectory.positions)
    middle = len(known.unknowns) // 2
    forth = known.unknowns[middle:]
    twice = known.through(np.vstack((known.unknowns, forth[-2::-1], forth[1:])))
    planner = MotionPlanner(first_found=True)
    plain, short = (
        planner.planned_in_space(solution.problem, (twice,), shortened=shortened) for shortened in (False, True)
    )
    assert (plain.resumed, plain.shortened, short.resumed, short.shortened) == (True, False, True, True)
    assert short.motion.busiest < 0.7 * plain.motion.busiest


@pytest.mark.drawn(1)
@pytest.mark.parametrize("stalls", [0, 2])
def test_an_arm_that_cannot_move_at_its_end_is_drawn_back(stalls: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tip is led onto a moved goal from the end of the known motion, or from an earlier keyframe of it."""
    solution = solved_in_space("swan-neck-in-space")
    known = known_motion(solution.problem.arm, solution.trajectory.positions)
    goal = solution.problem.goal
    assert isinstance(goal, TipGoal)
    moved = replace(solution.problem, goal=replace(goal, position=goal.position - 0.002))
    begun: list[Pose] = []

    def held(stepper: SpaceStepper, goal: GoalPose, pose: Pose, deadline: Deadline) -> list[Pose]:
        begun.append(pose)
        if len(begun) <= stalls:
            raise Stalled("held", [pose])
        return settle(stepper, goal, pose, deadline)

    monkeypatch.setattr(resuming, "settle", held)
    planned = MotionPlanner(first_found=True).planned_in_space(moved, (known,))
    assert planned.resumed
    kept = np.array_equal(begun[-1].v, known.unknowns[-1])
    assert kept == (stalls == 0)
    assert np.linalg.norm(planned.path.spline(1.0) - known.configurations[-1]) > 0.0
    tip = solution.problem.arm.joint_positions_at(planned.path.spline(1.0))[-1]
    assert np.linalg.norm(tip - goal.position + 0.002) <= solution.problem.tolerances.position
