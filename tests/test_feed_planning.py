"""Feeding: every joint on the leader's path, joints straight in the guide, whole problems from start to check."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.driver.metrics import leader_deviation
from ccm_opt.driver.pipeline import solve
from ccm_opt.io.reading import load_problem, parse_problem
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.leader import LINKS_PER_SAMPLE, SAMPLE_PERIOD, LeaderPath, pose_on_path, pose_path, slide
from ccm_opt.planning.leader_paths import ElasticBand
from ccm_opt.planning.leader_strategies import LedWays
from ccm_opt.planning.limits.guide_tube import GuideTubeLimit
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.spline_path import clamped_spline
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.benchmarks.feed_families import short_range
from tests.feed_scenes import LINK, LINKS, RADIUS, bow, fed_arm, make_problem, make_room

PROBLEMS = Path(__file__).parents[1] / "problems"


@settings(max_examples=25, deadline=None)
@given(turn=st.floats(-2.5, 2.5).filter(lambda t: abs(t) > 0.05), start=st.floats(0.0, 0.3))
def test_joints_slide_along_the_path(turn: float, start: float) -> None:
    """Whatever the arc, every joint of every keyframe lies on the axis or on the arc's own circle."""
    arm = fed_arm()
    path = bow(arm, turn)
    end = path.base_with_tip_at_end(arm.lengths)
    keyframes = slide(arm, path, start, end)
    joints = arm.joint_positions(arm.headings(keyframes[:, :-1]), keyframes[:, -1])
    radius = 0.5 / turn
    off_circle = np.abs(np.hypot(joints[..., 0] - 0.1, joints[..., 1] - radius) - abs(radius))
    off_axis = np.where(joints[..., 0] < 0.1 + 1e-9, np.abs(joints[..., 1]), np.inf)
    assert np.max(np.minimum(off_axis, off_circle)) < 1e-9
    assert np.allclose(joints[-1, -1], path.points[-1], atol=1e-9)


def test_configurations_carry_the_feed() -> None:
    """A configuration of the arm stands where the arm stands with its feed given beside it."""
    arm = fed_arm(base_heading=0.7)
    row = np.append(np.linspace(-0.2, 0.3, arm.links), 0.123)
    expected = arm.joint_positions(arm.headings(row[:-1]), 0.123)
    assert np.allclose(arm.joint_positions_at(row), expected)


@pytest.mark.parametrize("heading", [0.0, -0.5 * np.pi, 0.7])
def test_bending_in_the_guide_is_seen(heading: float) -> None:
    """A path that bends a joint before it has left the guide is refused, the same a little later is not."""
    arm = fed_arm(feed=Feed(0.0, 0.8, 0.4), base_heading=heading)
    feeds = np.linspace(0.0, 0.8, 81)
    for leaves, fine in ((0.30, False), (0.45, True)):
        bends = np.zeros((81, arm.links))
        bends[:, 0] = np.where(feeds > leaves, 0.1, 0.0)
        spline = clamped_spline(np.column_stack((bends, feeds)))
        held = GuideTubeLimit(arm, 1e-3).failures(spline(np.linspace(0.0, 1.0, 500)))
        assert (len(held) == 0) is fine


def test_deviation_of_a_bow() -> None:
    """On an arc the arm leaves its leader by no more than the sagitta of a link; on the axis not at all."""
    arm = fed_arm()
    path = bow(arm, 1.5)
    keyframes = slide(arm, path, 0.0, path.base_with_tip_at_end(arm.lengths))
    found = leader_deviation(arm, keyframes)
    assert found is not None
    sagitta = LINK**2 * (1.5 / 0.5) / 8.0
    assert 0.9 * sagitta < found.worst < 1.01 * sagitta
    assert found.straight_mean < 1e-7


def test_walls_are_seen_by_the_moving_base() -> None:
    """A straight arm pushed against a wall is not certified, one that stops before it is."""
    arm = fed_arm()
    ahead = np.zeros((9, arm.links + 1))
    ahead[:, -1] = np.linspace(0.0, 0.8, 9)
    assert not len(Certificate(arm, make_room(), 0.0).failures(ahead))
    narrow = Certificate(arm, make_room(*_plate(0.6)), 0.0)
    assert len(narrow.failures(ahead))
    assert not len(narrow.failures(ahead[:6]))


def test_feeding_round_a_plate() -> None:
    """A whole problem: a straight arm is fed round a plate to a pose of its tip, and the verifier agrees."""
    arm = fed_arm()
    solution = solve(make_problem(arm, make_room(*_plate(0.35)), TipGoal(np.array([0.45, 0.25]), heading=0.0)))
    assert all(check.passed for check in solution.checks)
    assert solution.metrics["leader_deviation_straight_mean_m"] < 0.02 * arm.radius
    assert solution.metrics["tip_error_m"] < 1e-6


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=7, deadline=None)
@given(turn=st.floats(0.3, 1.4), left=st.booleans(), gap=st.floats(0.004, 0.03))
def test_bands_keep_off_the_walls_of_a_bent_tube(turn: float, left: bool, gap: float) -> None:
    """In a tube round an arc a band keeps its distance, or where that is too much the middle, and its ends are kept."""
    sign = 1.0 if left else -1.0
    middle = bow(fed_arm(), sign * turn)
    line = shapely.LineString(middle.points[middle.arc > 0.7])
    tube = shapely.buffer(line, 0.15).difference(shapely.buffer(line, RADIUS + gap, cap_style="flat"))
    walls = Workspace(shapely.box(-2.0, -2.0, 2.0, 2.0), (Obstacle("tube", PlaneShape(tube)),)).flat_walls
    way = middle.points[(middle.arc > 0.82) & (middle.arc < 1.38)]
    wanted = RADIUS + 0.01
    band = ElasticBand(walls, wanted, 0.0, 15.0, LINK / 3.0, LINK).smoothed(way, (0.0, None))
    assert np.allclose(band[[0, -1]], way[[0, -1]], atol=1e-9)
    kept = shapely.distance(tube, shapely.points(band[2:-2]))
    assert kept.min() > min(wanted, RADIUS + gap) - 1.5e-3


def test_a_tube_is_passed() -> None:
    """An arm of 40 mm passes a tube 52 mm wide that bends by 60 degrees to each side, the verifier agreeing."""
    there = np.deg2rad(60.0) * np.linspace(0.0, 1.0, 200)
    back = np.deg2rad(60.0) * np.linspace(1.0, 0.0, 200)
    headings = np.concatenate((np.zeros(80), there, back, np.zeros(80)))
    steps = 0.7 / len(headings) * np.column_stack((np.cos(headings), np.sin(headings)))
    middle = shapely.LineString(np.cumsum(np.vstack(([0.0, 0.0], steps)), axis=0))
    tube = shapely.buffer(middle, 0.06, cap_style="flat").difference(shapely.buffer(middle, 0.026, cap_style="flat"))
    walls = [Obstacle(f"tube {k}", PlaneShape(part)) for k, part in enumerate(shapely.get_parts(tube))]
    goal = TipGoal(np.array(middle.coords[-8]), heading=0.0)
    problem = make_problem(fed_arm(), make_room(*walls), goal)
    path = MotionPlanner().plan(problem)
    assert path.candidate.startswith("follow the leader")
    assert_sound(problem, np.asarray(path.spline(np.linspace(0.0, 1.0, 400))))


@settings(max_examples=15, deadline=None)
@given(turn=st.floats(-1.8, 1.8).filter(lambda t: abs(t) > 0.05), share=st.floats(0.3, 1.0))
def test_an_arm_is_drawn_back_along_its_own_shape(turn: float, share: float) -> None:
    """The own path goes through every joint, and back along it every joint is straight when it comes to the hole."""
    arm = fed_arm()
    bow_path = bow(arm, turn)
    feed = share * bow_path.base_with_tip_at_end(arm.lengths)
    bends = pose_on_path(arm, bow_path, feed)
    path = pose_path(arm, bends, feed, 0.8 + 1.4 * LINK)
    assert path is not None
    assert np.allclose(pose_on_path(arm, path, feed), bends, atol=1e-7)
    drawn = slide(arm, path, feed, 0.0)
    places = drawn[:, -1:] + LINK * np.arange(arm.links)
    assert not drawn[:, :-1][places < 0.8].any()
    assert np.max(np.abs(drawn[:, :-1])) < 1.3 * np.max(np.abs(bends)) + 1e-9


def test_no_own_path_with_a_bend_at_the_hole() -> None:
    """A joint that bends where it has just left the guide cannot be drawn back as it is."""
    arm = fed_arm()
    bends = np.zeros(arm.links)
    bends[8] = 0.4
    assert pose_path(arm, bends, 0.4, 0.8 + 1.4 * LINK) is None


def test_reversed_paths() -> None:
    """A reversed path has the same poses at mirrored parameters, its keyframes the other way round."""
    path = MotionPlanner().plan(make_problem(fed_arm(), make_room(), TipGoal(np.array([0.5, 0.2]))))
    back = path.reversed()
    u = np.linspace(0.0, 1.0, 23)
    assert np.allclose(back.spline(u), path.spline(1.0 - u), atol=1e-12)
    assert np.array_equal(back.keyframes, path.keyframes[::-1])


def test_reshaping_leaves_the_guide_alone() -> None:
    """At a fixed feed the part beyond the hole changes its shape, for even and odd numbers of links there."""
    arm = fed_arm()
    room = make_room(*_plate(0.35))
    for beyond in (9, 10):
        feed = LINK * beyond
        problem = make_problem(arm, room, TipGoal(np.array([0.3, 0.2])), JointPose(np.zeros(arm.links), 0.0))
        bends = np.zeros(arm.links)
        bends[-beyond + 1 : -beyond + 3] = 0.4
        start = np.zeros(arm.links)
        start[-beyond + 1 : -beyond + 3] = 0.3
        problem = replace(problem, start=JointPose(start, feed), goal=JointPose(bends, feed))
        motion = next(ways(problem, 900.0).at_once())
        q = motion.configurations
        assert np.allclose(q[:, -1], feed)
        assert np.abs(q[:, : arm.links - beyond]).max() < 1e-12
        assert np.allclose(q[[0, -1], :-1], [start, bends], atol=1e-9)


@pytest.mark.parametrize("case", ["short range", "bent at the hole", "goal bent at the hole", "back to straight"])
def test_starts_that_following_alone_does_not_solve(case: str) -> None:
    """The path is certified, straight in the guide and clear of the walls by sampling; its ends are those asked for."""
    start = _bent(-0.35)
    goal = _bent(0.35)
    arm = fed_arm()
    if case == "short range":
        arm = fed_arm(low=0.35)
    elif case == "bent at the hole":
        start = _bent(-0.35, first=8)
    elif case == "goal bent at the hole":
        start = JointPose(np.zeros(arm.links), 0.0)
        goal = _bent(0.35, first=8)
    else:
        goal = JointPose(np.zeros(arm.links), 0.1)
    problem = make_problem(arm, make_room(), goal, start)
    path = MotionPlanner().plan(problem)
    rows = np.asarray(path.spline(np.linspace(0.0, 1.0, 600)))
    assert np.allclose(rows[0], np.append(start.bends, start.feed), atol=1e-12)
    assert np.allclose(rows[-1], np.append(goal.bends, goal.feed), atol=1e-12)
    assert_sound(problem, rows)


@pytest.mark.parametrize("name", ["feed-s-duct", "feed-penetration"])
def test_shipped_problems(name: str) -> None:
    """The shipped problems are planned; where the leader goes straight the arm is within 2 % of its radius of it."""
    problem = load_problem(PROBLEMS / f"{name}.toml")
    path = MotionPlanner().plan(problem)
    rows = np.asarray(path.spline(np.linspace(0.0, 1.0, 400)))
    assert_sound(problem, rows)
    found = leader_deviation(problem.arm, rows)
    assert found is not None
    assert found.straight_mean < 0.02 * problem.arm.radius
    assert 0.0 < found.mean < found.worst < 0.1 * problem.arm.radius


@pytest.mark.drawn(6, of="whole plans")
def test_unreachable_goals_say_why() -> None:
    """A goal behind a closed wall has no way; one that is too far is out of reach; joints in the guide are straight."""
    closed = make_room(Obstacle("closed", PlaneShape(shapely.box(0.3, -1.2, 0.33, 1.2))))
    with pytest.raises(UnreachableGoal, match="no way leads to the goal"):
        solve(make_problem(fed_arm(), closed, TipGoal(np.array([0.6, 0.0]))))
    with pytest.raises(UnreachableGoal, match="out of reach"):
        solve(make_problem(fed_arm(), make_room(), TipGoal(np.array([0.9, 0.8]))))
    bent = JointPose(np.append(0.2, np.zeros(15)), 0.0)
    with pytest.raises(UnreachableGoal, match=r"joint 1 by .* inside the guide"):
        MotionPlanner().plan(make_problem(fed_arm(), make_room(), TipGoal(np.array([0.5, 0.0])), bent))


def ways(problem: Problem, seconds: float) -> LedWays:
    """The ways of a fed arm, each change of shape within a time [s]."""
    planner = MotionPlanner()
    task = planner.task_without_routes(problem, resolve_ends(problem), Deadline.after(900.0))
    return LedWays(problem, task, planner.shape_change, seconds)


def assert_sound(problem: Problem, rows: FloatArray) -> None:
    """Samples of a path keep joint limits and walls, and joints in the guide are straight; by shapely's distances."""
    arm = problem.arm
    assert arm.feed is not None
    assert not rows[:, :-1][arm.held(rows[:, -1])].any()
    assert np.all(np.abs(rows[:, :-1]) <= arm.bend_limits)
    assert np.all((rows[:, -1] >= arm.feed.low) & (rows[:, -1] <= arm.feed.high))
    joints = arm.joint_positions(arm.headings(rows[:, :-1]), rows[:, -1])
    joints[:, 0] += arm.mount_length / arm.link_length * (joints[:, 1] - joints[:, 0])
    lines = shapely.linestrings(joints)
    for wall in problem.workspace.walls:
        assert np.min(shapely.distance(lines, wall.core)) - wall.rounding >= arm.radius - 1e-9


def _bent(bend: float, first: int = 10) -> JointPose:
    """Half the arm beyond the hole, two joints bent."""
    bends = np.zeros(LINKS)
    bends[first : first + 2] = bend
    return JointPose(bends, 0.4)


def _plate(at: float) -> tuple[Obstacle, ...]:
    """A plate across the way beyond the hole, its upper edge at y = 0.1."""
    return (Obstacle("plate", PlaneShape(shapely.box(at, -0.6, at + 0.03, 0.1))),)


def test_a_fast_feed_is_held_back_where_joints_leave_the_guide() -> None:
    """A feed limit that no arm needs makes no problem unsolvable: the base passes a part of a link between samples."""
    problem = load_problem(PROBLEMS / "feed-s-duct.toml")
    fast = replace(problem, limits=replace(problem.limits, feed_velocity=300.0, feed_acceleration=300.0))
    solution = solve(replace(fast, planner=replace(fast.planner, optimiser="none")))
    most = LINKS_PER_SAMPLE * problem.arm.link_length / SAMPLE_PERIOD
    assert np.max(np.abs(solution.trajectory.base_velocities)) <= most


def test_a_guide_and_a_hole_as_wide_as_the_arm_are_passed() -> None:
    """Touching is not hitting: the arm slides straight through what is no wider than it, and bends where that ends."""
    arm = fed_arm()
    guide = [
        Obstacle("guide", PlaneShape(shapely.box(-0.9, RADIUS, 0.02, 1.0))),
        Obstacle("other side", PlaneShape(shapely.box(-0.9, -1.0, 0.02, -RADIUS))),
    ]
    room = Workspace(shapely.box(-1.3, -1.2, 1.4, 1.2), tuple(guide))
    solution = solve(make_problem(arm, room, TipGoal(np.array([0.5, 0.25]))))
    assert all(check.passed for check in solution.checks)
    assert abs(solution.metrics["least_wall_clearance_m"]) < 1e-6


def test_feed_and_shape_change_at_once() -> None:
    """From one bow to another beside it the arm goes in less time than it takes to draw it back."""
    arm = fed_arm()
    start = bow(arm, 1.0)
    end = bow(arm, -0.6)

    def lying_on(path: LeaderPath) -> JointPose:
        feed = path.base_with_tip_at_end(arm.lengths)
        return JointPose(pose_on_path(arm, path, feed), feed)

    problem = make_problem(arm, make_room(), lying_on(end), lying_on(start))
    solution = solve(problem)
    assert problem.limits.feed_velocity is not None
    drawing_back = 2.0 * (lying_on(start).feed - 0.1) / problem.limits.feed_velocity
    assert solution.trajectory.time[-1] < 0.6 * drawing_back


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [0, 703])
def test_a_motion_lasts_no_longer_than_a_change_of_shape_alone(seed: int) -> None:
    """Where the arm gets to the tip's goal without any feed, it is not drawn back for longer than that takes."""
    problem = short_range(np.random.default_rng((5, seed)))
    alone = list(ways(problem, 900.0).at_once())
    assert len(alone) == 1
    found = MotionPlanner().plan(problem).spline(np.linspace(0.0, 1.0, 2000))
    scale = np.append(1.0 / problem.limits.velocity[1::3], 1.0 / (problem.limits.feed_velocity or 1.0))
    times = [np.abs(np.diff(q * scale, axis=0)).max(axis=1).sum() for q in (found, alone[0].configurations)]
    assert times[0] <= (1.0 + 1e-4) * times[1]


PARTLY_FED = """
schema = 1
name = "partly-fed"
limits = { velocity = 1.5, acceleration = 6.0, feed_velocity = 0.3, feed_acceleration = 1.0 }
start = { shape = "straight", feed = -0.219 }
goal = { position = [0.16041, -0.24688] }

[workspace]
bounds = [-0.405, -0.512, 0.426, 0.434]
clearance = 0.002
obstacles = [{ name = "ball", circle = { center = [0.1112, 0.0298], radius = 0.0339 } }]

[arm]
links = 4
link_length = 0.0912
radius = 0.0143
joint_limit_deg = 27.6
base = [0.0, 0.0]
base_heading_deg = -50.3
feed = { range = [-0.219, 0.0], hole = 0.193 }
"""


@pytest.mark.planning
def test_a_motion_that_is_not_found_in_the_plane_is_sought_in_space() -> None:
    """An arm of few links that never leaves its guide tube wholly follows no leader to the goal."""
    plan = solve(parse_problem(PARTLY_FED))
    tip = plan.problem.arm.joint_positions_at(plan.trajectory.positions[-1])[-1]
    np.testing.assert_allclose(tip, [0.16041, -0.24688], atol=1e-3)
