"""Poses at the goal besides the one that the search arrives at: random poses, their classes, the NLP from them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import WHOLE_TURN
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.goal_pose import GoalPoseSearch
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose_draws import PoseDraws, PoseDrawSettings, TipEquations, landmarks, same_class, windings
from ccm_opt.planning.pose_energy import EnergyWeights, PoseEnergy
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import ROOM, Scene, clutter, make_arm, wall_gaps

SEEDS = st.integers(0, 10_000)


def searched(scene: Scene) -> GoalPoseSearch:
    """The search for the goal pose of a scene."""
    problem = scene.problem()
    ends = resolve_ends(problem)
    return GoalPoseSearch(problem, ends, scene.start)


def draws_in(scene: Scene) -> PoseDraws:
    """Poses at the goal of a scene, near its goal pose."""
    space, _ = LinkSpace.through(scene.arm, scene.arm.bends(scene.goal))
    energy = PoseEnergy.of(space, scene.start, EnergyWeights(0.02, 0.5))
    goal = scene.goal_tip
    return PoseDraws(energy, scene.workspace.wall_segments, goal.position, goal.heading, scene.start, scene.goal)


@given(SEEDS)
def test_the_energy_is_bending_travel_and_distance(seed: int) -> None:
    """The quadratic form equals its three parts, reckoned link by link; its descent leads to the least of all."""
    rng = np.random.default_rng(seed)
    arm = make_arm(10)
    near = rng.normal(0.0, 1.0, 10)
    space, v = LinkSpace.through(arm, rng.normal(0.0, 1.0, 10))
    energy = PoseEnergy.of(space, near, EnergyWeights(0.3, 0.5))
    headings = arm.headings(space.configurations(v))
    bends = np.diff(headings)
    turned = np.diff(headings - near, prepend=0.0)
    parts = 0.3 * 10 * np.sum(bends**2) + 0.5 * np.sum(turned**2)
    assert energy.cost(v) == pytest.approx(parts, rel=1e-3)
    least = v + energy.descent(v)
    assert energy.cost(least) <= energy.cost(least + 0.1 * rng.standard_normal(len(v)))


@given(SEEDS)
def test_the_rows_of_the_tip_are_derivatives(seed: int) -> None:
    """Differences of what the tip misses, over small changes of the coordinates, are those that the rows say."""
    rng = np.random.default_rng(seed)
    space, v = LinkSpace.through(make_arm(12), rng.normal(0.0, 0.5, 12))
    equations = TipEquations(space, np.array([0.4, 0.3]), np.array([1.0]))
    step = 1e-6 * rng.standard_normal((1, len(v)))

    def headings(v: FloatArray) -> FloatArray:
        return space.arm.headings(space.configurations(v))

    rows = equations.rows(headings(v[None]))[0]
    change = equations.miss(headings(v + 0.5 * step)) - equations.miss(headings(v - 0.5 * step))
    assert change[0] == pytest.approx(-rows @ step[0], abs=1e-11)


@pytest.mark.parametrize(("seed", "polygons"), [(4, 20), (5, 40), (6, 80)])
def test_drawn_poses_are_at_the_goal_and_cross_nothing(seed: int, polygons: int) -> None:
    """They meet the goal, are cheaper than asked for, come the cheapest first, and keep their axes out of the walls."""
    scene = clutter(90_500 + seed, polygons)
    draws = draws_in(scene)
    drawn = draws.about(draws.cheapest_below(6.0), 6.0)
    points = scene.arm.joint_positions(drawn)
    assert np.abs(points[:, -1] - scene.goal_tip.position).max(initial=0.0) < 1e-3
    assert np.abs(np.exp(1j * drawn[:, -1]) - np.exp(1j * scene.goal[-1])).max(initial=0.0) < 1e-3
    travel = np.sum(np.diff(drawn - scene.start, axis=1, prepend=0.0) ** 2, axis=1)
    assert np.all(0.5 * travel < 6.0)
    if len(drawn):
        assert wall_gaps(scene.arm, scene.workspace, points).min() > -0.7 * scene.arm.radius - 1e-9
        assert np.all(shapely.is_simple(shapely.linestrings(points)))


def test_the_cheapest_pose_without_walls_is_not_beaten() -> None:
    """No pose that is drawn is cheaper than the cheapest of its whole turns."""
    scene = clutter(90_510, 20)
    draws = draws_in(scene)
    cheapest = draws.cheapest_below(20.0)
    least = min(pose.cost for pose in cheapest)
    drawn = draws.about(cheapest, least + 5.0)
    assert len(drawn) > 0
    space = draws.energy.space
    fitted = (drawn - scene.arm.headings(space.offset)) @ np.linalg.pinv(space.turns).T
    assert draws.energy.cost(fitted).min() > least - 1e-3


@given(SEEDS)
def test_windings_are_those_of_a_polygon(seed: int) -> None:
    """A simple loop goes once round the points inside it and not at all round those outside."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, WHOLE_TURN, 8))
    corners = rng.uniform(0.3, 1.0, 8)[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    polygon = shapely.Polygon(corners)
    points = rng.uniform(-1.0, 1.0, (40, 2))
    if polygon.is_valid:
        inside = shapely.contains_xy(polygon, points)
        assert np.array_equal(np.abs(windings(np.vstack((corners, corners[:1])), points)), inside)


def test_classes_are_told_apart_by_obstacles_and_whole_turns() -> None:
    """Two elbows are of one class in the open, of two with an obstacle between them, as are poses a turn apart."""
    arm = make_arm(12)
    bends = np.full(12, -0.15)
    left = np.cumsum(bends) + 1.0
    tip = arm.joint_positions(left)[-1]
    across = 2.0 * np.arctan2(tip[1], tip[0])
    right = across - left
    right = right + WHOLE_TURN * np.round((left[-1] - right[-1]) / WHOLE_TURN)
    middle = 0.5 * (arm.joint_positions(left)[6] + arm.joint_positions(right)[6])
    walled = Workspace(ROOM, (Obstacle("post", PlaneShape(shapely.Point(middle), 0.01)),))
    post = landmarks(walled)
    assert same_class(arm, landmarks(Workspace(ROOM)), left, right)
    assert not same_class(arm, post, left, right)
    assert same_class(arm, post, left, left)
    assert not same_class(arm, post, left, left + WHOLE_TURN)


@pytest.mark.parametrize(("seed", "polygons"), [(1, 20), (1, 80), (2, 80)])
def test_candidates_are_feasible_and_of_different_classes(seed: int, polygons: int) -> None:
    """They come the best first, at most one a class, none worse than what the NLP makes of the pose given."""
    scene = clutter(91_300 + seed, polygons)
    search = searched(scene)
    own = search.best(scene.goal)
    candidates = search.candidates(scene.goal)
    poses = [candidate.pose for candidate in candidates]
    costs = [pose.answer.cost for pose in poses]
    assert own is not None
    assert costs == sorted(costs)
    assert costs[0] <= own.answer.cost * (1.0 + 1e-6)
    assert all(search.feasible(pose) for pose in poses)
    assert sum(candidate.same_class for candidate in candidates) <= 1
    workspace = search.problem.workspace
    for index, pose in enumerate(poses):
        for other in poses[:index]:
            assert not same_class(scene.arm, landmarks(workspace), pose.headings, other.headings)


def test_a_pose_in_a_bad_class_is_improved_upon() -> None:
    """From a pose that has gone once more round the base than it need, candidates find the way without that turn."""
    scene = clutter(90_520, 10)
    search = searched(scene)
    direct = search.best(scene.goal)
    wound = search.candidates(scene.goal + WHOLE_TURN)
    assert direct is not None
    best = wound[0].pose
    assert best.answer.cost - best.answer.costs["distance"] < 1.1 * direct.answer.cost
    assert not wound[0].same_class


def test_nothing_is_drawn_when_it_is_not_asked_for() -> None:
    """With no drawn solutions only what becomes of the pose given is left."""
    scene = clutter(90_521, 20)
    search = replace(searched(scene), draw_settings=PoseDrawSettings(drawn_solutions=0))
    assert [candidate.same_class for candidate in search.candidates(scene.goal)] in ([True], [False])
