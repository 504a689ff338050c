"""RRT-Connect in the coordinates of the curve: cheap checks refute truly, what is found is certified, seeds decide."""

import shutil
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning import strategies
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.link_space import KNOTS, LinkSpace
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.rrt_connect import CONNECT, PointTree
from ccm_opt.planning.sampled_check import BlockedRaster, SampledCheck
from ccm_opt.planning.search import Failure, Strategy
from ccm_opt.planning.strategies import Turn, connected, connects, find_motion, straight
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.scene.certificate import Certificate
from tests.oracles.free_shares import free_shares_by_numpy

from .few_link_scenes import few_link_problem, few_link_scene
from .scenes import Scene, clutter, mixed_walls, motion_task, open_scene, self_gap, wall_gaps

CONNECT_ALONE = (Strategy(CONNECT, connected, connects),)
SEEDS = st.integers(0, 10_000)
EASY = (4, 5, 6, 9, 13, 20)
"""Scenes of few links whose trees meet after some extensions, with goals of every kind."""


def found(problem: Problem, **changes: object) -> Motion | None:
    """What RRT-Connect alone finds, before it is optimised."""
    task = replace(motion_task(problem), **changes)  # type: ignore[arg-type]  # fields of the task
    return connected(task, [])


def poses(scene: Scene, seed: int, count: int) -> FloatArray:
    """Link headings of random poses within the joint limits, shape (count, links) [rad]."""
    arm = scene.arm
    rng = np.random.default_rng(seed)
    limits = np.minimum(arm.bend_limits, np.pi)
    return arm.headings(rng.uniform(-limits, limits, (count, arm.links)))


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS, gap=st.floats(0.005, 0.1))
def test_blocked_cells_are_too_near_to_a_wall(seed: int, gap: float) -> None:
    """A place in a blocked cell is nearer to a wall than asked for; a free one is hardly so."""
    workspace = mixed_walls()
    middle = np.array([0.1, 0.05])
    raster = BlockedRaster.around(workspace, middle, 0.9, gap, 600)
    places = middle + np.random.default_rng(seed).uniform(-0.9, 0.9, (2000, 2))
    distance = np.min([shapely.distance(shapely.points(places), w.core) - w.rounding for w in workspace.walls], axis=0)
    distance[~shapely.contains_xy(workspace.boundary, places)] = -1.0
    blocked = raster.at(places[:, 0], places[:, 1])
    assert (distance[blocked] < gap).all()
    assert (distance[~blocked] > gap - 0.05 * gap - 2.0 * raster.cell).all()


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_refuted_poses_touch_something(seed: int) -> None:
    """No pose is refuted that touches neither walls nor itself; most that touch are refuted."""
    scene = few_link_scene(seed)
    drawn = poses(scene, seed, 60)
    points = scene.arm.joint_positions(drawn)
    own = np.array([_own_gap(scene, pose) for pose in points])
    gaps = np.minimum(wall_gaps(scene.arm, scene.workspace, points).min(axis=1), own)
    inside = [shapely.contains(scene.workspace.boundary, shapely.linestrings(pose)) for pose in points]
    refuted = SampledCheck.for_workspace(scene.arm, scene.workspace).refuted(drawn)
    assert not (refuted & (gaps > 0.0) & inside).any()
    assert refuted[gaps < -0.3 * scene.arm.radius].all()


def _own_gap(scene: Scene, points: FloatArray) -> float:
    return self_gap(scene.arm, points[None])


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
def test_certified_motions_are_never_refuted(seed: int) -> None:
    """What the certificate proves free is free by samples."""
    scene = few_link_scene(seed)
    drawn = poses(scene, seed, 12)
    check = SampledCheck.for_workspace(scene.arm, scene.workspace)
    shares = check.free_shares(drawn[:-1], drawn[1:])
    failing = Certificate(scene.arm, scene.workspace).failures(scene.arm.bends(drawn))
    proved = np.setdiff1d(np.arange(len(shares)), failing)
    assert (shares[proved] == 1.0).all()


@settings(max_examples=4, deadline=None)
@given(seed=SEEDS, many=st.booleans())
def test_compiled_shares_are_those_of_numpy(seed: int, many: bool) -> None:
    """C and numpy look at the same poses: where a cell more or less decides nothing, they say the same."""
    scene = clutter(seed, 20) if many else few_link_scene(seed)
    drawn = poses(scene, seed, 20)
    turned = drawn + np.random.default_rng(seed).normal(0.0, 0.2, drawn.shape)
    check = SampledCheck.for_workspace(scene.arm, scene.workspace)
    blocked = check.raster.blocked
    # Coordinates in single precision may fall into a neighbouring cell.
    smaller = replace(check.raster, blocked=ndimage.binary_erosion(blocked, np.ones((3, 3)), border_value=1))
    larger = replace(check.raster, blocked=ndimage.binary_dilation(blocked, np.ones((3, 3))))
    most, least = (free_shares_by_numpy(replace(check, raster=raster), drawn, turned) for raster in (smaller, larger))
    shares = check.free_shares(drawn, turned)
    assert (least <= shares).all()
    assert (shares <= most).all()


def test_a_motion_is_free_up_to_the_first_pose_that_is_refuted() -> None:
    """The share that is free ends before the wall, and not far before it."""
    scene = open_scene(1, 4)
    arm = scene.arm
    room = replace(scene.workspace, boundary=shapely.box(-1.3, -0.5, 1.3, 1.3))
    check = SampledCheck.for_workspace(arm, room)
    straight = np.zeros((1, 4))
    share = check.free_shares(straight, straight - 0.5 * np.pi)[0]
    # The straight arm of 1 m turns until its side meets the lower wall.
    meets = np.arcsin(0.5 - arm.radius) / (0.5 * np.pi)
    assert meets - 0.03 < share <= meets + 0.01


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS)
def test_a_tree_knows_what_hangs_on_a_node(seed: int) -> None:
    """A cut leaves what does not hang on the node, with its ways."""
    rng = np.random.default_rng(seed)
    tree = PointTree.empty(3)
    tree.add(rng.normal(size=(2, 3)), np.array([-1, -1]))
    for _ in range(40):
        tree.add(rng.normal(size=(1, 3)), rng.integers(len(tree), size=1))
    ways = [tree.nodes[tree.way_to(k)].copy() for k in range(len(tree))]
    gone = int(rng.integers(1, len(tree)))
    taken = tree.nodes[gone].copy()
    tree.cut(gone)
    kept = [way for way in ways if not (way == taken).all(axis=1).any()]
    assert len(tree) == len(kept)
    for number, way in enumerate(kept):
        np.testing.assert_array_equal(tree.nodes[tree.way_to(number)], way)


@pytest.mark.parametrize("seed", EASY)
def test_motions_are_certified_and_lead_from_the_start_to_the_goal(seed: int) -> None:
    """Whatever the goal, all between the exact start and the goal is proved free, within the limits."""
    problem = few_link_problem(seed)
    motion = found(problem)
    assert motion is not None
    assert motion.candidate == CONNECT
    arm = problem.arm
    assert isinstance(problem.start, JointPose)
    np.testing.assert_allclose(motion.configurations[0], problem.start.bends, atol=1e-12)
    assert len(Certificate(arm, problem.workspace).failures(motion.configurations)) == 0
    assert (np.abs(motion.configurations) <= arm.bend_limits).all()
    assert_at_goal(problem, arm.headings(motion.configurations[-1]))


def assert_at_goal(problem: Problem, headings: FloatArray) -> None:
    """Assert that a pose meets the goal within its tolerances."""
    arm = problem.arm
    goal = problem.goal
    if isinstance(goal, JointPose):
        np.testing.assert_allclose(arm.bends(headings), goal.bends, atol=1e-9)
        return
    tip = arm.joint_positions(headings)[-1]
    assert np.hypot(*(tip - goal.position)) <= problem.tolerances.position
    if goal.heading is not None:
        turn = (headings[-1] - goal.heading + np.pi) % (2.0 * np.pi) - np.pi
        assert abs(turn) <= problem.tolerances.heading


def test_what_is_found_is_optimised() -> None:
    """The search with RRT-Connect alone ends with a motion that is shorter than the one found, and certified."""
    problem = few_link_problem(6)
    task = motion_task(problem)
    first = connected(task, [])
    last = find_motion(task, CONNECT_ALONE)
    assert first is not None
    assert np.abs(np.diff(last.configurations, axis=0)).sum() < np.abs(np.diff(first.configurations, axis=0)).sum()
    assert len(Certificate(problem.arm, problem.workspace).failures(last.configurations)) == 0


def test_the_seed_decides() -> None:
    """The same seed gives the same motion, another seed another."""
    problem = few_link_problem(22)
    once = found(problem, seed=1)
    again = found(problem, seed=1)
    other = found(problem, seed=2)
    assert once is not None
    assert again is not None
    assert other is not None
    np.testing.assert_array_equal(once.configurations, again.configurations)
    assert once.configurations.shape != other.configurations.shape or not np.array_equal(
        once.configurations, other.configurations
    )


def test_many_links_go_straight_to_goals_of_the_whole_arm_before_anything_is_drawn() -> None:
    """Interpolation by the step comes first, forwards and backwards; RRT-Connect then finds the same ends."""
    scene = clutter(1, 5)
    problem = scene.problem(JointPose(scene.arm.bends(scene.goal)))
    for find in (straight, connected):
        motion = find(motion_task(problem), [])
        assert motion is not None
        np.testing.assert_allclose(scene.arm.headings(motion.configurations[0]), scene.start, atol=1e-9)
        np.testing.assert_allclose(scene.arm.headings(motion.configurations[-1]), scene.goal, atol=1e-9)
        assert len(Certificate(scene.arm, scene.workspace).failures(motion.configurations)) == 0


@pytest.mark.parametrize("number", [1, 2, 3])
def test_many_links_reach_goals_of_the_tip_without_poses_of_the_nlp(number: int) -> None:
    """Random poses at the goal are enough for a brief search, whose motion is certified and has the tip there."""
    scene = clutter(number, 5)
    task = motion_task(scene.problem())

    def costly() -> Iterator[FloatArray]:
        pytest.fail("a pose was computed")
        yield from ()

    motion = connected(replace(task, guesses=costly(), further_guesses=costly()), [], Turn.SOON)
    assert motion is not None
    tip = task.arm.joint_positions_at(motion.configurations[-1])[-1]
    np.testing.assert_allclose(tip, task.goal.position, atol=1e-9)
    assert len(Certificate(scene.arm, scene.workspace).failures(motion.configurations)) == 0


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_poses_move_onto_the_goal_by_exact_derivatives(seed: int) -> None:
    """The derivatives of the tip with respect to the headings of unequal links agree with differences."""
    scene = open_scene(seed)
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.4, 1.8, scene.arm.links)
    proportions = Proportions(lengths / lengths.mean(), np.ones(len(lengths)), np.ones(len(lengths)))
    arm = replace(scene.arm, proportions=proportions)
    space, _ = LinkSpace.through(arm, arm.bends(scene.start))
    shapes = TargetDraws.within(space, [arm.bends(scene.start)], KNOTS, 1.0)
    draws = GoalDraws(shapes, GoalPose(np.array([0.1, 0.2])), SampledCheck.for_workspace(arm, scene.workspace))
    headings, members, change = rng.normal(size=(3, 24)), rng.normal(size=(3, 3)), 1e-6 * rng.normal(size=(3, 24))
    rows, error = draws._equations(headings, members)
    _, after = draws._equations(headings + change, members)
    np.testing.assert_allclose(error - after, np.einsum("mdl,ml->md", rows, change), atol=1e-10)


def test_a_search_ends_with_its_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where some extensions do not suffice, the search ends after them, and the failure says so."""
    task = motion_task(few_link_problem(37))
    monkeypatch.setattr(strategies, "FEW_BUDGETS", (8, 8))
    failures: list[Failure] = []
    assert connected(task, failures) is None
    assert failures[0].candidate == CONNECT
    assert "8 extensions" in failures[0].message


@pytest.mark.skipif(shutil.which("cc") is None, reason="the plain sampler is compiled")
@pytest.mark.parametrize("seed", [6, 9, 20])
def test_the_plain_sampler_of_the_benchmark_is_sound(seed: int) -> None:
    """What the other side of the comparison calls a motion is proved free by the certificate, and keeps its ends."""
    from .benchmarks.plain_connect import plain_connect

    scene = few_link_scene(seed)
    problem = few_link_problem(seed)
    goal = scene.arm.bends(scene.goal)
    way = plain_connect(problem, goal[None], 10.0, seed).way
    assert way is not None
    np.testing.assert_allclose(scene.arm.headings(way[0]), scene.start, atol=1e-12)
    np.testing.assert_allclose(way[-1], goal, atol=1e-12)
    assert len(Certificate(scene.arm, scene.workspace).failures(way)) == 0
