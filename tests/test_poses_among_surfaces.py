"""The goal-pose NLP in space: its curve is a curve, its links follow it, and poses have room by distances of others."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik.bishop_shooting import link_quaternions
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_settings import DEFAULT_POSES
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.space_links import axis, product, quaternions_of, turned_by
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.bodies import BoxBody, SphereBody
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.arms import held_bends
from tests.space_arms import random_rotation, space_arm
from tests.space_clutter import Clutter, clutter, problem_at

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", params=[0, 2])
def solved(request: pytest.FixtureRequest) -> tuple[Clutter, ArmPose]:
    """A scene in which a pose has little room, and what the NLP makes of it."""
    scene = clutter(request.param, 16)
    found = GoalPoses(scene.problem, scene.tree).best(scene.seed)
    assert found is not None
    return scene, found


def numbers_of(expression: ca.SX) -> FloatArray:
    """An expression without symbols as numbers."""
    return np.asarray(ca.evalf(expression), dtype=np.float64).ravel()


def least_gap(scene: Clutter, q: FloatArray) -> float:
    """Gap of a pose to balls and boxes by samples of its links, each to the surfaces in closed form."""
    points = scene.problem.arm.joint_positions_at(q)
    shares = np.linspace(0.0, 1.0, 41)[:, None, None]
    places = (points[:-1] + shares * np.diff(points, axis=0)).reshape(-1, 3)
    gaps = []
    for obstacle in scene.problem.workspace.obstacles:
        body = obstacle.body
        if isinstance(body, SphereBody):
            gaps.append(np.linalg.norm(places - body.center, axis=1).min() - body.radius)
        elif isinstance(body, BoxBody):
            outside = np.maximum(np.maximum(body.low - places, places - body.high), 0.0)
            gaps.append(np.linalg.norm(outside, axis=1).min())
    return float(min(gaps)) - scene.problem.arm.radius - scene.problem.workspace.clearance


def test_a_found_pose_is_at_its_goal_within_limits_and_has_more_room(solved: tuple[Clutter, ArmPose]) -> None:
    """Tip and direction to rounding, every bend within its limit, and a gap that samples confirm."""
    scene, found = solved
    arm = scene.problem.arm
    goal = scene.problem.goal
    assert isinstance(goal, TipGoal)
    assert goal.direction is not None
    np.testing.assert_allclose(arm.joint_positions_at(found.q)[-1], goal.position, atol=1e-8)
    np.testing.assert_allclose(arm.link_rotations(found.q)[-1, :, 0], goal.direction, atol=1e-7)
    assert np.all(np.abs(found.q) <= arm.upper_limits)
    before = least_gap(scene, scene.seed)
    after = least_gap(scene, found.q)
    assert after >= min(found.gap, before) - 1e-6
    assert after > before
    assert found.answer.cost == pytest.approx(sum(found.answer.costs.values()))


def test_links_point_as_the_curve_does_over_their_length(solved: tuple[Clutter, ArmPose]) -> None:
    """The curve of the answer, integrated by itself, has the links' directions in the mean, to the order of mapping."""
    scene, found = solved
    arm = scene.problem.arm
    curve = found.curve
    assert curve.length == pytest.approx(arm.length, rel=1e-9)
    arc = np.linspace(0.0, curve.length, arm.links + 1)
    chords = np.diff(curve.positions_at(arc), axis=0)
    along = chords / np.linalg.norm(chords, axis=1, keepdims=True)
    links = arm.link_rotations(found.q)[..., 0]
    sharpest = float(np.linalg.norm(curve.curvature_at(np.linspace(0.0, curve.length, 300)), axis=1).max())
    turn = sharpest * arm.link_length
    assert np.max(np.arccos(np.clip(np.sum(links * along, axis=1), -1.0, 1.0))) < 0.1 * turn


def test_a_turned_scene_gives_the_turned_pose() -> None:
    """A turn of everything about the base turns the pose: the same bends, found with other numbers."""
    scene = clutter(5, 12)
    turn = random_rotation(np.random.default_rng(5))
    arm = scene.problem.arm
    turned_arm = replace(arm, base=turn @ arm.base, direction=turn @ arm.direction, up=turn @ arm.up)
    balls = tuple(
        Obstacle(each.name, SphereBody(turn @ each.body.center, each.body.radius))
        for each in scene.problem.workspace.obstacles
        if isinstance(each.body, SphereBody)
    )
    plain = tuple(each for each in scene.problem.workspace.obstacles if isinstance(each.body, SphereBody))
    answers = []
    for one, obstacles in ((arm, plain), (turned_arm, balls)):
        workspace = Workspace(bounds=None, obstacles=obstacles, clearance=0.002)
        problem = problem_at(one, workspace, scene.seed)
        answers.append(GoalPoses(problem, SurfaceTree.from_triangles(workspace.triangle_soup)).best(scene.seed))
    first, second = answers
    assert first is not None
    assert second is not None
    assert second.answer.cost == pytest.approx(first.answer.cost, rel=1e-3)
    np.testing.assert_allclose(second.q, first.q, atol=1e-2)


def test_a_pose_in_a_plane_stays_in_it() -> None:
    """Where start, goal and obstacle lie in the plane of the first bends, the second bends stay zero."""
    arm = space_arm(12, 1.0 / 12.0, 0.01)
    q = np.zeros(24)
    q[0::2] = 0.1
    middle = arm.joint_positions_at(q)[6]
    ball = SphereBody(middle + np.array([-0.05, 0.05, 0.0]), 0.05)
    workspace = Workspace(bounds=None, obstacles=(Obstacle("ball", ball),))
    found = GoalPoses(problem_at(arm, workspace, q), SurfaceTree.from_triangles(workspace.triangle_soup)).best(q)
    assert found is not None
    np.testing.assert_allclose(found.q[1::2], 0.0, atol=1e-6)
    assert np.ptp(found.q[0::2]) > 0.01


def test_joints_in_the_guide_tube_stay_straight() -> None:
    """With a feed the held joints have no bend, the base keeps them in the tube, and the others make the room."""
    arm = space_arm(12, 1.0 / 12.0, 0.01, feed=Feed(0.0, 0.5, 0.5), base_limit=0.8)
    q = np.zeros(25)
    q[24] = 0.27  # the joints of the first three links are in the tube
    q[6:24:2] = 0.08
    beside = arm.joint_positions_at(q)[8] + np.array([0.0, -0.033, 0.0])
    workspace = Workspace(bounds=None, obstacles=(Obstacle("ball", SphereBody(beside, 0.02)),))
    tree = SurfaceTree.from_triangles(workspace.triangle_soup)
    problem = problem_at(arm, workspace, q)
    found = GoalPoses(problem, tree).best(q)
    assert found is not None
    held = held_bends(arm, float(found.q[24]))
    assert held.any()
    np.testing.assert_array_equal(found.q[:24][held], 0.0)
    poses = GoalPoses(problem, tree)
    assert poses.gap(found.q) > poses.gap(q)


def test_links_keep_apart_where_the_arm_comes_back_to_itself() -> None:
    """A coil whose turns nearly touch gets room between them."""
    arm = space_arm(24, 1.0 / 24.0, 0.012, joint_limit=1.0)
    workspace = Workspace(bounds=None)
    tree = SurfaceTree.from_triangles(workspace.triangle_soup)
    for turning in np.linspace(0.0, 0.3, 601):
        azimuth = turning * np.arange(24)
        q = 2.0 * np.pi / 14.0 * np.column_stack((np.cos(azimuth), -np.sin(azimuth))).ravel()
        poses = GoalPoses(problem_at(arm, workspace, q), tree)
        before = poses.gap(q)
        if before > 0.0005:
            break
    assert 0.0 < before < 0.006
    sides = poses.regions(q, poses.settings)
    assert sides.most > 0
    found = poses.best(q)
    assert found is not None
    assert poses.gap(found.q) >= min(before, poses.wanted_gap) - 1e-6


def test_drives_can_hold_the_pose_that_is_found() -> None:
    """With torque limits that the first pose breaks, the answer keeps nine tenths of them at every joint."""
    scene = clutter(2, 10)
    arm = scene.problem.arm
    gravity = scene.problem.simulation.gravity

    def bears(q: FloatArray) -> FloatArray:
        def energy(bends: FloatArray) -> float:
            points = arm.joint_positions_at(bends)
            return float(-(arm.masses @ (0.5 * (points[1:] + points[:-1]) @ gravity)))

        return np.array([(energy(q + step) - energy(q - step)) / 2e-6 for step in 1e-6 * np.eye(len(q))])

    free = GoalPoses(scene.problem, scene.tree).best(scene.seed)
    assert free is not None
    worst = float(np.abs(bears(free.q)).max())
    limited = replace(scene.problem, limits=replace(scene.problem.limits, torque=np.full(30, 1.08 * worst)))
    held = GoalPoses(limited, scene.tree).best(scene.seed)
    assert held is not None
    assert np.abs(bears(held.q)).max() <= 0.9 * 1.08 * worst * (1.0 + 1e-6)
    assert held.answer.costs["torque"] > 0.0


@pytest.mark.drawn(20, of="dear tests")
def test_a_goal_out_of_reach_is_no_pose_and_says_which_row_fails() -> None:
    """Nothing is called feasible that is not, and the answer names what is broken."""
    scene = clutter(0, 8)
    goal = scene.problem.goal
    far = replace(scene.problem, goal=replace(goal, position=np.array([3.0, 0.0, 0.0])))  # type: ignore[type-var]
    poses = GoalPoses(far, scene.tree)
    (found,) = poses.improved(scene.seed)
    assert not poses.feasible(found)
    assert found.answer.broken
    assert found.answer.worst_row in found.answer.broken
    assert GoalPoses(far, scene.tree).best(scene.seed) is None


def test_a_goal_that_is_a_pose_leaves_nothing_to_find() -> None:
    """It is refused by what it is."""
    scene = clutter(0, 8)
    whole = replace(scene.problem, goal=JointPose.from_configuration(scene.seed, scene.problem.arm.coordinates))
    with pytest.raises(ProblemError, match="whole arm"):
        GoalPoses(whole, scene.tree).best(scene.seed)


def test_settings_widen_the_regions() -> None:
    """The second attempt looks farther and at more."""
    first, second, _ = DEFAULT_POSES.widening
    assert second.reach > first.reach
    assert second.most_sides > first.most_sides


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_quaternions_are_scipys(seed: int) -> None:
    """Products, axes, rotation vectors and chains of links agree with scipy's rotations and the arm's kinematics."""
    random = np.random.default_rng(seed)
    first, second = random.normal(size=(2, 3))
    numbers = quaternions_of(np.stack((first, second)))
    for vector, found in zip((first, second), numbers, strict=True):
        np.testing.assert_allclose(numbers_of(turned_by(ca.SX(ca.DM(vector)))), found, atol=1e-12)
    both = Rotation.from_rotvec(first) * Rotation.from_rotvec(second)
    symbolic = product(ca.SX(ca.DM(numbers[0])), ca.SX(ca.DM(numbers[1])))
    columns = [numbers_of(axis(symbolic, k)) for k in range(3)]
    np.testing.assert_allclose(np.column_stack(columns), both.as_matrix(), atol=1e-12)

    arm = space_arm(5)
    bends = random.uniform(-0.8, 0.8, (5, 2))
    turned = Rotation.from_quat(link_quaternions(bends), scalar_first=True).as_matrix()
    np.testing.assert_allclose(turned, arm.link_rotations(bends.ravel()), atol=1e-12)
