"""Goals in free order: the shortest order of what is known, whatever the order of the file, and what is left out."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.interpolate import BSpline

from ccm_opt.cli.outcome import IN_PART, NO_PLAN, SOLVED
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, ProblemError
from ccm_opt.core.progress import Stages
from ccm_opt.driver.known_motions import KnownMotions, Rest
from ccm_opt.driver.legs import Leg
from ccm_opt.driver.tour_order import OrderSolver, tour_cost
from ccm_opt.driver.tours import TourPlanner
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.joining import PathJoiner, Tube, chain_time
from ccm_opt.problem import JointPose, PlannerOptions, Problem, Stop, TipGoal, Tolerances, TourEnd
from ccm_opt.problem.solution import JointPath, Tour, UnvisitedGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.tool import Tool
from ccm_opt.scene.bodies import SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace
from ccm_opt.verification.tour import in_order
from ccm_opt.viz.document import plan_badges
from ccm_opt.viz.tour_section import tour_sentences

from .command_runs import CommandLine
from .conftest import SMALL_PROBLEM, make_solution
from .snakes_in_space import snake
from .test_legs import KNOTS, Straight, in_space

ENDS: tuple[TourEnd, ...] = ("free", "last", "start")


@st.composite
def symmetric_costs(draw: st.DrawFn) -> np.ndarray:
    """Costs of going between the start and up to six places, equal in both directions."""
    places = draw(st.integers(2, 7))
    costs = np.zeros((places, places))
    rows, columns = np.triu_indices(places, 1)
    costs[rows, columns] = draw(st.lists(st.integers(0, 1000), min_size=len(rows), max_size=len(rows)))
    return costs + costs.T


@given(costs=symmetric_costs(), end=st.sampled_from(ENDS))
@settings(max_examples=30, deadline=None)
def test_no_order_is_cheaper_than_the_one_found(costs: np.ndarray, end: TourEnd) -> None:
    """All orders, tried one by one, cost at least as much, and the bound is below them all."""
    goals = range(1, len(costs))
    found = OrderSolver(len(costs), end).solve(costs, Deadline.after(60.0))
    orders = [order for order in itertools.permutations(goals) if end != "last" or order[-1] == goals[-1]]
    best = min(tour_cost(costs, order, end) for order in orders)
    assert sorted(found.places) == list(goals)
    assert found.places in orders
    # Half of the least difference of two orders, which have whole costs.
    assert tour_cost(costs, found.places, end) <= best + 0.5
    assert found.bound <= best * (1.0 + 1e-6) + 1e-6


def held_karp(costs: np.ndarray) -> float:
    """Least cost of visiting all places from place 0 and ending anywhere (Held and Karp, 1962)."""
    count = len(costs) - 1
    least = np.full((2**count, count), np.inf)
    least[2 ** np.arange(count), np.arange(count)] = costs[0, 1:]
    for visited in range(2**count):
        for last in np.flatnonzero(np.isfinite(least[visited])):
            for ahead in np.flatnonzero(~(visited >> np.arange(count)) & 1):
                grown = least[visited, last] + costs[last + 1, ahead + 1]
                least[visited | 1 << ahead, ahead] = min(least[visited | 1 << ahead, ahead], grown)
    return float(least[-1].min())


def test_the_order_of_ten_goals_is_that_of_dynamic_programming() -> None:
    """An independent exact method finds the same cost."""
    places = np.random.default_rng(7).random((10, 2))
    costs = np.linalg.norm(places[:, None] - places[None], axis=2)
    found = OrderSolver(10, "free").solve(costs, Deadline.after(60.0))
    assert tour_cost(costs, found.places, "free") == pytest.approx(held_karp(costs), rel=1e-5)


class Lines(Straight):
    """A planner of straight lines in joint space, for arms in space."""

    def plan(self, problem: Problem) -> JointPath:
        """A line, unless the goal bends a joint by more than 1 rad."""
        self.asked.append(problem)
        ends = [problem.start.whole(problem.arm), problem.goal.whole(problem.arm)]
        assert ends[0] is not None
        assert ends[1] is not None
        if np.max(np.abs(ends[1])) > 1.0:
            raise MotionNotFound(Diagnosis("too far", "motion", ("nearer",)))
        control = np.linspace(ends[0], ends[1], 5)
        return JointPath(BSpline(KNOTS, control, 3), control, (), "line")


def toured(problem: Problem) -> tuple[tuple[Leg, ...], Tour]:
    """The tour of an arm that moves in straight lines in joint space, as fast as its joints accelerate and brake."""

    def time(leg: Leg) -> float:
        q = leg.path.spline(np.linspace(0.0, 1.0, 200))
        return float(2.0 * np.sqrt(np.abs(np.diff(q, axis=0)).max(axis=1).sum()))

    return TourPlanner(problem, Lines(), time, lambda _: None, Stages(), share=1.0).plan()


def free_order(end: TourEnd, bends: list[int]) -> Problem:
    """Goals in free order for an arm in empty space, which bend all joints alike, by hundredths of a radian."""
    problem = in_space(*(0.01 * bend for bend in bends))
    return replace(problem, planner=PlannerOptions(order="free", end=end))


@pytest.mark.drawn(20, of="dear tests")
@given(
    bends=st.lists(st.integers(-30, 30), min_size=2, max_size=5, unique=True),
    end=st.sampled_from(("free", "start")),
    data=st.data(),
)
@settings(max_examples=10, deadline=None)
def test_the_order_of_the_file_makes_no_difference(bends: list[int], end: TourEnd, data: st.DataObject) -> None:
    """Permuted goals are visited in as little time; never in more than in the order of the file; and all of them."""
    mixed = data.draw(st.permutations(bends))
    (legs, tour), (_, again) = toured(free_order(end, bends)), toured(free_order(end, mixed))
    assert tour.duration == pytest.approx(again.duration, abs=1e-6)
    assert tour.duration <= min(tour.as_given, again.as_given) + 1e-6
    assert sorted(tour.order) == list(range(1, len(bends) + 1))
    assert len(legs) == len(bends) + (end == "start")
    at = 0.0
    for leg, number in zip(legs, tour.order, strict=False):
        ends = leg.path.spline([0.0, 1.0])
        np.testing.assert_allclose(ends, [np.full(8, at), np.full(8, 0.01 * bends[number - 1])], atol=1e-9)
        at = 0.01 * bends[number - 1]
    # What the planner visits is what the verifier expects.
    planned, expected = tour.visited, in_order(tour.posed, tour)
    assert [stop.goal for stop in planned.goals] == [stop.goal for stop in expected.goals]


def test_a_goal_at_the_start_costs_nothing() -> None:
    """A motion without duration is known as any other, so that the goals after it are ordered too."""
    _, tour = toured(free_order("free", [0, 20, 10]))
    assert tour.order == (1, 3, 2)


def test_a_joined_motion_that_takes_longer_than_its_parts_is_not_taken() -> None:
    """Where the motion joined over the start takes long, one that is planned by itself is taken."""

    def time(leg: Leg) -> float:
        return sum(1e3 if part.candidate == "joined" else 2.0 for part in leg.path.parts or (leg.path,))

    planner = TourPlanner(free_order("start", [10, -10]), Lines(), time, lambda _: None, Stages(), share=1.0)
    planner._grow(Deadline.after(60.0))
    legs, tour = planner._ordered(Deadline.after(60.0))
    assert all("joined" not in leg.path.candidate for leg in legs)
    assert tour.duration == sum(map(time, legs)) == 2.0 * 3


def test_a_report_says_what_is_solved_in_part(small_problem: Problem) -> None:
    """The badge of a plan that leaves out goals is not that of one that visits all."""
    solution = make_solution(small_problem, np.zeros(small_problem.arm.links))
    for left_out, words in (((), "solved and verified"), ((UnvisitedGoal(2, "", ""),), "solved in part, and verified")):
        assert words in str(plan_badges(replace(solution, tour=Tour(small_problem, (1,), left_out))))


def test_no_bound_is_known_for_goals_planned_one_after_the_other() -> None:
    """A tour that such a motion replaces neither claims a bound nor that no order is shorter."""
    problem = free_order("free", [10, 30, 20])
    legs, tour = toured(problem)
    assert 0.0 < tour.bound <= tour.duration
    assert "no order is shorter" in " ".join(tour_sentences(tour))
    planner = TourPlanner(problem, Lines(), lambda _: 0.1, lambda _: None, Stages(), share=1.0)
    _, replaced = planner.compared(legs, replace(tour, as_given=9.0), Deadline.after(60.0))
    assert replaced.duration == pytest.approx(0.3)
    assert replaced.bound == 0.0
    assert "shorter" not in " ".join(tour_sentences(replaced))


def test_what_is_not_reached_is_left_out_unless_the_motion_ends_there() -> None:
    """A goal that the planner does not reach is named with its reason; the last one, where it must be, is refused."""
    problem = free_order("free", [10, 110, 20])
    _, tour = toured(problem)
    assert set(tour.order) == {1, 3}
    assert tour.left_out == (UnvisitedGoal(2, "no plan found", "too far"),)
    with pytest.raises(MotionNotFound, match=r"goal 3 of 3: too far, at which the motion has to end"):
        toured(free_order("last", [10, 20, 110]))
    with pytest.raises(MotionNotFound, match=r"goal 1 of 2: too far\n +no other goal is reached either"):
        toured(free_order("free", [110, 120]))
    _, ended = toured(free_order("last", [30, 10, 20]))
    assert ended.order[-1] == 3


@pytest.mark.parametrize(
    ("options", "goal", "words"),
    [
        ({"order": "free", "follow_within": 0.1}, {}, "planner.follow_within is not supported"),
        ({"order": "free", "method": "hill-climbing"}, {}, 'needs planner.method = "nlp"'),
        ({"order": "free", "retiming": "paul"}, {}, 'needs planner.retiming = "toppra"'),
        ({"order": "free", "tries": 2}, {}, "planner.tries must be 1"),
        ({"end": "start"}, {}, 'planner.end = "start" needs planner.order = "free"'),
        ({"order": "free"}, {"via": (np.zeros(3),)}, "goal.via is not supported"),
    ],
)
def test_what_a_free_order_does_not_support_is_refused(options: dict, goal: dict, words: str) -> None:
    """No key is silently without effect."""
    problem = in_space(0.1, 0.2)
    with pytest.raises(ProblemError, match=words):
        replace(problem, planner=PlannerOptions(**options), goal=TipGoal(np.array([0.5, 0.1, 0.0]), **goal))


FREE = (
    SMALL_PROBLEM.replace("[goal]", '[planner]\norder = "free"\nend = "start"\n\n[[goal]]')
    + """
[[goal]]
position = [0.35, -0.1]
pause = 0.1

[[goal]]
name = "valve"
position = [0.9, 0.0]

[[goal]]
position = [0.3, -0.2]
"""
)


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_a_motion_that_leaves_out_a_goal_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code, message and record name the goal; the folder checks, but not with another order or claim."""
    run = CommandLine(capsys)
    (tmp_path / "tour.toml").write_text(FREE.replace('"small"', '"tour"'))
    solved = run("solve", tmp_path / "tour.toml", "--out", tmp_path, "--no-pictures")
    assert solved.code == IN_PART
    assert "goal 3 of the file ('valve'): goal.position: out of reach" in solved.err
    assert "3 of 4 goals in the order" in solved.out
    folder = tmp_path / "tour"
    record = json.loads((folder / "solution.json").read_text())
    assert record["status"] == "solved in part"
    assert [goal["goal"] for goal in record["tour"]["left_out"]] == [3]
    assert sorted(record["tour"]["order"]) == [1, 2, 4]
    assert [goal.get("name") for goal in record["problem"]["goal"]] == [None, None, "valve", None]
    assert run("check", folder).code == SOLVED

    def changed(**tour: object) -> int:
        (folder / "solution.json").write_text(json.dumps(record | {"tour": record["tour"] | tour}))
        return run("check", folder).code

    assert changed(order=record["tour"]["order"][::-1]) == NO_PLAN
    assert changed(order=[1, 2, 3]) == NO_PLAN
    assert changed(order=[1, 2, 4, 4]) == NO_PLAN
    tour = record["tour"]
    assert changed(duration=1.01 * tour["duration"], as_given=2.0 * tour["as_given"]) == NO_PLAN
    assert changed(bound=1.01 * tour["duration"]) == NO_PLAN
    assert changed(as_given=0.99 * tour["duration"]) == NO_PLAN


def test_a_pause_at_the_last_goal_of_the_file_is_kept() -> None:
    """In free order it may be anywhere on the way."""
    problem = parse_problem(FREE + "pause = 0.2\n")
    assert [stop.pause for stop in Tour(problem, (4, 2, 1)).visited.stops] == [0.2, 0.1, 0.0]
    assert Tour(problem, (4, 2, 1)).visited.goals[-1] == Stop(problem.start, Tolerances())


def test_a_planner_of_the_user_is_asked_with_one_goal_at_a_time() -> None:
    """The free order is none of its business."""
    planner = Lines()
    TourPlanner(free_order("free", [10, 20]), planner, lambda _: 1.0, lambda _: None, Stages(), share=1.0).plan()
    assert all(asked.planner.order == "given" and not asked.stops for asked in planner.asked)


@given(
    feeds=st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 0.4)),
    bends=st.lists(st.floats(-0.5, 0.5), min_size=8, max_size=8),
)
def test_an_even_motion_of_a_fed_arm_bends_no_joint_in_the_tube(feeds: tuple[float, float], bends: list[float]) -> None:
    """Joints that are out at both ends bend as they like; those that come out begin to bend beyond the tube only."""
    arm = snake(4, feed=Feed(0.0, 0.4, 0.4))
    ends = np.column_stack((np.tile(bends, (2, 1)), feeds))
    tube = Tube(arm, travel=0.01)
    ends[:, :-1] *= tube.beyond(ends) > tube.travel + 2.0 * tube.step
    rows = tube.motion(*ends)
    np.testing.assert_array_equal(rows[[0, -1]], ends)
    assert not np.any(tube.bent_inside(rows))
    assert np.all(tube.beyond(rows)[rows[:, :-1] != 0.0] > tube.travel)
    assert np.all(np.abs(np.diff(rows[:, -1])) <= tube.step + 1e-12)


def beside_a_ball(below: float) -> tuple[Problem, np.ndarray, np.ndarray]:
    """A straight arm above a ball, and two poses: turned to a side of it, and lifted."""
    ball = SphereBody(np.array([0.9, 0.0, -below]), 0.02)
    problem = replace(
        in_space(0.1),
        workspace=Workspace(bounds=None, obstacles=(Obstacle("ball", ball),)),
        planner=PlannerOptions(wanted_gap=0.02),
    )
    aside, above = np.zeros((2, 8))
    aside[0], above[1] = 0.5, -0.3
    return problem, aside, above


def gaps(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Gaps of configurations (K, c) from the ball, by the distances of its centre from the links, shape (K,)."""
    (obstacle,) = problem.workspace.obstacles
    ball = obstacle.body
    assert isinstance(ball, SphereBody)
    joints = problem.arm.joint_positions_at(q)
    start, along = joints[:, :-1], np.diff(joints, axis=1)
    share = np.sum((ball.center - start) * along, axis=2) / np.sum(along**2, axis=2)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    away = np.linalg.norm(nearest - ball.center, axis=2) - ball.radius - problem.arm.radius
    return np.asarray(np.min(away, axis=1))


@given(below=st.floats(0.036, 0.08))
@settings(max_examples=10, deadline=None)
def test_a_joined_motion_keeps_the_preferred_clearance_of_the_motions_it_joins(below: float) -> None:
    """The straight motion passes a ball more closely than is preferred, the known motions far above it."""
    problem, aside, above = beside_a_ball(below)
    chain = np.vstack((np.linspace(-aside, above, 10), np.linspace(above, aside, 10)[1:]))
    joiner = PathJoiner(problem, np.ones(8))
    path = joiner.path(chain)
    assert path is not None
    q = path.spline(np.linspace(0.0, 1.0, 400))
    np.testing.assert_allclose(q[[0, -1]], chain[[0, -1]])
    tipped = replace(
        problem, arm=replace(problem.arm, tool=Tool(tip=np.array([0.02, 0.0, 0.0]), direction=np.eye(3)[0]))
    )
    assert [PathJoiner(each, np.ones(8)).joins(-aside, above) for each in (problem, tipped)] == [True, True]
    assert np.min(gaps(problem, q)) >= 0.9 * problem.wanted_gap
    assert np.max(joiner.lack(path)) <= 0.1


def test_a_motion_changes_from_one_known_motion_to_another() -> None:
    """Between two goals with motions from the start over a ball, a shorter one is estimated, found, and free."""
    problem, aside, above = beside_a_ball(0.036)
    start = problem.start.configuration(problem.arm)
    known = KnownMotions(
        problem, Straight(), lambda leg: float(chain_time(leg.path.spline(np.linspace(0, 1, 200)), np.ones(8))[-1]), 1.0
    )
    for q in (aside + above, above - aside):
        path = JointPath(BSpline(KNOTS, np.stack((start, 2.0 * above, 2.0 * above, q, q)), 3), np.zeros((9, 8)), ())
        known.rests.append(
            Rest(-1, Stop(JointPose.from_configuration(q, problem.arm.coordinates), Tolerances()), q, 0, path)
        )
    for k, rest in enumerate(known.rests[1:], start=1):
        assert rest.path is not None
        assert known.keep(0, k, rest.path)
    between, _ = known.fastest()
    known.make_roadmap()
    assert known.estimated(between)[1, 2] < between[1, 2]
    assert known.link(1, 2)
    assert known.durations[1, 2] < 0.7 * between[1, 2]
    np.testing.assert_array_equal(known.estimated(between)[1, 2], between[1, 2])
    rows = known.paths[1, 2].spline(np.linspace(0.0, 1.0, 200))
    np.testing.assert_allclose(rows[[0, -1]], [known.rests[1].q, known.rests[2].q])
    assert np.min(gaps(problem, rows)) > 0.0


@given(below=st.floats(0.036, 0.08), slower=st.floats(1.01, 3.0))
@settings(max_examples=10, deadline=None)
def test_clearance_is_worth_time_in_proportion_to_what_is_lacking(below: float, slower: float) -> None:
    """A leg past a ball is planned by itself if it lacks clearance, and kept where that takes too long for its gain."""
    problem, aside, above = beside_a_ball(below)

    class Over(Straight):
        """A planner of motions over the ball."""

        def plan(self, problem: Problem) -> JointPath:
            """Up, and down again."""
            start, goal = problem.start.whole(problem.arm), problem.goal.whole(problem.arm)
            assert start is not None
            assert goal is not None
            return JointPath(BSpline(KNOTS, np.stack((start, above, above, above, goal)), 3), np.zeros((9, 8)), ())

    ends = [JointPose.from_configuration(q, problem.arm.coordinates) for q in (-aside, aside)]
    asked = replace(problem, start=ends[0], goal=ends[1])
    straight = JointPath(BSpline(KNOTS, np.linspace(-aside, aside, 5), 3), np.zeros((40, 8)), ())
    leg = Leg(asked, straight)
    known = KnownMotions(problem, Over(), lambda leg: 1.0 if leg.path is straight else slower, 1.0)
    found = known.with_more_clearance(leg, Deadline.after(60.0))
    # The straight motion is nearest to the ball halfway, where one of its samples is; the other one keeps clear of it.
    lacking = 1.0 - min(float(np.min(gaps(problem, np.zeros((1, 8))))) / problem.wanted_gap, 1.0)
    if abs(lacking - 0.1) > 1e-3 and abs(1.0 + lacking - slower) > 1e-3:
        assert (found is not leg) == (lacking > 0.1 and slower < 1.0 + lacking)


def test_a_goal_of_another_problem_is_left_from_where_the_arm_rests() -> None:
    """Known motions begin where they are said to begin, though a goal is none of the present problem."""
    planner = TourPlanner(free_order("free", [10, 30]), Lines(), lambda _: 1.0, lambda _: None, Stages(), share=1.0)
    planner.plan()
    planner.plan_also(free_order("free", [31, 32]), {})
    rests = planner.motions.rests
    assert [rest.number for rest in rests[1:3]] == [-1, -1]
    for rest in rests[1:]:
        assert rest.path is not None
        np.testing.assert_allclose(rest.path.spline([0.0, 1.0]), [rests[rest.parent].q, rest.q], atol=1e-9)
