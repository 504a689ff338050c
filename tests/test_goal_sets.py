"""Goals with tolerances are sets: nothing is proved against a set with a free pose in it, and any member will do."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.polyline import unit_vector, wrap
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.explain import refuse_closed
from ccm_opt.diagnosis.planar_axis_paths import shortest_path_length
from ccm_opt.planning.ends import resolve_ends, tip_goal
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.problem import JointPose, Problem, TipGoal, Tolerances
from ccm_opt.scene.certificate import Certificate

from .goal_set_scenes import box_beside, pocket, slot, wall_behind
from .scenes import clutter, make_stepper, open_scene, random_polygon

SCENES = {"slot": slot, "pocket": pocket, "wall": wall_behind, "box": box_beside}
seeds = st.integers(0, 10**6)


def found(problem: Problem) -> FloatArray:
    """Bends at the end of a motion that the planner finds, not optimised, shape (links,) [rad]."""
    quick = replace(problem, planner=replace(problem.planner, optimiser="none", wanted_gap=0.0))
    path = MotionPlanner(refuse=refuse_closed).plan(quick)
    return np.asarray(path.spline(path.spline.t[-1]))


def missed(problem: Problem, bends: FloatArray) -> tuple[float, float]:
    """By how much a pose misses the tolerances of the goal [m], [rad]; negative inside."""
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    headings = problem.arm.headings(bends)
    off = float(np.hypot(*(problem.arm.joint_positions(headings)[-1] - goal.position)))
    turn = 0.0 if goal.heading is None else abs(float(wrap(headings[-1] - goal.heading)))
    return off - problem.tolerances.position, turn - problem.tolerances.heading


@pytest.mark.drawn(2)
@pytest.mark.parametrize("family", sorted(SCENES))
@settings(deadline=None, max_examples=2)
@given(seed=seeds)
def test_a_larger_tolerance_is_not_harder(family: str, seed: int) -> None:
    """Where a goal inside a wide one is reached the wide one is, too, though its middle is in a wall or behind it."""
    problem, goal, tolerances = SCENES[family](np.random.default_rng(seed))
    try:
        found(problem)
    except NoPlanFound:
        return
    wide = replace(problem, goal=goal, tolerances=tolerances)
    assert max(missed(wide, found(wide))) <= 0.0


@pytest.mark.drawn(2)
@pytest.mark.parametrize("width", [0.5, 5.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_base_may_lie_in_the_goal(width: float, seed: int) -> None:
    """A disc wider than the arm is long, as where metres and millimetres are mixed up, is a goal like any other."""
    wide = replace(clutter(seed, 10).problem(), tolerances=Tolerances(position=width))
    assert max(missed(wide, found(wide))) <= 0.0


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(deadline=None, max_examples=15)
@given(seed=seeds, width=st.floats(0.0, 0.4), turn=st.floats(0.0, np.pi), heading=st.booleans())
def test_nothing_is_proved_against_a_set_with_a_free_pose(
    seed: int, width: float, turn: float, *, heading: bool
) -> None:
    """A pose that touches nothing is a way from the base to its tip: no check may refuse a set that holds it."""
    rng = np.random.default_rng(seed)
    scene = clutter(seed, int(rng.integers(0, 30)))
    tip = scene.goal_tip
    assert tip.heading is not None
    middle = tip.position + width * rng.uniform() * unit_vector(rng.uniform(-np.pi, np.pi))
    turned = tip.heading + turn * rng.uniform(-1.0, 1.0) if heading else None
    # Limits that the pose just keeps, so that the checks of turning and curling up are tight.
    bends = scene.arm.bends(scene.goal)
    limits = np.abs(np.concatenate((bends, scene.arm.bends(scene.start))))
    tight = replace(scene.arm, joint_limit=max(float(limits.reshape(2, -1)[:, 1:].max()), 1e-3))
    problem = replace(scene.problem(TipGoal(middle, heading=turned)), arm=tight)
    wide = replace(problem, tolerances=Tolerances(width + 1e-9, turn + 1e-9))
    assert not any(finding.proved for finding in failed(wide)), failed(wide)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(deadline=None, max_examples=12)
@given(seed=seeds, degrees=st.floats(0.5, 10.0))
def test_nothing_is_proved_against_a_pose_that_is_free_within_tolerance(seed: int, degrees: float) -> None:
    """A goal for the whole arm that touches, or bends too far, is not refused while a free pose is near enough."""
    rng = np.random.default_rng(seed)
    scene = clutter(seed, 30)
    allowed = float(np.deg2rad(degrees))
    bends = scene.arm.bends(scene.goal)
    limit = max(float(np.abs(np.concatenate((bends, scene.arm.bends(scene.start)))[1:]).max()), 0.3)
    asked = JointPose(bends + rng.uniform(-allowed, allowed, len(bends)))
    arm = replace(scene.arm, joint_limit=limit)
    problem = replace(scene.problem(asked), arm=arm, tolerances=Tolerances(heading=allowed))
    # From the free pose itself, so that there is a way for certain.
    problem = replace(problem, start=JointPose(bends))
    assert not any(finding.proved for finding in failed(problem)), failed(problem)


def test_what_no_tolerance_mends_is_proved() -> None:
    """A goal that is deeper in a wall, or farther away, than its tolerances reach has a proof against it."""
    problem, _, _ = wall_behind(np.random.default_rng(3))
    middle = shapely.get_coordinates(problem.workspace.obstacles[0].core.centroid)[0]
    inside = replace(problem, goal=TipGoal(middle), tolerances=Tolerances(0.01))
    far = replace(problem, goal=TipGoal(np.array([1.29, 0.0])), tolerances=Tolerances(0.25))
    for impossible in (inside, far):
        with pytest.raises(NoPlanFound) as caught:
            refuse_closed(impossible)
        assert caught.value.status == "infeasible"
    refuse_closed(replace(inside, tolerances=Tolerances(0.1)))
    refuse_closed(replace(far, tolerances=Tolerances(0.3)))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_the_shortest_way_is_that_of_the_visibility_graph(seed: int) -> None:
    """The lazy search over corners finds the length that Dijkstra finds in the whole visibility graph."""
    rng = np.random.default_rng(seed)
    polygons = [random_polygon(rng, rng.uniform(-0.3, 0.3, 2)).buffer(0.03, quad_segs=2) for _ in range(8)]
    free = shapely.difference(shapely.box(-0.5, -0.5, 0.5, 0.5), shapely.union_all(polygons))
    start = np.array([-0.49, -0.49])
    goal = np.array([0.49, 0.49])
    piece = next(part for part in shapely.get_parts(free) if shapely.intersects_xy(part, *start))
    if not shapely.intersects_xy(piece, *goal):
        return
    corners = np.vstack((start, goal, shapely.get_coordinates(piece)))
    grown = piece.buffer(1e-9, join_style="mitre")
    i, j = np.triu_indices(len(corners), 1)
    seen = shapely.covers(grown, shapely.linestrings(np.stack((corners[i], corners[j]), axis=1)))
    lengths = np.linalg.norm(corners[i] - corners[j], axis=1)[seen] + 1e-15
    graph = scipy.sparse.coo_array((lengths, (i[seen], j[seen])), shape=(len(corners), len(corners))).tocsr()
    expected = float(dijkstra(graph, directed=False, indices=0)[1])
    assert shortest_path_length(piece, start, goal, 10.0, 1000) == pytest.approx(expected, abs=1e-7)
    assert shortest_path_length(piece, start, goal, 0.999 * expected, 1000) == 0.999 * expected
    assert shortest_path_length(piece, start, goal, 10.0, 3) is None


@settings(deadline=None, max_examples=30)
@given(
    seed=seeds,
    width=st.just(0.0) | st.floats(1e-9, 0.2),  # less is lost in the rounding of places
    turn=st.just(0.0) | st.floats(1e-9, 2.0),
)
def test_the_polish_ends_in_the_set_and_leaves_what_is_in_it(seed: int, width: float, turn: float) -> None:
    """Newton's method puts a pose near a set onto it, and does not move one that is in it."""
    rng = np.random.default_rng(seed)
    stepper, start = make_stepper(open_scene(seed))
    tip = start.points[-1]
    # An arm that is stretched out cannot reach what lies beyond its tip.
    assume(np.linalg.norm(tip - start.points[0]) < 0.98 * stepper.space.arm.length)
    aside = tip + 0.99 * width * unit_vector(rng.uniform(-np.pi, np.pi))
    inside = GoalPose(aside, start.tip_direction, room=(width, turn))
    assert inside.errors(start) == pytest.approx((0.0, 0.0), abs=1e-12)
    if inside.room[0] > 0.0 and inside.room[1] > 0.0:
        np.testing.assert_array_equal(moved_onto(stepper.space, inside, start).v, start.v)
    aside = tip + (width + 0.003) * unit_vector(rng.uniform(-np.pi, np.pi))
    beside = GoalPose(aside, unit_vector(float(stepper.space.arm.headings(start.q)[-1]) + 0.01), room=(width, 0.0))
    assert beside.on_goal(moved_onto(stepper.space, beside, start))


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=st.floats(0.0, 0.5), turn=st.floats(0.0, 3.0))
def test_the_nearest_member_is_in_the_set(seed: int, width: float, turn: float) -> None:
    """The member nearest to a pose is in the set, as far away as the errors say, and has no room of its own."""
    rng = np.random.default_rng(seed)
    goal = GoalPose(rng.normal(size=2), unit_vector(rng.uniform(-9.0, 9.0)), room=(width, turn))
    _, pose = make_stepper(open_scene(seed))
    member = goal.nearest_member(pose.tip, pose.tip_direction)
    assert member.errors(pose) == pytest.approx(goal.errors(pose), abs=1e-9)
    assert not member.is_set
    assert np.hypot(*(member.position - goal.position)) <= width + 1e-9 or not goal.is_set
    assert member.heading is not None
    assert goal.heading is not None
    assert abs(float(wrap(member.heading - goal.heading))) <= turn + 1e-9


def test_small_tolerances_leave_the_goal_a_point() -> None:
    """A tolerance as small as a precision is no room; half a turn either way leaves any heading."""
    problem = clutter(3, 0).problem()
    assert not resolve_ends(problem).goal.is_set
    goal = problem.goal
    assert isinstance(goal, TipGoal)
    wide = replace(problem, tolerances=Tolerances(0.1, np.pi))
    assert tip_goal(wide, goal).heading is None
    assert tip_goal(wide, goal).room[0] == pytest.approx(0.095)


def test_a_whole_arm_goal_a_little_beyond_its_limits_is_taken_at_them() -> None:
    """Within the tolerance a joint beyond its limit is turned back onto it; farther beyond it is refused."""
    scene = open_scene(2)
    bends = np.zeros(scene.arm.links)
    bends[5] = scene.arm.joint_limit + 0.01
    problem = replace(scene.problem(JointPose(bends)), start=JointPose(np.zeros(scene.arm.links)))
    goal = resolve_ends(problem).goal_pose
    assert goal is not None
    assert goal[5] == pytest.approx(scene.arm.joint_limit)
    with pytest.raises(NoPlanFound, match="bends joint 6"):
        resolve_ends(replace(problem, tolerances=Tolerances(heading=0.005)))


@settings(deadline=None, max_examples=3)
@given(seed=st.integers(0, 30))
def test_the_goal_pose_program_takes_any_member(seed: int) -> None:
    """With a set for its goal the program finds a pose in the set that costs no more than that at the middle."""
    scene = clutter(seed, 8)
    problem = scene.problem(time_limit=20.0)
    narrow = poses_at_goal(problem, resolve_ends(problem), scene.arm.bends(scene.goal))
    wide = replace(problem, tolerances=Tolerances(0.08, 0.5))
    free = poses_at_goal(wide, resolve_ends(wide), scene.arm.bends(scene.goal))
    exact = narrow.best(scene.arm.bends(scene.goal))
    pose = free.best(scene.arm.bends(scene.goal))
    if exact is None or pose is None:
        return
    assert max(missed(wide, scene.arm.bends(pose.headings))) <= 1e-9
    assert pose.answer.cost <= 1.001 * exact.answer.cost
    certified = Certificate.allowing_contact(scene.arm, scene.workspace)
    assert len(certified.failures(np.stack((pose.q, pose.q)))) == 0
