"""Arms of no width: routes, margins, crossings and whole-arm goals, on the chains of OMPL at 12 links."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import UnreachableGoal
from ccm_opt.planning.passage_widths import passage_widths
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.tip_paths import find_tip_paths, with_base_turn
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape
from tests.crossings import CrossingCheck, densely
from tests.ompl_scenes import LARGEST_CORRIDOR, SCENES, corridor, horn

needs_compiler = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")

SLOW_MACHINE = 900.0
"""Wall time for what is planned in seconds [s]: no test may fail because a machine is slow, or busy."""


def crosses(problem: Problem, bends: FloatArray) -> bool:
    """Oracle: whether the arm's axis meets a wall or itself, by shapely; the first link may touch where it stands."""
    arm = problem.arm
    axis = shapely.LineString(arm.joint_positions(arm.headings(bends)))
    walls = shapely.union_all([wall.core for wall in problem.workspace.obstacles])
    return not axis.is_simple or bool(axis.intersects(walls))


@pytest.mark.parametrize("scene", list(SCENES))
def test_chain_is_planned_without_crossing(scene: str) -> None:
    """A plan starts at the start, ends at the goal, and crosses nothing at any of 2000 poses, by shapely."""
    problem = SCENES[scene](12)
    problem = replace(problem, planner=replace(problem.planner, optimiser="none", time_limit=SLOW_MACHINE))
    path = MotionPlanner().plan(problem)
    poses = path.spline(np.linspace(0.0, 1.0, 2001))
    assert isinstance(problem.start, JointPose)
    np.testing.assert_allclose(poses[0], problem.start.bends, atol=1e-9)
    assert not any(crosses(problem, pose) for pose in poses)
    if isinstance(problem.goal, TipGoal):
        tip = problem.arm.joint_positions(problem.arm.headings(poses[-1]))[-1]
        assert np.hypot(*(tip - problem.goal.position)) < 1e-6
    else:
        assert isinstance(problem.goal, JointPose)
        np.testing.assert_allclose(poses[-1], problem.goal.bends, atol=1e-9)


@pytest.mark.parametrize("scene", list(SCENES))
@pytest.mark.parametrize("links", [12, 24, 96])
def test_starts_are_free(scene: str, links: int) -> None:
    """The scenes' starts cross nothing, and the wall beside the horn's arm stands ln(n)/n from its base."""
    problem = SCENES[scene](links)
    assert isinstance(problem.start, JointPose)
    assert not crosses(problem, problem.start.bends)
    if scene == "horn":
        distance = shapely.distance(problem.workspace.obstacles[0].core, shapely.Point(1.0 / links, 0.0))
        assert distance == pytest.approx(np.log(links) / links, rel=0.1)


def test_corridor_goal_is_in_the_shaft_as_long_as_possible() -> None:
    """The goal lies between the blocks up to the largest corridor; beyond, the scene is refused."""
    problem = corridor(LARGEST_CORRIDOR)
    assert isinstance(problem.goal, TipGoal)
    left = shapely.Polygon(problem.workspace.obstacles[0].core.coords)
    assert not left.contains(shapely.Point(problem.goal.position))
    with pytest.raises(ValueError, match="inside a wall"):
        corridor(LARGEST_CORRIDOR + 2)


def test_axis_on_a_wall_counts_as_contact() -> None:
    """An arm of no width whose axis lies on a wall is refused, for axes may touch nothing."""
    problem = horn(12)
    assert isinstance(problem.start, JointPose)
    points = problem.arm.joint_positions(problem.arm.headings(problem.start.bends))
    touching = Obstacle("needle", PlaneShape(shapely.LineString([points[6], points[6] + [0.0, 0.1]])))
    workspace = replace(problem.workspace, obstacles=(*problem.workspace.obstacles, touching))
    with pytest.raises(UnreachableGoal, match="needle"):
        MotionPlanner().plan(replace(problem, workspace=workspace))


def test_certificate_sees_the_jump_through_a_sheet() -> None:
    """The straight motion from start to goal crosses sheets of no thickness; bisection finds out, however thin."""
    problem = horn(12)
    assert isinstance(problem.start, JointPose)
    assert isinstance(problem.goal, JointPose)
    ends = np.stack([pose.bends for pose in (problem.start, problem.goal)])
    assert len(Certificate(problem.arm, problem.workspace).failures(ends)) == 1


def test_only_tip_paths_that_turn_the_base_as_the_goal_does_remain() -> None:
    """Of both sides of a whole-arm goal the one is kept that turns the first link by the goal's own angle."""
    problem = horn(12)
    arm = problem.arm
    assert isinstance(problem.start, JointPose)
    assert isinstance(problem.goal, JointPose)
    points, route = (arm.joint_positions(arm.headings(pose.bends)) for pose in (problem.start, problem.goal))
    paths = find_tip_paths(FreeSpace(problem.workspace, 1e-3), points, (route,), 0.016)
    assert {path.side for path in paths} == {1, -1}
    assert [path.side for path in with_base_turn(paths, np.pi - 1e-3)] == [1]
    assert [path.side for path in with_base_turn(paths, -np.pi - 1e-3)] == [-1]
    assert with_base_turn(paths, 20.0) == paths


@given(st.floats(0.05, 0.4), st.floats(-0.8, 0.8), st.floats(-np.pi, np.pi))
@settings(max_examples=30, deadline=None)
def test_width_of_a_channel(width: float, place: float, turn: float) -> None:
    """Between two parallel sheets the passage is as wide as they are apart, wherever the path runs."""
    problem = corridor(12)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sheets = tuple(
        Obstacle(f"{y}", PlaneShape(shapely.LineString(np.array([[-3.0, y], [3.0, y]]) @ rotation.T)))
        for y in (-0.5 * width, 0.5 * width)
    )
    workspace = replace(problem.workspace, boundary=shapely.box(-5.0, -5.0, 5.0, 5.0), obstacles=sheets)
    y = 0.5 * width * place
    path = np.array([[-1.0, y], [0.2, y], [1.0, y]]) @ rotation.T
    np.testing.assert_allclose(passage_widths(workspace.flat_walls, path, 1.0), width, rtol=1e-9)


@needs_compiler
@given(st.integers(0, 10**6), st.sampled_from(list(SCENES)), st.floats(0.02, 1.0))
@settings(max_examples=60, deadline=None)
def test_compiled_check_agrees_with_shapely(seed: int, scene: str, spread: float) -> None:
    """The compiled crossing check of the comparison and shapely call the same poses free, inside the room."""
    problem = SCENES[scene](12)
    assert isinstance(problem.start, JointPose)
    rng = np.random.default_rng(seed)
    bends = problem.start.bends + spread * rng.standard_normal(12)
    points = problem.arm.joint_positions(problem.arm.headings(bends))[1:]
    outside = not shapely.contains_xy(problem.workspace.boundary, points[:, 0], points[:, 1]).all()
    assert CrossingCheck(problem)(bends) == (not outside and not crosses(problem, bends))


def test_dense_samples_turn_no_joint_by_more_than_the_step() -> None:
    """Dense samples keep the vertices of a polyline and step from one to the next by at most the step."""
    bends = np.array([[0.0, 0.0], [0.3, -0.1], [0.3, 0.05]])
    dense = densely(bends, 0.01)
    assert np.abs(np.diff(dense, axis=0)).max() <= 0.01 + 1e-12
    assert all(np.any(np.all(np.isclose(dense, vertex, atol=1e-12), axis=1)) for vertex in bends)
